//! `hil-sim hand`: a whole hand in real time, for GOD's hosts: over TCP, like the Ethernet device server of the hand, or on a
//! pseudo-terminal, like its serial line.
//!
//! One host at a time: a client is the host from connecting (TCP) or its first byte (pseudo-terminal) until it disconnects; others
//! get a busy message and, over TCP, are disconnected. GOD's output without a host is lost, as on a serial line, and a
//! disconnect aborts what is running. CAN tools may watch the bus at any time.

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

use super::event::{Clock, EVENTS, Event, NewClient, Protocol, SLICE_US, WAIT, bad};
use super::link::{CHUNK, Link};
use super::pace::Pace;
use super::pty;
use super::tcp::{self, Client};
use crate::ports::output::{print, warn};
use crate::ports::state_file::StateFile;

const ADDRESS: &str = "127.0.0.1:11001";

/// Type-ahead limit, bytes, besides the last chunk. Within it a ^C or a disconnect takes effect at once; bytes beyond it stay in the
/// socket.
const MAX_TYPE_AHEAD: usize = 1 << 16;

/// Maximum number of tools that watch the bus.
const WATCHERS: usize = 4;

/// The arguments of `hil-sim hand`.
#[derive(clap::Args)]
pub struct HandArgs {
    /// Serve the hand over TCP here; port 0 picks a free one. Prints `gcl HOST:PORT`. Default without --pty: 127.0.0.1:11001.
    #[arg(long, value_name = "HOST:PORT")]
    listen: Option<String>,
    /// Create a pseudo-terminal for hosts that expect a serial port. Prints `pty PATH`.
    #[arg(long)]
    pty: bool,
    /// Serve SLCAN over TCP here, for CAN tools that watch the bus. Prints `slcan HOST:PORT`.
    #[arg(long, value_name = "HOST:PORT")]
    slcan: Option<String>,
    /// Objects between the fingers: a TOML file such as hil-sim/grasps/ball.toml; default: none.
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Keep what the hand stores without power in this file; created if missing.
    #[arg(long, value_name = "FILE")]
    state: Option<PathBuf>,
    /// Speed of simulated time: 1 is real time, max as fast as possible.
    #[arg(long, value_enum, default_value_t = Speed::One)]
    speed: Speed,
    /// Transmit each byte at the bit rate of parameter BAUD.
    #[arg(long)]
    pace_baud: bool,
    /// Seed of the sensor noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Speed {
    /// Real time.
    #[value(name = "1")]
    One,
    /// As fast as possible.
    Max,
}

/// # Errors
/// An address is in use, or the state is damaged.
pub fn hand(args: &HandArgs, clock: Clock) -> Result<(), Box<dyn Error>> {
    let scene = args.scenario.as_deref().map_or_else(|| Ok(Scene::default()), grasp::read)?;
    let (mut hand, state_file) = open_hand(args)?;
    hand.set_scene(scene);
    let (sender, events) = sync_channel(EVENTS);
    let address = args.listen.as_deref().or((!args.pty).then_some(ADDRESS));
    if let Some(address) = address {
        print(&format!("gcl {}\n", tcp::listen("--listen", address, Protocol::Gcl, sender.clone())?))?;
    }
    let terminal = args.pty.then(pty::open).transpose()?;
    if let Some((_, path)) = &terminal {
        print(&format!("pty {path}\n"))?;
    }
    if let Some(address) = &args.slcan {
        print(&format!("slcan {}\n", tcp::listen("--slcan", address, Protocol::Slcan, sender.clone())?))?;
    }
    let terminal = terminal.map(|(port, path)| {
        let new_link = move |number, events| Link::new(number, path.clone(), port.clone(), events);
        Terminal { link: new_link(0, sender.clone()), new_link: Box::new(new_link) }
    });
    let serial = Serial::new(args.pace_baud);
    let pace = (args.speed == Speed::One).then(Pace::default);
    let server = Server {
        hand,
        state_file,
        serial,
        output: Vec::new(),
        host: Host::None,
        terminal,
        watchers: Vec::new(),
        events,
        sender,
        links: 0,
        pace,
        warned: false,
    };
    server.run(clock)
}

fn open_hand(args: &HandArgs) -> Result<(Hand, Option<StateFile>), BadInput> {
    let new = || Hand::new(Model::Averaged, args.seed, Memory::default());
    let Some(path) = &args.state else { return Ok((new(), None)) };
    let (mut state_file, state) = StateFile::open(path)?;
    let mut hand = match &state {
        None => new(),
        Some(state) => Hand::restore(Model::Averaged, args.seed, state).map_err(|error| {
            let next = "restore a copy, or name a new file";
            bad(format!("--state {}", path.display()), &error.to_string(), "a hand within its stops", next)
        })?,
    };
    // Write now, so that an unwritable file is an error now.
    state_file.write(&mut hand)?;
    Ok((hand, Some(state_file)))
}

enum Host {
    None,
    Tcp(Link),
    Terminal,
}

struct Terminal {
    link: Link,
    new_link: Box<dyn Fn(u64, SyncSender<Event>) -> Link>,
}

struct Server {
    hand: Hand,
    state_file: Option<StateFile>,
    serial: Serial,
    output: Vec<u8>,
    host: Host,
    terminal: Option<Terminal>,
    watchers: Vec<Client>,
    events: Receiver<Event>,
    sender: SyncSender<Event>,
    links: u64,
    /// `None`: as fast as possible.
    pace: Option<Pace>,
    warned: bool,
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
                        warn(&text);
                    }
                    target_us
                }
            };
            let room = CHUNK.saturating_sub(self.output.len());
            self.serial.run_until(&mut self.hand, target_us.min(slice_us), &mut self.output, room);
            self.save();
            self.send_output();
            self.send_frames();
            let wait = if slice_us < target_us { Duration::ZERO } else { WAIT };
            match self.events.recv_timeout(wait) {
                Ok(event) => self.handle(event)?,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Ok(()),
            }
        }
        Ok(())
    }

    /// Writes the state before the host sees a prompt (`> `): a prompt promises that values are stored.
    fn save(&mut self) {
        let Some(state_file) = &mut self.state_file else { return };
        if let Err(error) = state_file.save_changes(&mut self.hand, self.output.contains(&b'>'))
            && !std::mem::replace(&mut self.warned, true)
        {
            warn(&format!("warning: {error}\n  Trying again later."));
        }
    }

    fn link(&mut self) -> Option<&mut Link> {
        match &mut self.host {
            Host::None => None,
            Host::Tcp(link) => Some(link),
            Host::Terminal => self.terminal.as_mut().map(|terminal| &mut terminal.link),
        }
    }

    fn send_output(&mut self) {
        let mut output = std::mem::take(&mut self.output);
        let has_room = self.serial.waiting() < MAX_TYPE_AHEAD;
        match self.link() {
            Some(link) => {
                // The rest stays, and GOD waits.
                link.send(&mut output);
                if has_room {
                    link.read_next();
                }
            }
            None => output.clear(),
        }
        self.output = output;
    }

    fn send_frames(&mut self) {
        while let Some(stamped) = self.hand.bus_mut().tapped() {
            self.watchers.iter_mut().for_each(|watcher| watcher.frame(&stamped));
        }
        let gone = |watcher: &mut Client| !watcher.flush();
        for watcher in self.watchers.extract_if(.., gone) {
            warn(&format!("{} does not read; disconnected", watcher.link.peer));
            watcher.link.close();
        }
        if self.watchers.is_empty() {
            self.hand.bus_mut().tap(false);
        }
    }

    fn handle(&mut self, event: Event) -> Result<(), Box<dyn Error>> {
        match event {
            Event::Client(client) if client.protocol == Protocol::Gcl => self.host_connected(client),
            Event::Client(client) => self.watcher_connected(client),
            Event::Bytes(number, bytes) => self.received(number, &bytes),
            Event::Gone(number) => self.disconnected(number),
            Event::Frame(_) => {}
            Event::Lost(problem) => return Err(problem.into()),
        }
        Ok(())
    }

    fn host_connected(&mut self, client: NewClient) {
        if let Some(link) = self.link() {
            let why = format!("{} speaks with the hand, and one host does at a time", link.peer);
            warn(&format!("{} refused: {why}", client.peer));
            tcp::refuse(client, &why);
            return;
        }
        self.links += 1;
        // Ignore clients that disconnected before accept.
        if let Ok(link) = tcp::accept(client, self.links, self.sender.clone()) {
            warn(&format!("{} is the host", link.peer));
            self.host = Host::Tcp(link);
        }
    }

    fn watcher_connected(&mut self, client: NewClient) {
        if self.watchers.len() >= WATCHERS {
            tcp::refuse(client, &format!("{WATCHERS} tools are watching already"));
            return;
        }
        self.links += 1;
        if let Ok(link) = tcp::accept(client, self.links, self.sender.clone()) {
            warn(&format!("{} watches the bus", link.peer));
            if self.watchers.is_empty() {
                self.hand.bus_mut().tap(true);
            }
            self.watchers.push(Client::new(link, Slcan::listener()));
        }
    }

    fn received(&mut self, number: u64, bytes: &[u8]) {
        if let Some(watcher) = self.watchers.iter_mut().find(|watcher| watcher.link.number == number) {
            // Watching tools send no frames.
            bytes.iter().for_each(|&byte| _ = watcher.push(byte));
            watcher.link.chunk_received();
            watcher.link.read_next();
            return;
        }
        let is_free = matches!(self.host, Host::None);
        if let Some(terminal) = self.terminal.as_mut().filter(|terminal| terminal.link.number == number) {
            terminal.link.chunk_received();
            if is_free {
                warn(&format!("{} is the host", terminal.link.peer));
                self.host = Host::Terminal;
            } else if let Host::Tcp(host) = &self.host {
                let why = format!(
                    "\r\n\rbusy: {} speaks with the hand, and one host does at a time\r\n\r",
                    host.peer
                );
                // A host that does not read misses this.
                terminal.link.send(&mut why.into_bytes());
                terminal.link.read_next();
                return;
            }
        } else if let Host::Tcp(link) = &mut self.host
            && link.number == number
        {
            link.chunk_received();
        } else {
            // From a link that was closed.
            return;
        }
        self.serial.put(bytes, &self.hand);
    }

    fn disconnected(&mut self, number: u64) {
        self.watchers.retain(|watcher| watcher.link.number != number);
        let was_host = match (&self.host, &mut self.terminal) {
            (Host::Tcp(link), _) if link.number == number => true,
            (host, Some(terminal)) if terminal.link.number == number => {
                let was_host = matches!(host, Host::Terminal);
                self.links += 1;
                let next = (terminal.new_link)(self.links, self.sender.clone());
                std::mem::replace(&mut terminal.link, next).close();
                was_host
            }
            _ => false,
        };
        if was_host {
            if let Host::Tcp(link) = std::mem::replace(&mut self.host, Host::None) {
                warn(&format!("{} has left", link.peer));
                link.close();
            }
            self.output.clear();
            self.serial.hang_up(&mut self.hand);
        }
    }
}
