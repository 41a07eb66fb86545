//! A motion of some motors (manual 5.5), as one state machine: prepare, start, follow, judge, restore.
//!
//! All motors start together: an order is one frame, with goal and mode. Each motion ends when its board reports so (LFLAGS). Boards are
//! polled as well, because a report may be lost, and because a board in mode 4 takes a silent host for lost.
//!
//! # Deadlines
//! A motor ends its share of the command, with a status, when
//! * its board refused the order: with the first answers, some ms after it;
//! * its board left the motion without an END, or the report was lost: within two polls, 100 ms;
//! * its board is silent: after [`LOST_US`]. It gets the order to stop at each poll, and twice before the host learns of it.
//!
//! A board ends a motion without a hall count after TSTOP (never with TSTOP 0). ^C drops the command at any time.

use tater_wire::{Cmd, EndCode, FaultCode, ModeCode, Property};

use crate::boards::{Answers, REPORTS, Reported};
use crate::events::EventKind;
use crate::god::God;
use crate::motors::{COUNT, Motor, Motors};
use crate::status::Status;
use crate::{order, pace, query, units};

/// Interval at which boards are polled, µs.
const POLL_US: u64 = 50_000;

/// A polled board that is silent for this long counts as absent, µs: four polls.
const LOST_US: u64 = 200_000;

/// Reaction of a finger whose link breaks away (manual 5.1.2). The link is always locked; with BS of the link its tip stops as well.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Breakaway {
    /// Breakaway is off: BT is 0 for the motion. With X "breakaways become irrelevant", and a link that meets something stalls.
    Off,
    TipGoesOn,
    /// The tip goes to this position instead, GCL counts: C, to envelop the object.
    TipGoesTo(Answers),
    /// The tip stops: without its link it cannot keep its direction (WM).
    TipStops,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Plan {
    pub motors: Motors,
    /// Start positions, GCL counts; motors that move until they stall have neither this nor a goal.
    pub from: Answers,
    /// GCL counts.
    pub goals: Answers,
    /// Motors that get this number of CMD instead of M with their goal.
    pub order: Option<(Motors, Cmd)>,
    /// Whether a motor that does not reach its goal is an error.
    pub is_judged: bool,
    pub breakaway: Breakaway,
    /// Motors that arrive together; those of a finger, if they move until they stall, only move together.
    pub together: [Motors; 3],
}

impl Plan {
    pub fn by_command(motors: Motors, cmd: Cmd, together: [Motors; 3]) -> Self {
        let (from, goals) = (Answers::default(), Answers::default());
        let order = Some((motors, cmd));
        Self { motors, from, goals, order, is_judged: false, breakaway: Breakaway::TipGoesOn, together }
    }

    pub fn to(goals: Answers, from: Answers) -> Self {
        let (motors, breakaway) = (goals.motors(), Breakaway::TipGoesOn);
        Self { motors, from, goals, order: None, is_judged: true, breakaway, together: [Motors::NONE; 3] }
    }

    const fn cmd(&self, motor: Motor) -> Option<Cmd> {
        match self.order {
            Some((motors, cmd)) if motors.has(motor) => Some(cmd),
            _ => None,
        }
    }

    fn runs_in(&self, motor: Motor, mode: i64) -> bool {
        let mode = ModeCode::of(mode);
        match self.cmd(motor) {
            // Velocity to its stop, then position back to zero.
            Some(Cmd::Hi) => matches!(mode, Some(ModeCode::Velocity | ModeCode::Trapezoidal)),
            Some(Cmd::Tc | Cmd::To) => mode == Some(ModeCode::Velocity),
            _ => mode == Some(ModeCode::Trapezoidal),
        }
    }
}

/// Runs a motion to its end on every motor. Returns the sum of their codes; S has each motor's own.
pub(crate) async fn run(god: &God<'_>, plan: &Plan) -> Status {
    let status = match Motion::prepare(god, plan).await {
        Ok(mut motion) => {
            let unstarted = motion.start(plan.motors, &plan.goals).await;
            motion.follow(unstarted).await;
            let status = motion.judge(unstarted).await;
            motion.stop_silent().await;
            status
        }
        Err(refusal) => refusal,
    };
    order::restore_properties(god, Motors::NONE).await;
    status
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Share {
    #[default]
    None,
    Moving {
        /// The board answered a mode that is not one of this motion: with END 0 after that, it has dropped out.
        left: bool,
    },
    Ended(EndCode),
    /// Its board did not begin the motion, or left it, without an END: a latched fault, IVEL 0, another host.
    Dropped,
    /// Its board stopped answering; the motor may still move.
    Silent,
}

impl Share {
    const fn is_moving(self) -> bool {
        matches!(self, Self::Moving { .. })
    }
}

struct Motion<'a, 'g> {
    god: &'a God<'g>,
    plan: &'a Plan,
    holding: Motors,
    /// Links with BS: their tips stop with them.
    tips_stop: Motors,
    shares: [Share; COUNT],
    started_us: u64,
}

impl Motion<'_, '_> {
    fn share(&self, motor: Motor) -> Share {
        self.shares.get(motor.index()).copied().unwrap_or_default()
    }

    fn set_share(&mut self, motor: Motor, share: Share) {
        if let Some(place) = self.shares.get_mut(motor.index()) {
            *place = share;
        }
    }

    fn filter(&self, is: impl Fn(Share) -> bool) -> Motors {
        self.plan.motors.iter().filter(|&motor| is(self.share(motor))).collect()
    }

    fn moving(&self) -> Motors {
        self.filter(Share::is_moving)
    }

    fn silent(&self) -> Motors {
        self.filter(|share| share == Share::Silent)
    }

    fn ended_by(&self, code: EndCode) -> Motors {
        self.filter(|share| share == Share::Ended(code))
    }
}

impl<'a, 'g> Motion<'a, 'g> {
    async fn prepare(god: &'a God<'g>, plan: &'a Plan) -> Result<Self, Status> {
        let motors = plan.motors;
        god.boards.set(motors, Property::LFLAGS, REPORTS).await;
        let holding = query::property(god, motors, Property::HOLD).await?.filter(|hold| hold != 0);
        let mut tips_stop = Motors::NONE;
        if let Breakaway::Off = plan.breakaway {
            let own = query::property(god, motors, Property::BT).await?;
            let off = Answers::uniform(own.filter(|bt| bt != 0), 0);
            order::override_property(god, Property::BT, &off, &own).await;
        } else {
            let links = motors.intersection(Motors::LINKS);
            tips_stop = query::property(god, links, Property::BS).await?.filter(|bs| bs != 0);
        }
        match plan.order {
            Some((_, cmd @ (Cmd::Tc | Cmd::To))) => {
                pace::move_along(god, &plan.together, cmd == Cmd::Tc).await?;
            }
            _ => pace::arrive_together(god, &plan.together, &plan.from, &plan.goals).await?,
        }
        Ok(Self { god, plan, holding, tips_stop, shares: [Share::None; COUNT], started_us: 0 })
    }
}

impl Motion<'_, '_> {
    /// Starts motors. Returns those that have ended or dropped out at once.
    ///
    /// A board that gets an order while its motor moves reports the end of the former motion first. To tell the two apart, each board is
    /// asked for E after its order: what arrives before this answer may belong to the former motion, what follows belongs to this one.
    ///
    /// A board that refused the order has END 0 and another mode. MODE is asked before END: a motion that ends in between has its END.
    async fn start(&mut self, motors: Motors, goals: &Answers) -> Motors {
        let boards = &self.god.boards;
        self.god.session.begin_motion(motors, self.holding);
        for motor in motors.iter() {
            self.set_share(motor, Share::Moving { left: false });
            let alone = Motors::only(motor);
            match (self.plan.cmd(motor), goals.get(motor)) {
                (Some(cmd), _) => boards.set(alone, Property::CMD, cmd.into()).await,
                (None, Some(goal)) => {
                    // The manual's 20000 is beyond every joint, and goes to its stop: it is judged by the goal that was asked for.
                    let halls = motor.kind().nearest_goal(units::halls_from_gcl(goal));
                    boards.set(alone, Property::M, halls).await;
                }
                (None, None) => {}
            }
        }
        let ordered = boards.get(motors, Property::E).await.motors();
        motors.iter().for_each(|motor| _ = boards.take_reported(motor));
        let modes = boards.get(ordered, Property::MODE).await;
        let ends = boards.get(ordered, Property::END).await;
        motors.difference(ends.motors()).iter().for_each(|motor| self.set_share(motor, Share::Silent));
        for motor in ends.motors().iter() {
            self.note(motor, Reported { mode: modes.get(motor), end: None });
            self.note(motor, Reported { mode: None, end: ends.get(motor) });
        }
        self.started_us = self.god.io.now_us();
        ends.motors().difference(self.moving())
    }
}

impl Motion<'_, '_> {
    /// Waits until no motor moves any more, and acts on each end; `over` are those that have ended or dropped out already.
    async fn follow(&mut self, mut over: Motors) {
        let (io, boards) = (self.god.io, &self.god.boards);
        let mut poll_us = io.after_us(POLL_US);
        loop {
            let moving = self.moving();
            moving.iter().for_each(|motor| self.note(motor, boards.take_reported(motor)));
            over = over.union(moving.difference(self.moving()));
            while !over.is_empty() {
                over = self.act_on_ends(over).await;
            }
            if self.moving().is_empty() {
                return;
            }
            boards.wait_for_report(poll_us).await;
            if io.now_us() >= poll_us {
                boards.ask(self.moving(), Property::MODE).await;
                boards.ask(self.moving(), Property::END).await;
                self.find_silent();
                // A board that only lost some frames obeys this.
                order::stop(self.god, self.silent(), self.holding).await;
                poll_us = io.after_us(POLL_US);
            }
        }
    }

    fn note(&mut self, motor: Motor, reported: Reported) {
        let Share::Moving { left } = self.share(motor) else { return };
        let share = match (reported.end, reported.mode) {
            (Some(0), _) if left => {
                self.god.io.record(EventKind::Refused { motor });
                Share::Dropped
            }
            // A value that the table lacks is no success.
            (Some(end), _) if end != 0 => Share::Ended(EndCode::of(end).unwrap_or(EndCode::Fault)),
            (_, Some(mode)) => Share::Moving { left: !self.plan.runs_in(motor, mode) },
            (_, None) => return,
        };
        self.set_share(motor, share);
    }

    fn find_silent(&mut self) {
        for motor in self.moving().iter() {
            let received_us = self.god.boards.received_us(motor).max(self.started_us);
            let lost_us = LOST_US.saturating_add(self.god.io.link_us());
            if self.god.io.now_us() >= received_us.saturating_add(lost_us) {
                self.set_share(motor, Share::Silent);
            }
        }
    }

    /// Acts on motors that have ended or dropped out, and on those that depend on them. Returns motors that were restarted and ended at once.
    /// Silent motors stay in the session, so that ^C stops them too.
    async fn act_on_ends(&mut self, over: Motors) -> Motors {
        self.god.session.end_motion(over);
        if let Some((ordered, Cmd::Tc | Cmd::To)) = self.plan.order {
            let stalled = over.intersection(ordered).intersection(self.ended_by(EndCode::Stalled));
            // At once: the last motor may end long after them.
            self.god.session.press(stalled.intersection(self.holding));
            // The tip of a link that an object has stopped continues alone, as in a breakaway.
            order::restore_speed(self.god, stalled.tips().intersection(self.moving())).await;
        }
        let mut again = Motors::NONE;
        for link in over.intersection(self.ended_by(EndCode::Breakaway)).iter() {
            if let Some(tip) = link.tip().filter(|&tip| self.plan.motors.has(tip)) {
                again = again.union(self.act_on_breakaway(link, Motors::only(tip)).await);
            }
        }
        again
    }

    async fn act_on_breakaway(&mut self, link: Motor, tip: Motors) -> Motors {
        match &self.plan.breakaway {
            Breakaway::TipGoesTo(goals) if !self.tips_stop.has(link) => {
                // A tip that stopped short of its goal, by strain for instance, does not continue.
                let continuing = tip.intersection(self.moving().union(self.ended_by(EndCode::Arrived)));
                order::restore_speed(self.god, continuing).await;
                return self.start(continuing, goals).await;
            }
            Breakaway::TipGoesOn | Breakaway::Off if !self.tips_stop.has(link) => {}
            _ => order::stop(self.god, tip.intersection(self.moving()), self.holding).await,
        }
        Motors::NONE
    }

    async fn stop_silent(&self) {
        let silent = self.silent();
        if !silent.is_empty() {
            order::stop(self.god, silent, self.holding).await;
            self.god.boards.get(silent, Property::MODE).await;
            order::stop(self.god, silent, self.holding).await;
        }
        self.god.session.end_motion(Motors::ALL);
    }
}

impl Motion<'_, '_> {
    /// The status of each motor, into S, and their sum; `unstarted` had ended or dropped out before they could begin.
    async fn judge(&self, unstarted: Motors) -> Status {
        let (god, plan) = (self.god, self.plan);
        let answering = plan.motors.difference(self.silent());
        let judged = if plan.is_judged { answering.intersection(plan.goals.motors()) } else { Motors::NONE };
        let positions = query::known_positions(god, judged).await;
        let tolerances = query::known_counts(god, judged, Property::MPE).await;
        let errors = god.boards.get(answering, Property::ERROR).await;
        let mut lost = query::uninitialized(god, answering).await;
        match plan.order {
            Some((motors, Cmd::Hi)) => lost = lost.union(motors.intersection(unstarted)),
            Some((motors, Cmd::Tc | Cmd::To)) => {
                let modes = god.boards.get(motors.intersection(answering), Property::MODE).await;
                let pressing = modes.filter(|mode| ModeCode::of(mode) == Some(ModeCode::Velocity));
                god.session.cease_pressing(modes.motors().difference(pressing));
                god.session.press(pressing);
            }
            _ => {}
        }
        let mut sum = Status::OK;
        for motor in plan.motors.iter() {
            let distance =
                plan.goals.get(motor).zip(positions.get(motor)).map(|(goal, at)| (at - goal).abs());
            let tolerance = tolerances.get(motor);
            let answered_all = !judged.has(motor) || (distance.is_some() && tolerance.is_some());
            let status = match errors.get(motor) {
                Some(error) if answered_all => {
                    let share = self.share(motor);
                    let is_stopped = matches!(share, Share::Dropped | Share::Ended(EndCode::Fault));
                    let is_reached = !judged.has(motor) || !(is_stopped || distance > tolerance);
                    judge_motor(share, error, is_reached, lost.has(motor))
                }
                _ => Status::NO_BOARD,
            };
            god.session.set_result(motor, status);
            sum |= status;
        }
        sum
    }
}

/// A motor's status by its share and ERROR; faults of former motions were cleared before this one.
fn judge_motor(share: Share, error: i64, is_reached: bool, is_lost: bool) -> Status {
    let fault = FaultCode::of(error);
    let mut status = Status::OK;
    if !is_reached {
        status |= Status::NOT_REACHED;
    }
    if fault == Some(FaultCode::OverTemperature) {
        status |= Status::OVER_TEMPERATURE;
    }
    if is_lost {
        status |= Status::NOT_INITIALIZED;
    }
    // HI alone raises it: the motor is not only lost, something must be freed.
    if fault == Some(FaultCode::Jammed) {
        status |= Status::FAULT;
    }
    if !status.is_ok() {
        return status;
    }
    match (fault, share) {
        // Its flash cannot forget a stored position, so its board does not let it move.
        (Some(FaultCode::Storage), Share::Dropped | Share::Ended(EndCode::Aborted)) => Status::NOT_STORED,
        (Some(FaultCode::Storage), _) => Status::OK,
        (None, Share::Dropped) => Status::FAULT,
        (None, _) if error == 0 => Status::OK,
        _ => Status::FAULT,
    }
}

#[cfg(test)]
mod tests {
    use crate::motors::Motor;
    use crate::testing::type_line;
    use std::format;
    use tater_wire::{FaultCode, ModeCode, Property};

    /// An initialized board at position 0, with END 0 and this ERROR and mode.
    fn board(property: Property, error: i64, mode: ModeCode) -> i64 {
        match property {
            Property::HALLH => 1 << 30,
            Property::ERROR => error,
            Property::MODE => mode.into(),
            Property::MPE => 4,
            _ => 0,
        }
    }

    #[test]
    fn refused_motor_ends_its_share_within_100_ms() {
        for (line, fault, status) in [
            ("X1TC", None, 8),
            ("X1TC", Some(FaultCode::UnderVoltage), 8),
            ("X1TC", Some(FaultCode::OverTemperature), 8192),
            ("X1TC", Some(FaultCode::Storage), 512),
            ("X1C", None, 8),
            ("X1M 5500", None, 16),
            ("X1M 5500", Some(FaultCode::OverTemperature), 8208),
            ("X1HI", None, 4),
            ("X1HI", Some(FaultCode::OverTemperature), 8196),
            ("X1HI", Some(FaultCode::Jammed), 12),
        ] {
            let error = fault.map_or(0, i64::from);
            let (answer, us) =
                type_line(line, |_: Motor, property, _| Some(board(property, error, ModeCode::Idle)));
            assert_eq!(answer, format!("\r\n\rERR {status}\r\n\r=> "), "{line} {fault:?}");
            assert!(us <= 100_000, "{line} {fault:?}: {us} us");
        }
    }

    #[test]
    fn motor_whose_mode_is_changed_without_end_ends_its_share_within_100_ms() {
        const CHANGED_US: u64 = 1_000_000;
        let (answer, us) = type_line("X1M 5500", |_: Motor, property, now_us| {
            let mode = if now_us < CHANGED_US { ModeCode::Trapezoidal } else { ModeCode::Idle };
            Some(board(property, 0, mode))
        });
        assert_eq!(answer, "\r\n\rERR 16\r\n\r=> ");
        assert!((CHANGED_US..=CHANGED_US + 100_000).contains(&us), "{us} us");
    }

    #[test]
    fn board_that_falls_silent_under_way_ends_its_share_within_430_ms() {
        const SILENT_US: u64 = 1_000_000;
        let (answer, us) = type_line("X12M 5500", |motor: Motor, property, now_us| {
            let mode = if now_us < SILENT_US { ModeCode::Trapezoidal } else { ModeCode::Idle };
            (motor.number() == 2 || now_us < SILENT_US).then(|| board(property, 0, mode))
        });
        assert_eq!(answer, "\r\n\rERR 17\r\n\r=> ");
        assert!((SILENT_US..=SILENT_US + 430_000).contains(&us), "{us} us");
    }
}
