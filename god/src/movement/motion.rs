//! A motion of some motors, from its start to its ends (manual 5.5), and what that comes to.
//!
//! All begin together: an order is one frame, goal and mode in one. Each ends when its board says so (LFLAGS); it is asked as well, because a
//! report may be lost and because boards in mode 4 take a silent host for lost.

use tater_wire::{Cmd, FaultCode, Property};

use super::{moves, pace, ready};
use crate::boards::{
    ABORTED, ARRIVED, Answers, BROKE_AWAY, FAULT, MOVES, REPORTS, Reported, STALLED, VELOCITY,
};
use crate::events::EventKind;
use crate::god::God;
use crate::motors::{Motor, Motors};
use crate::status::Status;
use crate::units;

/// How often boards are asked whether their motion has ended, µs. A board that stops without reporting it has ended its share within two polls.
const POLL_US: u64 = 50_000;

/// A board that is polled and silent for this long counts as absent, µs: four polls.
const LOST_US: u64 = 200_000;

/// What it is to a finger that its link meets an object and breaks away (manual 5.1.2): the link is locked there, its tip may go on. With
/// BS of the link both stop in any case.
#[derive(Clone, Copy, Debug)]
pub(super) enum Breakaway {
    /// There is none: BT is 0 meanwhile. With X "breakaways become irrelevant", and what a link meets stalls it.
    Off,
    /// The tip goes on to its goal.
    TipGoesOn,
    /// The tip goes on to there instead, GCL counts: C, to envelop the object.
    TipGoesTo(Answers),
    /// The tip stops: without its link it cannot keep its direction (WM).
    TipStops,
}

/// What is asked of the boards.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plan {
    /// Who moves.
    pub motors: Motors,
    /// Where they are, GCL counts; what goes until it stalls has neither this nor a goal.
    pub from: Answers,
    /// Where they go.
    pub goals: Answers,
    /// Motors that get this number of CMD, and not M with their goal.
    pub order: Option<(Motors, Cmd)>,
    /// Whether a motor that does not reach its goal is an error.
    pub judged: bool,
    /// What a breakaway is.
    pub breakaway: Breakaway,
    /// Motors that arrive together; those of a finger, if they go until they stall, only go together.
    pub together: [Motors; 3],
}

impl Plan {
    /// By a number of CMD, without a goal.
    pub fn ordered(motors: Motors, cmd: Cmd, together: [Motors; 3]) -> Self {
        let (from, goals) = (Answers::default(), Answers::default());
        let order = Some((motors, cmd));
        Self { motors, from, goals, order, judged: false, breakaway: Breakaway::TipGoesOn, together }
    }

    /// To positions.
    pub fn to(goals: Answers, from: Answers) -> Self {
        let (motors, breakaway) = (goals.motors(), Breakaway::TipGoesOn);
        Self { motors, from, goals, order: None, judged: true, breakaway, together: [Motors::NONE; 3] }
    }

    /// Whether a motor is in this motion while its board is in that mode.
    fn runs_in(&self, motor: Motor, mode: i64) -> bool {
        match self.cmd(motor) {
            // To its stop by velocity, and back by position.
            Some(Cmd::Hi) => mode == VELOCITY || mode == MOVES,
            Some(Cmd::Tc | Cmd::To) => mode == VELOCITY,
            _ => mode == MOVES,
        }
    }

    const fn cmd(&self, motor: Motor) -> Option<Cmd> {
        match self.order {
            Some((motors, cmd)) if motors.has(motor) => Some(cmd),
            _ => None,
        }
    }
}

/// Runs it, and waits for its end on every motor. Each one's code is in S, their sum is returned.
pub(super) async fn run(god: &God<'_>, plan: &Plan) -> Status {
    let status = match prepare(god, plan).await {
        Ok(tips_stop) => {
            let mut motion = Motion::new(god, plan, tips_stop);
            motion.start(plan.motors, &plan.goals).await;
            motion.unstarted = motion.ended.union(motion.dropped);
            motion.follow().await;
            let status = motion.judge().await;
            motion.stop_silent().await;
            status
        }
        Err(refusal) => refusal,
    };
    moves::give_back(god).await;
    status
}

/// All that is set and asked before a motion; which links stop their tips when they break away (BS).
async fn prepare(god: &God<'_>, plan: &Plan) -> Result<Motors, Status> {
    let motors = plan.motors;
    god.boards.set(motors, Property::LFLAGS, REPORTS).await;
    let holding = ready::all(god, motors, Property::HOLD).await?.filter(|hold| hold != 0);
    let mut stops = Motors::NONE;
    if let Breakaway::Off = plan.breakaway {
        let was = ready::all(god, motors, Property::BT).await?;
        let on = was.filter(|bt| bt != 0);
        let mut off = Answers::default();
        on.iter().for_each(|motor| off.set(motor, 0));
        moves::lend(god, Property::BT, &off, &was).await;
    } else {
        let links = motors.intersection(Motors::LINKS);
        stops = ready::all(god, links, Property::BS).await?.filter(|bs| bs != 0);
    }
    match plan.order {
        Some((_, cmd @ (Cmd::Tc | Cmd::To))) => pace::along(god, &plan.together, cmd == Cmd::Tc).await?,
        _ => pace::together(god, &plan.together, &plan.from, &plan.goals).await?,
    }
    god.moves.begin(motors, holding);
    god.lower.forget(motors);
    Ok(stops)
}

/// A motion under way.
struct Motion<'a, 'g> {
    god: &'a God<'g>,
    plan: &'a Plan,
    /// Links whose tips stop with them.
    tips_stop: Motors,
    moving: Motors,
    /// Of the moving ones, those whose end has not had its consequences yet.
    ended: Motors,
    /// Those whose mode is not one of this motion: if END is 0 after that, they have dropped out.
    left: Motors,
    /// Those whose boards have not begun the motion, or have left it, without an END: a latched fault, IVEL 0, another host.
    dropped: Motors,
    /// Those whose boards have stopped answering: nobody knows whether they move.
    silent: Motors,
    /// Those that had ended before they could begin.
    unstarted: Motors,
    /// Why they ended (END).
    ends: Answers,
    /// When the last order was sent, µs.
    started_us: u64,
}

impl<'a, 'g> Motion<'a, 'g> {
    fn new(god: &'a God<'g>, plan: &'a Plan, tips_stop: Motors) -> Self {
        Self {
            god,
            plan,
            tips_stop,
            moving: Motors::NONE,
            ended: Motors::NONE,
            left: Motors::NONE,
            dropped: Motors::NONE,
            silent: Motors::NONE,
            unstarted: Motors::NONE,
            ends: Answers::default(),
            started_us: 0,
        }
    }

    /// Sets motors going.
    ///
    /// A board that takes an order while its motor moves reports the end of that former motion first, which must not count as the end of
    /// this one. So each board is asked for E after its order: it sends everything in order, so what arrives before this answer may belong to
    /// the former motion, and all that arrives after it, END's answer and reports alike, belongs to this one.
    ///
    /// A board that has refused the order has END 0 and a mode that is not the motion's. MODE is asked before END: a motion that ends between
    /// the two has its END.
    async fn start(&mut self, motors: Motors, goals: &Answers) {
        let boards = &self.god.boards;
        self.moving = self.moving.union(motors);
        self.god.moves.go_on(self.moving.union(self.silent));
        for motor in motors.iter() {
            let alone = Motors::only(motor);
            match (self.plan.cmd(motor), goals.get(motor)) {
                (Some(cmd), _) => boards.set(alone, Property::CMD, cmd.number().into()).await,
                (None, Some(goal)) => boards.set(alone, Property::M, units::halls(goal)).await,
                (None, None) => {}
            }
        }
        let ordered = boards.get(motors, Property::E).await.motors();
        motors.iter().for_each(|motor| _ = boards.take_reported(motor));
        let modes = boards.get(ordered, Property::MODE).await;
        let ends = boards.get(ordered, Property::END).await;
        self.silent = self.silent.union(motors.difference(ends.motors()));
        for motor in ends.motors().iter() {
            self.note(motor, Reported { mode: modes.get(motor), end: None });
            self.note(motor, Reported { mode: None, end: ends.get(motor) });
        }
        self.started_us = self.god.io.now_us();
    }

    /// Waits until every motor's motion has ended, and acts on each end.
    async fn follow(&mut self) {
        let (io, boards) = (self.god.io, &self.god.boards);
        let mut poll_us = io.after_us(POLL_US);
        loop {
            if io.now_us() >= poll_us {
                boards.ask(self.moving, Property::MODE).await;
                boards.ask(self.moving, Property::END).await;
                self.find_silent();
                // One that has only lost some frames stops.
                moves::stop(self.god, self.silent).await;
                poll_us = io.after_us(POLL_US);
            }
            for motor in self.moving.iter() {
                self.note(motor, boards.take_reported(motor));
            }
            self.act_on_ends().await;
            if self.moving.is_empty() {
                return;
            }
            boards.wait_for_report(poll_us).await;
        }
    }

    /// Notes what a board says of mode and end.
    fn note(&mut self, motor: Motor, reported: Reported) {
        match reported.end {
            None => {}
            Some(0) if self.left.has(motor) => {
                self.dropped = self.dropped.with(motor);
                self.god.io.record(EventKind::Refused { motor });
            }
            Some(0) => {}
            Some(end) => {
                self.ends.set(motor, end);
                self.ended = self.ended.with(motor);
            }
        }
        match reported.mode {
            None => {}
            Some(mode) if self.plan.runs_in(motor, mode) => self.left = self.left.without(motor),
            Some(_) => self.left = self.left.with(motor),
        }
    }

    /// A board that is polled is heard each [`POLL_US`].
    fn find_silent(&mut self) {
        let (now_us, boards) = (self.god.io.now_us(), &self.god.boards);
        for motor in self.moving.iter() {
            if now_us >= boards.heard_us(motor).max(self.started_us).saturating_add(LOST_US) {
                self.silent = self.silent.with(motor);
            }
        }
    }

    /// Removes motors whose motion has ended, with the consequences for others.
    async fn act_on_ends(&mut self) {
        let ended = self.moving.intersection(self.ended);
        self.ended = Motors::NONE;
        self.moving = self.moving.difference(ended).difference(self.silent).difference(self.dropped);
        self.god.moves.go_on(self.moving.union(self.silent));
        if let Some((ordered, Cmd::Tc | Cmd::To)) = self.plan.order {
            let stalled = ended.intersection(ordered).intersection(self.ends.filter(|end| end == STALLED));
            // At once: the last may end long after them.
            self.god.moves.press_as_held(stalled);
            // What stops a link lets its tip go on, as in a breakaway.
            moves::hurry(self.god, stalled.tips().intersection(self.moving)).await;
        }
        for link in ended.intersection(self.ends.filter(|end| end == BROKE_AWAY)).iter() {
            if let Some(tip) = link.tip().filter(|&tip| self.plan.motors.has(tip)) {
                self.act_on_breakaway(link, Motors::only(tip)).await;
            }
        }
    }

    async fn act_on_breakaway(&mut self, link: Motor, tip: Motors) {
        match &self.plan.breakaway {
            _ if self.tips_stop.has(link) => moves::stop(self.god, tip.intersection(self.moving)).await,
            Breakaway::TipStops => moves::stop(self.god, tip.intersection(self.moving)).await,
            Breakaway::TipGoesTo(goals) => {
                // A tip that has ended elsewhere than at its goal, by strain for instance, has ended.
                let arrived = self.ends.filter(|end| end == ARRIVED);
                let goes_on = tip.intersection(self.moving.union(arrived)).difference(self.silent);
                moves::hurry(self.god, goes_on).await;
                self.start(goes_on, goals).await;
            }
            Breakaway::TipGoesOn | Breakaway::Off => {}
        }
    }

    /// Silent boards are told to stop once more before the host learns of them, and again after some time.
    async fn stop_silent(&self) {
        if !self.silent.is_empty() {
            moves::stop(self.god, self.silent).await;
            self.god.boards.get(self.silent, Property::MODE).await;
            moves::stop(self.god, self.silent).await;
        }
        self.god.moves.ends();
    }

    /// What it has come to.
    async fn judge(&self) -> Status {
        let (god, plan) = (self.god, self.plan);
        let heard = plan.motors.difference(self.silent);
        let goals = if plan.judged { heard.intersection(plan.goals.motors()) } else { Motors::NONE };
        let positions = ready::known_positions(god, goals).await;
        let most = ready::known_counts(god, goals, Property::MPE).await;
        let errors = god.boards.get(heard, Property::ERROR).await;
        let mut lost = ready::lost(god, heard).await;
        match plan.order {
            Some((motors, Cmd::Hi)) => lost = lost.union(motors.intersection(self.unstarted)),
            Some((motors, Cmd::Tc | Cmd::To)) => {
                let modes = god.boards.get(motors.intersection(heard), Property::MODE).await;
                god.moves.cease_pressing(modes.filter(|mode| mode != VELOCITY));
                god.moves.press(modes.filter(|mode| mode == VELOCITY));
            }
            _ => {}
        }
        let [hot, storage] =
            [FaultCode::OverTemperature, FaultCode::Storage].map(|fault| fault.code().into());
        let mut sum = Status::OK;
        for motor in plan.motors.iter() {
            let mut status = Status::OK;
            // Who does not tell is no board, and not far from its goal.
            let goal = plan.goals.get(motor).zip(positions.get(motor)).zip(most.get(motor));
            let is_far = goal.is_some_and(|((goal, position), most)| (position - goal).abs() > most);
            let dropped = self.dropped.has(motor);
            let failed = self.ends.get(motor) == Some(FAULT) || dropped;
            if goals.has(motor) && (failed || is_far) {
                status |= Status::NOT_REACHED;
            }
            if errors.get(motor) == Some(hot) {
                status |= Status::OVER_TEMPERATURE;
            }
            if lost.has(motor) {
                status |= Status::NOT_INITIALIZED;
            }
            // Its flash cannot forget a stored position, so its board does not let it move.
            let stuck = self.ends.get(motor) == Some(ABORTED);
            // Faults of former motions have been cleared.
            let fault = errors.get(motor).is_some_and(|code| code != 0 && code != storage);
            let not_stored = errors.get(motor) == Some(storage) && (stuck || dropped);
            if status.is_ok() && not_stored {
                status = Status::NOT_STORED;
            } else if status.is_ok() && (fault || dropped) {
                status = Status::FAULT;
            }
            if errors.get(motor).is_none() || (goals.has(motor) && goal.is_none()) {
                status = Status::NO_BOARD;
            }
            god.note(motor, status);
            sum |= status;
        }
        sum
    }
}
