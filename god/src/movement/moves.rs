//! What outlives a motion's future: which motors move, so that ^C can end them; what their boards are to be given back; and who presses on
//! after TC and TO.

use core::cell::Cell;
use core::convert::Infallible;

use tater_wire::Property;

use crate::boards::{Answers, HOLDS, IDLE, REPORTS};
use crate::god::God;
use crate::io::NEVER;
use crate::motors::Motors;
use crate::status::Status;

/// How often a board hears of GOD while its motor presses: after 500 ms of silence it takes its host for lost, and lets go.
const COMPANY_US: u64 = 200_000;

/// What goes on in the boards.
#[derive(Debug, Default)]
pub(crate) struct Moves {
    /// Motors whose motion has not ended.
    moving: Cell<Motors>,
    /// Those of them with HOLD.
    holding: Cell<Motors>,
    /// Motors that TC or TO has left pressing in mode 4, because of HOLD.
    pressing: Cell<Motors>,
    /// [`LENT`] as they were before a motion changed them for its own time.
    lent: [Cell<Answers>; LENT.len()],
}

/// What a motion may change for its own time: velocities and BT; RealTime KPV.
const LENT: [Property; 5] = [Property::MV, Property::MCV, Property::MOV, Property::BT, Property::KPV];

impl Moves {
    /// A motion begins.
    pub(super) fn begin(&self, motors: Motors, holding: Motors) {
        self.moving.set(motors);
        self.holding.set(holding);
    }

    /// These move still.
    pub(super) fn go_on(&self, motors: Motors) {
        self.moving.set(motors);
    }

    /// None moves any more; those that did.
    pub(super) fn ends(&self) -> Motors {
        self.moving.take()
    }

    /// These press on from now on.
    pub(super) fn press(&self, motors: Motors) {
        self.pressing.set(self.pressing.get().union(motors));
    }

    /// The same for those of them with HOLD.
    pub(super) fn press_as_held(&self, motors: Motors) {
        self.press(motors.intersection(self.holding.get()));
    }

    /// These do no more: they are given something else to do.
    pub(crate) fn cease_pressing(&self, motors: Motors) {
        self.pressing.set(self.pressing.get().difference(motors));
    }

    fn lent(&self, property: Property) -> &Cell<Answers> {
        let [first, ..] = &self.lent;
        let place = LENT.iter().position(|&lent| lent == property);
        place.and_then(|place| self.lent.get(place)).unwrap_or(first)
    }
}

/// Sets a property, one of [`LENT`], for the time of a motion; `was` is given back after it.
pub(crate) async fn lend(god: &God<'_>, property: Property, values: &Answers, was: &Answers) {
    let mut lent = god.moves.lent(property).get();
    for motor in values.motors().iter() {
        // What is still to be given back from before is the older.
        if let Some(was) = was.get(motor).filter(|_| lent.get(motor).is_none()) {
            lent.set(motor, was);
        }
    }
    // First of all: ^C may come at any time.
    god.moves.lent(property).set(lent);
    god.boards.set_each(property, values).await;
}

/// Gives boards back what was lent. What a board does not confirm is tried again at the next motion.
pub(super) async fn give_back(god: &God<'_>) {
    give_back_but(god, Motors::NONE).await;
}

/// The same, without waiting for `silent` ones, which are known not to answer.
pub(super) async fn give_back_but(god: &God<'_>, silent: Motors) {
    let mut silent = silent;
    for property in LENT {
        let lent = god.moves.lent(property).get();
        if lent.motors().is_empty() {
            continue;
        }
        god.boards.set_each(property, &lent).await;
        let asked = lent.motors().difference(silent);
        let found = god.boards.get(asked, property).await;
        // One that does not answer is asked once, and not for each property.
        silent = silent.union(asked.difference(found.motors()));
        let mut left = Answers::default();
        for motor in lent.motors().iter() {
            if let Some(was) = lent.get(motor).filter(|_| found.get(motor) != lent.get(motor)) {
                left.set(motor, was);
            }
        }
        god.moves.lent(property).set(left);
    }
}

/// Gives motors their velocities back, to go on faster; [`give_back`] is to follow in the end.
pub(super) async fn hurry(god: &God<'_>, motors: Motors) {
    for property in [Property::MV, Property::MCV, Property::MOV] {
        let lent = god.moves.lent(property).get();
        for motor in motors.intersection(lent.motors()).iter() {
            god.boards.set(Motors::only(motor), property, lent.get(motor).unwrap_or(0)).await;
        }
    }
}

/// Ends the motion of motors as HOLD says: to mode 3 where they are, or power off (manual 5.5).
pub(super) async fn stop(god: &God<'_>, motors: Motors) {
    let holding = god.moves.holding.get();
    god.boards.set(motors.intersection(holding), Property::MODE, HOLDS).await;
    god.boards.set(motors.difference(holding), Property::MODE, IDLE).await;
}

/// ^C has dropped a motion, if there was one: ends it on every motor that still moves.
pub(crate) async fn abort(god: &God<'_>) {
    let moving = god.moves.ends();
    stop(god, moving).await;
    moving.iter().for_each(|motor| god.note(motor, Status::ABORTED));
    give_back(god).await;
}

/// Lets the boards whose motors press on hear of GOD, for as long as it is polled.
pub(crate) async fn keep_company(god: &God<'_>) -> Infallible {
    loop {
        let pressing = || Some(god.moves.pressing.get()).filter(|motors| !motors.is_empty());
        god.io.wait_until(NEVER, pressing).await;
        god.io.sleep_until(god.io.after_us(COMPANY_US)).await;
        // What they have been told before: it changes nothing, and is not answered.
        god.boards.set(god.moves.pressing.get(), Property::LFLAGS, REPORTS).await;
    }
}
