//! The scenario's time: what is said and asked when, a millisecond at a time.

use servo_core::Command;
use servo_core::mode::Mode;
use tater_fw::codes::mode_code;
use tater_fw::motion;
use tater_wire::{Cmd, MotorKind, Property};

use super::seat::{Ask, Seat};
use super::{Job, OverCan, Ran, Watched};
use crate::experiment::properties::PROPERTIES;
use crate::experiment::run::POLL_MS as HOST_MS;
use crate::experiment::scenario::{Action, Scenario};

impl<S: Watched> OverCan<S> {
    /// Runs a scenario with every board at once. Their motors are exchanged for those of the jobs at its beginning: a boot takes
    /// time in which a rotor would coast and a winding cool.
    ///
    /// # Errors
    /// A board that does not take a property, does not answer, or stands still for good.
    pub fn run(&mut self, scenario: &Scenario, jobs: Vec<Job>, poll_ms: u32) -> Result<Vec<Ran>, String> {
        let count = |job: &Job| job.rig.truth().counts.round() as i64;
        for job in &jobs {
            self.put(job.node, Property::LFLAGS, 3)?;
            self.put(job.node, Property::P, count(job))?;
            let defaults = motion::defaults(MotorKind::of(job.node));
            for property in &PROPERTIES {
                let value = property.get(&job.case.config);
                if value != property.get(&defaults) {
                    self.put(job.node, property.property, value)?;
                }
            }
        }
        // A board's tick is at whole milliseconds if it is the native one.
        let begin_us = (self.bus.now_us() / 1000 + 1) * 1000 + self.phase_us;
        self.rest("setting up", begin_us - self.bus.now_us())?;
        let mut seats = Vec::new();
        for (index, job) in jobs.into_iter().enumerate() {
            let Some(station) = self.bus.station_mut(index) else { break };
            let mut rig = job.rig.clone().starting_at(begin_us);
            // As a board that is made with its motor: the noise that follows is the same.
            rig.analog();
            *station.rig_mut() = rig;
            seats.push(Seat::new(job, station, begin_us));
        }
        let boards = u32::try_from(seats.len()).unwrap_or(1);
        play(self, scenario, &mut seats, begin_us, poll_ms * boards)?;
        Ok(seats.into_iter().map(|seat| seat.finish()).collect())
    }
}

/// Plays a scenario's timeline to all boards.
fn play<S: Watched>(
    host: &mut OverCan<S>,
    scenario: &Scenario,
    seats: &mut [Seat],
    begin_us: u64,
    poll_ms: u32,
) -> Result<(), String> {
    let mut timeline = scenario.timeline.iter().peekable();
    for ms in 0..scenario.duration_ms {
        while let Some(timed) = timeline.next_if(|timed| timed.ms <= ms) {
            for (index, seat) in seats.iter_mut().enumerate() {
                act(&timed.action, host, seat, index);
            }
        }
        for seat in seats.iter_mut() {
            // A host polls, and modes 2 and 4 end without one.
            if ms.is_multiple_of(HOST_MS) {
                seat.poll(&[Property::MODE, Property::ERROR]);
            }
            if poll_ms > 0 && ms.is_multiple_of(poll_ms) {
                seat.poll(&[Property::T, Property::MODE, Property::P]);
            }
        }
        exchange(host, seats, begin_us + 1000 * (u64::from(ms) + 1))?;
        for (seat, station) in seats.iter_mut().zip(host.bus.stations()) {
            seat.tick(ms, station);
        }
        host.check()?;
        host.tell("scenario", u64::from(ms), u64::from(scenario.duration_ms));
    }
    // What the last tick has changed is asked for once more.
    for seat in seats.iter_mut() {
        seat.poll(&[Property::T, Property::MODE, Property::P, Property::ERROR]);
    }
    exchange(host, seats, host.bus.now_us() + LAST_US)?;
    for seat in seats.iter_mut() {
        seat.close(scenario.duration_ms);
    }
    Ok(())
}

/// What four answers of each of seven boards take at most, us.
const LAST_US: u64 = 10_000;

/// Sends and receives until `until_us`.
fn exchange<S: Watched>(host: &mut OverCan<S>, seats: &mut [Seat], until_us: u64) -> Result<(), String> {
    loop {
        let now_us = host.bus.now_us();
        let mut wake_us = until_us;
        for seat in seats.iter_mut() {
            seat.pump(host, now_us)?;
            wake_us = wake_us.min(seat.due_us().filter(|&due| due > now_us).unwrap_or(until_us));
        }
        match host.bus.wait(wake_us) {
            Some(stamped) => seats.iter_mut().for_each(|seat| seat.hear(&stamped.frame, stamped.at_us)),
            None if host.bus.now_us() >= until_us => return Ok(()),
            None => {}
        }
    }
}

/// Lets a timed action happen to one board.
fn act<S: Watched>(action: &Action, host: &mut OverCan<S>, seat: &mut Seat, index: usize) {
    match action {
        Action::Command(command) => {
            if let Some((property, value, echo)) = say(command, seat) {
                seat.ask(Ask::Command { command: *command, property, value, echo });
            }
        }
        Action::Set(rows) => {
            for (property, value) in rows {
                seat.ask(Ask::Set(property.property, *value));
            }
        }
        Action::Disturbance(n_m) => {
            if let Some(station) = host.bus.station_mut(index) {
                station.rig_mut().set_disturbance(*n_m);
            }
        }
        Action::Bus(v) => {
            if let Some(station) = host.bus.station_mut(index) {
                station.rig_mut().set_bus(*v);
            }
        }
    }
}

/// A command in properties, and what a host then looks at: the property, and its value if the board has obeyed.
fn say(command: &Command, seat: &Seat) -> Option<(Property, i64, (Property, Option<i64>))> {
    let mode = |mode: Mode| (Property::MODE, Some(mode_code(mode).into()));
    let cmd = |cmd: Cmd| (Property::CMD, i64::from(cmd.number()));
    let is_steered = |of: Mode| seat.mode() == of;
    let ((property, value), echo) = match *command {
        Command::Mode(to) => ((Property::MODE, mode_code(to).into()), mode(to)),
        // The limits may leave less of it.
        Command::Torque(torque) => ((Property::T, i64::from(torque.0)), (Property::MODE, None)),
        Command::Velocity(velocity) => {
            let value = i64::from(velocity.round());
            ((Property::V, value), (Property::V, is_steered(Mode::Velocity).then_some(value)))
        }
        Command::Position(counts) => {
            let value = i64::from(counts);
            ((Property::P, value), (Property::P, (!is_steered(Mode::Pid)).then_some(value)))
        }
        Command::End(counts) => ((Property::E, i64::from(counts)), (Property::E, Some(i64::from(counts)))),
        Command::Move(counts) => ((Property::M, i64::from(counts)), (Property::E, Some(i64::from(counts)))),
        Command::TorqueControlled { closing: true } => (cmd(Cmd::Tc), mode(Mode::Velocity)),
        Command::TorqueControlled { closing: false } => (cmd(Cmd::To), mode(Mode::Velocity)),
        Command::Home => (cmd(Cmd::Hi), mode(Mode::Velocity)),
        Command::Terminate => (cmd(Cmd::T), mode(Mode::Idle)),
        Command::ClearFault => ((Property::STAT, 2), (Property::ERROR, Some(0))),
        // A host that ends a move leaves the motor as HOLD has it (manual 5.5 case 3).
        Command::Abort if is_steered(Mode::Idle) => return None,
        Command::Abort => {
            let to = if seat.holds() { Mode::Pid } else { Mode::Idle };
            ((Property::MODE, mode_code(to).into()), mode(to))
        }
        // The scenario's reader makes neither.
        Command::Configure(_) | Command::ClearBreakaway => return None,
    };
    Some((property, value, echo))
}
