//! The manual's functions (7) that are more than one line of the language: findZero, move, close, open, command, saveParameters.

use std::sync::atomic::Ordering;
use std::time::Duration;

use god::Motors;
use god::Status;
use god::grammar::lower::Request;
use god::grammar::{self, Statement};
use god::motors::{Motor, Prefix};
use god::units::tip_travel_along;
use tater_wire::end::EndCode;
use tater_wire::property::MotorKind;
use tater_wire::{Cmd, FaultCode, ModeCode, Node, Property};

use super::{Hand, NODES, OnProgress, POLL, Progress, of_step};
use crate::deadline::Deadline;
use crate::error::{CallError, Failure};

/// Time that a board needs to write a SAVE to its flash, as GOD waits for it.
const STORE: Duration = Duration::from_millis(100);

/// How far a joint at its stop may seem to stand from it, hall counts: half a count outside, the stop's springs, and HI's own contact, which is
/// within one count (decision 0048).
const AT_STOP: i64 = 3;

/// A motor that opens to its stop stands there when its position has not changed for so long; TSTOP, which ends the motion itself, may be 0. HI
/// gives a stall 250 ms (decision 0009); hosts poll slowly.
const STANDS: Duration = Duration::from_millis(500);

/// The end of a move that reaches its goal. A breakaway does not: the link stays, and its tip closes alone.
const REACHED: &[EndCode] = &[EndCode::Arrived];

/// Ends of a move that closes: an object stops it, or the spread's stop, which lies before its closed position.
const CLOSED: &[EndCode] = &[EndCode::Arrived, EndCode::Breakaway, EndCode::Stalled, EndCode::Strain];

/// A move of fingers.
struct Goals {
    /// Hall counts of links; their tips go a third of the joint angle along.
    link: i64,
    /// Hall counts of the spread.
    spread: i64,
    /// How it may end.
    ends: &'static [EndCode],
}

/// Motors as digits.
fn digits(motors: Motors) -> String {
    motors.iter().map(|motor| motor.number().to_string()).collect()
}

/// Whether a SET begins a move of mode 5. CMD's others reset, store or idle a board.
fn begins_move(property: Property, value: i64) -> bool {
    match property {
        Property::MODE => value == i64::from(ModeCode::Trapezoidal),
        Property::CMD => {
            !matches!(Cmd::of(value), None | Some(Cmd::T | Cmd::Load | Cmd::Save | Cmd::Def | Cmd::Reset))
        }
        _ => false,
    }
}

impl Hand {
    /// Finds the stops of motors and moves them to 0 (the manual's findZero): links open to their stops, and wait there, out of the way, while the spread
    /// opens and the tips close to theirs; they return to 0 last. `motors` is a prefix of the language: `13`, `G`, `S`, `X15`, or empty for all with
    /// EN. The workspace must be clear. The progress has the positions of links that open.
    ///
    /// # Errors
    /// ERR 4: a motor has not found its stop, while the others have; those of every call.
    pub fn find_zero(
        &mut self,
        motors: &str,
        limit: Duration,
        progress: OnProgress,
    ) -> Result<(), CallError> {
        let failed = |failure| CallError { call: format!("find zero of {motors}"), failure };
        let deadline = Deadline::after(limit);
        let prefix = super::prefix(motors).map_err(failed)?;
        let parsed = Prefix::parse(prefix.as_bytes()).unwrap_or_default();
        let named = parsed.select(self.enabled(parsed, &deadline)?).motors();
        let (links, others) = (named.intersection(Motors::LINKS), named.difference(Motors::LINKS));
        if links.is_empty() || others.is_empty() {
            return self.motion(motors, "HI", deadline.remaining(), progress).map_err(of_step(limit));
        }
        self.was_cancelled.store(false, Ordering::SeqCst);
        // Wakes them, as HI does.
        self.parameter(&format!("X{}", digits(named)), "EN", deadline.remaining()).map_err(of_step(limit))?;
        let (links, others) = (digits(links), digits(others));
        self.open_to_stops(&links, &deadline, progress).map_err(of_step(limit))?;
        let mut sum = Status::OK;
        for motors in [others, links] {
            match self.motion(&format!("X{motors}"), "HI", deadline.remaining(), progress) {
                Ok(()) => {}
                // One bad finger does not keep the others from starting.
                Err(CallError { failure: Failure::Status(status), .. }) => sum |= status,
                Err(error) => return Err(of_step(limit)(error)),
            }
        }
        if sum.is_ok() { Ok(()) } else { Err(failed(Failure::Status(sum))) }
    }

    /// The motors with EN, if a prefix asks for them.
    fn enabled(&mut self, prefix: Prefix, deadline: &Deadline) -> Result<Motors, CallError> {
        if prefix.given || prefix.exclusive {
            return Ok(Motors::ALL);
        }
        let values = self.parameter(&format!("X{NODES}"), "EN", deadline.remaining())?;
        let enabled = Motors::ALL.iter().zip(values).filter(|(_, value)| *value != 0);
        Ok(enabled.map(|(motor, _)| motor).collect())
    }

    /// Drives links to their open stops as HI does, at IVEL, and switches them off there. One that cannot move is left to HI.
    fn open_to_stops(
        &mut self,
        links: &str,
        deadline: &Deadline,
        progress: OnProgress,
    ) -> Result<(), CallError> {
        for (node, velocity) in self.get_with(links, Property::IVEL, deadline.remaining(), progress)? {
            self.set(&node.number().to_string(), Property::V, velocity, deadline.remaining())?;
        }
        let outcome = self
            .set(links, Property::MODE, ModeCode::Velocity.into(), deadline.remaining())
            .and_then(|()| self.until_standing(links, deadline, progress))
            .and_then(|()| self.set(links, Property::MODE, ModeCode::Idle.into(), deadline.remaining()));
        if outcome.is_err() {
            // A lost connection is the call's own failure already.
            let _ = self.session.abort();
        }
        outcome
    }

    /// Polls until no link is in mode 4, or all stand.
    fn until_standing(
        &mut self,
        links: &str,
        deadline: &Deadline,
        progress: OnProgress,
    ) -> Result<(), CallError> {
        let failed = |failure| CallError { call: format!("open {links} to their stops"), failure };
        let (mut last, mut stands) = (Vec::new(), deadline.within(STANDS));
        loop {
            let modes = self.get_with(links, Property::MODE, deadline.remaining(), progress)?;
            let values = self.get_with(links, Property::P, deadline.remaining(), progress)?;
            if values != last {
                (last, stands) = (values.clone(), deadline.within(STANDS));
            }
            let is_cancelled = progress(&Progress { elapsed: deadline.elapsed(), values }).is_break();
            if is_cancelled || self.was_cancelled.load(Ordering::SeqCst) {
                return Err(failed(Failure::Cancelled));
            }
            if deadline.is_over() {
                return Err(failed(Failure::TimedOut(deadline.limit())));
            }
            let is_driven = |(_, mode): &(Node, i64)| *mode == i64::from(ModeCode::Velocity);
            if stands.is_over() || !modes.iter().any(is_driven) {
                return Ok(());
            }
            self.rest(&deadline.within(POLL)).map_err(failed)?;
        }
    }

    /// Moves fingers to a position of their links in hall counts, and their tips by a third of the joint angle (the manual's move). `fingers`
    /// is of 1, 2, 3 and 4 (the spread). The progress has the positions.
    ///
    /// # Errors
    /// [`Failure::NotReached`], and those of every call.
    pub fn move_halls(
        &mut self,
        fingers: &str,
        halls: i64,
        limit: Duration,
        progress: OnProgress,
    ) -> Result<(), CallError> {
        let goals = Goals { link: halls, spread: halls, ends: REACHED };
        self.move_fingers(&format!("move {fingers} to {halls} hall counts"), fingers, &goals, limit, progress)
    }

    /// Moves fingers to position 0, with their tips (the manual's open).
    ///
    /// # Errors
    /// Those of [`Self::move_halls`].
    pub fn open_fingers(
        &mut self,
        fingers: &str,
        limit: Duration,
        progress: OnProgress,
    ) -> Result<(), CallError> {
        let goals = Goals { link: 0, spread: 0, ends: REACHED };
        self.move_fingers(&format!("open {fingers}"), fingers, &goals, limit, progress)
    }

    /// Moves fingers to the defaults of their CT, or until an object stops them, with their tips (the manual's close).
    ///
    /// # Errors
    /// Those of [`Self::move_halls`].
    pub fn close_fingers(
        &mut self,
        fingers: &str,
        limit: Duration,
        progress: OnProgress,
    ) -> Result<(), CallError> {
        let closed = |kind| Property::CT.rules().default_for_motor(kind).map_or(0, i64::from);
        let goals = Goals { link: closed(MotorKind::Link), spread: closed(MotorKind::Spread), ends: CLOSED };
        self.move_fingers(&format!("close {fingers}"), fingers, &goals, limit, progress)
    }

    fn move_fingers(
        &mut self,
        call: &str,
        fingers: &str,
        goals: &Goals,
        limit: Duration,
        progress: OnProgress,
    ) -> Result<(), CallError> {
        let failed = |failure| CallError { call: call.to_owned(), failure };
        let deadline = Deadline::after(limit);
        let is_finger = |c: char| matches!(c, '1'..='4');
        if fingers.is_empty() || !fingers.chars().all(is_finger) {
            return Err(failed(Failure::Invalid(
                "fingers 1, 2, 3, or 4 for the spread, such as 13".to_owned(),
            )));
        }
        self.was_cancelled.store(false, Ordering::SeqCst);
        let (spread, links): (String, String) = fingers.chars().partition(|finger| *finger == '4');
        // The tip of link 1 is node 5.
        let tips: String = links.bytes().map(|byte| char::from(byte + 4)).collect();
        let all = format!("{links}{spread}{tips}");
        let ends = [(&links, goals.link), (&spread, goals.spread), (&tips, tip_travel_along(goals.link))];
        for (nodes, goal) in ends.into_iter().filter(|(nodes, _)| !nodes.is_empty()) {
            self.set_with(nodes, Property::E, goal, deadline.remaining(), progress)
                .map_err(of_step(limit))?;
        }
        let moving = ModeCode::Trapezoidal.into();
        let begun = self.set_with(&all, Property::MODE, moving, deadline.remaining(), progress);
        if let Err(error) = begun {
            // Some boards may have taken it.
            let _ = self.session.abort();
            return Err(of_step(limit)(error));
        }
        self.until_moved(call, &all, &deadline, progress)?;
        let reasons = self.get(&all, Property::END, deadline.remaining()).map_err(of_step(limit))?;
        let is_right = |end: i64| EndCode::of(end).is_some_and(|end| goals.ends.contains(&end));
        let Some((node, end)) = reasons.into_iter().find(|(_, end)| !is_right(*end)) else {
            return Ok(());
        };
        if self.was_cancelled.load(Ordering::SeqCst) {
            return Err(failed(Failure::Cancelled));
        }
        let errors = self
            .get(&node.number().to_string(), Property::ERROR, deadline.remaining())
            .map_err(of_step(limit))?;
        let fault = errors.first().and_then(|(_, code)| FaultCode::of(*code));
        let stop = match (fault, EndCode::of(end)) {
            (None, Some(EndCode::Stalled | EndCode::Breakaway)) => {
                self.stop_of(node, deadline.remaining()).map_err(of_step(limit))?
            }
            _ => None,
        };
        Err(failed(Failure::NotReached { node, end, fault, stop }))
    }

    /// The stop that a joint stands at, hall counts; `None` away from both.
    fn stop_of(&mut self, node: Node, limit: Duration) -> Result<Option<i64>, CallError> {
        let places = self.get(&node.number().to_string(), Property::P, limit)?;
        let kind = Motor::new(node.number()).map(Motor::kind);
        let stops = kind.map_or([0; 2], MotorKind::range_counts).map(i64::from);
        let is_near = |stop: &i64| places.iter().any(|(_, place)| (place - stop).abs() <= AT_STOP);
        Ok(stops.into_iter().find(is_near))
    }

    /// Polls until no board is in mode 5. The progress has the positions. Whatever ends the wait before aborts the move: boards that do not
    /// answer, a cancel, the limit.
    fn until_moved(
        &mut self,
        call: &str,
        nodes: &str,
        deadline: &Deadline,
        progress: OnProgress,
    ) -> Result<(), CallError> {
        let outcome = self.poll_moves(call, nodes, deadline, progress);
        if outcome.is_err() {
            // A lost connection is the call's own failure already.
            let _ = self.session.abort();
        }
        outcome
    }

    fn poll_moves(
        &mut self,
        call: &str,
        nodes: &str,
        deadline: &Deadline,
        progress: OnProgress,
    ) -> Result<(), CallError> {
        let failed = |failure| CallError { call: call.to_owned(), failure };
        let limit = deadline.limit();
        loop {
            let mut get = |property| {
                self.get_with(nodes, property, deadline.remaining(), progress).map_err(of_step(limit))
            };
            let (modes, values) = (get(Property::MODE)?, get(Property::P)?);
            let seen = Progress { elapsed: deadline.elapsed(), values };
            if modes.iter().all(|(_, mode)| *mode != i64::from(ModeCode::Trapezoidal)) {
                let _ = progress(&seen);
                return Ok(());
            }
            if progress(&seen).is_break() {
                return Err(failed(Failure::Cancelled));
            }
            if deadline.is_over() {
                return Err(failed(Failure::TimedOut(limit)));
            }
            self.rest(&deadline.within(POLL)).map_err(failed)?;
        }
    }

    /// Runs a line. If it begins moves by MODE 5 or CMD, waits until they are over (the manual's command).
    ///
    /// # Errors
    /// Those of [`Self::command_with`]; boards that fall silent.
    pub fn command_and_wait(
        &mut self,
        line: &str,
        limit: Duration,
        progress: OnProgress,
    ) -> Result<Vec<String>, CallError> {
        let deadline = Deadline::after(limit);
        let lines = self.command_with(line, limit, progress)?;
        let upper = line.to_ascii_uppercase();
        if let Ok(Statement::Lower(Request::Set(motors, property, value))) = grammar::parse(&upper)
            && begins_move(property, value)
        {
            let nodes: String = motors.iter().map(|motor| motor.number().to_string()).collect();
            self.until_moved(line, &nodes, &deadline, progress)?;
        }
        Ok(lines)
    }

    /// Stores positions and parameters of boards, and with node 0 the hand's own parameters (the manual's saveParameters). Motors should be in
    /// mode 0: only a position at rest is trusted at the next power-on. [`Self::prepare_power_off`] sees to that itself.
    ///
    /// # Errors
    /// ERR 512: a flash has not taken them; ERR 1: a board sleeps or is silent; node 0 by CAN, before anything is sent.
    pub fn save_nodes(&mut self, nodes: &str, limit: Duration) -> Result<(), CallError> {
        let call = format!("save {nodes}");
        let failed = |failure| CallError { call: call.clone(), failure };
        let deadline = Deadline::after(limit);
        let (god, boards): (String, String) = nodes.chars().partition(|node| *node == '0');
        if !god.is_empty() {
            self.needs_god().map_err(failed)?;
        }
        if god.is_empty() || !boards.is_empty() {
            self.set(&boards, Property::SAVE, -1, deadline.remaining()).map_err(of_step(limit))?;
            self.rest(&deadline.within(STORE)).map_err(failed)?;
            let errors = self.get(&boards, Property::ERROR, deadline.remaining()).map_err(of_step(limit))?;
            if errors.iter().any(|(_, code)| FaultCode::of(*code) == Some(FaultCode::Storage)) {
                return Err(failed(Failure::Status(Status::NOT_STORED)));
            }
        }
        if !god.is_empty() {
            self.command("PSAVE", deadline.remaining()).map_err(of_step(limit))?;
        }
        Ok(())
    }
}
