//! The event logs of GOD and the boards, for people and programs.

use std::fmt;

use serde::Serialize;
use tater_fw::events::BoardEvent;
use tater_wire::Property;

use crate::metrics::{end_word, fault_word, mode_word};
use hil_world::bus::Station;
use hil_world::hand::Hand;
use hil_world::node::Node;

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

/// The events still in the logs of GOD and the boards, oldest first.
#[must_use]
pub fn of_hand(hand: &Hand) -> Vec<Event> {
    let mut events = Vec::new();
    hand.io().events().for_each(|event| {
        let ms = event.at_us as f64 / 1000.0;
        events.push(Event { ms, source: "GOD".to_owned(), event: event.kind.to_string() });
    });
    events.extend(hand.bus().stations().flat_map(of_board));
    // The sort is stable: simultaneous events keep the order of their log.
    events.sort_by(|a, b| a.ms.total_cmp(&b.ms));
    events
}

/// The events still in a board's log, oldest first. The log starts anew with the application.
#[must_use]
pub fn of_board(node: &Node) -> Vec<Event> {
    let source = format!("board {}", node.straps().number());
    let (now_us, clock) = (node.now_us(), node.stamp());
    let entries = node.application().into_iter().flat_map(|tater| tater.events());
    let event = |entry: &tater_fw::events::Entry| {
        // By the board's own clock, which may drift.
        let age_us = clock.wrapping_since(entry.at).0;
        let ms = now_us.saturating_sub(age_us.into()) as f64 / 1000.0;
        Event { ms, source: source.clone(), event: board_text(&entry.event) }
    };
    entries.map(event).collect()
}

fn board_text(event: &BoardEvent) -> String {
    match event {
        BoardEvent::Order { property, value } => format!("SET {} {value}", property.row().name),
        BoardEvent::Refused { property, error } => {
            let name = match property.map(|number| (number, Property::of(number))) {
                Some((_, Some(property))) => property.row().name.to_owned(),
                Some((number, None)) => format!("property {number}"),
                None => "a frame".to_owned(),
            };
            format!("refused {name}: {error:?}")
        }
        BoardEvent::Mode(mode) => format!("mode {}", mode_word(*mode)),
        BoardEvent::Motor(event) => motor_text(event),
        BoardEvent::Field(sector) => format!("field to sector {sector}"),
        BoardEvent::Found(Ok(number)) => format!("found wiring {number}"),
        BoardEvent::Found(Err(trouble)) => format!("found no wiring: {trouble:?}"),
        BoardEvent::Flash(error) => format!("flash: {error:?}"),
    }
}

/// What a report of the servo says, as text.
#[must_use]
pub fn motor_text(event: &servo_core::Event) -> String {
    use servo_core::Event;
    match event {
        Event::Ended { reason, mode } => format!("{}, then {}", end_word(*reason), mode_word(*mode)),
        Event::Breakaway { position, stop_tip: false } => format!("breakaway at {position}"),
        Event::Breakaway { position, stop_tip: true } => format!("breakaway at {position}, tip stops too"),
        Event::Fault(fault) => format!("fault: {}", fault_word(*fault)),
        Event::Glitch(glitch) => format!("glitch: {glitch:?}"),
        Event::Homed => "homed".to_owned(),
    }
}

/// Lines of text under a heading; empty without events.
#[must_use]
pub fn text(events: &[Event]) -> String {
    if events.is_empty() {
        return String::new();
    }
    let lines: String = events.iter().map(|event| format!("{event}\n")).collect();
    format!("last events, oldest first:\n{lines}")
}
