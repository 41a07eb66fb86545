//! What a board shows to the judge, in the terms of the wire, and what its world knows of it. This is the one place that knows both the judge
//! and the firmware.

use std::cell::Cell;

use servo_core::Event;
use tater_fw::Tater;
use tater_fw::codes::{end_code, mode_code};
use tater_fw::events::BoardEvent;
use tater_wire::Property;

use super::invariant::{Ground, Seen};
use hil_world::board::SimBoard;
use hil_world::node::Node;

/// Numbers of properties.
const NUMBERS: usize = 128;

/// The answers of a board at one tick, each asked for once: a dozen checks want MODE and END.
pub struct Answers([Cell<(u64, Option<i64>)>; NUMBERS]);

impl Default for Answers {
    fn default() -> Self {
        Self(std::array::from_fn(|_| Cell::new((u64::MAX, None))))
    }
}

impl Answers {
    /// The answer to a GET at the tick `at`, which no other board and no other time has.
    pub fn get(&self, at: u64, tater: &Tater<SimBoard>, property: Property) -> Option<i64> {
        let (asked, value) = self.0.get(property as usize).map_or((u64::MAX, None), Cell::get);
        if asked == at {
            return value;
        }
        let value = tater.property(property);
        if let Some(answer) = self.0.get(property as usize) {
            answer.set((at, value));
        }
        value
    }
}

/// An event of a board, as a host may see it.
pub fn seen(event: BoardEvent) -> Seen {
    match event {
        BoardEvent::Order { property, value } => Seen::Order { property, value: value.into() },
        BoardEvent::Refused { .. } => Seen::Refused,
        BoardEvent::Mode(mode) => Seen::Mode(mode_code(mode)),
        BoardEvent::Motor(Event::Ended { reason, mode }) => {
            Seen::Ended { end: end_code(reason), mode: mode_code(mode) }
        }
        BoardEvent::Motor(Event::Homed) => Seen::Homed,
        BoardEvent::Motor(Event::Breakaway { .. } | Event::Fault(_) | Event::Glitch(_))
        | BoardEvent::Field(_)
        | BoardEvent::Found(_)
        | BoardEvent::Flash(_) => Seen::Other,
    }
}

/// What the world knows of a board.
pub(crate) fn ground(node: &Node) -> Ground {
    let flash = node.board().sim_flash();
    Ground {
        starts: node.starts(),
        heard_us: node.heard_us(),
        watchdog_resets: node.watchdog_resets(),
        flash_operations: flash.operations(),
        erased_while_driven: flash.erased_while_driven(),
        is_marked_hot: node.application().is_none_or(Tater::is_marked_hot),
    }
}
