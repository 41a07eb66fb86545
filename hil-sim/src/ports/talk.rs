//! `hil-sim grasper`: the console of the walk-through between standard input and a hand at the other end of a TCP connection.

use std::error::Error;
use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;
use std::time::Duration;

use crate::experiment::input::BadInput;
use crate::ports::grasper::Console;

use crate::ports::lines::Lines;
use crate::ports::output::{print, tell};

/// How long the hand may be silent while it is waited for: a motor may press for TSTOP, up to 65 s, before it counts as stalled.
const SILENT: Duration = Duration::from_secs(120);

/// The arguments of `hil-sim grasper`.
#[derive(clap::Args)]
pub struct GrasperArgs {
    /// Where the hand is served (`hil-sim hand --listen`).
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:11001")]
    connect: String,
}

/// What the threads that wait tell.
enum Event {
    /// What was entered, where, and whether by a person; or that it cannot be read; or that there is no more.
    Entry(Result<Option<Entry>, BadInput>),
    /// Bytes from the hand.
    Heard(Vec<u8>),
    /// The connection is gone, and why.
    Gone(String),
}

struct Entry {
    text: String,
    place: String,
    is_typed: bool,
}

/// Lets standard input talk to a hand, to its end. Returns whether the hand told no error.
///
/// # Errors
/// There is no hand, or it goes away; an entry is none, unless a person can correct it.
pub fn grasper(args: &GrasperArgs) -> Result<bool, Box<dyn Error>> {
    let lost = |problem: &str, found: String| BadInput {
        place: format!("--connect {}", args.connect),
        problem: problem.to_owned(),
        found,
        expected: "a hand that is served there, and speaks with nobody else".to_owned(),
        next: "start one with hil-sim hand --listen, or name its address".to_owned(),
    };
    let (sender, events) = sync_channel(1);
    let hand = connect(&args.connect, sender.clone()).map_err(|e| lost("there is no hand", e.to_string()))?;
    let (next, wanted) = sync_channel(1);
    thread::spawn(move || read(&wanted, &sender));
    let mut talk = Talk { hand, next, console: Console::default(), asked: None, last: String::new() };
    loop {
        talk.go_on()?;
        // A person may take any time.
        let event = match talk.asked {
            Some(_) => events.recv().ok(),
            None => events.recv_timeout(SILENT).ok(),
        };
        match event {
            Some(Event::Entry(entry)) => match entry? {
                Some(entry) => talk.enter(entry)?,
                None => return talk.ends(),
            },
            Some(Event::Heard(bytes)) => talk.hear(&bytes)?,
            Some(Event::Gone(why)) => {
                return Err(lost("the hand is gone", format!("{why}, after {:?}", talk.last)).into());
            }
            None => return Err(lost("the hand is silent", format!("nothing for {SILENT:?}")).into()),
        }
    }
}

struct Talk {
    hand: TcpStream,
    /// Lets the next entry be read.
    next: SyncSender<()>,
    console: Console,
    /// What the person has been asked and not answered.
    asked: Option<&'static str>,
    /// The hand's last line.
    last: String,
}

impl Talk {
    /// Tells the hand what it is to be told; otherwise it is the person's turn.
    fn go_on(&mut self) -> Result<(), BadInput> {
        while let Some(line) = self.console.says() {
            // A connection that is gone is told by who reads from it.
            let _ = self.hand.write_all(line.as_bytes());
        }
        if self.asked.is_none()
            && let Some(question) = self.console.asks()
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
                tell(&BadInput { place, ..bad }.to_string());
                Ok(())
            }
            Err(bad) => Err(BadInput { place, ..bad }),
        }
    }

    fn hear(&mut self, bytes: &[u8]) -> Result<(), BadInput> {
        for &byte in bytes {
            let Some(line) = self.console.hears(byte) else { continue };
            // Before what is being asked, which is asked again.
            let question = self.asked.unwrap_or_default();
            let from = if question.is_empty() { "" } else { "\n" };
            print(&format!("{from}{line}\n{question}"))?;
            self.last = line;
        }
        Ok(())
    }

    /// There are no more entries.
    fn ends(&self) -> Result<bool, Box<dyn Error>> {
        print("\n")?;
        if !self.console.is_asking() {
            return Ok(!self.console.went_wrong());
        }
        Err(Box::new(BadInput {
            place: "standard input".to_owned(),
            problem: "it ends in the middle of a command".to_owned(),
            found: "no more entries".to_owned(),
            expected: format!("an answer to {:?}", self.asked.unwrap_or_default()),
            next: "after M enter motors and a position, after C and O motors, each in a line".to_owned(),
        }))
    }
}

/// Connects; what comes from there are events.
fn connect(address: &str, events: SyncSender<Event>) -> io::Result<TcpStream> {
    let hand = TcpStream::connect(address)?;
    hand.set_nodelay(true)?;
    let mut from = hand.try_clone()?;
    thread::spawn(move || {
        let mut bytes = [0; 1024];
        loop {
            let event = match from.read(&mut bytes) {
                Ok(0) => Event::Gone("it has closed the connection".to_owned()),
                Ok(count) => Event::Heard(bytes.iter().take(count).copied().collect()),
                Err(error) => Event::Gone(error.to_string()),
            };
            let is_last = matches!(event, Event::Gone(_));
            if events.send(event).is_err() || is_last {
                return;
            }
        }
    });
    Ok(hand)
}

/// Reads an entry from standard input whenever one is wanted.
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
