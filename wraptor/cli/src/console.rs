//! The console: entries in, the hand's answers out.

use std::io::{self, IsTerminal};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Duration;

use god::Status;
use god::boards::parse_report;
use wraptor::discovery::EVERYWHERE;
use wraptor::{
    BoardState, Boards, CallError, Connect, DownloadProgress, Failure, Firmware, Found, Frame, Hand,
    Progress, discover,
};

use crate::drive::drive;
use crate::entry::{self, Entry, Motion, Way};
use crate::input::{Input, Next};
use crate::output::print;
use crate::tables;
use crate::trouble::Trouble;
use crate::watch::watch;
use programs::interrupt::{self, during};

/// Limit of a connection.
pub const CONNECT: Duration = Duration::from_secs(5);

/// Limit of a board's download: over a serial line at 9600 baud it takes some 4 minutes.
pub const DOWNLOAD: Duration = Duration::from_secs(30 * 60);

/// How long hands may take to answer a search.
pub const SEARCH: Duration = Duration::from_secs(1);

const PROMPT: &str = "=> ";

/// A person's or a script's session with a hand.
pub struct Console {
    input: Input,
    hand: Option<Hand>,
    /// Limit of a line.
    limit: Duration,
    /// Whether M, C and O alone ask, as in the walk-through.
    walks: bool,
    /// Code of the worst trouble of a person's session.
    code: u8,
}

impl Console {
    pub const fn new(input: Input, hand: Option<Hand>, limit: Duration, walks: bool) -> Self {
        Self { input, hand, limit, walks, code: 0 }
    }

    /// Runs entries until their end. A script ends at its first trouble; a person is told. Returns the exit code.
    ///
    /// # Errors
    /// The trouble that has ended a script, with its place.
    pub fn run(mut self) -> Result<u8, Trouble> {
        loop {
            let text = match self.input.next(PROMPT)? {
                Next::Entry(text) => text,
                Next::Dropped => {
                    self.abort();
                    continue;
                }
                Next::End => break,
            };
            let outcome = entry::parse(&text, self.walks).map_err(invalid).and_then(|entry| match entry {
                Entry::Quit => Ok(ControlFlow::Break(())),
                entry => self.enter(entry).map(ControlFlow::Continue),
            });
            let reports = self.hand.as_mut().map(Hand::take_reports).unwrap_or_default();
            reports.iter().try_for_each(|line| print(&format!("{line}\n")))?;
            match outcome {
                Ok(ControlFlow::Continue(())) => {}
                Ok(ControlFlow::Break(())) => break,
                Err(trouble) => self.trouble(trouble)?,
            }
            // The call that ^C was for had just ended.
            if !self.input.is_typed() && interrupt::interrupted() {
                return Ok(interrupt::CODE);
            }
        }
        Ok(self.code)
    }

    /// ^C at the prompt stops motors that an entry has left moving, such as MODE 4.
    fn abort(&mut self) {
        if let Some(hand) = &self.hand {
            // A lost connection shows at the next entry.
            let _ = hand.canceller().cancel();
        }
    }

    /// Tells a person, or ends a script.
    fn trouble(&mut self, trouble: Trouble) -> Result<(), Trouble> {
        if trouble.is_lost() {
            self.hand = None;
        }
        if !self.input.is_typed() {
            return Err(Trouble::Script(self.input.place(), Box::new(trouble)));
        }
        eprintln!("{trouble}");
        // ^C is no trouble of a person's.
        if trouble.code() != interrupt::CODE {
            self.code = self.code.max(trouble.code());
        }
        Ok(())
    }

    fn enter(&mut self, entry: Entry) -> Result<(), Trouble> {
        match entry {
            Entry::Nothing | Entry::Quit => Ok(()),
            Entry::Line(line) => self.line(&line),
            Entry::Ask(motion) => self.ask(motion),
            Entry::Walk(walks) => {
                self.walks = walks;
                Ok(())
            }
            Entry::Connect(way) => {
                // A hand takes one host, which may be this one.
                if self.hand.as_ref().is_some_and(|hand| hand.place() == way.place()) {
                    self.hand = None;
                }
                // If that fails, the connection before stays.
                self.hand = Some(connect(&way)?);
                Ok(())
            }
            Entry::Disconnect => {
                self.hand = None;
                Ok(())
            }
            Entry::Discover => print(&list(&discover(&EVERYWHERE, SEARCH)?)),
            Entry::Download { file, nodes } => {
                let firmware = firmware(&file)?;
                download(self.hand()?, &nodes, &firmware)
            }
            Entry::Help(None) => print(&tables::overview()),
            Entry::Help(Some(name)) => {
                let text = tables::explain(&name);
                let unknown = || invalid(format!("help: found {name:?}, expected a name of `help`"));
                print(&text.ok_or_else(unknown)?)
            }
            Entry::Loop { motors, velocities, time } => {
                let is_typed = self.input.is_typed();
                let hand = self.hand()?;
                during(|| drive(hand, &motors, &velocities, time, is_typed))
            }
            Entry::Watch { nodes, properties, time } => {
                let is_typed = self.input.is_typed();
                let hand = self.hand()?;
                during(|| watch(hand, &nodes, &properties, time, is_typed))
            }
        }
    }

    fn hand(&mut self) -> Result<&mut Hand, Trouble> {
        self.hand.as_mut().ok_or_else(|| {
            Trouble::Input(
                "found no connection, expected one\n  next: connect HOST:PORT; discover lists hands".into(),
            )
        })
    }

    fn line(&mut self, line: &str) -> Result<(), Trouble> {
        let limit = self.limit;
        let hand = self.hand()?;
        let outcome = during(|| hand.command_and_wait(line, limit, &mut until_interrupted));
        let answer = outcome.map_err(|error| explained(hand, line, error))?;
        let typed = tables::typed_name(line);
        answer.iter().try_for_each(|line| print(&format!("{line}{typed}\n")))?;
        // After `0 S REPLY 1` boards answer by packets.
        while let Some(frame) = self.hand()?.receive(Duration::ZERO)? {
            print(&text(&frame))?;
        }
        Ok(())
    }

    /// The walk-through's entries, one after the other.
    fn ask(&mut self, motion: Motion) -> Result<(), Trouble> {
        let Some(fingers) = self.answer("Motors: ", entry::fingers)? else { return Ok(()) };
        let position = match motion {
            Motion::Move => self.answer("Position: ", entry::position)?,
            Motion::Close | Motion::Open => Some(0),
        };
        let Some(position) = position else { return Ok(()) };
        let limit = self.limit;
        let hand = self.hand()?;
        let moved = during(|| match motion {
            Motion::Move => hand.move_halls(&fingers, position, limit, &mut until_interrupted),
            Motion::Close => hand.close_fingers(&fingers, limit, &mut until_interrupted),
            Motion::Open => hand.open_fingers(&fingers, limit, &mut until_interrupted),
        });
        moved.map_err(|error| explained(hand, &format!("{fingers} S E {position}"), error))
    }

    /// `None`: ^C drops the command.
    fn answer<T>(
        &mut self,
        question: &str,
        parse: impl FnOnce(&str) -> Result<T, String>,
    ) -> Result<Option<T>, Trouble> {
        match self.input.next(question)? {
            Next::Entry(text) => parse(&text).map(Some).map_err(invalid),
            Next::Dropped => Ok(None),
            Next::End => Err(invalid(format!("found the end, expected an answer to {question:?}"))),
        }
    }
}

/// A packet as the line that it would be, or as its bytes.
fn text(frame: &Frame) -> String {
    match parse_report(frame) {
        Some((motor, property, value)) => {
            format!("{} {}={value} (packet)\n", motor.number(), property.row().name)
        }
        None => format!("{:03X} {:02X?} (packet)\n", frame.raw_id(), frame.data()),
    }
}

/// What the hand's number does not tell: the value and its range, or which boards sleep, are silent or have one number.
fn explained(hand: &mut Hand, line: &str, error: CallError) -> Trouble {
    let hint = match &error.failure {
        Failure::Status(status) if status.has(Status::INVALID_VALUE) => tables::range(line),
        Failure::Status(status) if status.has(Status::NO_BOARD) => asleep(hand).or_else(|| missing(hand)),
        _ => None,
    };
    match hint {
        Some(hint) => Trouble::Explained(error, hint),
        None => error.into(),
    }
}

/// Names boards that sleep.
fn asleep(hand: &mut Hand) -> Option<String> {
    // Another error shows at the next entry.
    let states = hand.boards(CONNECT).ok()?;
    let nodes = nodes_in(&states, BoardState::Asleep);
    (!nodes.is_empty()).then(|| format!("boards {nodes} are asleep\n  next: WAKE"))
}

/// Names boards that do not answer, and two with one number, as the hand's ERR 1 does: `motor 2: ...`, and a next step indented behind it.
fn missing(hand: &mut Hand) -> Option<String> {
    let lines = hand.command("ERR 1", CONNECT).ok()?;
    // The first one is the meaning of the number.
    let named = lines.iter().skip(1).map(|line| match line.strip_prefix("  ") {
        Some(step) => format!("  next: {step}"),
        None => line.clone(),
    });
    let named: Vec<String> = named.collect();
    (!named.is_empty()).then(|| named.join("\n"))
}

fn nodes_in(states: &[BoardState; 7], state: BoardState) -> String {
    let of = states.iter().zip(entry::NODES.chars()).filter(|(of, _)| **of == state);
    of.map(|(_, node)| node).collect()
}

fn invalid(text: String) -> Trouble {
    Trouble::Input(text + "\n  next: enter it again; help lists all commands")
}

fn until_interrupted(_: &Progress) -> ControlFlow<()> {
    match interrupt::interrupted() {
        true => ControlFlow::Break(()),
        false => ControlFlow::Continue(()),
    }
}

/// Connects, and says to what.
///
/// # Errors
/// The cause and the next step.
pub fn connect(way: &Way) -> Result<Hand, Trouble> {
    let connect = match way {
        Way::Tcp(place) => Connect::tcp(place),
        #[cfg(unix)]
        Way::Serial(place, baud) => Connect::serial(place, *baud),
        Way::Can(place) => Connect::can(place),
    };
    // The walk-through begins with boards that sleep.
    let mut hand = connect.boards(Boards::Any).connect(CONNECT)?;
    let states = hand.boards(CONNECT)?;
    let mut text = format!("connected to {}: firmware {}", hand.place(), hand.version());
    for (state, name) in [
        (BoardState::Ready, "ready"),
        (BoardState::Asleep, "asleep (WAKE)"),
        (BoardState::Unusable, "unusable"),
        (BoardState::Silent, "without power or off the bus"),
    ] {
        let nodes = nodes_in(&states, state);
        if !nodes.is_empty() {
            text.push_str(&format!("; boards {nodes} {name}"));
        }
    }
    print(&(text + "\n"))?;
    Ok(hand)
}

/// Hands, a line each.
pub fn list(found: &[Found]) -> String {
    if found.is_empty() {
        return "no hand answers\n".to_owned();
    }
    let line =
        |found: &Found| format!("{}  {}\n", found.address, hardware(found).unwrap_or_else(|| "-".to_owned()));
    found.iter().map(line).collect()
}

/// `00:20:4A:01:02:03`.
pub fn hardware(found: &Found) -> Option<String> {
    let bytes = found.hardware?;
    Some(bytes.map(|byte| format!("{byte:02X}")).join(":"))
}

/// Reads and checks a `.tek` file.
///
/// # Errors
/// It cannot be read, or no board takes it.
pub fn firmware(path: &Path) -> Result<Firmware, Trouble> {
    Firmware::read(path).map_err(|error| Trouble::Input(error.to_string()))
}

/// Downloads to boards, with percent on a terminal.
///
/// # Errors
/// The board and the cause.
pub fn download(hand: &mut Hand, nodes: &str, firmware: &Firmware) -> Result<(), Trouble> {
    let is_shown = io::stderr().is_terminal();
    let version = firmware.header().version;
    for node in nodes.chars() {
        let show = &mut |progress: &DownloadProgress| {
            if is_shown {
                eprint!("\rnode {node}: {:>3} %", progress.percent());
            }
            match interrupt::interrupted() {
                true => ControlFlow::Break(()),
                false => ControlFlow::Continue(()),
            }
        };
        let outcome = during(|| hand.download(&node.to_string(), firmware, DOWNLOAD, show));
        if is_shown {
            eprintln!();
        }
        if let Err(CallError { failure: Failure::Cancelled, .. }) = &outcome {
            eprintln!("node {node} keeps its old application");
        }
        outcome?;
        print(&format!("node {node}: version {version} runs\n"))?;
    }
    Ok(())
}
