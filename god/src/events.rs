//! The event log: GOD's last actions and observations, for its owner to print when something fails.
//!
//! A ring of fixed size; the newest event replaces the oldest. Recording copies a few words and formats nothing. RealTime's velocities and
//! gains are not recorded: at 250 blocks a second they would push everything else out within 20 ms.

use crate::shared::Shared;

use heapless::Deque;
use tater_wire::Property;

use crate::motors::Motor;
use crate::status::Status;

/// Number of events kept.
pub const CAPACITY: usize = 128;

/// One event and its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Event {
    /// Time since GOD's start, µs.
    pub at_us: u64,
    /// The event.
    pub kind: EventKind,
}

/// The kind of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum EventKind {
    /// GOD started, or started anew after RESET.
    Started,
    /// GOD sent an order: a SET of a property.
    Sent {
        /// The motor.
        motor: Motor,
        /// The property.
        property: Property,
        /// The value, in the board's unit.
        value: i64,
    },
    /// A board neither began nor continued a motion: END is 0, and MODE is not one of that motion.
    Refused {
        /// The motor.
        motor: Motor,
    },
    /// A board answered ERROR with a value other than 0.
    Fault {
        /// The motor.
        motor: Motor,
        /// ERROR.
        code: i64,
    },
    /// A board reported or answered that its mode is another one.
    Mode {
        /// The motor.
        motor: Motor,
        /// MODE.
        mode: i64,
    },
    /// A board reported or answered that its motion has ended.
    Ended {
        /// The motor.
        motor: Motor,
        /// END.
        end: i64,
    },
    /// A board did not answer in time.
    NoAnswer {
        /// The motor.
        motor: Motor,
        /// The property that was asked for.
        property: Property,
    },
    /// Two boards have this motor's number.
    Doubled {
        /// The motor.
        motor: Motor,
    },
    /// The bus took no frame for [`SEND_US`](crate::io::SEND_US); all queued frames were dropped.
    BusDown,
    /// A frame came in after [`EventKind::BusDown`].
    BusUp,
    /// ^C, or the host hung up.
    Aborted,
    /// A command ended with a status other than 0.
    Failed {
        /// The status.
        status: Status,
    },
}

/// The ring.
#[derive(Debug, Default)]
pub struct EventLog {
    ring: Shared<Deque<Event, CAPACITY>>,
}

impl EventLog {
    pub(crate) fn record(&self, at_us: u64, kind: EventKind) {
        self.ring.with(|ring| {
            if ring.is_full() {
                ring.pop_front();
            }
            let _ = ring.push_back(Event { at_us, kind });
        });
    }

    /// Calls `visit` for each event, oldest first.
    pub fn for_each(&self, visit: impl FnMut(&Event)) {
        self.ring.with(|ring| ring.iter().for_each(visit));
    }
}

impl core::fmt::Display for Event {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let [s, us] = [self.at_us / 1_000_000, self.at_us % 1_000_000];
        write!(f, "{s:4}.{us:06} s  {}", self.kind)
    }
}

impl core::fmt::Display for EventKind {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::Started => f.write_str("GOD started"),
            Self::Sent { motor, property, value } => {
                write!(f, "motor {}: SET {} {value}", motor.number(), property.name())
            }
            Self::Refused { motor } => write!(f, "motor {}: no motion (END is 0)", motor.number()),
            Self::Fault { motor, code } => write!(f, "motor {}: ERROR {code}", motor.number()),
            Self::Mode { motor, mode } => write!(f, "motor {}: MODE {mode}", motor.number()),
            Self::Ended { motor, end } => write!(f, "motor {}: END {end}", motor.number()),
            Self::NoAnswer { motor, property } => {
                write!(f, "motor {}: no answer to GET {}", motor.number(), property.name())
            }
            Self::Doubled { motor } => write!(f, "motor {}: two boards have its number", motor.number()),
            Self::BusDown => f.write_str("bus down: it takes no frames"),
            Self::BusUp => f.write_str("bus up"),
            Self::Aborted => f.write_str("aborted by ^C or hang-up"),
            Self::Failed { status } => write!(f, "command failed: ERR {}", status.code()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::format;
    use std::vec::Vec;

    #[test]
    fn full_ring_drops_the_oldest_event() {
        let log = EventLog::default();
        let events = CAPACITY as u64 + 3;
        (0..events).for_each(|at_us| log.record(at_us, EventKind::BusDown));
        let mut times = Vec::new();
        log.for_each(|event| times.push(event.at_us));
        assert_eq!(times, (3..events).collect::<Vec<_>>());
    }

    #[test]
    fn events_print_as_lines_of_a_log() {
        let motor = Motor::SPREAD;
        for (kind, text) in [
            (EventKind::Started, "GOD started"),
            (EventKind::Sent { motor, property: Property::MT, value: -5 }, "motor 4: SET MT -5"),
            (EventKind::Refused { motor }, "motor 4: no motion (END is 0)"),
            (EventKind::Fault { motor, code: 5 }, "motor 4: ERROR 5"),
            (EventKind::Mode { motor, mode: 3 }, "motor 4: MODE 3"),
            (EventKind::Ended { motor, end: 2 }, "motor 4: END 2"),
            (EventKind::NoAnswer { motor, property: Property::P }, "motor 4: no answer to GET P"),
            (EventKind::Doubled { motor }, "motor 4: two boards have its number"),
            (EventKind::BusDown, "bus down: it takes no frames"),
            (EventKind::BusUp, "bus up"),
            (EventKind::Aborted, "aborted by ^C or hang-up"),
            (EventKind::Failed { status: Status::NO_BOARD }, "command failed: ERR 1"),
        ] {
            assert_eq!(format!("{kind}"), text);
            let event = Event { at_us: 12_000_345, kind };
            assert_eq!(format!("{event}"), format!("  12.000345 s  {text}"));
        }
    }
}
