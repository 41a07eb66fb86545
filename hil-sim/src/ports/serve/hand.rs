//! `hil-sim hand`: a whole hand in real time, for GOD's hosts: over TCP, as behind the Ethernet device server of the hand, or a
//! pseudo-terminal, as on its serial line.
//!
//! One host speaks at a time: it is the host from when it connects (TCP) or first writes (pseudo-terminal) until it closes; another is told
//! that the hand is busy, and, over TCP, closed. What GOD says while there is no host is lost, as on a serial line, and what a host had
//! begun when it left is aborted. A CAN tool may watch the bus meanwhile.

use std::error::Error;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

use crate::experiment::grasp;
use crate::experiment::input::BadInput;
use crate::ports::slcan::Slcan;
use crate::world::hand::Hand;
use crate::world::hand::scene::Scene;
use crate::world::hand::serial::Serial;
use crate::world::plant::Model;
use clap::ValueEnum;
use god::Memory;

use super::event::{Arrival, Clock, Door, EVENTS, Event, SLICE_US, WAIT, bad};
use super::link::{CHUNK, Link};
use super::pace::Pace;
use super::pty;
use super::tcp::{self, Client};
use crate::ports::keep::Keeper;
use crate::ports::output::{print, tell};

/// Where a host comes if nobody says otherwise.
const ADDRESS: &str = "127.0.0.1:11001";

/// Bytes of a host that may wait for GOD, beside the last piece. A ^C among them is heard at once, and so is their host's end: what
/// is beyond them nobody has read.
const TYPED_AHEAD: usize = 1 << 16;

/// Tools that may watch the bus at once.
const WATCHERS: usize = 4;

/// The arguments of `hil-sim hand`.
#[derive(clap::Args)]
pub struct HandArgs {
    /// Where a host connects; port 0 picks one. The output says `gcl HOST:PORT`. Without --listen and --pty: 127.0.0.1:11001.
    #[arg(long, value_name = "HOST:PORT")]
    listen: Option<String>,
    /// Make a pseudo-terminal for a host that wants a serial port. The output says `pty PATH`.
    #[arg(long)]
    pty: bool,
    /// Serve SLCAN over TCP here, for CAN tools that watch the bus. The output says `slcan HOST:PORT`.
    #[arg(long, value_name = "HOST:PORT")]
    slcan: Option<String>,
    /// What is between the fingers: a TOML file such as hil-sim/grasps/ball.toml; without it, nothing.
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Keep in this file what the hand keeps without power; it is made if there is none.
    #[arg(long, value_name = "FILE")]
    state: Option<PathBuf>,
    /// How fast time passes: 1 is real time, max as fast as the machine can.
    #[arg(long, value_enum, default_value_t = Speed::One)]
    speed: Speed,
    /// A byte of the host's takes the time that it takes on a serial line at parameter BAUD.
    #[arg(long)]
    pace_baud: bool,
    /// Seed of the sensors' noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Speed {
    /// Real time.
    #[value(name = "1")]
    One,
    /// As fast as the machine can.
    Max,
}

/// Serves a hand as the arguments say, until the clock ends.
///
/// # Errors
/// The arguments cannot be served: an address is taken, the state is damaged.
pub fn hand(args: &HandArgs, clock: Clock) -> Result<(), Box<dyn Error>> {
    let scene = args.scenario.as_deref().map_or_else(|| Ok(Scene::default()), grasp::read)?;
    let (mut hand, keeper) = made(args)?;
    hand.set_scene(scene);
    let (sender, events) = sync_channel(EVENTS);
    let address = args.listen.as_deref().or((!args.pty).then_some(ADDRESS));
    if let Some(address) = address {
        print(&format!("gcl {}\n", tcp::listen("--listen", address, Door::Gcl, sender.clone())?))?;
    }
    let terminal = args.pty.then(pty::open).transpose()?;
    if let Some((_, path)) = &terminal {
        print(&format!("pty {path}\n"))?;
    }
    if let Some(address) = &args.slcan {
        print(&format!("slcan {}\n", tcp::listen("--slcan", address, Door::Slcan, sender.clone())?))?;
    }
    let terminal = terminal.map(|(port, path)| {
        let again = move |number, events| Link::new(number, path.clone(), port.clone(), events);
        Terminal { link: again(0, sender.clone()), again: Box::new(again) }
    });
    let serial = Serial::new(args.pace_baud);
    let pace = (args.speed == Speed::One).then(Pace::default);
    let server = Server {
        hand,
        keeper,
        serial,
        heard: Vec::new(),
        host: Host::None,
        terminal,
        watchers: Vec::new(),
        events,
        sender,
        numbers: 0,
        pace,
        told: false,
    };
    server.run(clock)
}

/// The hand, new or as its state has it, and who keeps that.
fn made(args: &HandArgs) -> Result<(Hand, Option<Keeper>), BadInput> {
    let new = || Hand::new(Model::Averaged, args.seed, Memory::default());
    let Some(path) = &args.state else { return Ok((new(), None)) };
    let (mut keeper, state) = Keeper::open(path)?;
    let mut hand = match &state {
        None => new(),
        Some(state) => Hand::restore(Model::Averaged, args.seed, state).map_err(|error| {
            let next = "restore a copy, or name a file that does not exist yet: it is made";
            bad(format!("--state {}", path.display()), &error.to_string(), "a hand within its stops", next)
        })?,
    };
    // Now, so that a file that cannot be written is an error now.
    keeper.write(&mut hand)?;
    Ok((hand, Some(keeper)))
}

/// Who speaks with GOD.
enum Host {
    None,
    Tcp(Link),
    Terminal,
}

/// The pseudo-terminal, which stays while hosts come and go.
struct Terminal {
    link: Link,
    again: Box<dyn Fn(u64, SyncSender<Event>) -> Link>,
}

struct Server {
    hand: Hand,
    keeper: Option<Keeper>,
    serial: Serial,
    /// What GOD has said and the host has not been sent.
    heard: Vec<u8>,
    host: Host,
    terminal: Option<Terminal>,
    watchers: Vec<Client>,
    events: Receiver<Event>,
    /// For links to come.
    sender: SyncSender<Event>,
    /// Links so far.
    numbers: u64,
    /// `None`: as fast as the machine can.
    pace: Option<Pace>,
    /// The user has been told that the state cannot be kept.
    told: bool,
}

impl Server {
    fn run(mut self, clock: Clock) -> Result<(), Box<dyn Error>> {
        while let Some(real_us) = clock() {
            let now_us = self.hand.now_us();
            let slice_us = now_us + SLICE_US;
            let target_us = match &mut self.pace {
                None => slice_us + 1,
                Some(pace) => {
                    let (target_us, late) = pace.target(real_us, now_us);
                    if let Some(text) = late {
                        tell(&text);
                    }
                    target_us
                }
            };
            let room = CHUNK.saturating_sub(self.heard.len());
            self.serial.run_until(&mut self.hand, target_us.min(slice_us), &mut self.heard, room);
            self.keep();
            self.answer();
            self.watch();
            let wait = if slice_us < target_us { Duration::ZERO } else { WAIT };
            match self.events.recv_timeout(wait) {
                Ok(event) => self.handle(event)?,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Ok(()),
            }
        }
        Ok(())
    }

    /// Before the host sees a prompt, which ends in `>` and a space: what it answers for is kept then.
    fn keep(&mut self) {
        let Some(keeper) = &mut self.keeper else { return };
        if let Err(error) = keeper.follow(&mut self.hand, self.heard.contains(&b'>'))
            && !std::mem::replace(&mut self.told, true)
        {
            tell(&format!("warning: {error}\n  It is tried again."));
        }
    }

    /// The link of the host.
    fn link(&mut self) -> Option<&mut Link> {
        match &mut self.host {
            Host::None => None,
            Host::Tcp(link) => Some(link),
            Host::Terminal => self.terminal.as_mut().map(|terminal| &mut terminal.link),
        }
    }

    /// What GOD says to the host, and room for what the host says.
    fn answer(&mut self) {
        let mut heard = std::mem::take(&mut self.heard);
        let has_room = self.serial.waiting() < TYPED_AHEAD;
        match self.link() {
            Some(link) => {
                // What finds no room is kept, and GOD waits.
                link.send(&mut heard);
                if has_room {
                    link.go_on();
                }
            }
            None => heard.clear(),
        }
        self.heard = heard;
    }

    /// What the bus has for those who watch.
    fn watch(&mut self) {
        while let Some(stamped) = self.hand.bus_mut().tapped() {
            self.watchers.iter_mut().for_each(|watcher| watcher.frame(&stamped));
        }
        let gone = |watcher: &mut Client| !watcher.flush();
        for watcher in self.watchers.extract_if(.., gone) {
            tell(&format!("{} does not read what it is told", watcher.link.peer));
            watcher.link.close();
        }
        if self.watchers.is_empty() {
            self.hand.bus_mut().tap(false);
        }
    }

    fn handle(&mut self, event: Event) -> Result<(), Box<dyn Error>> {
        match event {
            Event::Client(arrival) if arrival.door == Door::Gcl => self.host_comes(arrival),
            Event::Client(arrival) => self.watcher_comes(arrival),
            Event::Bytes(number, bytes) => self.bytes(number, &bytes),
            Event::Gone(number) => self.gone(number),
            Event::Frame(_) => {}
            Event::Lost(problem) => return Err(problem.into()),
        }
        Ok(())
    }

    fn host_comes(&mut self, arrival: Arrival) {
        if let Some(link) = self.link() {
            let why = format!("{} speaks with the hand, and one host does at a time", link.peer);
            tell(&format!("{} is sent away: {why}", arrival.peer));
            tcp::refuse(arrival, &why);
            return;
        }
        self.numbers += 1;
        // One that has gone already has not come.
        if let Ok(link) = tcp::accept(arrival, self.numbers, self.sender.clone()) {
            tell(&format!("{} is the host", link.peer));
            self.host = Host::Tcp(link);
        }
    }

    fn watcher_comes(&mut self, arrival: Arrival) {
        if self.watchers.len() >= WATCHERS {
            tcp::refuse(arrival, &format!("{WATCHERS} tools watch already"));
            return;
        }
        self.numbers += 1;
        if let Ok(link) = tcp::accept(arrival, self.numbers, self.sender.clone()) {
            tell(&format!("{} watches the bus", link.peer));
            if self.watchers.is_empty() {
                self.hand.bus_mut().tap(true);
            }
            self.watchers.push(Client::new(link, Slcan::listener()));
        }
    }

    fn bytes(&mut self, number: u64, bytes: &[u8]) {
        if let Some(watcher) = self.watchers.iter_mut().find(|watcher| watcher.link.number == number) {
            // It sends no frames.
            bytes.iter().for_each(|&byte| _ = watcher.push(byte));
            watcher.link.has_come();
            watcher.link.go_on();
            return;
        }
        let is_free = matches!(self.host, Host::None);
        if let Some(terminal) = self.terminal.as_mut().filter(|terminal| terminal.link.number == number) {
            terminal.link.has_come();
            if is_free {
                tell(&format!("{} is the host", terminal.link.peer));
                self.host = Host::Terminal;
            } else if let Host::Tcp(host) = &self.host {
                let why = format!(
                    "\r\n\rbusy: {} speaks with the hand, and one host does at a time\r\n\r",
                    host.peer
                );
                // One that does not read is not told.
                terminal.link.send(&mut why.into_bytes());
                terminal.link.go_on();
                return;
            }
        } else if let Host::Tcp(link) = &mut self.host
            && link.number == number
        {
            link.has_come();
        } else {
            // Of a link that has been closed.
            return;
        }
        self.serial.put(bytes, &self.hand);
    }

    fn gone(&mut self, number: u64) {
        self.watchers.retain(|watcher| watcher.link.number != number);
        let was_host = match (&self.host, &mut self.terminal) {
            (Host::Tcp(link), _) if link.number == number => true,
            (host, Some(terminal)) if terminal.link.number == number => {
                let was_host = matches!(host, Host::Terminal);
                self.numbers += 1;
                let next = (terminal.again)(self.numbers, self.sender.clone());
                std::mem::replace(&mut terminal.link, next).close();
                was_host
            }
            _ => false,
        };
        if was_host {
            if let Host::Tcp(link) = std::mem::replace(&mut self.host, Host::None) {
                tell(&format!("{} has left", link.peer));
                link.close();
            }
            self.heard.clear();
            self.serial.hang_up(&mut self.hand);
        }
    }
}
