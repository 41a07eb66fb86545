//! Writes properties of boards over their bus and stores them: on all boards, or on none.
//!
//! First every value is set and read back on every board, in RAM alone. Then each board stores its values, and takes them from its storage
//! again. After a failure all that was written gets its old value; what each board then holds is part of the result.
//! Which values, and where the old ones are kept, is the caller's.
//!
//! The link may lose, double and damage frames (decision 0071). So a value counts that is in its range and has been read twice alike, a SET and a
//! SAVE are repeated until they show, and at the end every stored property of every board is what it should be: a digit that became
//! another one may have set another property, or that of another board.

use tater_wire::property::{Access, Stored};
use tater_wire::{Destination, FaultCode, Message, MotorKind, Node as Id, Property};

use super::excite::{Failure, Link};

/// Time limit of an answer, µs: a board that erases a page (40 ms) answers after it.
const ANSWER_US: u64 = 100_000;

/// Tries of a question: the answers of a busy bus can be lost.
const TRIES: u32 = 3;

/// Readings of a value of which no two were alike. Where one answer in five is damaged, a million values have one.
const READINGS: u32 = 8;

/// Tries of a SET or a SAVE that does not show.
const WRITES: u32 = 4;

/// Time limit of a board that wakes, µs: its monitor reads the whole application first, and the first start erases eight pages.
const WAKE_US: u64 = 5_000_000;

/// Time in which a board puts a SAVE into its flash, µs: a page is moved (512 half-words of 53 µs) and erased (40 ms).
const STORE_US: u64 = 100_000;

/// Time between two looks at a board that wakes, µs.
const LOOK_US: u64 = 50_000;

/// A property that a SAVE stores, such as a gain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Change {
    /// The property.
    pub property: Property,
    /// Its value in the board when it was read.
    pub old: i64,
    /// The value that it shall have.
    pub new: i64,
}

/// A board that answers, is awake, and stands still in idle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Present {
    /// Its number on the bus.
    pub node: Id,
    /// KIND.
    pub kind: MotorKind,
    /// SN: another board with the same number has another.
    pub serial: i64,
}

/// A board and what shall change there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Board {
    /// The board.
    pub present: Present,
    /// Its properties, in the order in which they are written.
    pub changes: Vec<Change>,
    /// The other properties that are stored, as they were read: they stay as they are.
    pub rest: Vec<(Property, i64)>,
}

/// What a board holds at the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// The new values, also in its storage.
    New,
    /// Nothing was written.
    Untouched,
    /// Its old values, written again and read back; stored too if the new ones may have been.
    Restored,
    /// It did not take its old values back.
    Unknown {
        /// Whether SAVE was sent: otherwise its storage holds what it held before.
        may_be_stored: bool,
    },
}

impl State {
    /// What the board holds, as the end of a sentence. `is_undo`: the values to be written were those from before an apply.
    #[must_use]
    pub const fn text(self, is_undo: bool) -> &'static str {
        match (self, is_undo) {
            (Self::New, false) => "holds the new values, stored",
            (Self::New, true) => "holds the values from before the apply, stored",
            (Self::Untouched, false) => "holds its old values: nothing was written",
            (Self::Untouched, true) => "holds the applied values: nothing was written",
            (Self::Restored, false) => "holds its old values again",
            (Self::Restored, true) => "holds the applied values again",
            (Self::Unknown { may_be_stored: false }, false) => {
                "may hold new values until its next reset; its storage has the old ones"
            }
            (Self::Unknown { may_be_stored: false }, true) => {
                "may hold values from before the apply until its next reset; its storage has the applied ones"
            }
            (Self::Unknown { may_be_stored: true }, false) => "may hold and have stored new values",
            (Self::Unknown { may_be_stored: true }, true) => {
                "may hold and have stored some of the values from before the apply"
            }
        }
    }

    /// As a value of JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::New => "new",
            Self::Untouched => "untouched",
            Self::Restored => "restored",
            Self::Unknown { may_be_stored: false } => "unknown, stored values old",
            Self::Unknown { may_be_stored: true } => "unknown",
        }
    }
}

/// A write that failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Broken {
    /// Why.
    pub failure: Failure,
    /// What each board holds, in the order of the boards.
    pub states: Vec<State>,
}

fn failed<T>(node: Id, what: &str, next: &str) -> Result<T, Failure> {
    Err(Failure::Failed(format!("node {}: {what}\n  next: {next}", node.number())))
}

fn name(property: Property) -> &'static str {
    property.row().name
}

fn set(link: &mut dyn Link, node: Id, property: Property, value: i64) -> Result<(), Failure> {
    match Message::set(Destination::Node(node), property, value) {
        Some(message) => Ok(link.send(&message.frame())?),
        None => failed(node, &format!("{} = {value} has no frame", name(property)), "give a value in range"),
    }
}

/// One answer about a property; `None` without one.
fn ask(link: &mut dyn Link, node: Id, property: Property) -> Result<Option<i64>, Failure> {
    let mut is_damaged = false;
    for _ in 0..TRIES {
        link.send(&Message::get(Destination::Node(node), property).frame())?;
        let until_us = link.now_us() + ANSWER_US;
        while let Some((_, frame)) = link.receive(until_us)? {
            match Message::parse(&frame).and_then(|message| message.answered()) {
                Some((from, of, Some(value))) if (from, of) == (node, property) => return Ok(Some(value)),
                Some((from, of, None)) if (from, of) == (node, property) => {
                    is_damaged = true;
                    break;
                }
                _ if link.now_us() >= until_us => break,
                _ => {}
            }
        }
    }
    if !is_damaged {
        return Ok(None);
    }
    let (min, max) = (property.row().min, property.row().max);
    failed(
        node,
        &format!("{} reads no value from {min} to {max}, {TRIES} times", name(property)),
        "check adapter and cable (each damaged answer is counted); an application of another version may have another range",
    )
}

const SILENT: &str = "check the board's power, its number, and cable and termination of the bus; --node N leaves other boards alone";

/// A value as one answer says it.
fn look(link: &mut dyn Link, node: Id, property: Property) -> Result<i64, Failure> {
    match ask(link, node, property)? {
        Some(value) => Ok(value),
        None => failed(node, &format!("no answer about {}", name(property)), SILENT),
    }
}

/// A value as two answers say it, without one that differs before a question about something else is answered: neither a damaged answer counts
/// nor the second copy of one to an earlier question.
fn get(link: &mut dyn Link, node: Id, property: Property) -> Result<i64, Failure> {
    let mut seen = Vec::new();
    for _ in 0..READINGS {
        let now_us = link.now_us();
        while link.receive(now_us)?.is_some() {}
        let value = look(link, node, property)?;
        let again = look(link, node, property)?;
        if value == again && !is_contradicted(link, node, property, value)? {
            return Ok(value);
        }
        seen.extend([value, again]);
    }
    seen.sort_unstable();
    seen.dedup();
    failed(
        node,
        &format!("{} reads another value each time: {seen:?}", name(property)),
        "check adapter and cable; nothing is written from a value that is not sure",
    )
}

/// Asks about something else, and returns whether an answer about the property that comes before says another value.
fn is_contradicted(link: &mut dyn Link, node: Id, property: Property, value: i64) -> Result<bool, Failure> {
    let other = if property == Property::STAT { Property::ERROR } else { Property::STAT };
    let mut is_other = false;
    for _ in 0..TRIES {
        link.send(&Message::get(Destination::Node(node), other).frame())?;
        let until_us = link.now_us() + ANSWER_US;
        while let Some((_, frame)) = link.receive(until_us)? {
            match Message::parse(&frame).and_then(|message| message.answered()) {
                Some((from, of, _)) if (from, of) == (node, other) => return Ok(is_other),
                Some((from, of, Some(found))) if (from, of) == (node, property) => is_other |= found != value,
                _ if link.now_us() >= until_us => break,
                _ => {}
            }
        }
    }
    failed(node, &format!("no answer about {}", name(other)), SILENT)
}

fn pause(link: &mut dyn Link, us: u64) -> Result<(), Failure> {
    let until_us = link.now_us() + us;
    while link.now_us() < until_us && link.receive(until_us)?.is_some() {}
    Ok(())
}

/// Meets a board: wakes it if it is in its monitor, and makes sure that nothing moves.
///
/// # Errors
/// No answer, no application, a motor that moves or may move, or a user who ends it.
pub fn meet(link: &mut dyn Link, node: Id, progress: &mut dyn FnMut(&str)) -> Result<Present, Failure> {
    if link.is_interrupted() {
        return Err(Failure::Interrupted);
    }
    if get(link, node, Property::STAT)? != 2 {
        progress(&format!(
            "node {} is asleep in its monitor, as after power-up; it is woken (STAT 2)",
            node.number()
        ));
        wake(link, node)?;
    }
    // Earlier programs have no such property.
    if ask(link, node, Property::HOSTUNITS)?.is_some_and(|units| units != 0) {
        return failed(
            node,
            "its HOSTUNITS is not 0: it speaks another hand's units",
            "SET HOSTUNITS (127) to 0, repeat this, and set it again afterwards",
        );
    }
    let kind = match MotorKind::from_code(get(link, node, Property::KIND)?) {
        Some(kind) => kind,
        None => return failed(node, "KIND names no motor", "download an application of this project"),
    };
    let mode = get(link, node, Property::MODE)?;
    if mode != 0 {
        return failed(
            node,
            &format!("it drives its motor (MODE {mode}), and new gains would act at once"),
            "end the motion and idle the motor (SET MODE 0; GCL: T), then repeat this",
        );
    }
    let velocity = look(link, node, Property::VEL)?;
    if velocity != 0 {
        return failed(
            node,
            &format!("its motor turns, at {velocity} counts/s"),
            "wait until it rests, then repeat this",
        );
    }
    Ok(Present { node, kind, serial: get(link, node, Property::SN)? })
}

fn wake(link: &mut dyn Link, node: Id) -> Result<(), Failure> {
    set(link, node, Property::STAT, 2)?;
    let until_us = link.now_us() + WAKE_US;
    let mut error = None;
    while link.now_us() < until_us {
        if link.is_interrupted() {
            return Err(Failure::Interrupted);
        }
        pause(link, LOOK_US)?;
        if ask(link, node, Property::STAT)? == Some(2) {
            return Ok(());
        }
        // The monitor says why it cannot start the application.
        error = ask(link, node, Property::ERROR)?.filter(|error| *error != 0).or(error);
    }
    let why = error.map_or_else(|| "ERROR 0".to_owned(), |error| format!("ERROR {error}"));
    failed(
        node,
        &format!("it stays asleep for {} s: {why}", WAKE_US / 1_000_000),
        "look ERROR up in docs/properties.md; 16: `cargo xtask download` gives it an application",
    )
}

/// Reads the present values of properties that shall get others.
///
/// # Errors
/// No answer, or a user who ends it.
pub fn compare(link: &mut dyn Link, present: Present, values: &[(Property, i64)]) -> Result<Board, Failure> {
    let mut changes = Vec::new();
    for &(property, new) in values {
        if link.is_interrupted() {
            return Err(Failure::Interrupted);
        }
        changes.push(Change { property, old: get(link, present.node, property)?, new });
    }
    let mut rest = Vec::new();
    for property in Property::ALL.iter().copied() {
        let rules = property.rules();
        // The position is the motor's own.
        let is_kept =
            rules.stored == Stored::Yes && rules.access == Access::ReadWrite && property != Property::P;
        if is_kept && changes.iter().all(|change| change.property != property) {
            if link.is_interrupted() {
                return Err(Failure::Interrupted);
            }
            rest.push((property, get(link, present.node, property)?));
        }
    }
    Ok(Board { present, changes, rest })
}

/// Writes and stores the new values.
///
/// # Errors
/// The adapter is lost, a board does not answer or does not take a value, its flash fails, or the user ends it: what was written has its old
/// value again where the board still answers.
pub fn write(link: &mut dyn Link, boards: &[Board], progress: &mut dyn FnMut(&str)) -> Result<(), Broken> {
    let mut states = vec![State::Untouched; boards.len()];
    let done = store_all(link, boards, &mut states, progress);
    let Err(failure) = done else { return Ok(()) };
    for (board, state) in boards.iter().zip(&mut states).rev() {
        let may_be_stored = match state {
            State::Untouched | State::Restored => {
                // A frame for another board may have come here.
                *state = if settle(link, board, |change| change.old) == Ok(true) {
                    State::Restored
                } else {
                    *state
                };
                continue;
            }
            State::New => true,
            State::Unknown { may_be_stored } => *may_be_stored,
        };
        *state = match restore(link, board, may_be_stored) {
            Ok(()) => State::Restored,
            Err(_) => State::Unknown { may_be_stored },
        };
    }
    Err(Broken { failure, states })
}

fn store_all(
    link: &mut dyn Link,
    boards: &[Board],
    states: &mut [State],
    progress: &mut dyn FnMut(&str),
) -> Result<(), Failure> {
    for (board, state) in boards.iter().zip(states.iter_mut()) {
        *state = State::Unknown { may_be_stored: false };
        put(link, board, |change| change.new)?;
    }
    for (board, state) in boards.iter().zip(states) {
        if link.is_interrupted() {
            return Err(Failure::Interrupted);
        }
        let Board { present, changes, .. } = board;
        progress(&format!(
            "node {}: {} values of its {} go into its flash",
            present.node.number(),
            changes.len(),
            present.kind.name()
        ));
        *state = State::Unknown { may_be_stored: true };
        store(link, board, |change| change.new)?;
        *state = State::New;
    }
    settle_all(link, boards, |change| change.new)
}

fn restore(link: &mut dyn Link, board: &Board, is_stored: bool) -> Result<(), Failure> {
    put(link, board, |change| change.old)?;
    if is_stored {
        store(link, board, |change| change.old)?;
    }
    settle(link, board, |change| change.old).map(|_| ())
}

/// Sets a value until it reads back.
fn put_one(link: &mut dyn Link, node: Id, property: Property, value: i64) -> Result<(), Failure> {
    let mut found = value;
    for _ in 0..WRITES {
        set(link, node, property, value)?;
        found = get(link, node, property)?;
        if found == value {
            return Ok(());
        }
    }
    refused(node, property, value, found, "SET")
}

/// Sets values and reads them back.
fn put(link: &mut dyn Link, board: &Board, value: fn(&Change) -> i64) -> Result<(), Failure> {
    board
        .changes
        .iter()
        .try_for_each(|change| put_one(link, board.present.node, change.property, value(change)))
}

/// Stores values that are set, and takes them from the storage.
fn store(link: &mut dyn Link, board: &Board, value: fn(&Change) -> i64) -> Result<(), Failure> {
    let node = board.present.node;
    for change in &board.changes {
        // One by one: SAVE -1 would also store what others have set for a while.
        set(link, node, Property::SAVE, change.property.id().into())?;
    }
    pause(link, STORE_US)?;
    for change in &board.changes {
        prove(link, node, change, value(change))?;
    }
    if get(link, node, Property::ERROR)? == i64::from(FaultCode::Storage) {
        return failed(
            node,
            "its flash did not take the values (ERROR 8)",
            "SET STAT 2 clears ERROR; try again, and replace the board if it stays",
        );
    }
    Ok(())
}

/// Takes a value from the storage, after RAM has been given another one: otherwise a LOAD that is lost would show nothing.
fn prove(link: &mut dyn Link, node: Id, change: &Change, value: i64) -> Result<(), Failure> {
    let &Change { property, old, new } = change;
    // The motor idles, and each of them is in range.
    let other = match (old == value, new == value) {
        (false, _) => old,
        (true, false) => new,
        (true, true) if property.rules().admits(value + 1) => value + 1,
        (true, true) => value - 1,
    };
    let mut found = other;
    for _ in 0..WRITES {
        put_one(link, node, property, other)?;
        set(link, node, Property::LOAD, property.id().into())?;
        found = get(link, node, property)?;
        if found == value {
            return Ok(());
        }
        // LOAD or SAVE was lost.
        put_one(link, node, property, value)?;
        set(link, node, Property::SAVE, property.id().into())?;
        pause(link, STORE_US)?;
    }
    refused(node, property, value, found, "SAVE and LOAD")
}

/// Looks whether a board holds these values, and in all other stored properties what it held before; corrects what it does not, until nothing is
/// left to correct. Returns whether there was anything.
fn settle(link: &mut dyn Link, board: &Board, value: fn(&Change) -> i64) -> Result<bool, Failure> {
    for pass in 0..WRITES {
        let mut is_corrected = idle(link, board.present.node)?;
        is_corrected |= correct_changes(link, board, value)?;
        is_corrected |= correct_rest(link, board)?;
        // The second copy of a SET may have come meanwhile.
        is_corrected |= correct_changes(link, board, value)?;
        if !is_corrected {
            return Ok(pass > 0);
        }
    }
    failed(board.present.node, "its values change each time that they are read", "check adapter and cable")
}

/// Idles a motor that a damaged frame has set in motion.
fn idle(link: &mut dyn Link, node: Id) -> Result<bool, Failure> {
    let is_driving = get(link, node, Property::MODE)? != 0;
    if is_driving {
        put_one(link, node, Property::MODE, 0)?;
    }
    Ok(is_driving)
}

fn correct_changes(link: &mut dyn Link, board: &Board, value: fn(&Change) -> i64) -> Result<bool, Failure> {
    let node = board.present.node;
    let mut is_corrected = false;
    for change in &board.changes {
        if get(link, node, change.property)? != value(change) {
            is_corrected = true;
            put_one(link, node, change.property, value(change))?;
            set(link, node, Property::SAVE, change.property.id().into())?;
            pause(link, STORE_US)?;
            prove(link, node, change, value(change))?;
        }
    }
    Ok(is_corrected)
}

fn correct_rest(link: &mut dyn Link, board: &Board) -> Result<bool, Failure> {
    let node = board.present.node;
    let mut is_corrected = false;
    for &(property, before) in &board.rest {
        if look(link, node, property)? != before && get(link, node, property)? != before {
            is_corrected = true;
            put_one(link, node, property, before)?;
        }
    }
    Ok(is_corrected)
}

/// The same of all boards: what corrects one may have reached another.
fn settle_all(link: &mut dyn Link, boards: &[Board], value: fn(&Change) -> i64) -> Result<(), Failure> {
    for _ in 0..WRITES {
        let mut is_corrected = false;
        for board in boards {
            is_corrected |= settle(link, board, value)?;
        }
        if !is_corrected {
            break;
        }
    }
    Ok(())
}

fn refused<T>(node: Id, property: Property, value: i64, found: i64, after: &str) -> Result<T, Failure> {
    failed(
        node,
        &format!("{} reads {found} after {after}, expected {value}: the board refused it", name(property)),
        "read ERROR and look it up in docs/properties.md; an application of another version may have another range",
    )
}
