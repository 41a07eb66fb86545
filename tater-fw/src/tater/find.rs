//! WIRING, which says how the motor is connected, and FIND, which learns it (decision 0046).

use super::Tater;
use super::finding::Finding;
use super::settings;
use crate::board::Board;
use crate::events::BoardEvent;
use crate::find::{Find, Limits, Step, Trouble};
use crate::set_error::SetError;
use servo_core::sense::commutation::Commutator;
use servo_core::sense::wiring::Wiring;
use servo_core::units::MilliAmps;
use servo_core::{Command, Refusal};
use tater_wire::Property;
use tater_wire::find::{FindState, Order};

/// Counts of the test move: a few degrees of the joint, and no more than FIND itself moves.
const TEST_WAY: i32 = 6;

/// Counts from which on a host can have seen it.
const LEAST_WAY: i32 = 3;

/// The wiring of a value of WIRING, and whether the direction of closing is known. Unknown wiring is taken as the standard's.
fn decoded(value: u8) -> (Wiring, bool) {
    let number = value.checked_sub(1).map(|value| value / 2);
    let wiring = number.and_then(Wiring::from_number);
    (wiring.unwrap_or(Wiring::STANDARD), wiring.is_some() && value.is_multiple_of(2))
}

impl<B: Board> Tater<B> {
    /// Follows WIRING: the halls and the bridge, and whether anything may move.
    pub(super) fn rewire(&mut self) {
        let (wiring, known) = decoded(self.settings.wiring);
        let code = self.board.halls() & 7;
        self.commutator = Commutator::new(wiring, code, self.commutator.count());
        self.servo.set_wired(known);
    }

    /// SET WIRING, in idle only. Positions counted with another wiring mean nothing.
    pub(super) fn set_wiring(&mut self, value: i32) -> Result<(), SetError> {
        self.in_idle()?;
        if i32::from(self.settings.wiring) == value {
            return Ok(());
        }
        if !settings::set(&mut self.settings, Property::WIRING, value) {
            return Err(SetError::Range(Property::WIRING));
        }
        self.distrust();
        self.servo.doubt_position();
        self.rewire();
        Ok(())
    }

    /// SET FIND: see [`tater_wire::find`].
    pub(super) fn find(&mut self, value: i64) -> Result<(), SetError> {
        let order = Order::of(value).ok_or(SetError::Range(Property::FIND))?;
        let wiring = self.settings.wiring;
        match order {
            Order::Learn => {
                self.command(Command::Find)?;
                let limits = Limits::new(self.servo.starts(), &self.servo.config().motor);
                self.finding = Finding::Learning(Find::at(limits, self.commutator.count()));
            }
            Order::Test | Order::TestBack => {
                self.in_idle()?;
                let way = if order == Order::Test { TEST_WAY } else { -TEST_WAY };
                if wiring == 0 {
                    return Err(SetError::Servo(Refusal::Wiring));
                }
                // Not bounded: where the joint stands is not known.
                let end = self.servo.telemetry().position.round().saturating_add(way);
                self.command(Command::Move(end))?;
                self.finding = Finding::Testing { from: self.commutator.count() };
            }
            Order::Closed | Order::Opened => {
                let Finding::Testing { from } = self.finding else {
                    return Err(SetError::Servo(Refusal::Wiring));
                };
                if self.commutator.count().wrapping_sub(from).abs() < LEAST_WAY {
                    return Err(SetError::Servo(Refusal::Wiring));
                }
                self.command(Command::Terminate)?;
                let (mut wiring, _) = decoded(wiring);
                if order == Order::Opened {
                    wiring = wiring.mirrored();
                }
                self.keep_wiring(wiring, true);
            }
        }
        Ok(())
    }

    /// Takes a wiring and stores it.
    fn keep_wiring(&mut self, wiring: Wiring, known: bool) {
        self.finding = Finding::Nothing;
        self.settings.wiring = 1 + 2 * wiring.number() + u8::from(known);
        self.store.set(Property::WIRING, self.settings.wiring.into());
        self.distrust();
        self.servo.doubt_position();
        self.rewire();
    }

    /// Before each tick while FIND is under way: the torque and the legs of this tick.
    #[cold]
    #[inline(never)]
    pub(super) fn step_find(&mut self, current: MilliAmps) {
        let Finding::Learning(find) = &mut self.finding else { return };
        if !self.servo.is_finding() {
            // It was replaced by another motion, or a fault ended it.
            self.finding = Finding::Nothing;
            self.commutator.hold(None);
            return;
        }
        if !self.servo.has_field() {
            return;
        }
        let before = find.sector();
        let found = match find.step(self.board.halls() & 7, current) {
            Step::Hold(sector, torque) => {
                self.commutator.hold(Some(sector));
                self.servo.set_field(torque);
                if sector != before {
                    self.record(BoardEvent::Field(sector));
                }
                return;
            }
            Step::Done(found) => found,
        };
        self.commutator.hold(None);
        self.servo.end_field(found.is_ok());
        match found {
            Ok(wiring) => self.keep_wiring(wiring, false),
            Err(trouble) => self.finding = Finding::Refused(trouble),
        }
        self.record(BoardEvent::Found(found.map(|wiring| wiring.number())));
    }

    /// GET FIND.
    pub(super) fn found(&self) -> i64 {
        let state = match self.finding {
            Finding::Learning(_) => FindState::Learning,
            Finding::Refused(trouble) => return state_of(trouble),
            Finding::Testing { from } if self.commutator.count().wrapping_sub(from).abs() >= LEAST_WAY => {
                FindState::Tested
            }
            Finding::Testing { .. } | Finding::Nothing => match self.settings.wiring {
                0 => FindState::Unknown,
                wiring if wiring % 2 == 0 => FindState::Known,
                _ => FindState::Learned,
            },
        };
        state.into()
    }
}

/// GET FIND after a refusal.
fn state_of(trouble: Trouble) -> i64 {
    let (first, wire) = match trouble {
        Trouble::Blocked => (FindState::Blocked, 0),
        Trouble::Silent => (FindState::Silent, 0),
        Trouble::Unclear => (FindState::Unclear, 0),
        Trouble::AllOpen => (FindState::AllOpen, 0),
        Trouble::Open(leg) => (FindState::OpenA, leg),
        Trouble::Stuck { line, high: false } => (FindState::Low0, line),
        Trouble::Stuck { line, high: true } => (FindState::High0, line),
        Trouble::Shorted(other) => (FindState::Shorted12, other),
    };
    i64::from(first) + i64::from(wire)
}
