//! Macros and sequences (manual 5.2.4).
//!
//! While a sequence is recorded, its commands run as well, as they are typed. PLAY and REC are not recorded, nor is LOOP: a host that plays a
//! sequence waits for its prompt, and its next bytes would be taken for control blocks (decision 0028). Each command is stored when it is
//! recorded. A recording ends with its host. A command that fails ends PLAY with its status; so does ^C. MAC and PLAY of an empty one are ERR 128.

use heapless::String;

use crate::command::GclCommand;
use crate::god::God;
use crate::grammar::{self, Arguments, Statement};
use crate::memory::{MACROS, Positions, SEQUENCE, SEQUENCES};
use crate::motors::{COUNT, Motors, Prefix};
use crate::movement;
use crate::query;
use crate::status::Status;
use crate::words::words;

/// Line end of a recorded command.
pub(crate) const END: char = '\r';

pub(crate) async fn execute(
    god: &God<'_>,
    command: GclCommand,
    prefix: Prefix,
    arguments: Arguments<'_>,
) -> Status {
    let number = match arguments.only_number() {
        Ok(number) => number,
        Err(status) => return status,
    };
    match (command, number) {
        (GclCommand::Rec, None) if god.session.recording().is_some() => {
            god.session.set_recording(None);
            // It is stored already, unless a line could not be: then the prompt says whether it is now.
            god.memory.update(|_| ());
            Status::OK
        }
        (GclCommand::Rec, None) => begin(god, 0),
        (_, None) => Status::INVALID_VALUE,
        (GclCommand::Rec, Some(number)) => begin(god, number),
        (GclCommand::Mac, Some(number)) => play_macro(god, prefix, number).await,
        (GclCommand::Macset, Some(number)) => set_macro(god, number).await,
        (GclCommand::Wait, Some(milliseconds)) => wait(god, milliseconds).await,
        // The shell runs PLAY's commands: here it comes from inside a sequence.
        _ => Status::INVALID_VALUE,
    }
}

fn place(number: i64, count: usize) -> Result<usize, Status> {
    usize::try_from(number).ok().filter(|&place| place < count).ok_or(Status::INVALID_VALUE)
}

/// Stores the present positions as macro `number`; all motors must know theirs.
async fn set_macro(god: &God<'_>, number: i64) -> Status {
    let Ok(place) = place(number, MACROS) else { return Status::INVALID_VALUE };
    if god.boards.wake(Motors::ALL).await != Motors::ALL {
        return Status::NO_BOARD;
    }
    if !query::uninitialized(god, Motors::ALL).await.is_empty() {
        return Status::NOT_INITIALIZED;
    }
    let positions = query::known_positions(god, Motors::ALL).await;
    let mut found: Positions = [0; COUNT];
    for motor in Motors::ALL.iter() {
        let position = positions.get(motor).and_then(|position| position.try_into().ok());
        match (found.get_mut(motor.index()), position) {
            (Some(to), Some(position)) => *to = position,
            _ => return Status::NO_BOARD,
        }
    }
    god.memory.update(|stored| {
        if let Some(to) = stored.macros.get_mut(place) {
            *to = Some(found);
        }
    });
    Status::OK
}

async fn play_macro(god: &God<'_>, prefix: Prefix, number: i64) -> Status {
    let positions = place(number, MACROS)
        .ok()
        .and_then(|place| god.memory.read(|stored| stored.macros.get(place).copied().flatten()));
    let Some(positions) = positions else { return Status::INVALID_VALUE };
    movement::to_positions(god, prefix, &positions).await
}

/// Empties sequence `number` and begins to record commands in it.
fn begin(god: &God<'_>, number: i64) -> Status {
    let (Ok(place), Ok(number)) = (place(number, SEQUENCES), u8::try_from(number)) else {
        return Status::INVALID_VALUE;
    };
    god.memory.update(|stored| {
        if let Some(sequence) = stored.sequences.get_mut(place) {
            sequence.clear();
        }
    });
    god.session.set_recording(Some(number));
    Status::OK
}

/// Records a line that can be played, while recording. Where there is no room for it, recording ends with a line of text, because no
/// status code means that.
pub(crate) async fn record(god: &God<'_>, line: &str) {
    let Some(number) = god.session.recording() else { return };
    match grammar::parse(line) {
        Ok(Statement::Command { command: GclCommand::Rec | GclCommand::Loop, .. } | Statement::Empty)
        | Err(_) => return,
        Ok(Statement::Command { .. } | Statement::Lower(_)) => {}
    }
    let line = line.trim_ascii();
    let fits = god.memory.update(|stored| {
        let Some(sequence) = stored.sequences.get_mut(usize::from(number)) else { return false };
        let fits = sequence.len() + line.len() + END.len_utf8() <= SEQUENCE;
        fits && sequence.push_str(line).is_ok() && sequence.push(END).is_ok()
    });
    if !fits {
        god.session.set_recording(None);
        god.print_line(words!["sequence ", number, " is full: recording has ended"]).await;
    }
}

/// The sequence that a line plays, if its command is PLAY.
///
/// # Errors
/// Why this PLAY is refused.
pub(crate) fn played(god: &God<'_>, line: &str) -> Result<Option<String<SEQUENCE>>, Status> {
    let Ok(Statement::Command { command: GclCommand::Play, prefix, arguments }) = grammar::parse(line) else {
        return Ok(None);
    };
    if prefix != Prefix::default() {
        return Err(Status::NO_PREFIX);
    }
    let number = arguments.only_number()?.unwrap_or(0);
    let place = place(number, SEQUENCES)?;
    let sequence = god.memory.read(|stored| stored.sequences.get(place).cloned());
    sequence.filter(|sequence| !sequence.is_empty()).map(Some).ok_or(Status::INVALID_VALUE)
}

/// Waits for up to 2³² ms, 49 days.
async fn wait(god: &God<'_>, milliseconds: i64) -> Status {
    let Ok(milliseconds) = u32::try_from(milliseconds) else { return Status::INVALID_VALUE };
    let us = u64::from(milliseconds).saturating_mul(1000);
    god.boards.listen_until(god.io.after_us(us)).await;
    Status::OK
}
