//! `hil-sim grasper`: connects the walk-through's console to standard input and, over TCP, to a hand.

use std::error::Error;
use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Duration;

use crate::experiment::input::BadInput;
use crate::ports::grasper::Console;

use super::guard::{Guard, guard};
use crate::ports::lines::Lines;
use crate::ports::output::{print, warn};
use crate::ports::thread;

/// Timeout without output from the hand: a motor may push for TSTOP, up to 65 s, before it counts as stalled.
const SILENCE_LIMIT: Duration = Duration::from_secs(120);

/// Timeout of the first prompt: a hand may wait 2 s for the answers of a host that has closed its side, and aborts within 0.5 s.
const FIRST_LIMIT: Duration = Duration::from_secs(5);

/// The arguments of `hil-sim grasper`.
#[derive(clap::Args)]
pub struct GrasperArgs {
    /// Address of the hand (`hil-sim hand --listen`).
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:11001")]
    connect: String,
    /// Be the process that sends ^C after the end of the console.
    #[arg(long, hide = true)]
    guard: bool,
}

enum Event {
    /// An entry; `None` at the end of the input.
    Entry(Result<Option<Entry>, BadInput>),
    Received(Vec<u8>),
    Gone(String),
}

struct Entry {
    text: String,
    place: String,
    is_typed: bool,
}

/// Runs the console until standard input ends. Returns whether the hand reported no error.
///
/// # Errors
/// No hand, or it disconnects or times out; an invalid entry, unless a person can correct it.
pub fn grasper(args: &GrasperArgs) -> Result<bool, Box<dyn Error>> {
    if args.guard {
        guard()?;
        return Ok(true);
    }
    let lost = |problem: &str, found: String| BadInput {
        place: format!("--connect {}", args.connect),
        problem: problem.to_owned(),
        found,
        expected: "a hand at this address without another host".to_owned(),
        next: "start one with hil-sim hand --listen, or give its address".to_owned(),
    };
    let (sender, events) = sync_channel(1);
    let hand = connect(&args.connect, sender.clone()).map_err(|e| lost("there is no hand", e.to_string()))?;
    let (next, wanted) = sync_channel(1);
    thread::start(move || read(&wanted, &sender)).map_err(|e| lost("cannot be served", e.to_string()))?;
    let _guard = Guard::new(&hand).map_err(|e| lost("cannot be served", e.to_string()))?;
    let mut session = Session { hand, next, console: Console::default(), asked: None, last: String::new() };
    let mut limit = FIRST_LIMIT;
    loop {
        session.advance()?;
        // A person may take any time.
        let event = match session.asked {
            Some(_) => events.recv().ok(),
            None => events.recv_timeout(limit).ok(),
        };
        match event {
            Some(Event::Entry(entry)) => match entry? {
                Some(entry) => session.enter(entry)?,
                None => return session.finish(),
            },
            Some(Event::Received(bytes)) => {
                limit = SILENCE_LIMIT;
                session.received(&bytes)?;
            }
            Some(Event::Gone(why)) => {
                return Err(lost("the hand is gone", format!("{why}, after {:?}", session.last)).into());
            }
            None => return Err(lost("the hand is silent", format!("nothing for {limit:?}")).into()),
        }
    }
}

struct Session {
    hand: TcpStream,
    next: SyncSender<()>,
    console: Console,
    /// The question printed and not yet answered.
    asked: Option<&'static str>,
    last: String,
}

impl Session {
    fn advance(&mut self) -> Result<(), BadInput> {
        while let Some(line) = self.console.next_line() {
            // A lost connection is reported by the reading thread.
            let _ = self.hand.write_all(line.as_bytes());
        }
        if self.asked.is_none()
            && let Some(question) = self.console.question()
        {
            print(question)?;
            self.asked = Some(question);
            let _ = self.next.send(());
        }
        Ok(())
    }

    fn enter(&mut self, Entry { text, place, is_typed }: Entry) -> Result<(), BadInput> {
        self.asked = None;
        if !is_typed {
            print(&format!("{text}\n"))?;
        }
        match self.console.enter(&text) {
            Ok(lines) => lines.iter().try_for_each(|line| print(&format!("-> {line}\n"))),
            Err(bad) if is_typed => {
                warn(&BadInput { place, ..bad }.to_string());
                Ok(())
            }
            Err(bad) => Err(BadInput { place, ..bad }),
        }
    }

    fn received(&mut self, bytes: &[u8]) -> Result<(), BadInput> {
        for &byte in bytes {
            let Some(line) = self.console.push_byte(byte) else { continue };
            // Print above the open question and repeat that.
            let question = self.asked.unwrap_or_default();
            let from = if question.is_empty() { "" } else { "\n" };
            print(&format!("{from}{line}\n{question}"))?;
            self.last = line;
        }
        Ok(())
    }

    fn finish(&self) -> Result<bool, Box<dyn Error>> {
        print("\n")?;
        if !self.console.is_incomplete() {
            return Ok(!self.console.had_error());
        }
        Err(Box::new(BadInput {
            place: "standard input".to_owned(),
            problem: "ends in the middle of a command".to_owned(),
            found: "no more entries".to_owned(),
            expected: format!("an answer to {:?}", self.asked.unwrap_or_default()),
            next: "after M enter motors and a position, after C and O motors, each in a line".to_owned(),
        }))
    }
}

fn connect(address: &str, events: SyncSender<Event>) -> io::Result<TcpStream> {
    let hand = TcpStream::connect(address)?;
    hand.set_nodelay(true)?;
    let mut from = hand.try_clone()?;
    thread::start(move || {
        let mut bytes = [0; 1024];
        loop {
            let event = match from.read(&mut bytes) {
                Ok(0) => Event::Gone("it closed the connection".to_owned()),
                Ok(count) => Event::Received(bytes.iter().take(count).copied().collect()),
                Err(error) => Event::Gone(error.to_string()),
            };
            let is_last = matches!(event, Event::Gone(_));
            if events.send(event).is_err() || is_last {
                return;
            }
        }
    })?;
    Ok(hand)
}

/// Reads one entry from standard input per request.
fn read(wanted: &Receiver<()>, events: &SyncSender<Event>) {
    let mut lines = Lines::open(None);
    for () in wanted {
        let entry = match &mut lines {
            Ok(lines) => lines
                .next_line()
                .map(|text| text.map(|text| Entry { text, place: lines.place(), is_typed: lines.are_typed })),
            Err(bad) => Err(bad.clone()),
        };
        if events.send(Event::Entry(entry)).is_err() {
            return;
        }
    }
}
