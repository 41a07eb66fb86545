//! The board itself: start, prompt, line, command, status, prompt (manual 5.1).

use core::cell::{Cell, RefCell};
use core::convert::Infallible;

use heapless::String;

use crate::boards::Boards;
use crate::command::{Category, Command};
use crate::io::{Io, unless_aborted, with_background};
use crate::line::{self, Heard};
use crate::memory::{Memory, Parameters};
use crate::motors::{COUNT, Motor, Motors, Prefix, Selection};
use crate::status::Status;
use crate::words::{self, Words};
use crate::{administration, lower, movement, realtime, sequences, settings};
use tater_wire::Property;

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
    /// The position of each motor that the host knows, GCL counts: FGET P or RealTime told it (manual 6.2.3).
    pub(crate) reported: Cell<[i32; COUNT]>,
    /// Until when UPSECS has been counted, us.
    pub(crate) counted_us: Cell<u64>,
    /// The sequence that commands are recorded in.
    pub(crate) recording: Cell<Option<u8>>,
    /// What the lower grammar needs between two lines.
    pub(crate) lower: lower::State,
    /// RESET was the last command.
    pub(crate) is_over: Cell<bool>,
    /// What moves, and what it is to be given back.
    pub(crate) moves: movement::Moves,
}

/// GOD, from its start on. Never ends.
pub async fn run(io: &Io, memory: &Memory) -> Infallible {
    loop {
        let god = God::new(io, memory);
        with_background(settings::hand::keep(&god), async {
            god.start().await;
            with_background(movement::keep_company(&god), async { while god.serve().await {} }).await;
        })
        .await;
        settings::hand::count(&god);
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
            reported: Cell::default(),
            counted_us: Cell::new(io.now_us()),
            recording: Cell::default(),
            lower: lower::State::default(),
            is_over: Cell::default(),
            moves: movement::Moves::default(),
        }
    }

    async fn start(&self) {
        self.io.set_baud(self.parameters.borrow().hand.baud);
        self.io.print(format_args!("{LINE_END}{BANNER}")).await;
        self.prompt().await;
    }

    pub(crate) async fn prompt(&self) {
        self.io.print(format_args!("{LINE_END}{PROMPT}")).await;
    }

    /// A line, and the prompt after it. Returns whether it goes on: not after RESET.
    async fn serve(&self) -> bool {
        lower::tell_ends(self).await;
        let status = match line::read(self.io).await {
            Heard::Abort => lower::abort(self).await,
            Heard::TooLong => Status::TOO_MANY_ARGUMENTS,
            Heard::Line(mut line) => {
                line.make_ascii_uppercase();
                self.line(&line).await
            }
        };
        if self.is_over.get() {
            return false;
        }
        if !status.is_ok() {
            self.io.print(format_args!("{LINE_END}ERR {}", status.code())).await;
        }
        self.prompt().await;
        true
    }

    /// Does what a line says, or as much of it as is done before ^C.
    pub(crate) async fn line(&self, line: &str) -> Status {
        // ^C at the prompt was for what was typed before.
        let done = unless_aborted(self.io, self.commands(line)).await;
        if let Some(status) = done {
            return status;
        }
        self.io.take_abort();
        self.io.leave_raw();
        // Orders that have not left yet are void; output that the host does not read must not keep the prompt back.
        self.io.drop_frames();
        self.io.discard_full_output();
        movement::abort(self).await;
        lower::abort(self).await;
        Status::ABORTED
    }

    /// Does a line's command; instead of PLAY, those of its sequence, until one goes wrong.
    async fn commands(&self, line: &str) -> Status {
        let sequence = match sequences::played(self, line) {
            Ok(sequence) => sequence,
            Err(status) => return status,
        };
        if sequence.is_none() {
            sequences::record(self, line).await;
        }
        // A recorded sequence has no PLAY (manual 5.2.4), so this does not go deeper.
        for command in sequence.as_deref().unwrap_or(line).split_terminator(sequences::END) {
            let status = match words::parse(command) {
                Ok(words) => self.words(words).await,
                Err(status) => status,
            };
            if !status.is_ok() || self.is_over.get() {
                return status;
            }
        }
        Status::OK
    }

    /// The motors of a prefix. Without one those with EN, which their boards say, awake for it; one that says nothing is not taken for
    /// disabled, so that a hand with a dead board says so.
    ///
    /// # Errors
    /// There are none.
    pub(crate) async fn selection(&self, prefix: Prefix) -> Result<Selection, Status> {
        let mut enabled = Motors::ALL;
        if !prefix.given && !prefix.exclusive {
            let awake = self.boards.wake(Motors::ALL).await;
            enabled = enabled.difference(self.boards.get(awake, Property::EN).await.filter(|en| en == 0));
        }
        let selection = prefix.select(enabled);
        if selection.axes.is_empty() { Err(Status::NO_MOTOR) } else { Ok(selection) }
    }

    /// The same; their boards are woken.
    ///
    /// # Errors
    /// There are none, or a board does not answer.
    pub(crate) async fn selected(&self, prefix: Prefix) -> Result<Selection, Status> {
        let selection = self.selection(prefix).await?;
        let motors = selection.motors();
        let silent = motors.difference(self.boards.wake(motors).await);
        if silent.is_empty() { Ok(selection) } else { Err(Status::NO_BOARD) }
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
