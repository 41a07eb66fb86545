//! Saturating Q32.32 numbers, and the functions of the normal distribution.

use fixed::types::I32F32;
use servo_core::units::Micros;

/// A saturating number with 32 fractional bits: ±2^31 in steps of 2.3·10^-10.
pub type Real = fixed::Saturating<I32F32>;

/// 0.
pub const ZERO: Real = fixed::Saturating(I32F32::ZERO);
/// 1.
pub const ONE: Real = fixed::Saturating(I32F32::ONE);
/// 1/2.
pub const HALF: Real = real!("0.5");

/// Coefficients of 2^−g, from the fifth power to the second.
const SERIES: [Real; 4] =
    [real!("-0.0013333558"), real!("0.0096181291"), real!("-0.0555041087"), real!("0.2402265070")];
/// log2 e, ln 2, √½, and 1/√2π, the density at 0.
const LOG2_E: Real = real!("1.4426950409");
const LN_2: Real = real!("0.6931471806");
const ROOT_HALF: Real = real!("0.7071067812");
const DENSITY_0: Real = real!("0.3989422804");
/// p of the distribution's t = 1/(1 + p·z).
const SLOPE: Real = real!("0.2316419");
/// Coefficients of the distribution, from the fifth power to the first.
const TERMS: [Real; 5] = [
    real!("1.330274429"),
    real!("-1.821255978"),
    real!("1.781477937"),
    real!("-0.356563782"),
    real!("0.319381530"),
];

/// `n / d`, saturated; the largest number if `d` is 0.
pub fn ratio(n: Real, d: Real) -> Real {
    if d.0 == I32F32::ZERO { fixed::Saturating(I32F32::MAX) } else { n / d }
}

/// √x within 2^-31 of itself; 0 for a negative number.
pub fn root(x: Real) -> Real {
    let bits = u64::try_from(x.0.to_bits()).unwrap_or(0);
    let shift = bits.leading_zeros() & 62;
    let root = (bits << shift).isqrt();
    fixed::Saturating(I32F32::from_bits((root.cast_signed() << 16) >> (shift / 2)))
}

/// The larger of two numbers.
pub fn larger(a: Real, b: Real) -> Real {
    fixed::Saturating(a.0.max(b.0))
}

/// `x`, or the nearer of two bounds.
pub fn within(x: Real, low: Real, high: Real) -> Real {
    fixed::Saturating(x.0.max(low.0).min(high.0))
}

/// A whole number.
pub fn whole(x: i32) -> Real {
    fixed::Saturating(I32F32::from_num(x))
}

/// A time in seconds; times beyond 35 minutes are taken as that.
pub fn seconds(time: Micros) -> Real {
    let us = i64::from(time.0.min((1 << 31) - 1));
    // Rounded up, so that no time but 0 is 0 and a second is exact.
    fixed::Saturating(I32F32::from_bits((us * (1 << 32) + 999_999) / 1_000_000))
}

/// e^−x for x ≥ 0, within 2·10^-6: 2^−k · 2^−½ · 2^−g with |g| ≤ ½, and the series of 2^−g to the fifth power.
pub fn exp_neg(x: Real) -> Real {
    let binary = x * LOG2_E;
    let k: u32 = binary.0.to_num::<i32>().try_into().unwrap_or(0);
    if k >= 32 {
        return ZERO;
    }
    let g = fixed::Saturating(binary.0.frac()) - HALF;
    let tail = SERIES.into_iter().fold(ZERO, |sum, term| sum * g + term);
    let power = (tail * g - LN_2) * g + ONE;
    fixed::Saturating((power * ROOT_HALF).0 >> k)
}

/// Density of the normal distribution, φ(z).
pub(crate) fn density(z: Real) -> Real {
    exp_neg(z * z * HALF) * DENSITY_0
}

/// Φ(z), the normal distribution, from φ = φ(z): the rational approximation of Abramowitz and Stegun 26.2.17, within 10^-6.
pub fn distribution(z: Real, density: Real) -> Real {
    let t = ratio(ONE, ONE + SLOPE * fixed::Saturating(z.0.abs()));
    let upper = density * TERMS.into_iter().fold(ZERO, |sum, term| (sum + term) * t);
    if z.0 < I32F32::ZERO { upper } else { ONE - upper }
}

/// Probability of −`below` < z < `above`, and the mean of z if that holds. Beyond five standard deviations on the wrong
/// side, the probability is at least 2^-30 and the mean is that of the tail: b − 1/|b| at the bound b.
pub fn truncated(below: Real, above: Real) -> (Real, Real) {
    const FAR: Real = real!("5");
    const LEAST: Real = real!("0.000000001");
    for (bound, sign) in [(above, ONE), (below, -ONE)] {
        if bound.0 < -FAR.0 {
            return (LEAST, sign * (bound + ratio(ONE, bound)));
        }
    }
    let (mut probability, mut moment) = (ONE, ZERO);
    for (bound, sign) in [(above, ONE), (below, -ONE)] {
        if bound.0 < FAR.0 {
            let density = density(bound);
            probability -= ONE - distribution(bound, density);
            moment -= sign * density;
        }
    }
    let probability = larger(probability, LEAST);
    (probability, ratio(moment, probability))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(found: Real, want: &str, tolerance: &str) {
        let (want, tolerance) = (I32F32::from_str(want).unwrap(), I32F32::from_str(tolerance).unwrap());
        assert!((found.0 - want).abs() <= tolerance, "{found}, not {want}");
    }

    #[test]
    fn exponential_and_distribution_are_within_their_bounds() {
        let tables = [
            ("0", "1", "0.3989423", "0.5"),
            ("0.125", "0.8824969", "0.3958376", "0.5497382"),
            ("1", "0.3678794", "0.2419707", "0.8413447"),
            ("2", "0.1353353", "0.0539910", "0.9772499"),
            ("4.5", "0.0111090", "0.0000160", "0.9999966"),
        ];
        for (z, exp, density_of, below) in tables {
            let z = fixed::Saturating(I32F32::from_str(z).unwrap());
            near(exp_neg(z), exp, "0.000002");
            near(density(z), density_of, "0.000002");
            near(distribution(z, density(z)), below, "0.000002");
            near(ONE - distribution(-z, density(z)), below, "0.000002");
        }
        assert_eq!(exp_neg(real!("23")), ZERO);
    }

    #[test]
    fn truncated_mean_is_that_of_the_interval() {
        let (all, none) = truncated(real!("9"), real!("9"));
        assert_eq!((all, none), (ONE, ZERO));
        // Half of the distribution: mean −√(2/π).
        let (half, mean) = truncated(real!("9"), ZERO);
        near(half, "0.5", "0.000002");
        near(mean, "-0.7978846", "0.00001");
        let (half, mean) = truncated(ZERO, real!("9"));
        near(half, "0.5", "0.000002");
        near(mean, "0.7978846", "0.00001");
        // A short interval is evenly filled.
        near(truncated(real!("0.1"), real!("0.1")).1, "0", "0.0001");
        // The tail at −6: mean −6.1584.
        near(truncated(real!("20"), real!("-6")).1, "-6.1584", "0.01");
        near(truncated(real!("-6"), real!("20")).1, "6.1584", "0.01");
    }

    #[test]
    fn quotients_by_zero_and_roots_of_negatives_have_values() {
        assert_eq!(ratio(ONE, ZERO).0, I32F32::MAX);
        assert_eq!(ratio(-ONE, ZERO).0, I32F32::MAX);
        assert_eq!((root(-ONE), root(real!("9"))), (ZERO, real!("3")));
        assert_eq!((seconds(Micros(1_000_000)), seconds(Micros(0))), (ONE, ZERO));
        assert_eq!((larger(ONE, HALF), within(ONE, ZERO, HALF), within(-ONE, ZERO, HALF)), (ONE, HALF, ZERO));
    }
}
