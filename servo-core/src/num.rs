//! The Q-formats of the control laws and the few operations that `fixed` does not give.
//!
//! A 32-bit format multiplies in one `SMULL` on the Cortex-M3; a 64-bit one in a library call. So loops run in
//! [`Law`] and only the profile, which must land exactly, keeps wider state.

use fixed::types::I16F16;

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

/// `a · b / 2^shift`, rounded down, saturated to 32 bits: one `SMULL` and a shift. `shift` < 64.
#[must_use]
pub const fn mul_shift(a: i32, b: i32, shift: u32) -> i32 {
    let product = (a as i64 * b as i64) >> shift;
    if product > i32::MAX as i64 {
        i32::MAX
    } else if product < i32::MIN as i64 {
        i32::MIN
    } else {
        product as i32
    }
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
