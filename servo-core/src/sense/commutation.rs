//! Sector and sign of the torque to the state of each leg of the bridge.

use crate::sense::hall::{HallDecoder, HallEvent, Wiring};
use crate::units::{Duty, Micros};

#[cfg(test)]
mod tests;

/// State of one leg of the bridge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Leg {
    /// Complementary PWM: the high side for the duty, the low side for the rest (less dead time).
    Pwm,
    /// Low side on.
    Low,
    /// Both switches off.
    Float,
}

/// State of the bridge.
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

/// Legs for positive torque in sectors 0..5: A+B−, A+C−, B+C−, B+A−, C+A−, C+B− (decision 0003). In sector k, which spans
/// [30° + 60°·k, 90° + 60°·k) electrical, these two EMFs are at opposite flat tops. The first three rows are repeated, so
/// that the opposite sector is three rows further.
const POSITIVE: [[Leg; 3]; 9] = [
    [Leg::Pwm, Leg::Low, Leg::Float],
    [Leg::Pwm, Leg::Float, Leg::Low],
    [Leg::Float, Leg::Pwm, Leg::Low],
    [Leg::Low, Leg::Pwm, Leg::Float],
    [Leg::Low, Leg::Float, Leg::Pwm],
    [Leg::Float, Leg::Low, Leg::Pwm],
    [Leg::Pwm, Leg::Low, Leg::Float],
    [Leg::Pwm, Leg::Float, Leg::Low],
    [Leg::Float, Leg::Pwm, Leg::Low],
];

/// The same with phases B and C interchanged: for a motor whose phases are in an odd order.
const SWAPPED: [[Leg; 3]; 9] = {
    const fn swapped([a, b, c]: [Leg; 3]) -> [Leg; 3] {
        [a, c, b]
    }
    let [r0, r1, r2, r3, r4, r5, ..] = POSITIVE;
    let [r0, r1, r2] = [swapped(r0), swapped(r1), swapped(r2)];
    [r0, r1, r2, swapped(r3), swapped(r4), swapped(r5), r0, r1, r2]
};

/// The bridge for a signed duty in a sector (0..=5), otherwise `Off`. A negative duty, which opens, swaps the two driven
/// legs, as in the opposite sector. A duty of zero short-circuits the two phases.
#[must_use]
pub fn bridge(sector: Option<u8>, duty: Option<Duty>) -> Bridge {
    by(&POSITIVE, sector.unwrap_or(NONE), duty)
}

#[inline]
fn by(vectors: &[[Leg; 3]; 9], sector: u8, duty: Option<Duty>) -> Bridge {
    let Some(duty) = duty.filter(|_| sector < NONE) else { return Bridge::Off };
    let opposite = if duty < Duty::ZERO { 3 } else { 0 };
    match vectors.get(usize::from(sector) + opposite) {
        Some(&legs) => Bridge::On { legs, duty: Duty(duty.0.saturating_abs()) },
        None => Bridge::Off,
    }
}

/// State of the hall interrupt: the decoder and the duty of the last control tick, so that a new sector is commutated at once.
#[derive(Clone, Copy, Debug)]
pub struct Commutator {
    halls: HallDecoder,
    vectors: &'static [[Leg; 3]; 9],
    duty: Option<Duty>,
    /// Whether FIND holds the legs of a sector wherever the rotor is.
    held: bool,
    /// The sector of the bridge: the rotor's trusted one or the held one; [`NONE`] before the first valid code.
    sector: u8,
}

/// No sector: 0 to 5 are some.
const NONE: u8 = 6;

impl Commutator {
    /// A commutator with the bridge off, whose lines read `code` at hall count `count`.
    #[must_use]
    #[inline(never)]
    pub fn new(wiring: Wiring, code: u8, count: i32) -> Self {
        let vectors = if wiring.swaps_phases() { &SWAPPED } else { &POSITIVE };
        let halls = HallDecoder::new(wiring, code, count);
        Self { halls, vectors, duty: None, held: false, sector: halls.sector().unwrap_or(NONE) }
    }

    /// The bridge for `code` if a sample of it moves the rotor on: [`Self::bridge`] after [`Self::sample`], without the time of
    /// a sample. `None` if it does not, or if it is the first valid code.
    #[must_use]
    pub fn ahead(&self, code: u8, at: Micros) -> Option<Bridge> {
        let sector = self.halls.ahead(code, at)?;
        Some(by(self.vectors, if self.held { self.sector } else { sector }, self.duty))
    }

    /// Whether one more sample of `code` would change nothing.
    #[inline]
    #[must_use]
    pub fn is_settled(&self, code: u8) -> bool {
        self.halls.is_settled(code)
    }

    /// One sample of the lines: at each of their changes, and at each control tick before the servo's.
    pub fn sample(&mut self, code: u8, at: Micros) -> Option<HallEvent> {
        let event = self.halls.sample(code, at);
        if !self.held {
            self.follow();
        }
        event
    }

    /// See [`HallDecoder::age`].
    pub fn age(&mut self, now: Micros) {
        self.halls.age(now);
    }

    /// The signed duty of the control tick; `None` switches the bridge off.
    pub const fn set(&mut self, duty: Option<Duty>) {
        self.duty = duty;
    }

    /// Holds the legs of a sector wherever the rotor is, as FIND needs it; `None` follows the rotor.
    pub fn hold(&mut self, sector: Option<u8>) {
        self.held = sector.is_some();
        match sector {
            Some(sector) => self.sector = sector,
            None => self.follow(),
        }
    }

    fn follow(&mut self) {
        self.sector = self.halls.sector().unwrap_or(NONE);
    }

    /// The present bridge. It follows the trusted sector, so a glitch does not reach the motor.
    #[must_use]
    pub fn bridge(&self) -> Bridge {
        by(self.vectors, self.sector, self.duty)
    }

    /// The hall count.
    #[must_use]
    pub const fn count(&self) -> i32 {
        self.halls.count()
    }
}
