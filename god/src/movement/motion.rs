//! A motion of some motors, from its start to its ends (manual 5.5), and what that comes to.
//!
//! All begin together: an order is one frame, goal and mode in one. Each ends when its board says so (LFLAGS); it is asked as well, because a
//! report may be lost and because boards in mode 4 take a silent host for lost.

use tater_wire::{Cmd, FaultCode, Property};

use super::{moves, pace, ready};
use crate::boards::{ABORTED, ARRIVED, Answers, BROKE_AWAY, FAULT, REPORTS, STALLED, VELOCITY};
use crate::god::God;
use crate::motors::{Motor, Motors};
use crate::status::Status;
use crate::units;

/// How often boards are asked whether they have ended, µs.
const ASK_US: u64 = 50_000;

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

    const fn cmd(&self, motor: Motor) -> Option<Cmd> {
        match self.order {
            Some((motors, cmd)) if motors.has(motor) => Some(cmd),
            _ => None,
        }
    }
}

/// Does it, and waits for its end on every motor. Each one's code is in S, their sum is returned.
pub(super) async fn run(god: &God<'_>, plan: &Plan) -> Status {
    match prepare(god, plan).await {
        Ok(stops) => {
            let motors = plan.motors;
            let mut motion = Motion {
                god,
                plan,
                stops,
                moving: motors,
                ended: Motors::NONE,
                silent: Motors::NONE,
                refused: Motors::NONE,
                ends: Answers::default(),
            };
            motion.begin(motors, |motor| plan.cmd(motor), &plan.goals).await;
            motion.refused = motion.ended;
            motion.until_all_have_ended().await;
            let status = motion.judge().await;
            motion.give_up().await;
            moves::give_back(god).await;
            status
        }
        Err(refusal) => {
            moves::give_back(god).await;
            refusal
        }
    }
}

/// All that is set and asked before a motion; which links stop their tips when they break away (BS).
async fn prepare(god: &God<'_>, plan: &Plan) -> Result<Motors, Status> {
    let motors = plan.motors;
    god.boards.set(motors, Property::LFLAGS, REPORTS).await;
    let holding = ready::all(god, motors, Property::HOLD).await?.which(|hold| hold != 0);
    let mut stops = Motors::NONE;
    if let Breakaway::Off = plan.breakaway {
        let was = ready::all(god, motors, Property::BT).await?;
        let on = was.which(|bt| bt != 0);
        let mut off = Answers::default();
        on.iter().for_each(|motor| off.put(motor, 0));
        moves::lend(god, Property::BT, &off, &was).await;
    } else {
        let links = motors.of(Motors::LINKS);
        stops = ready::all(god, links, Property::BS).await?.which(|bs| bs != 0);
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
    stops: Motors,
    moving: Motors,
    /// Of the moving ones, those of whose end nobody has made anything yet.
    ended: Motors,
    /// Those whose boards have stopped answering: nobody knows whether they move.
    silent: Motors,
    /// Those that had ended before they could begin.
    refused: Motors,
    /// Why they ended (END).
    ends: Answers,
}

impl Motion<'_, '_> {
    /// Sets motors going.
    ///
    /// A board that takes an order while its motor moves reports the end of that motion first, and END with it, which must not be taken
    /// for the end of this one. So each is asked for E next: it says everything in its order, so what comes before this answer may be of a
    /// former motion, and all that comes after it, END's answer and reports alike, is of this one.
    async fn begin(&mut self, motors: Motors, cmd: impl Fn(Motor) -> Option<Cmd>, goals: &Answers) {
        let boards = &self.god.boards;
        self.moving = self.moving.and(motors);
        self.god.moves.go_on(self.moving.and(self.silent));
        for motor in motors.iter() {
            let alone = Motors::NONE.with(motor);
            match (cmd(motor), goals.of(motor)) {
                (Some(cmd), _) => boards.set(alone, Property::CMD, cmd.number().into()).await,
                (None, Some(goal)) => boards.set(alone, Property::M, units::halls(goal)).await,
                (None, None) => {}
            }
        }
        let ordered = boards.get(motors, Property::E).await.motors();
        motors.iter().for_each(|motor| _ = boards.takes(motor));
        let ends = boards.get(ordered, Property::END).await;
        self.hear(motors, &ends);
    }

    /// Takes note of what boards say of their ends.
    fn hear(&mut self, asked: Motors, ends: &Answers) {
        for motor in ends.which(|end| end != 0).iter() {
            self.ends.put(motor, ends.of(motor).unwrap_or(0));
            self.ended = self.ended.with(motor);
        }
        self.silent = self.silent.and(asked.but(ends.motors()));
    }

    async fn until_all_have_ended(&mut self) {
        let mut ask_us = self.god.io.now_us().saturating_add(ASK_US);
        loop {
            if self.god.io.now_us() >= ask_us {
                let ends = self.god.boards.get(self.moving, Property::END).await;
                self.hear(self.moving, &ends);
                // Those that only lost some frames stop.
                moves::stop(self.god, self.silent).await;
                ask_us = self.god.io.now_us().saturating_add(ASK_US);
            }
            let mut reported = Answers::default();
            for motor in self.moving.iter() {
                if let Some(end) = self.god.boards.takes(motor).end {
                    reported.put(motor, end);
                }
            }
            self.hear(Motors::NONE, &reported);
            self.end().await;
            if self.moving.is_empty() {
                return;
            }
            self.god.boards.hear(ask_us).await;
        }
    }

    /// Ends what has ended, with its consequences.
    async fn end(&mut self) {
        let ended = self.moving.of(self.ended);
        self.ended = Motors::NONE;
        self.moving = self.moving.but(ended).but(self.silent);
        self.god.moves.go_on(self.moving.and(self.silent));
        if let Some((ordered, Cmd::Tc | Cmd::To)) = self.plan.order {
            let stalled = ended.of(ordered).of(self.ends.which(|end| end == STALLED));
            // At once: the last may end long after them.
            self.god.moves.press_as_held(stalled);
            // What stops a link lets its tip go on, as in a breakaway.
            moves::hurry(self.god, stalled.tips().of(self.moving)).await;
        }
        for link in ended.of(self.ends.which(|end| end == BROKE_AWAY)).iter() {
            if let Some(tip) = link.tip().filter(|&tip| self.plan.motors.has(tip)) {
                self.breaks_away(link, Motors::NONE.with(tip)).await;
            }
        }
    }

    async fn breaks_away(&mut self, link: Motor, tip: Motors) {
        match &self.plan.breakaway {
            _ if self.stops.has(link) => moves::stop(self.god, tip.of(self.moving)).await,
            Breakaway::TipStops => moves::stop(self.god, tip.of(self.moving)).await,
            Breakaway::TipGoesTo(goals) => {
                // What has ended a tip elsewhere than at its goal, strain as an instance, has ended it.
                let arrived = self.ends.which(|end| end == ARRIVED);
                let goes_on = tip.of(self.moving.and(arrived)).but(self.silent);
                moves::hurry(self.god, goes_on).await;
                self.begin(goes_on, |_| None, goals).await;
            }
            Breakaway::TipGoesOn | Breakaway::Off => {}
        }
    }

    /// Those that nobody hears: before the host is told that they are lost, they are told to stop once more, and again after some time.
    async fn give_up(&self) {
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
        let heard = plan.motors.but(self.silent);
        let goals = if plan.judged { heard.of(plan.goals.motors()) } else { Motors::NONE };
        let positions = ready::known_positions(god, goals).await;
        let most = ready::known_counts(god, goals, Property::MPE).await;
        let errors = god.boards.get(heard, Property::ERROR).await;
        let mut lost = ready::lost(god, heard).await;
        match plan.order {
            Some((motors, Cmd::Hi)) => lost = lost.and(motors.of(self.refused)),
            Some((motors, Cmd::Tc | Cmd::To)) => {
                let modes = god.boards.get(motors.of(heard), Property::MODE).await;
                god.moves.cease_pressing(modes.which(|mode| mode != VELOCITY));
                god.moves.press(modes.which(|mode| mode == VELOCITY));
            }
            _ => {}
        }
        let [hot, storage] =
            [FaultCode::OverTemperature, FaultCode::Storage].map(|fault| fault.code().into());
        let mut sum = Status::OK;
        for motor in plan.motors.iter() {
            let mut status = Status::OK;
            // Who does not tell is no board, and not far from its goal.
            let goal = plan.goals.of(motor).zip(positions.of(motor)).zip(most.of(motor));
            let is_far = goal.is_some_and(|((goal, position), most)| (position - goal).abs() > most);
            let failed = self.ends.of(motor) == Some(FAULT);
            if goals.has(motor) && (failed || is_far) {
                status |= Status::NOT_REACHED;
            }
            if errors.of(motor) == Some(hot) {
                status |= Status::OVER_TEMPERATURE;
            }
            if lost.has(motor) {
                status |= Status::NOT_INITIALIZED;
            }
            // Its flash cannot forget a stored position, so its board does not let it move.
            let stuck = self.ends.of(motor) == Some(ABORTED) && errors.of(motor) == Some(storage);
            // Faults of former motions have been cleared.
            let fault = errors.of(motor).is_some_and(|code| code != 0 && code != storage);
            if status.is_ok() && (fault || stuck) {
                status = if fault { Status::FAULT } else { Status::NOT_STORED };
            }
            if errors.of(motor).is_none() || (goals.has(motor) && goal.is_none()) {
                status = Status::NO_BOARD;
            }
            god.note(motor, status);
            sum |= status;
        }
        sum
    }
}
