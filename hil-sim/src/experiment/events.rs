//! The event logs of GOD and the boards, for people and programs.

use std::fmt;

use serde::Serialize;

use crate::world::hand::Hand;

/// An event of a log.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Event {
    /// Simulated time, ms.
    pub ms: f64,
    /// The log: `GOD` or `board 1` to `board 7`.
    pub source: String,
    /// The event in words.
    pub event: String,
}

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:>12.3} ms  {:<7}  {}", self.ms, self.source, self.event)
    }
}

/// The events that GOD and the boards of a hand still have, oldest first.
#[must_use]
pub fn of_hand(hand: &Hand) -> Vec<Event> {
    let mut events = Vec::new();
    hand.io().events().for_each(|event| {
        let ms = event.at_us as f64 / 1000.0;
        events.push(Event { ms, source: "GOD".to_owned(), event: event.kind.to_string() });
    });
    // Stable: events of equal times keep the order of their log.
    events.sort_by(|a, b| a.ms.total_cmp(&b.ms));
    events
}

/// Events as lines of text under a heading; nothing if there are none.
#[must_use]
pub fn text(events: &[Event]) -> String {
    if events.is_empty() {
        return String::new();
    }
    let lines: String = events.iter().map(|event| format!("{event}\n")).collect();
    format!("last events, oldest first:\n{lines}")
}
