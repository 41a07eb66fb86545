//! Executes the lower grammar ([`lower`](crate::grammar::lower), decision 0029).
//!
//! A SET goes to the boards unchanged and is not verified, but a board that sleeps or does not answer is
//! ERR 1 (SET STAT wakes one); a GET prints a line for each board, `1 TEMP=350`. GET STAT and WAKE look for two boards with one number, which are ERR 1 as well: only
//! one answer is printed, and `ERR 1` names them. A motor that this grammar has set going reports its end:
//! `4 MODE=3`, between two lines of the host, while nothing is typed. ^C stops it.
//!
//! Node 0 is GOD. It has one property, REPLY, 0 after the start: with `0 S REPLY 1` answers and ends of motions are packets instead of lines
//! (manual 1.4): the board's frame, as two bytes of identifier, the high one first, one of its length, and its data. Echo, errors and prompts
//! stay text.

use tater_wire::property::Access;
use tater_wire::{Cmd, Frame, ModeCode, Property};

use crate::boards::{REPORTS, Reported};
use crate::god::God;
use crate::grammar::lower::Request;
use crate::io::NEVER;
use crate::motors::{COUNT, Motor, Motors};
use crate::status::Status;
use crate::words::words;
use crate::{order, packets, query};

/// Wait between two readings of a position, µs: a board counts its motor as standing after 200 ms without a hall count (decision 0012).
const STANDSTILL_US: u64 = 300_000;

/// Most such waits: without power the spread stops within a second.
const STANDSTILL_TRIES: usize = 10;

pub(crate) async fn execute(god: &God<'_>, request: Request) -> Status {
    match request {
        Request::Wake => wake(god).await,
        Request::Save => save(god).await,
        Request::Set(motors, property, value) => set(god, motors, property, value).await,
        Request::Get(motors, property) => get(god, motors, property).await,
        Request::SetReply(mode @ 0..=1) => {
            god.session.set_packets(mode == 1);
            Status::OK
        }
        Request::SetReply(_) => Status::INVALID_VALUE,
        Request::GetReply => {
            god.print_line(words!["0 REPLY=", u8::from(god.session.packets())]).await;
            Status::OK
        }
    }
}

async fn set(god: &God<'_>, motors: Motors, property: Property, value: i64) -> Status {
    let rules = property.rules();
    if rules.access == Access::ReadOnly {
        return Status::READ_ONLY;
    }
    let is_goal = matches!(property, Property::E | Property::M | Property::P);
    let is_beyond = |motor: Motor| motor.kind().nearest_goal(value) != value;
    if is_goal && motors.iter().any(is_beyond) {
        // Boards that refuse it refuse MODE 5 as well, until a good one comes.
        let beyond = motors.iter().filter(|&motor| is_beyond(motor)).collect();
        god.boards.set(beyond, property, value).await;
        return Status::INVALID_VALUE;
    }
    if !rules.admits(value) {
        return Status::INVALID_VALUE;
    }
    if order::begins_motion(property, value) && query::is_too_hot(god) {
        return Status::OVER_TEMPERATURE;
    }
    let stat = god.boards.get(motors, Property::STAT).await;
    // A sleeping board obeys none but STAT: the numbers of some others mean something else in its monitor.
    let obeying = if property == Property::STAT { stat.motors() } else { stat.filter(|stat| stat != 0) };
    let status = if obeying == motors { Status::OK } else { Status::NO_BOARD };
    let motors = obeying;
    if order::begins_motion(property, value) {
        // Another host may have woken the boards without setting LFLAGS. Earlier reports are dropped.
        god.boards.set(motors, Property::LFLAGS, REPORTS).await;
        motors.iter().for_each(|motor| _ = god.boards.take_reported(motor));
        god.session.watch(motors);
    }
    if order::changes_motion(property, value) {
        // The host moves them now, and has to keep their boards alive.
        god.session.cease_pressing(motors);
    }
    god.boards.set(motors, property, value).await;
    if !is_order(property, value) {
        return status;
    }
    // A board that answers this has the order.
    let answering = god.boards.get(motors, Property::HOLD).await.motors();
    status | if answering == motors { Status::OK } else { Status::NO_BOARD }
}

/// Whether a SET is an order that only an awake board obeys, and that leaves it awake.
fn is_order(property: Property, value: i64) -> bool {
    match property {
        Property::MODE | Property::M => true,
        Property::CMD => Cmd::of(value) != Some(Cmd::Reset),
        _ => false,
    }
}

async fn get(god: &God<'_>, motors: Motors, property: Property) -> Status {
    if property.rules().access == Access::WriteOnly {
        return Status::INVALID_VALUE;
    }
    let values = god.boards.get(motors, property).await;
    for motor in values.motors().iter() {
        packets::reply(god, motor, property, values.get(motor).unwrap_or(0)).await;
    }
    let doubled = match property {
        Property::STAT => god.boards.find_doubled(values.motors()).await.1.motors(),
        _ => query::doubled(god, values.motors()).await,
    };
    if doubled.is_empty() && values.motors() == motors { Status::OK } else { Status::NO_BOARD }
}

async fn wake(god: &God<'_>) -> Status {
    let awake = god.boards.wake(Motors::ALL).await;
    // Boards that another host has woken may speak that host's units.
    god.boards.set_own_units(awake).await;
    let (_, doubled) = god.boards.find_doubled(awake).await;
    if awake == Motors::ALL && doubled.motors().is_empty() { Status::OK } else { Status::NO_BOARD }
}

/// SAVE (manual 3, step 17): switches motors off, because only the position of a motor at rest can be trusted; then each board saves its
/// position and parameters, and GOD its own.
async fn save(god: &God<'_>) -> Status {
    let stat = god.boards.get(Motors::ALL, Property::STAT).await;
    // A board in its monitor has nothing to save.
    let awake = stat.filter(|stat| stat == 2);
    god.session.cease_pressing(Motors::ALL);
    let busy =
        god.boards.get(awake, Property::MODE).await.filter(|mode| ModeCode::of(mode) != Some(ModeCode::Idle));
    god.boards.set(busy, Property::MODE, ModeCode::Idle.into()).await;
    let mut before = god.boards.get(awake, Property::P).await;
    for _ in 0..STANDSTILL_TRIES {
        god.boards.listen_until(god.io.after_us(STANDSTILL_US)).await;
        let now = god.boards.get(awake, Property::P).await;
        if core::mem::replace(&mut before, now) == now {
            break;
        }
    }
    let parameters = god.memory.parameters();
    god.memory.update(|stored| stored.parameters = parameters);
    let answered = if stat.motors() == Motors::ALL { Status::OK } else { Status::NO_BOARD };
    answered | god.boards.save(awake, core::iter::once(-1)).await
}

/// Reports motions of this grammar that have ended, each followed by a prompt, until the host sends something.
pub(crate) async fn report_ends(god: &God<'_>) {
    loop {
        let (missing, until_us) = god.session.awaited();
        let deadline_us = if missing == 0 { NEVER } else { until_us };
        let event = god.io.wait_until(deadline_us, || {
            let passed = packets::next(god).map(Event::Passed);
            let ended = || ended(god).map(|(motor, mode)| Event::Ended(motor, mode));
            let event = passed.or_else(ended).or_else(|| god.io.has_input().then_some(Event::Input));
            event.or_else(|| god.io.wait_for_line(missing > 0 || !god.session.watched().is_empty()))
        });
        let (motor, mode) = match event.await {
            Some(Event::Input) => return,
            Some(Event::Passed(frame)) => {
                packets::pass(god, &frame).await;
                continue;
            }
            Some(Event::Ended(motor, mode)) => (motor, mode),
            None => {
                god.session.give_up_answers();
                continue;
            }
        };
        // The question below would take answers to the host's packets for its own.
        packets::settle(god).await;
        // END 0: a later order has replaced that motion. Its reports arrived before the prompt of that order: the board has answered since.
        if god.boards.get(Motors::only(motor), Property::END).await.get(motor) == Some(0) {
            continue;
        }
        god.session.unwatch(Motors::only(motor));
        // A board reports MODE before END: a mode that came before it may be that of the motion.
        let mode = god.boards.take_reported(motor).mode.unwrap_or(mode);
        packets::reply(god, motor, Property::MODE, mode).await;
        god.prompt().await;
    }
}

enum Event {
    /// The host has sent something.
    Input,
    /// A board has sent this to the host.
    Passed(Frame),
    /// A motion has ended in this mode.
    Ended(Motor, i64),
}

/// A motor whose motion has ended, and its mode now.
fn ended(god: &God<'_>) -> Option<(Motor, i64)> {
    god.boards.drain();
    god.session.watched().iter().find_map(|motor| {
        let Reported { mode, .. } = god.boards.take_reported(motor);
        mode.map(|mode| (motor, mode))
    })
}

/// ^C or a disconnect: stops the motions of this grammar and of packets, as HOLD demands (manual 5.5, case 3), and reports no end of them.
/// Motors that hold or press go on. Returns [`Status::ABORTED`] if one was moving.
pub(crate) async fn abort(god: &God<'_>) -> Status {
    let watched = god.session.take_host_moved();
    let modes = god.boards.get(watched, Property::MODE).await;
    let silent = watched.difference(modes.motors());
    let at_rest = |mode| matches!(ModeCode::of(mode), Some(ModeCode::Idle | ModeCode::Pid));
    let moving = modes.filter(|mode| !at_rest(mode));
    let holding = god.boards.get(moving, Property::HOLD).await.filter(|hold| hold != 0);
    order::stop(god, moving.union(silent), holding).await;
    // With their answers the orders have left: no later ^C drops them.
    god.boards.get(moving, Property::MODE).await;
    moving.iter().for_each(|motor| god.session.set_result(motor, Status::ABORTED));
    if moving.is_empty() { Status::OK } else { Status::ABORTED }
}

const _: () = assert!(COUNT == 7, "a node is one digit");
