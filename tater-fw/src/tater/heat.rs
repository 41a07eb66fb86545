//! The winding's heat over a reset and a loss of power (decision 0051): a word that a reset keeps, and the hot mark in the flash.

use super::Tater;
use crate::board::Board;
use servo_core::guard::thermal::{HotMark, Start};

/// What a board keeps whose winding is as warm as its housing: a simulated board that has been on for some time.
pub const COLD: u32 = u32::from_le_bytes([0, !0, RESET, !RESET]);

/// The kinds of a word, in its third byte.
const RESET: u8 = 0x3C;
const INTERRUPTED: u8 = 0xC3;

impl<B: Board> Tater<B> {
    /// Starts the servo's thermal model with what is known of the winding. Nobody knows how long the board was without power or in
    /// the monitor, so nothing has cooled down.
    pub(super) fn start_warm(&mut self) {
        let hot = self.store.is_hot();
        let kept = decode(self.board.retained());
        self.servo.start_warm(kept.unwrap_or(if hot { Start::Marked } else { Start::Unmarked }));
        self.servo.set_hot_mark(hot);
        // Until housekeeping knows better: this program may be interrupted too.
        match kept {
            Some(Start::Interrupted(rise)) => {
                self.retain(Start::Interrupted(rise.saturating_add(self.servo.uncounted())))
            }
            Some(Start::Reset(rise)) => self.retain(Start::Interrupted(rise)),
            Some(Start::Marked | Start::Unmarked) | None => {}
        }
    }

    /// Keeps the present rise for a start after this.
    pub(super) fn retain_rise(&mut self, start: fn(u16) -> Start) {
        if let Some(rise) = self.servo.rise() {
            self.retain(start(rise));
        }
    }

    fn retain(&mut self, start: Start) {
        if let Some(word) = encode(start) {
            self.board.retain(word);
        }
    }

    /// Queues the hot mark or its removal, and lets the servo use what the flash has.
    pub(super) fn update_hot_mark(&mut self) {
        match self.servo.hot_mark() {
            HotMark::Wanted => self.store.set_hot(true),
            HotMark::Obsolete => self.store.set_hot(false),
            HotMark::Right => {}
        }
        self.servo.set_hot_mark(self.store.is_hot());
    }
}

/// Bytes: the rise in whole kelvin, rounded up; its complement; the kind; the complement of the kind, exclusive or the rise. Of
/// random words after power-up one in 8 million is valid.
fn encode(start: Start) -> Option<u32> {
    let (rise, kind) = match start {
        Start::Reset(rise) => (rise, RESET),
        Start::Interrupted(rise) => (rise, INTERRUPTED),
        Start::Marked | Start::Unmarked => return None,
    };
    let kelvin = u8::try_from(rise.div_ceil(10)).unwrap_or(u8::MAX);
    Some(u32::from_le_bytes([kelvin, !kelvin, kind, !kind ^ kelvin]))
}

fn decode(word: u32) -> Option<Start> {
    let [kelvin, ..] = word.to_le_bytes();
    let rise = u16::from(kelvin) * 10;
    [Start::Reset(rise), Start::Interrupted(rise)].into_iter().find(|&start| encode(start) == Some(word))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kept_word_round_trips_and_no_other_decodes() {
        for kelvin in 0..=255 {
            for start in [Start::Reset(10 * kelvin), Start::Interrupted(10 * kelvin)] {
                let word = encode(start).expect("a rise");
                assert_eq!(decode(word), Some(start));
                for bit in 0..32 {
                    assert_eq!(decode(word ^ 1 << bit), None);
                }
            }
        }
        assert_eq!(encode(Start::Reset(301)), encode(Start::Reset(310)), "rounded up");
        assert_eq!(encode(Start::Reset(u16::MAX)), encode(Start::Reset(2550)));
        assert_eq!(decode(COLD), Some(Start::Reset(0)));
        assert_eq!((decode(0), decode(u32::MAX)), (None, None), "no RAM yet");
    }
}
