//! The Q-formats of the control laws and the operations that `fixed` lacks.
//!
//! On a Cortex-M3 a 32-bit format multiplies in one `SMULL`, a 64-bit format in a library call. The loops therefore use
//! [`Law`]; what needs more digits or a wider range has a 32-bit format of its own, and [`times`] multiplies any two.

use fixed::FixedI32;
use fixed::types::I16F16;
use fixed::types::extra::Unsigned;

/// Number of a control law: errors, velocities, gains, torques.
pub type Law = I16F16;

/// Control ticks a second (decision 0004).
pub const TICK_HZ: u32 = 1000;

/// A gain from its property, `raw / 2^fraction_bits` with `fraction_bits` ≤ 16; saturates below 32,768.
#[must_use]
pub const fn gain(raw: u16, fraction_bits: u32) -> Law {
    Law::from_bits((raw as i32).saturating_mul(1 << (16 - fraction_bits)))
}

/// `v² / d`, within 2^-15 of it and rounded up where not exact; saturates at 2^32 − 1. `d` is not 0.
#[must_use]
pub const fn ratio_of_square(v: u32, d: u64) -> u32 {
    let square = v as u64 * v as u64;
    if square == 0 {
        return 0;
    }
    let (zeros, divisor_zeros) = (square.leading_zeros(), (d + (d == 0) as u64).leading_zeros());
    let divisor = (((d + (d == 0) as u64) << divisor_zeros) >> 48) as u32;
    // Its highest bit is set, which a compiler that saves bytes does not see.
    let divisor = if divisor == 0 { 1 } else { divisor };
    // 2^32 by 2^16.
    let quotient = ((square << zeros) >> 32) as u32 / divisor;
    // 32 bits of `square` above 2^(32 − zeros), 16 bits of `d` above 2^(48 − zeros).
    let shift = divisor_zeros as i32 - zeros as i32 - 16;
    if shift < 0 {
        let down = (-shift) as u32;
        if down > 31 { 0 } else { quotient >> down }
    } else if shift > 14 {
        u32::MAX
    } else {
        quotient << shift
    }
}

/// The low word of a number that the caller knows to fit, or that is to wrap.
#[must_use]
pub const fn low_word(x: i64) -> i32 {
    x as i32
}

/// Half octaves of a time above 1 ms in µs, to the nearest; 0 below. `us` < 2^29.
#[must_use]
pub const fn half_octaves(us: u32) -> usize {
    // Times 2^(1/4) and rounded down is to the nearest.
    let us = us + us / 8 + us / 16;
    let zeros = (us | 1).leading_zeros();
    let half = (us << zeros) >= 0xB504_F334;
    let octaves = 2 * (31 - zeros) + half as u32;
    octaves.saturating_sub(20) as usize
}

/// `a · b / 2^shift`, rounded down and saturated to 32 bits. `shift` < 64.
#[must_use]
pub const fn mul_shift(a: i32, b: i32, shift: u32) -> i32 {
    saturating_i32((a as i64 * b as i64) >> shift)
}

const fn saturating_i32(x: i64) -> i32 {
    let low = x as i32;
    if low as i64 == x {
        low
    } else if x < 0 {
        i32::MIN
    } else {
        i32::MAX
    }
}

/// The product of two control-law numbers, saturated and rounded down. `fixed` multiplies in 128 bits to saturate: 28
/// instructions on the Cortex-M3, where this takes 6.
#[must_use]
pub const fn product(a: Law, b: Law) -> Law {
    Law::from_bits(mul_shift(a.to_bits(), b.to_bits(), 16))
}

/// `a · b / 2^shift`, rounded down; the caller guarantees that it fits. `shift` < 64.
#[must_use]
pub const fn mul_low(a: i32, b: i32, shift: u32) -> i32 {
    ((a as i64 * b as i64) >> shift) as i32
}

/// `a · b` in the format of the result, rounded down; the caller guarantees that it fits. `fixed` multiplies within one format; this is one
/// `SMULL` and a shift, for any.
#[must_use]
pub const fn times<A: Unsigned, B: Unsigned, C: Unsigned>(a: FixedI32<A>, b: FixedI32<B>) -> FixedI32<C> {
    FixedI32::from_bits(mul_low(a.to_bits(), b.to_bits(), A::U32 + B::U32 - C::U32))
}

/// [`times`], saturated.
#[must_use]
pub const fn times_saturated<A: Unsigned, B: Unsigned, C: Unsigned>(
    a: FixedI32<A>,
    b: FixedI32<B>,
) -> FixedI32<C> {
    FixedI32::from_bits(mul_shift(a.to_bits(), b.to_bits(), A::U32 + B::U32 - C::U32))
}

/// [`mul_low`] of unsigned numbers.
#[must_use]
pub const fn mul_low_unsigned(a: u32, b: u32, shift: u32) -> u32 {
    ((a as u64 * b as u64) >> shift) as u32
}

/// The product of two control-law numbers, rounded down and clamped as by `clamp_q13`.
#[must_use]
pub fn mul_clamped(a: Law, b: Law) -> Law {
    clamp_q13(a.to_bits() as i64 * b.to_bits() as i64)
}

/// `a · b + c · d`, rounded down once and clamped as by `clamp_q13`. `a` and `c` are not negative, so the sum is below 2^63.
#[must_use]
pub fn sum_of_products((a, b): (Law, Law), (c, d): (Law, Law)) -> Law {
    let (ab, cd) = (a.to_bits() as i64 * b.to_bits() as i64, c.to_bits() as i64 * d.to_bits() as i64);
    clamp_q13(ab + cd)
}

/// A product of two control-law numbers as one: exact within ±8192, clamped to at least 8191 beyond. That exceeds every torque
/// and leaves room to add. Clamping the upper word alone is one `SSAT`; saturating takes eight instructions.
fn clamp_q13(product: i64) -> Law {
    let high = ((product >> 32) as i32).clamp(-(1 << 13), (1 << 13) - 1);
    Law::from_bits((high << 16) | (product as u32 >> 16) as i32)
}

/// `a · b` as the nearest whole number, halves up; within ±2^30.
#[must_use]
pub const fn round_product(a: Law, b: Law) -> i32 {
    ((a.to_bits() as i64 * b.to_bits() as i64 + (1 << 31)) >> 32) as i32
}

/// `n / d` to the nearest, halves up; 2^32 − 1 beyond, and for `d` 0. `n + d / 2` fits 64 bits.
///
/// A Cortex-M3 divides 32 bits; the library's division of 64 has 900 bytes, this loop 60.
#[inline(never)]
#[must_use]
pub fn half_up(n: u64, d: u64) -> u32 {
    let mut rest = n + d / 2;
    if d <= rest >> 32 {
        return u32::MAX;
    }
    let mut quotient = 0;
    for bit in (0..32).rev() {
        if d <= rest >> bit {
            rest -= d << bit;
            quotient |= 1 << bit;
        }
    }
    quotient
}

/// The same in a constant, where a division costs nothing. `d` is not 0.
#[must_use]
pub const fn nearest(n: u64, d: u64) -> u32 {
    ((n + d / 2) / d) as u32
}

/// 64 bits of 32, in a constant.
#[must_use]
pub const fn wide(x: u32) -> u64 {
    x as u64
}

/// The square root of `x`, rounded down, at least `least` and at most `most`. A turn for each step between them: smaller than a faster one.
#[must_use]
pub fn root_within(x: u32, least: u32, most: u32) -> u32 {
    (least + 1..=most).take_while(|root| root * root <= x).last().unwrap_or(least)
}

/// An unsigned number as a signed one, saturated at 2^31 − 1.
#[must_use]
pub const fn saturating_signed(x: u32) -> i32 {
    if x > i32::MAX as u32 { i32::MAX } else { x as i32 }
}

/// An unsigned number saturated to 16 bits.
#[must_use]
pub const fn saturating_u16(x: u32) -> u16 {
    if x > u16::MAX as u32 { u16::MAX } else { x as u16 }
}

/// A signed number saturated to 16 bits.
#[must_use]
pub const fn saturating_i16(x: i32) -> i16 {
    if x > i16::MAX as i32 {
        i16::MAX
    } else if x < i16::MIN as i32 {
        i16::MIN
    } else {
        x as i16
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn products_and_sums_round_once_and_clamp(
            a in 0..=i32::MAX, b: i32, c in 0..=i32::MAX, d: i32, shift in (0..32_u32, 0..32_u32),
        ) {
            let (a, c) = (a >> shift.0, c >> shift.1);
            let law = Law::from_bits;
            let (ab, cd) = (i128::from(a) * i128::from(b), i128::from(c) * i128::from(d));
            let product = mul_clamped(law(a), law(b));
            let sum = sum_of_products((law(a), law(b)), (law(c), law(d)));
            for (exact, found) in [(ab >> 16, product), ((ab + cd) >> 16, sum)] {
                let found = i128::from(found.to_bits());
                if exact.abs() < 8192 << 16 {
                    prop_assert_eq!(found, exact);
                } else {
                    prop_assert!(found.signum() == exact.signum() && found.abs() >= 8191 << 16, "{} {}", found, exact);
                    prop_assert!(found.abs() <= 8192 << 16, "{}", found);
                }
            }
        }

        #[test]
        fn rounded_product_is_the_nearest(a: i32, b: i32) {
            let exact = i128::from(a) * i128::from(b);
            let error = (i128::from(round_product(Law::from_bits(a), Law::from_bits(b))) << 32) - exact;
            prop_assert!(error.abs() <= 1 << 31, "{error}");
        }

        /// The divisor is rounded down to 16 bits, 2^-15 of it, and so is the quotient.
        #[test]
        fn ratio_of_square_is_within_2_15ths(
            v: u32, d in 1..=u64::MAX, shift in (0..32_u32, 0..64_u32),
        ) {
            let (v, d) = (v >> shift.0, (d >> shift.1).max(1));
            let exact = u128::from(v) * u128::from(v) / u128::from(d);
            let ratio = u128::from(ratio_of_square(v, d));
            if exact >> 32 != 0 {
                prop_assert!(ratio >= (1 << 32) - (1 << 17), "{ratio} {exact}");
            } else {
                let error = 1 + (exact >> 15) + 1;
                prop_assert!(ratio.abs_diff(exact) <= error || ratio == u128::from(u32::MAX), "{ratio} {exact}");
            }
        }

        /// us ≥ 1024·2^(i/2 − 1/4) in the fourth power; 19/16 is 2^(1/4) less 0.14 %, and two quotients are rounded down.
        #[test]
        fn half_octaves_are_the_nearest(us in 1..1_u32 << 29, shift in 0..29_u32) {
            let us = (us >> shift).max(1);
            let fourth = 2 * u128::from(us).pow(4);
            let at_least = |octaves: usize, percent: u128| fourth * percent >= (100 << 40) << (2 * octaves);
            let octaves = half_octaves(us);
            prop_assert!(octaves == 0 || at_least(octaves, 102), "{us}: {octaves}");
            prop_assert!(!at_least(octaves + 1, 98), "{us}: {octaves}");
        }

        #[test]
        fn low_word_wraps(x: i64) {
            let low = i64::from(low_word(x));
            prop_assert_eq!((i128::from(x) - i128::from(low)) % (1 << 32), 0);
            prop_assert_eq!(i64::from(low_word(low)), low);
        }
    }

    #[test]
    fn product_of_two_formats_has_that_of_its_result() {
        use fixed::types::extra::{U4, U20, U28};
        // −1¾ · 3 is −5¼.
        let (a, b) = (FixedI32::<U28>::from_bits(-7 << 26), FixedI32::<U4>::from_num(3));
        let product: FixedI32<U20> = times(a, b);
        assert_eq!(product.to_bits(), -21 << 18);
        // Rounded down, to a unit of the result.
        let product: FixedI32<U4> = times(FixedI32::<U20>::DELTA, -b);
        assert_eq!(product, -FixedI32::<U4>::DELTA);
        let saturated: FixedI32<U28> = times_saturated(a, FixedI32::<U4>::MAX);
        assert_eq!(saturated, FixedI32::<U28>::MIN);
    }

    #[test]
    fn products_saturate_and_round_down() {
        let law = |x: i32| Law::from_num(x);
        assert_eq!(product(law(-3), law(7)), law(-21));
        assert_eq!(product(Law::MAX, law(2)), Law::MAX);
        assert_eq!(product(Law::MAX, law(-2)), Law::MIN);
        assert_eq!(product(Law::MIN, Law::MIN), Law::MAX);
        assert_eq!(product(Law::DELTA, Law::DELTA), Law::ZERO);
        assert_eq!(product(-Law::DELTA, Law::DELTA), -Law::DELTA);
        assert_eq!(mul_shift(i32::MAX, 2, 1), i32::MAX);
        assert_eq!(mul_shift(1 << 30, 4, 1), i32::MAX);
        assert_eq!(mul_shift(-(1 << 30), 4, 1), i32::MIN);
    }

    proptest! {
        #[test]
        fn half_up_is_the_nearest(n in 0..1_u64 << 62, d in 1..1_u64 << 62, shift in (0..62_u32, 0..62_u32)) {
            let (n, d) = (n >> shift.0, (d >> shift.1).max(1));
            let exact = (2 * u128::from(n) + u128::from(d)) / (2 * u128::from(d));
            prop_assert_eq!(u128::from(half_up(n, d)), exact.min(u32::MAX.into()));
        }
    }

    #[test]
    fn half_up_has_its_bounds() {
        for (n, d, quotient) in
            [(0, 7, 0), (3, 7, 0), (4, 7, 1), (7, 2, 4), (5, 0, u32::MAX), (1 << 40, 2, u32::MAX)]
        {
            assert_eq!(half_up(n, d), quotient, "{n} {d}");
        }
    }

    #[test]
    fn ratio_of_square_has_its_bounds() {
        for (v, d, ratio) in [
            (0, 1, 0),
            (1, 1, 1),
            (1 << 20, 1 << 20, 1 << 20),
            (1 << 20, 1 << 41, 0),
            (1 << 16, 1, u32::MAX),
            (u32::MAX, 1, u32::MAX),
            (1 << 31, 1 << 33, 1 << 29),
        ] {
            assert_eq!(ratio_of_square(v, d), ratio, "{v} {d}");
        }
    }

    #[test]
    fn conversions_saturate_at_their_bounds_only() {
        for x in [i32::MIN, -32_769, -32_768, -1, 0, 1, 32_766, 32_767, 32_768, i32::MAX] {
            assert_eq!(i32::from(saturating_i16(x)), x.clamp(-32_768, 32_767));
        }
        for x in [0, 1, u32::MAX / 2, u32::MAX / 2 + 1, u32::MAX] {
            assert_eq!(i64::from(saturating_signed(x)), i64::from(x).min(i32::MAX.into()));
        }
    }
}
