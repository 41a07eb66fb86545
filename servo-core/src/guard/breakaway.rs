//! BT, BD, BP, BS: when a closing link has met an object (manual 5.1.2, decision 0008).
//!
//! Link and tip have motors of their own, so the clutch of the BarrettHand is simulated: the link breaks away when it
//! carries more load than BT and falls behind its set-point. Torque alone would also trigger at the start of a move, where
//! static friction breaks loose and the rotor catches up within milliseconds.

use crate::units::{CountsPerSec, Torque};

/// Least duration of the load. A start against 0.06 N·m of static friction is over within 5 ms; TSTOP, the next guard, is
/// 300 ms.
const LOAD_MS: u8 = 10;

/// The breakaway detector.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Breakaway {
    loaded_ms: u8,
}

impl Breakaway {
    /// One tick of 1 ms; returns whether the link has broken away. Only closing motions break away. `bt` in torque units, 0
    /// = never.
    #[must_use]
    pub fn step(&mut self, applied: Torque, setpoint: CountsPerSec, measured: CountsPerSec, bt: u16) -> bool {
        let closing = setpoint > CountsPerSec::ZERO;
        // A rotor that still turns the other way is being braked, not loaded.
        let behind = measured >= CountsPerSec::ZERO && measured.0 < setpoint.0 >> 2;
        let loaded = i32::from(applied.0) >= i32::from(bt);
        if bt != 0 && closing && behind && loaded {
            self.loaded_ms = self.loaded_ms.saturating_add(1);
        } else {
            self.loaded_ms = 0;
        }
        self.loaded_ms >= LOAD_MS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ticks_until(torque: i16, wanted: i16, measured: i16, bt: u16) -> Option<usize> {
        let mut breakaway = Breakaway::default();
        (1..1000).find(|_| {
            breakaway.step(
                Torque(torque),
                CountsPerSec::from_int(wanted),
                CountsPerSec::from_int(measured),
                bt,
            )
        })
    }

    #[test]
    fn breaks_away_after_10_ms_of_load_on_a_slowed_closing_link() {
        assert_eq!(ticks_until(400, 500, 20, 300), Some(10));
        assert_eq!(ticks_until(299, 500, 20, 300), None, "below BT");
        assert_eq!(ticks_until(400, 500, 124, 300), Some(10), "less than a quarter");
        assert_eq!(ticks_until(400, 500, 125, 300), None, "a quarter");
        assert_eq!(ticks_until(400, 500, 450, 300), None, "keeps up: accelerating");
        assert_eq!(ticks_until(400, -500, -20, 300), None, "opening");
        assert_eq!(ticks_until(400, 500, -600, 300), None, "turns round from opening");
        assert_eq!(ticks_until(400, 500, 20, 0), None, "BT 0 is off");
    }

    #[test]
    fn load_of_9_ms_does_not_break_away() {
        let mut breakaway = Breakaway::default();
        let (fast, slow) = (CountsPerSec::from_int(500), CountsPerSec::ZERO);
        for tick in 0..1000 {
            let measured = if tick % 10 == 9 { fast } else { slow };
            assert!(!breakaway.step(Torque(700), fast, measured, 300));
        }
    }
}
