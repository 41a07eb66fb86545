//! The shell: start, prompt, line, command, status, prompt (manual 5.1).
//!
//! # Deadlines
//! ^C and a hang-up end every command: its orders that have not left yet are dropped, the motors that it moved are stopped, overridden
//! properties restored. With a dead bus that takes 0.5 s at most. After it the host is at a prompt.

use core::convert::Infallible;
use core::future::poll_fn;
use core::pin::{Pin, pin};
use core::task::{Context, Poll};

use tater_wire::Property;

use crate::command::{Category, GclCommand};
use crate::events::EventKind;
use crate::god::God;
use crate::grammar::{self, Statement};
use crate::io::{Io, unless_aborted, with_background};
use crate::line::{self, Input};
use crate::memory::Memory;
use crate::motors::{Motors, Prefix};
use crate::status::Status;
use crate::words::words;
use crate::{administration, movement, order, packets, realtime, sequences, settings, walk_through};

enum Outcome {
    Done(Status),
    /// RESET: start anew.
    Reset,
}

/// Runs GOD from its start on. Never ends.
pub async fn run(io: &Io, memory: &Memory) -> Infallible {
    loop {
        let god = God::new(io, memory);
        io.record(EventKind::Started);
        let life = pin!(async {
            io.set_baud(god.memory.parameters().hand.baud);
            god.banner().await;
            god.prompt().await;
            with_background(pin!(order::send_keepalives(&god)), pin!(serve(&god))).await;
        });
        with_background(pin!(settings::hand::maintain_statistics(&god)), life).await;
        settings::hand::update_statistics(&god);
    }
}

/// Reads lines and runs them, until RESET.
async fn serve(god: &God<'_>) {
    loop {
        if god.io.take_hang_up() {
            god.session.forget_host();
        }
        walk_through::report_ends(god).await;
        let outcome = match line::read(god.io).await {
            // Queued frames stay: the last stop orders may be among them. On a dead bus they expire.
            Input::Abort => {
                let status = walk_through::abort(god).await;
                packets::drop_late_answers(god).await;
                Outcome::Done(status)
            }
            Input::Packet(packet) => match packets::place(god, &packet).await {
                // A host sends hundreds in a second, and waits for none.
                Status::OK => continue,
                refusal => Outcome::Done(refusal),
            },
            Input::BrokenPacket | Input::Unreadable => Outcome::Done(Status::INVALID_VALUE),
            Input::TooLong => Outcome::Done(Status::TOO_MANY_ARGUMENTS),
            Input::Line(mut line) => {
                line.make_ascii_uppercase();
                run_line(god, &line).await
            }
        };
        match outcome {
            Outcome::Reset => return,
            Outcome::Done(status) if !status.is_ok() => {
                god.io.record(EventKind::Failed { status });
                god.print_line(words!["ERR ", status.code()]).await;
            }
            Outcome::Done(_) => {}
        }
        god.prompt().await;
    }
}

async fn run_line(god: &God<'_>, line: &str) -> Outcome {
    let outcome = {
        let committed = pin!(async {
            packets::settle(god).await;
            match run_commands(god, line).await {
                Outcome::Done(status) => Outcome::Done(status | god.memory.commit(god.io).await),
                Outcome::Reset => Outcome::Reset,
            }
        });
        // What ^C breaks off is dropped here.
        unless_aborted(god.io, committed).await
    };
    if let Some(outcome) = outcome {
        return outcome;
    }
    god.io.take_abort();
    god.io.leave_raw();
    // Orders that have not left yet are void; output that the host does not read must not hold the prompt back.
    god.io.drop_frames();
    god.io.discard_full_output();
    order::abort_motion(god).await;
    walk_through::abort(god).await;
    packets::drop_late_answers(god).await;
    Outcome::Done(Status::ABORTED)
}

/// Runs a line's command; for PLAY those of its sequence, until one fails.
async fn run_commands(god: &God<'_>, line: &str) -> Outcome {
    let sequence = match sequences::played(god, line) {
        Ok(sequence) => sequence,
        Err(status) => return Outcome::Done(status),
    };
    if sequence.is_none() {
        sequences::record(god, line).await;
    }
    // A recorded sequence contains no PLAY (manual 5.2.4), so this does not nest.
    // As one of a set: the search for a single character has a panic in it.
    for command in sequence.as_deref().unwrap_or(line).split_terminator([sequences::END]) {
        let outcome = match grammar::parse(command) {
            Ok(statement) => dispatch(god, statement).await,
            Err(status) => Outcome::Done(status),
        };
        match outcome {
            Outcome::Done(status) if status.is_ok() => {}
            outcome => return outcome,
        }
    }
    Outcome::Done(Status::OK)
}

/// Polls a future in a call of its own: the others of [`dispatch`] take no stack meanwhile.
#[inline(never)]
fn poll_apart<F: Future>(future: Pin<&mut F>, context: &mut Context<'_>) -> Poll<F::Output> {
    future.poll(context)
}

macro_rules! apart {
    ($future:expr) => {{
        let mut future = pin!($future);
        poll_fn(|context| poll_apart(future.as_mut(), context)).await
    }};
}

async fn dispatch(god: &God<'_>, statement: Statement<'_>) -> Outcome {
    let (command, prefix, arguments) = match statement {
        Statement::Empty => return Outcome::Done(Status::OK),
        Statement::Lower(request) => return Outcome::Done(apart!(walk_through::execute(god, request))),
        Statement::Command { command, prefix, arguments } => (command, prefix, arguments),
    };
    let Some(spec) = command.row() else { return Outcome::Done(Status::UNKNOWN_COMMAND) };
    if !spec.prefix && prefix != Prefix::default() {
        return Outcome::Done(Status::NO_PREFIX);
    }
    Outcome::Done(match (command, spec.category) {
        (GclCommand::Loop, _) => apart!(realtime::execute(god, prefix, arguments)),
        (GclCommand::Reset, _) => match arguments.none() {
            Ok(()) => {
                // Back into their monitors, as after power-on.
                god.boards.set(Motors::ALL, Property::STAT, 0).await;
                return Outcome::Reset;
            }
            Err(status) => status,
        },
        (_, Category::Movement) => apart!(movement::execute(god, command, prefix, arguments)),
        (_, Category::MotorParameters | Category::GlobalParameters)
        | (GclCommand::Flista | GclCommand::Flistav | GclCommand::Plista | GclCommand::Plistav, _) => {
            apart!(settings::execute(god, command, prefix, arguments))
        }
        (_, Category::Sequences) => apart!(sequences::execute(god, command, prefix, arguments)),
        (_, Category::Administration | Category::Advanced) => {
            apart!(administration::execute(god, command, arguments))
        }
    })
}
