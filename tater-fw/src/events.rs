//! A ring of a board's last events with their times: a probe logs them, a simulator prints them when a run fails.
//!
//! Entries are plain values without text. The 1 kHz tick records nothing, except each vector of FIND.

use heapless::Deque;
use servo_core::Event;
use servo_core::mode::Mode;
use servo_core::units::Micros;
use tater_wire::Property;

use crate::find::Trouble;
use crate::set_error::SetError;
use boot::FlashError;

/// Entries kept; a new one drops the oldest.
pub const CAPACITY: usize = 32;

/// Something that happened on a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum BoardEvent {
    /// A SET was obeyed. Those of T and V, which hosts stream, and of LOCK are not recorded.
    Order {
        /// The property that was set.
        property: Property,
        /// Its new value.
        value: i32,
    },
    /// A frame changed nothing. Not recorded if the entry before says the same.
    Refused {
        /// Number of the property in the frame; `None` if it has none.
        property: Option<u8>,
        /// The reason.
        error: SetError,
    },
    /// The servo's mode changed to this.
    Mode(Mode),
    /// The servo's report: the end of a motion, a fault (a lost host is one), a breakaway, a hall glitch, homed.
    Motor(Event),
    /// FIND turns its field to this sector, 0 to 5.
    Field(u8),
    /// FIND is complete: the wiring's number up to its mirror image, or why there is none.
    Found(Result<u8, Trouble>),
    /// The flash failed, which is ERROR 8 until SET STAT 2.
    Flash(FlashError),
}

/// An event and its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Entry {
    /// The time of the control tick or frame that caused it, µs since the program's start.
    pub at: Micros,
    /// The event.
    pub event: BoardEvent,
}

/// The last [`CAPACITY`] entries, and how many of them have not been taken yet.
#[derive(Debug, Default)]
pub struct Events {
    entries: Deque<Entry, CAPACITY>,
    unread: usize,
}

impl Events {
    /// Records an event.
    pub fn push(&mut self, at: Micros, event: BoardEvent) {
        let repeated = || self.entries.back().is_some_and(|last| last.event == event);
        if matches!(event, BoardEvent::Refused { .. }) && repeated() {
            return;
        }
        if self.entries.is_full() {
            self.entries.pop_front();
        }
        let _ = self.entries.push_back(Entry { at, event });
        self.unread = self.entries.len().min(self.unread.saturating_add(1));
    }

    /// The oldest entry that has not been taken yet. It stays in [`Self::iter`].
    pub fn take_next(&mut self) -> Option<Entry> {
        let next = self.entries.len().checked_sub(self.unread)?;
        let entry = *self.entries.get(next)?;
        self.unread = self.unread.saturating_sub(1);
        Some(entry)
    }

    /// All entries, oldest first.
    pub fn iter(&self) -> impl Iterator<Item = &Entry> {
        self.entries.iter()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    fn order(value: i32) -> BoardEvent {
        BoardEvent::Order { property: Property::M, value }
    }

    #[test]
    fn full_ring_drops_oldest_and_each_entry_is_taken_once() {
        let mut events = Events::default();
        assert_eq!(events.take_next(), None);
        events.push(Micros(1), order(1));
        assert_eq!(events.take_next(), Some(Entry { at: Micros(1), event: order(1) }));
        assert_eq!(events.take_next(), None);
        for value in 2..=40 {
            events.push(Micros(2), order(value));
        }
        let kept: Vec<BoardEvent> = events.iter().map(|entry| entry.event).collect();
        assert_eq!(kept, (9..=40).map(order).collect::<Vec<_>>());
        let mut taken = Vec::new();
        while let Some(entry) = events.take_next() {
            taken.push(entry.event);
        }
        assert_eq!(taken, kept);
        assert_eq!(events.iter().count(), CAPACITY);
    }

    #[test]
    fn refusal_that_repeats_is_recorded_once() {
        let mut events = Events::default();
        let refused = BoardEvent::Refused { property: Some(8), error: SetError::Unnamed };
        for at in 0..3 {
            events.push(Micros(at), refused);
        }
        assert_eq!(events.iter().count(), 1);
        events.push(Micros(3), order(1));
        events.push(Micros(4), refused);
        assert_eq!(events.iter().count(), 3);
    }
}
