//! The walk-through's grammar (manual 3): `<nodes> S <property> <value>`, `<nodes> G <property>`, WAKE, SAVE.
//!
//! White space is optional. Properties are those of the boards, in hall counts, by the names of their table; M means MODE, and AP P,
//! as in the manual. A SET goes to the boards as it is and is not verified, but that an order (MODE, M, CMD) which a sleeping board does not
//! obey is ERR 1; a GET answers a line for each board, `1 TEMP=350`. A motor that this grammar has sent says so when its motion has ended:
//! `4 MODE=3`, between two lines of the host, when nothing is typed. ^C ends it.
//!
//! Node 0 is GOD. It has one property, REPLY, 0 after the start: with `0 S REPLY 1` answers and ends of motions are packets instead
//! of lines (manual 1.4): the board's frame, as two bytes of identifier, the high one first, one of its length, and its data. Echo, errors
//! and prompts stay as they are.

use core::cell::Cell;

use tater_wire::property::Access;
use tater_wire::{Cmd, Message, Property};

use crate::boards::{HOLDS, IDLE, REPORTS, Reported};
use crate::god::God;
use crate::io::NEVER;
use crate::motors::{COUNT, Motor, Motors};
use crate::movement;
use crate::status::Status;

/// How a motor that has been let go is waited for, us: a board takes it for standing after 200 ms without a hall count.
const STANDS_US: u64 = 300_000;

/// How often that is waited for: the spread, free, has come to rest within a second.
const STANDS_TRIES: usize = 10;

/// What is known between two lines.
#[derive(Debug, Default)]
pub struct State {
    /// Motors whose end of motion is to be told.
    sent: Cell<Motors>,
    /// REPLY.
    packets: Cell<bool>,
}

impl State {
    /// These are given something else to do: their ends are not told.
    pub(crate) fn forget(&self, motors: Motors) {
        self.sent.set(self.sent.get().difference(motors));
    }
}

/// What a line asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Order {
    Set(Motors, Property, i64),
    Get(Motors, Property),
    /// Of GOD.
    SetReply(i64),
    GetReply,
}

/// Does it.
pub(crate) async fn execute(god: &God<'_>, line: &str) -> Status {
    match line {
        "WAKE" => return wake(god).await,
        "SAVE" => return save(god).await,
        _ => {}
    }
    match parse(line) {
        Err(status) => status,
        Ok(Order::Set(motors, property, value)) => set(god, motors, property, value).await,
        Ok(Order::Get(motors, property)) => get(god, motors, property).await,
        Ok(Order::SetReply(mode @ 0..=1)) => {
            god.lower.packets.set(mode == 1);
            Status::OK
        }
        Ok(Order::SetReply(_)) => Status::INVALID_VALUE,
        Ok(Order::GetReply) => {
            god.answer(format_args!("0 REPLY={}", u8::from(god.lower.packets.get()))).await;
            Status::OK
        }
    }
}

// --- grammar --------------------------------------------------------------------------------------------

fn parse(line: &str) -> Result<Order, Status> {
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
        // What GOD has, no board has.
        (true, _) if !motors.is_empty() => Err(Status::UNKNOWN_PARAMETER),
        (true, true) => {
            let (_, value) = value(rest, |name| (name == "REPLY").then_some(()))?;
            Ok(Order::SetReply(value))
        }
        (true, false) if rest == "REPLY" => Ok(Order::GetReply),
        (true, false) => Err(Status::UNKNOWN_PARAMETER),
        (false, true) => value(rest, named).map(|(property, value)| Order::Set(motors, property, value)),
        (false, false) if rest.contains(|c: char| c.is_ascii_whitespace()) => Err(Status::TOO_MANY_ARGUMENTS),
        (false, false) => {
            named(rest).map(|property| Order::Get(motors, property)).ok_or(Status::UNKNOWN_PARAMETER)
        }
    }
}

/// A property's name and a value. Without white space between them the name is as short as can be, but has all letters: `X012` is
/// 12 for X0.
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

// --- orders ---------------------------------------------------------------------------------------------

async fn set(god: &God<'_>, motors: Motors, property: Property, value: i64) -> Status {
    let rules = property.rules();
    if rules.access == Access::ReadOnly {
        return Status::READ_ONLY;
    }
    if !rules.admits(value) {
        return Status::INVALID_VALUE;
    }
    if begins_motion(property, value) {
        if movement::is_too_hot(god) {
            return Status::OVER_TEMPERATURE;
        }
        // Who woke the boards may not have told them to report ends; of what has been before, nobody wants to hear.
        god.boards.set(motors, Property::LFLAGS, REPORTS).await;
        motors.iter().for_each(|motor| _ = god.boards.take_reported(motor));
        god.lower.sent.set(god.lower.sent.get().union(motors));
    }
    if changes_motion(property, value) {
        // From here on it is the host who moves them, and must be there.
        god.moves.cease_pressing(motors);
    }
    god.boards.set(motors, property, value).await;
    if !is_order(property, value) {
        return Status::OK;
    }
    // A board that sleeps obeys none, and has no such property.
    let heard = god.boards.get(motors, Property::HOLD).await.motors();
    if heard == motors { Status::OK } else { Status::NO_BOARD }
}

/// Whether a SET may set a motor in motion: what ends one or is none of it is never refused to a hot hand.
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

/// Whether a SET begins, changes or ends a motion, or may.
fn changes_motion(property: Property, value: i64) -> bool {
    match property {
        Property::MODE | Property::M | Property::V | Property::T => true,
        // 2 ends faults, not motions.
        Property::STAT => value != 2,
        Property::CMD => !matches!(Cmd::of(value), Some(Cmd::Load | Cmd::Save | Cmd::Def)),
        _ => false,
    }
}

/// Whether a SET is an order that only a board obeys that is awake, and that is so after it.
fn is_order(property: Property, value: i64) -> bool {
    match property {
        Property::MODE | Property::M => true,
        Property::CMD => Cmd::of(value) != Some(Cmd::Reset),
        _ => false,
    }
}

async fn get(god: &God<'_>, motors: Motors, property: Property) -> Status {
    if property.rules().access == Access::WriteOnly {
        // It has no value.
        return Status::INVALID_VALUE;
    }
    let values = god.boards.get(motors, property).await;
    for motor in values.motors().iter() {
        reply(god, motor, property, values.get(motor).unwrap_or(0)).await;
    }
    if motors.difference(values.motors()).is_empty() { Status::OK } else { Status::NO_BOARD }
}

/// Tells a value, as REPLY wants it.
async fn reply(god: &God<'_>, motor: Motor, property: Property, value: i64) {
    if !god.lower.packets.get() {
        return god.answer(format_args!("{} {}={value}", motor.number(), property.row().name)).await;
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

/// Everything is ready for power-off (manual 3, step 17): what moves or holds is let go, because a position can only be trusted that a
/// standing motor has saved; then each board saves where it is, and all its parameters, and GOD its own.
async fn save(god: &God<'_>) -> Status {
    let stat = god.boards.get(Motors::ALL, Property::STAT).await;
    // A board in its monitor has nothing new.
    let awake = stat.filter(|stat| stat == 2);
    god.moves.cease_pressing(Motors::ALL);
    let busy = god.boards.get(awake, Property::MODE).await.filter(|mode| mode != IDLE);
    god.boards.set(busy, Property::MODE, IDLE).await;
    let mut before = god.boards.get(awake, Property::P).await;
    for _ in 0..STANDS_TRIES {
        god.io.sleep_until(god.io.after_us(STANDS_US)).await;
        let now = god.boards.get(awake, Property::P).await;
        if core::mem::replace(&mut before, now) == now {
            break;
        }
    }
    let parameters = *god.parameters.borrow();
    god.memory.change(|stored| stored.parameters = parameters);
    let answered = if stat.motors() == Motors::ALL { Status::OK } else { Status::NO_BOARD };
    answered | god.boards.save(awake, core::iter::once(-1)).await
}

// --- ends of motions ------------------------------------------------------------------------------------

/// Until the host says something, tells which motions have ended that this grammar began; a prompt follows.
pub(crate) async fn tell_ends(god: &God<'_>) {
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
        // An order that took the place of a motion has ended it, and what it began goes on. All that was said of the former one has come before
        // the order's line was over, because its board has answered another question since.
        if god.boards.get(Motors::only(motor), Property::END).await.get(motor) == Some(0) {
            continue;
        }
        god.lower.forget(Motors::only(motor));
        reply(god, motor, Property::MODE, mode).await;
        god.prompt().await;
    }
}

/// A motor whose end of motion is to be told, and the mode it is in now.
fn ended(god: &God<'_>) -> Option<(Motor, i64)> {
    god.boards.drain();
    let sent = god.lower.sent.get();
    sent.iter().find_map(|motor| {
        let Reported { mode, .. } = god.boards.take_reported(motor);
        mode.map(|mode| (motor, mode))
    })
}

/// ^C, or the host is gone: ends what this grammar has set in motion, as HOLD says (manual 5.5, case 3); nothing more is told of it. What
/// holds or presses goes on. [`Status::ABORTED`], if something moved.
pub(crate) async fn abort(god: &God<'_>) -> Status {
    let sent = god.lower.sent.take();
    let modes = god.boards.get(sent, Property::MODE).await;
    let silent = sent.difference(modes.motors());
    let moving = modes.filter(|mode| mode != IDLE && mode != HOLDS);
    let holding = god.boards.get(moving, Property::HOLD).await.filter(|hold| hold != 0);
    god.boards.set(holding, Property::MODE, HOLDS).await;
    god.boards.set(moving.difference(holding).union(silent), Property::MODE, IDLE).await;
    moving.iter().for_each(|motor| god.note(motor, Status::ABORTED));
    if moving.is_empty() { Status::OK } else { Status::ABORTED }
}

const _: () = assert!(COUNT == 7, "a node is one digit");
