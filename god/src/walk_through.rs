//! The walk-through's grammar (manual 3, decision 0029): `<nodes> S <property> <value>`, `<nodes> G <property>`, WAKE, SAVE.
//!
//! White space is optional. Properties are the boards' own, in hall counts, by the names of their table; M means MODE, and AP means P, as in
//! the manual. A SET goes to the boards unchanged and is not verified, but an order (MODE, M, CMD) that a sleeping board does not obey is
//! ERR 1; a GET prints a line for each board, `1 TEMP=350`. A motor that this grammar has set going reports its end: `4 MODE=3`, between two
//! lines of the host, while nothing is typed. ^C stops it.
//!
//! Node 0 is GOD. It has one property, REPLY, 0 after the start: with `0 S REPLY 1` answers and ends of motions are packets instead of lines
//! (manual 1.4): the board's frame, as two bytes of identifier, the high one first, one of its length, and its data. Echo, errors and prompts
//! stay text.

use tater_wire::property::Access;
use tater_wire::{Cmd, Message, ModeCode, Property};

use crate::boards::{REPORTS, Reported};
use crate::god::God;
use crate::io::NEVER;
use crate::motors::{COUNT, Motor, Motors};
use crate::status::Status;
use crate::{order, query};

/// Wait between two readings of a position, µs: a board counts its motor as standing after 200 ms without a hall count (decision 0012).
const STANDSTILL_US: u64 = 300_000;

/// Most such waits: without power the spread stops within a second.
const STANDSTILL_TRIES: usize = 10;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Request {
    Set(Motors, Property, i64),
    Get(Motors, Property),
    SetReply(i64),
    GetReply,
}

pub(crate) async fn execute(god: &God<'_>, line: &str) -> Status {
    match line {
        "WAKE" => return wake(god).await,
        "SAVE" => return save(god).await,
        _ => {}
    }
    match parse(line) {
        Err(status) => status,
        Ok(Request::Set(motors, property, value)) => set(god, motors, property, value).await,
        Ok(Request::Get(motors, property)) => get(god, motors, property).await,
        Ok(Request::SetReply(mode @ 0..=1)) => {
            god.session.set_packets(mode == 1);
            Status::OK
        }
        Ok(Request::SetReply(_)) => Status::INVALID_VALUE,
        Ok(Request::GetReply) => {
            god.print_line(format_args!("0 REPLY={}", u8::from(god.session.packets()))).await;
            Status::OK
        }
    }
}

fn parse(line: &str) -> Result<Request, Status> {
    let end = line.find(|c: char| !c.is_ascii_digit() && !c.is_ascii_whitespace());
    let (nodes, rest) = line.split_at_checked(end.unwrap_or(line.len())).unwrap_or((line, ""));
    let (is_set, rest) = match (rest.strip_prefix('S'), rest.strip_prefix('G')) {
        (Some(rest), _) => (true, rest.trim_ascii()),
        (_, Some(rest)) => (false, rest.trim_ascii()),
        _ => return Err(Status::UNKNOWN_COMMAND),
    };
    let mut motors = Motors::NONE;
    let mut is_god = false;
    for node in nodes.bytes().filter(u8::is_ascii_digit) {
        match Motor::new(node - b'0') {
            Some(motor) => motors = motors.with(motor),
            None if node == b'0' => is_god = true,
            None => return Err(Status::NO_MOTOR),
        }
    }
    match (is_god, is_set) {
        // GOD and the boards have no property in common.
        (true, _) if !motors.is_empty() => Err(Status::UNKNOWN_PARAMETER),
        (true, true) => {
            let (_, value) = value(rest, |name| (name == "REPLY").then_some(()))?;
            Ok(Request::SetReply(value))
        }
        (true, false) if rest == "REPLY" => Ok(Request::GetReply),
        (true, false) => Err(Status::UNKNOWN_PARAMETER),
        (false, true) => value(rest, named).map(|(property, value)| Request::Set(motors, property, value)),
        (false, false) if rest.contains(|c: char| c.is_ascii_whitespace()) => Err(Status::TOO_MANY_ARGUMENTS),
        (false, false) => {
            named(rest).map(|property| Request::Get(motors, property)).ok_or(Status::UNKNOWN_PARAMETER)
        }
    }
}

/// A property's name and a value. Without white space between them the name is the shortest that has all letters: `X012` sets X0 to 12.
fn value<T>(text: &str, named: impl Fn(&str) -> Option<T>) -> Result<(T, i64), Status> {
    let end = |is: fn(char) -> bool| text.find(is).unwrap_or(text.len());
    let letters = end(|c| !c.is_ascii_alphabetic());
    let (found, value) = [end(|c| c.is_ascii_whitespace()), letters, letters + 1]
        .into_iter()
        .filter_map(|end| text.split_at_checked(end))
        .find_map(|(name, value)| named(name).map(|found| (found, value.trim_ascii())))
        .ok_or(Status::UNKNOWN_PARAMETER)?;
    if value.contains(|c: char| c.is_ascii_whitespace()) {
        return Err(Status::TOO_MANY_ARGUMENTS);
    }
    value.parse().map(|value| (found, value)).map_err(|_| Status::INVALID_VALUE)
}

fn named(name: &str) -> Option<Property> {
    match name {
        "M" => Some(Property::MODE),
        "AP" => Some(Property::P),
        name => Property::named(name),
    }
}

async fn set(god: &God<'_>, motors: Motors, property: Property, value: i64) -> Status {
    let rules = property.rules();
    if rules.access == Access::ReadOnly {
        return Status::READ_ONLY;
    }
    if !rules.admits(value) {
        return Status::INVALID_VALUE;
    }
    if begins_motion(property, value) {
        if query::is_too_hot(god) {
            return Status::OVER_TEMPERATURE;
        }
        // Another host may have woken the boards without setting LFLAGS. Earlier reports are dropped.
        god.boards.set(motors, Property::LFLAGS, REPORTS).await;
        motors.iter().for_each(|motor| _ = god.boards.take_reported(motor));
        god.session.watch(motors);
    }
    if changes_motion(property, value) {
        // The host moves them now, and has to keep their boards alive.
        god.session.cease_pressing(motors);
    }
    god.boards.set(motors, property, value).await;
    if !is_order(property, value) {
        return Status::OK;
    }
    // A sleeping board neither obeys these orders nor answers this question.
    let answering = god.boards.get(motors, Property::HOLD).await.motors();
    if answering == motors { Status::OK } else { Status::NO_BOARD }
}

/// Whether a SET may start a motion, which a hot hand refuses.
fn begins_motion(property: Property, value: i64) -> bool {
    match property {
        Property::MODE => value != 0,
        Property::M => true,
        Property::CMD => {
            !matches!(Cmd::of(value), Some(Cmd::T | Cmd::Load | Cmd::Save | Cmd::Def | Cmd::Reset))
        }
        _ => false,
    }
}

fn changes_motion(property: Property, value: i64) -> bool {
    match property {
        Property::MODE | Property::M | Property::V | Property::T => true,
        // 2 clears faults and ends no motion.
        Property::STAT => value != 2,
        Property::CMD => !matches!(Cmd::of(value), Some(Cmd::Load | Cmd::Save | Cmd::Def)),
        _ => false,
    }
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
        reply(god, motor, property, values.get(motor).unwrap_or(0)).await;
    }
    if motors.difference(values.motors()).is_empty() { Status::OK } else { Status::NO_BOARD }
}

async fn reply(god: &God<'_>, motor: Motor, property: Property, value: i64) {
    if !god.session.packets() {
        return god.print_line(format_args!("{} {}={value}", motor.number(), property.row().name)).await;
    }
    if let Some(message) = Message::reply(motor.node(), property, value) {
        let frame = message.frame();
        let [high, low] = frame.raw_id().to_be_bytes();
        let len = u8::try_from(frame.data().len()).unwrap_or(0);
        god.io.write(&[high, low, len]).await;
        god.io.write(frame.data()).await;
    }
}

async fn wake(god: &God<'_>) -> Status {
    if god.boards.wake(Motors::ALL).await == Motors::ALL { Status::OK } else { Status::NO_BOARD }
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
        god.io.sleep_until(god.io.after_us(STANDSTILL_US)).await;
        let now = god.boards.get(awake, Property::P).await;
        if core::mem::replace(&mut before, now) == now {
            break;
        }
    }
    let parameters = *god.parameters.borrow();
    god.memory.update(|stored| stored.parameters = parameters);
    let answered = if stat.motors() == Motors::ALL { Status::OK } else { Status::NO_BOARD };
    answered | god.boards.save(awake, core::iter::once(-1)).await
}

/// Reports motions of this grammar that have ended, each followed by a prompt, until the host sends something.
pub(crate) async fn report_ends(god: &God<'_>) {
    loop {
        let ended = god
            .io
            .wait_until(NEVER, || match ended(god) {
                Some(ended) => Some(Some(ended)),
                None => god.io.has_input().then_some(None),
            })
            .await
            .flatten();
        let Some((motor, mode)) = ended else { return };
        // END 0: a later order has replaced that motion. Its reports arrived before the prompt of that order: the board has answered since.
        if god.boards.get(Motors::only(motor), Property::END).await.get(motor) == Some(0) {
            continue;
        }
        god.session.unwatch(Motors::only(motor));
        reply(god, motor, Property::MODE, mode).await;
        god.prompt().await;
    }
}

/// A motor whose motion has ended, and its mode now.
fn ended(god: &God<'_>) -> Option<(Motor, i64)> {
    god.boards.drain();
    god.session.watched().iter().find_map(|motor| {
        let Reported { mode, .. } = god.boards.take_reported(motor);
        mode.map(|mode| (motor, mode))
    })
}

/// ^C or a disconnect: stops the motions of this grammar, as HOLD demands (manual 5.5, case 3), and reports no end of them.
/// Motors that hold or press go on. Returns [`Status::ABORTED`] if one was moving.
pub(crate) async fn abort(god: &God<'_>) -> Status {
    let watched = god.session.watched();
    god.session.unwatch(watched);
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
