//! The board itself: start, prompt, line, command, status, prompt (manual 5.1).

use core::cell::{Cell, RefCell};
use core::convert::Infallible;

use heapless::String;

use crate::boards::Boards;
use crate::command::{Category, Command};
use crate::io::{Io, unless_aborted};
use crate::line::{self, Heard};
use crate::memory::{Memory, Parameters};
use crate::motors::{COUNT, Motor, Prefix};
use crate::status::Status;
use crate::words::{self, Words};
use crate::{administration, lower, movement, realtime, sequences, settings};

/// What ends a line before an answer, an error and the prompt: clients look for LF CR, others for CR LF; this has both (PROTOCOL 3).
pub const LINE_END: &str = "\r\n\r";

/// What waits for a command.
pub const PROMPT: &str = "=> ";

/// What it says when it starts; clients wait for the words "BarrettHand Firmware" after RESET.
pub const BANNER: &str = "GOD of a BarrettWraptor, as BarrettHand Firmware";

/// The version of GOD's software: that of the boards it is made for.
pub const VERSION: u16 = 600;

/// What goes on between two commands.
pub struct God<'a> {
    pub(crate) io: &'a Io,
    pub(crate) memory: &'a Memory,
    pub(crate) boards: Boards<'a>,
    /// The parameters as they are.
    pub(crate) parameters: RefCell<Parameters>,
    /// What a motor's last motion came to (parameter S), by place.
    pub(crate) results: Cell<[Status; COUNT]>,
    /// What moves, and what it is to be given back.
    pub(crate) moves: movement::Moves,
    /// The position of each motor that the host knows, GCL counts: FGET P or RealTime told it (manual 6.2.3).
    pub(crate) reported: Cell<[i32; COUNT]>,
}

/// GOD, from its start on. Never ends.
pub async fn run(io: &Io, memory: &Memory) -> Infallible {
    loop {
        let god = God::new(io, memory);
        god.start().await;
        while movement::accompanied(&god, god.serve()).await {}
    }
}

impl<'a> God<'a> {
    fn new(io: &'a Io, memory: &'a Memory) -> Self {
        Self {
            io,
            memory,
            boards: Boards::new(io),
            parameters: RefCell::new(memory.look(|stored| stored.parameters)),
            results: Cell::default(),
            moves: movement::Moves::default(),
            reported: Cell::default(),
        }
    }

    async fn start(&self) {
        self.io.set_baud(self.parameters.borrow().hand.baud);
        self.io.print(format_args!("{LINE_END}{BANNER}")).await;
        self.prompt().await;
    }

    async fn prompt(&self) {
        self.io.print(format_args!("{LINE_END}{PROMPT}")).await;
    }

    /// A line, and the prompt after it. Returns whether it goes on: not after RESET.
    async fn serve(&self) -> bool {
        let status = match line::read(self.io).await {
            Heard::Abort => Status::OK,
            Heard::TooLong => Status::TOO_MANY_ARGUMENTS,
            Heard::Line(mut line) => {
                line.make_ascii_uppercase();
                self.line(&line).await
            }
        };
        if !status.is_ok() {
            self.io.print(format_args!("{LINE_END}ERR {}", status.code())).await;
        }
        self.prompt().await;
        true
    }

    /// Does what a line says, or as much of it as is done before ^C.
    pub(crate) async fn line(&self, line: &str) -> Status {
        let words = match words::parse(line) {
            Ok(words) => words,
            Err(status) => return status,
        };
        // ^C at the prompt was for what was typed before.
        let done = unless_aborted(self.io, self.words(words)).await;
        if let Some(status) = done {
            return status;
        }
        self.io.takes_abort();
        self.io.set_raw(false);
        movement::abort(self).await;
        Status::ABORTED
    }

    async fn words(&self, words: Words<'_>) -> Status {
        let (command, prefix, arguments) = match words {
            Words::Empty => return Status::OK,
            Words::Lower(line) => return lower::execute(self, line).await,
            Words::Command { command, prefix, arguments } => (command, prefix, arguments),
        };
        let Some(row) = command.row() else { return Status::UNKNOWN_COMMAND };
        if !row.prefix && prefix != Prefix::default() {
            return Status::NO_PREFIX;
        }
        match (command, row.category) {
            (Command::Loop, _) => realtime::execute(self, prefix, arguments).await,
            (_, Category::Movement) => movement::execute(self, command, prefix, arguments).await,
            (_, Category::MotorParameters | Category::GlobalParameters)
            | (Command::Flista | Command::Flistav | Command::Plista | Command::Plistav, _) => {
                settings::execute(self, command, prefix, arguments).await
            }
            (_, Category::Sequences) => sequences::execute(self, command, prefix, arguments).await,
            (_, Category::Administration | Category::Advanced) => {
                administration::execute(self, command, arguments).await
            }
        }
    }

    /// Says a line of an answer.
    pub(crate) async fn answer(&self, text: core::fmt::Arguments<'_>) {
        self.io.print(format_args!("{LINE_END}{text}")).await;
    }

    /// Takes note of what a motor's motion has come to.
    pub(crate) fn note(&self, motor: Motor, status: Status) {
        let mut results = self.results.get();
        if let Some(result) = results.get_mut(motor.index()) {
            *result = status;
        }
        self.results.set(results);
    }

    /// What a motor's last motion came to.
    pub(crate) fn result(&self, motor: Motor) -> Status {
        self.results.get().get(motor.index()).copied().unwrap_or_default()
    }
}

/// A line of an answer in the making.
pub(crate) type Text = String<{ crate::io::TEXT }>;
