//! Sector and torque sign → which leg of the bridge is driven high, low or left floating.

use crate::units::Duty;

/// What one leg of the bridge does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Leg {
    /// Complementary PWM: the high side for the duty, the low side for the rest (less dead time).
    Pwm,
    /// Low side on.
    Low,
    /// Both switches off.
    Float,
}

/// What the whole bridge does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bridge {
    /// All switches off: the motor coasts.
    Off,
    /// Legs A, B, C, and the duty of the `Pwm` leg, never negative: the sign is in the legs.
    On {
        /// Legs of phases A, B and C.
        legs: [Leg; 3],
        /// Share of the bus voltage across the two driven phases, 0 ≤ duty < 1.
        duty: Duty,
    },
}
