//! The Q-formats of the control laws and the few operations that `fixed` does not give.
//!
//! A 32-bit format multiplies in one `SMULL` on the Cortex-M3; a 64-bit one in a library call. So loops run in
//! [`Law`] and only the profile, which must land exactly, keeps wider state.

use core::num::NonZeroU64;
use fixed::types::{I16F16, I32F32};

/// The number of a control law: errors, velocities, gains times errors, torque units. Saturating in every law.
pub type Law = I16F16;

/// Control ticks a second (DESIGN 4.3).
pub const TICK_HZ: u32 = 1000;

/// A gain from its property: `raw / 2^fraction_bits`; `fraction_bits` ≤ 16.
#[must_use]
pub const fn gain(raw: u16, fraction_bits: u32) -> Law {
    // raw < 2^15 by the property's range, so the shift cannot overflow for fraction_bits ≥ 1.
    Law::from_bits((raw as i32).saturating_mul(1 << (16 - fraction_bits)))
}

/// The state of the profile: counts, counts a tick or counts a tick², ±2^31 with 2^-32 resolution.
pub type Wide = I32F32;

/// `a · b` for two magnitudes with 32 fractional bits, rounded down; the product must be below 2^32.
#[must_use]
pub const fn mul_q32(a: u64, b: u64) -> u64 {
    ((a as u128 * b as u128) >> 32) as u64
}

/// `x²` with 51 fractional bits for a magnitude below 2^6 with 32 fractional bits, rounded down.
#[must_use]
pub const fn square_q51(x: u64) -> u64 {
    ((x as u128 * x as u128) >> 13) as u64
}

/// `n / d` with 32 fractional bits, of which the last three are zero, rounded down; n and d have the same
/// number of fractional bits and d < 2^35. Saturates.
#[must_use]
pub fn ratio_q32(n: u64, d: NonZeroU64) -> u64 {
    // In two steps, since n · 2^32 would need 128 bits: the remainder is below d, so 29 more bits fit.
    let whole = n / d;
    let remainder = n.wrapping_sub(whole.wrapping_mul(d.get()));
    whole.saturating_mul(1 << 32).saturating_add(((remainder << 29) / d) << 3)
}

/// `√x` for 52 fractional bits: 32 fractional bits, of which the last six are zero, rounded down to 2^-26 but
/// not to zero.
#[must_use]
pub fn isqrt_q52(x: u64) -> NonZeroU64 {
    const STEP: NonZeroU64 = NonZeroU64::MIN.saturating_add(63);
    NonZeroU64::new(x.isqrt() << 6).unwrap_or(STEP)
}

/// The first tick strictly after a time with 32 fractional bits, and the time from then to it, (0, 1].
#[must_use]
pub const fn next_tick(time: u64) -> (u32, u64) {
    (((time >> 32) as u32).saturating_add(1), (1 << 32) - (time & 0xFFFF_FFFF))
}

/// `a · b / 2^shift`, rounded down, saturated to 32 bits: one `SMULL`, a shift, and one compare that tells whether
/// the upper word is only the sign. `shift` < 64.
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

/// The product of two numbers of a control law, saturated and rounded down. `fixed`'s own multiplies in 128 bits
/// on a 32-bit machine to know whether it must saturate: 28 instructions on the Cortex-M3; this takes 6.
#[must_use]
pub const fn product(a: Law, b: Law) -> Law {
    Law::from_bits(mul_shift(a.to_bits(), b.to_bits(), 16))
}

/// `a · b / 2^32`, rounded down: the upper word of an `SMULL`.
#[must_use]
pub const fn mul_upper(a: i32, b: i32) -> i32 {
    ((a as i64 * b as i64) >> 32) as i32
}

/// `a · b / 2^shift`, rounded down, where the caller knows that it fits; else the low 32 bits. `shift` < 64.
#[must_use]
pub const fn mul_low(a: i32, b: i32, shift: u32) -> i32 {
    ((a as i64 * b as i64) >> shift) as i32
}

/// The same of unsigned numbers.
#[must_use]
pub const fn mul_low_unsigned(a: u32, b: u32, shift: u32) -> u32 {
    ((a as u64 * b as u64) >> shift) as u32
}

/// `a · b + c · d`, rounded down and saturated once, of which `a` and `c` are not negative: then the sum of the whole
/// products is below 2^63.
#[must_use]
pub const fn sum_of_products((a, b): (Law, Law), (c, d): (Law, Law)) -> Law {
    let (ab, cd) = (a.to_bits() as i64 * b.to_bits() as i64, c.to_bits() as i64 * d.to_bits() as i64);
    Law::from_bits(saturating_i32(ab.wrapping_add(cd) >> 16))
}

/// `a · b` as the nearest whole number, halves up: below 2^30, so nothing saturates, and the upper word of an `SMLAL`.
#[must_use]
pub const fn round_product(a: Law, b: Law) -> i32 {
    ((a.to_bits() as i64 * b.to_bits() as i64 + (1 << 31)) >> 32) as i32
}

/// An unsigned number as a signed one, saturated at 2^31 − 1.
#[must_use]
pub const fn saturating_signed(x: u32) -> i32 {
    if x > i32::MAX as u32 { i32::MAX } else { x as i32 }
}

/// The low 16 bits' range of a signed number, saturated.
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

    const ONE: u64 = 1 << 32;

    proptest! {
        #[test]
        fn products_and_squares_are_rounded_down(a in 0..1_u64 << 35, b in 0..1_u64 << 35) {
            prop_assert_eq!(u128::from(mul_q32(a, b)), u128::from(a) * u128::from(b) / u128::from(ONE));
            prop_assert_eq!(u128::from(square_q51(a)), u128::from(a) * u128::from(a) / (1 << 13));
        }

        #[test]
        fn sums_of_products_round_once_and_saturate(a in 0..=i32::MAX, b: i32, c in 0..=i32::MAX, d: i32) {
            let exact = (i128::from(a) * i128::from(b) + i128::from(c) * i128::from(d)) >> 16;
            let law = Law::from_bits;
            let sum = sum_of_products((law(a), law(b)), (law(c), law(d))).to_bits();
            prop_assert_eq!(i128::from(sum), exact.clamp(i128::from(i32::MIN), i128::from(i32::MAX)));
        }

        #[test]
        fn a_rounded_product_is_the_nearest(a: i32, b: i32) {
            let exact = i128::from(a) * i128::from(b);
            let error = (i128::from(round_product(Law::from_bits(a), Law::from_bits(b))) << 32) - exact;
            prop_assert!(error.abs() <= 1 << 31, "{error}");
        }

        #[test]
        fn a_ratio_is_right_to_29_bits(n in 0..1_u64 << 57, d in 1..1_u64 << 35) {
            let exact = (u128::from(n) << 32) / u128::from(d);
            let ratio = u128::from(ratio_q32(n, NonZeroU64::new(d).unwrap()));
            prop_assert!(exact > u128::from(u64::MAX) || ratio == exact & !7, "{ratio} {exact}");
        }

        #[test]
        fn a_root_is_rounded_down_to_26_bits(x in any::<u64>(), shift in 0..64_u32) {
            let x = (x >> shift).max(1);
            let root = u128::from(isqrt_q52(x).get() >> 6);
            prop_assert_eq!(isqrt_q52(x).get() & 63, 0);
            prop_assert!(root * root <= u128::from(x) && (root + 1) * (root + 1) > u128::from(x));
        }

        #[test]
        fn the_next_tick_is_later_by_at_most_one(time in 0..u64::from(u32::MAX) << 32) {
            let (tick, wait) = next_tick(time);
            prop_assert!((1..=ONE).contains(&wait));
            prop_assert_eq!(u64::from(tick) << 32, time + wait);
        }
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
        // The edge of the upper word: 2^31 − 1 fits, 2^31 does not.
        assert_eq!(mul_shift(i32::MAX, 2, 1), i32::MAX);
        assert_eq!(mul_shift(1 << 30, 4, 1), i32::MAX);
        assert_eq!(mul_shift(-(1 << 30), 4, 1), i32::MIN);
    }

    #[test]
    fn extremes_saturate() {
        assert_eq!(ratio_q32(u64::MAX, NonZeroU64::MIN), u64::MAX);
        assert_eq!(isqrt_q52(0).get(), 64);
        assert_eq!(next_tick(u64::MAX), (u32::MAX, 1));
    }
}
