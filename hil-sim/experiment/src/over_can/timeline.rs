//! The scenario's timeline over CAN: commands, polls and answers, a millisecond at a time.

use servo_core::Command;
use servo_core::mode::Mode;
use tater_fw::codes::mode_code;
use tater_fw::motion;
use tater_wire::{Cmd, MotorKind, Property};

use super::board_view::{Ask, BoardView};
use super::{BoardResult, Job, ObservedBoard, OverCan};
use crate::properties::PROPERTIES;
use crate::run::POLL_MS as HOST_MS;
use crate::scenario::{Action, Order, Scenario};
use servo_core::way::Way;

impl<S: ObservedBoard> OverCan<S> {
    /// Runs a scenario on all boards at once. The jobs' motors replace the boards' at the start: during the boot a rotor would coast and
    /// a winding cool down.
    ///
    /// # Errors
    /// A board refuses a property, does not answer, or has stopped for good.
    pub fn run(
        &mut self,
        scenario: &Scenario,
        jobs: Vec<Job>,
        poll_ms: u32,
    ) -> Result<Vec<BoardResult>, String> {
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
        // The native board ticks at whole milliseconds.
        let begin_us = (self.bus.now_us() / 1000 + 1) * 1000 + self.phase_us;
        self.rest("setting up", begin_us - self.bus.now_us())?;
        let mut boards = Vec::new();
        for (index, job) in jobs.into_iter().enumerate() {
            let Some(station) = self.bus.station_mut(index) else { break };
            let mut rig = job.rig.clone().starting_at(begin_us);
            // The same noise sequence as for a board created with this rig.
            rig.analog();
            *station.rig_mut() = rig;
            boards.push(BoardView::new(job, station, begin_us));
        }
        let count = u32::try_from(boards.len()).unwrap_or(1);
        play(self, scenario, &mut boards, begin_us, poll_ms * count)?;
        Ok(boards.into_iter().map(|board| board.finish()).collect())
    }
}

fn play<S: ObservedBoard>(
    host: &mut OverCan<S>,
    scenario: &Scenario,
    boards: &mut [BoardView],
    begin_us: u64,
    poll_ms: u32,
) -> Result<(), String> {
    let mut timeline = scenario.timeline.iter().peekable();
    for ms in 0..scenario.duration_ms {
        while let Some(timed) = timeline.next_if(|timed| timed.ms <= ms) {
            for (index, board) in boards.iter_mut().enumerate() {
                apply(&timed.action, host, board, index);
            }
        }
        for board in boards.iter_mut() {
            // Hosts poll; modes 2 and 4 end without a host.
            if ms.is_multiple_of(HOST_MS) {
                board.poll(&[Property::MODE, Property::ERROR]);
            }
            if poll_ms > 0 && ms.is_multiple_of(poll_ms) {
                board.poll(&[Property::T, Property::MODE, Property::P]);
            }
        }
        exchange(host, boards, begin_us + 1000 * (u64::from(ms) + 1))?;
        for (board, station) in boards.iter_mut().zip(host.bus.stations()) {
            board.tick(ms, station);
        }
        host.check()?;
        host.report_progress("scenario", u64::from(ms), u64::from(scenario.duration_ms));
    }
    // Read the state that the last tick left.
    for board in boards.iter_mut() {
        board.poll(&[Property::T, Property::MODE, Property::P, Property::ERROR]);
    }
    exchange(host, boards, host.bus.now_us() + LAST_US)?;
    for board in boards.iter_mut() {
        board.close(scenario.duration_ms);
    }
    Ok(())
}

/// Time for four answers of each of seven boards, us.
const LAST_US: u64 = 10_000;

fn exchange<S: ObservedBoard>(
    host: &mut OverCan<S>,
    boards: &mut [BoardView],
    until_us: u64,
) -> Result<(), String> {
    loop {
        let now_us = host.bus.now_us();
        let mut wake_us = until_us;
        for board in boards.iter_mut() {
            board.pump(host, now_us)?;
            wake_us = wake_us.min(board.due_us().filter(|&due| due > now_us).unwrap_or(until_us));
        }
        match host.bus.wait(wake_us) {
            Some(stamped) => boards.iter_mut().for_each(|board| board.receive(&stamped.frame, stamped.at_us)),
            None if host.bus.now_us() >= until_us => return Ok(()),
            None => {}
        }
    }
}

fn apply<S: ObservedBoard>(action: &Action, host: &mut OverCan<S>, board: &mut BoardView, index: usize) {
    match action {
        Action::Order(order) => {
            if let Some((property, value, echo)) = as_property(order, board) {
                board.ask(Ask::Order { order: *order, property, value, echo });
            }
        }
        Action::Set(rows) => {
            for (property, value) in rows {
                board.ask(Ask::Set(property.property, *value));
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

/// An order as a property, and the property with which a host verifies it, with its value if the board obeyed.
fn as_property(order: &Order, board: &BoardView) -> Option<(Property, i64, (Property, Option<i64>))> {
    let mode = |mode: Mode| (Property::MODE, Some(mode_code(mode).into()));
    let cmd = |cmd: Cmd| (Property::CMD, i64::from(cmd.number()));
    let is_steered = |of: Mode| board.mode() == of;
    let command = match *order {
        Order::Command(command) => command,
        Order::Abort if is_steered(Mode::Idle) => return None,
        Order::Abort => Command::Mode(if board.holds() { Mode::Pid } else { Mode::Idle }),
    };
    let ((property, value), echo) = match command {
        Command::Mode(to) => ((Property::MODE, mode_code(to).into()), mode(to)),
        // The limits may reduce it.
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
        Command::TorqueControlled { way: Way::Closing } => (cmd(Cmd::Tc), mode(Mode::Velocity)),
        Command::TorqueControlled { way: Way::Opening } => (cmd(Cmd::To), mode(Mode::Velocity)),
        Command::Home => (cmd(Cmd::Hi), mode(Mode::Velocity)),
        Command::Find => ((Property::FIND, 1), (Property::FIND, None)),
        Command::Terminate => (cmd(Cmd::T), mode(Mode::Idle)),
        Command::ClearFault => ((Property::STAT, 2), (Property::ERROR, Some(0))),
        // Not available in scenarios.
        Command::Configure(_) | Command::ClearBreakaway | Command::MoveToEnd => return None,
    };
    Some((property, value, echo))
}
