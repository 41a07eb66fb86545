//! Macros and sequences (manual 5.2.4).
//!
//! While a sequence is recorded, its commands are done as well, as they are typed; PLAY and REC are not recorded, nor is LOOP:
//! a host that plays a sequence waits for its prompt, and what it says next would be taken for control blocks. What has been recorded
//! is stored at once. A command that goes wrong ends PLAY, and its status is PLAY's; so does ^C. A macro or a sequence that is
//! empty is no value of MAC or PLAY: ERR 128.

use heapless::String;

use crate::command::Command;
use crate::god::God;
use crate::memory::{MACROS, Positions, SEQUENCE, SEQUENCES};
use crate::motors::{COUNT, Motors, Prefix};
use crate::movement;
use crate::parameter;
use crate::settings;
use crate::status::Status;
use crate::words::{self, Arguments, Words};

/// What ends a recorded command, as it ended the line.
pub(crate) const END: char = '\r';

/// Does it.
pub(crate) async fn execute(
    god: &God<'_>,
    command: Command,
    prefix: Prefix,
    arguments: Arguments<'_>,
) -> Status {
    let number = match arguments.only_number() {
        Ok(number) => number,
        Err(status) => return status,
    };
    match (command, number) {
        (Command::Rec, None) => {
            god.recording.set(None);
            Status::OK
        }
        (_, None) => Status::INVALID_VALUE,
        (Command::Rec, Some(number)) => begin(god, number),
        (Command::Mac, Some(number)) => play_macro(god, prefix, number).await,
        (Command::Macset, Some(number)) => set_macro(god, number).await,
        (Command::Wait, Some(milliseconds)) => wait(god, milliseconds).await,
        // PLAY has been taken apart before: it cannot be here but from inside a sequence.
        _ => Status::INVALID_VALUE,
    }
}

fn place(number: i64, count: usize) -> Result<usize, Status> {
    usize::try_from(number).ok().filter(|&place| place < count).ok_or(Status::INVALID_VALUE)
}

// --- macros ---------------------------------------------------------------------------------------------

/// Where the motors are is macro `number` from now on; all of them must know it.
async fn set_macro(god: &God<'_>, number: i64) -> Status {
    let Ok(place) = place(number, MACROS) else { return Status::INVALID_VALUE };
    if god.boards.wake(Motors::ALL).await != Motors::ALL {
        return Status::NO_BOARD;
    }
    if !movement::lost(god, Motors::ALL).await.is_empty() {
        return Status::NOT_INITIALIZED;
    }
    let Some(row) = parameter::motor("P") else { return Status::UNKNOWN_PARAMETER };
    let positions = settings::motors::values(god, row, Motors::ALL).await;
    let mut found: Positions = [0; COUNT];
    for motor in Motors::ALL.iter() {
        let position = positions.get(motor).and_then(|position| position.try_into().ok());
        match (found.get_mut(motor.index()), position) {
            (Some(to), Some(position)) => *to = position,
            _ => return Status::NO_BOARD,
        }
    }
    god.memory.change(|stored| {
        if let Some(to) = stored.macros.get_mut(place) {
            *to = Some(found);
        }
    });
    Status::OK
}

/// Moves motors to where they were at MACSET.
async fn play_macro(god: &God<'_>, prefix: Prefix, number: i64) -> Status {
    let positions = place(number, MACROS)
        .ok()
        .and_then(|place| god.memory.look(|stored| stored.macros.get(place).copied().flatten()));
    let Some(positions) = positions else { return Status::INVALID_VALUE };
    movement::to_positions(god, prefix, &positions).await
}

// --- sequences ------------------------------------------------------------------------------------------

/// Sequence `number` is empty, and commands are recorded there from now on.
fn begin(god: &God<'_>, number: i64) -> Status {
    let (Ok(place), Ok(number)) = (place(number, SEQUENCES), u8::try_from(number)) else {
        return Status::INVALID_VALUE;
    };
    god.memory.change(|stored| {
        if let Some(sequence) = stored.sequences.get_mut(place) {
            sequence.clear();
        }
    });
    god.recording.set(Some(number));
    Status::OK
}

/// Records a line that can be played, if that is to be done. Where there is no room for it, recording ends, and says so: no status code means that.
pub(crate) async fn record(god: &God<'_>, line: &str) {
    let Some(number) = god.recording.get() else { return };
    match words::parse(line) {
        Ok(Words::Command { command: Command::Rec | Command::Loop, .. } | Words::Empty) | Err(_) => return,
        Ok(Words::Command { .. } | Words::Lower(_)) => {}
    }
    let line = line.trim_ascii();
    let fits = god.memory.change(|stored| {
        let Some(sequence) = stored.sequences.get_mut(usize::from(number)) else { return false };
        let fits = sequence.len() + line.len() + END.len_utf8() <= SEQUENCE;
        fits && sequence.push_str(line).is_ok() && sequence.push(END).is_ok()
    });
    if !fits {
        god.recording.set(None);
        god.answer(format_args!("sequence {number} is full: recording has ended")).await;
    }
}

/// The sequence that a line plays, if it is PLAY.
///
/// # Errors
/// A PLAY that is none.
pub(crate) fn played(god: &God<'_>, line: &str) -> Result<Option<String<SEQUENCE>>, Status> {
    let Ok(Words::Command { command: Command::Play, prefix, arguments }) = words::parse(line) else {
        return Ok(None);
    };
    if prefix != Prefix::default() {
        return Err(Status::NO_PREFIX);
    }
    let number = arguments.only_number()?.ok_or(Status::INVALID_VALUE)?;
    let place = place(number, SEQUENCES)?;
    let sequence = god.memory.look(|stored| stored.sequences.get(place).cloned());
    sequence.filter(|sequence| !sequence.is_empty()).map(Some).ok_or(Status::INVALID_VALUE)
}

/// Does nothing for so long: up to the 49 days that fit 32 bits.
async fn wait(god: &God<'_>, milliseconds: i64) -> Status {
    let Ok(milliseconds) = u32::try_from(milliseconds) else { return Status::INVALID_VALUE };
    let us = u64::from(milliseconds).saturating_mul(1000);
    god.io.sleep_until(god.io.after_us(us)).await;
    Status::OK
}
