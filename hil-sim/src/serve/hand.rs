//! `hil-sim hand`: a whole hand in real time, for GOD's hosts: over TCP, like the Ethernet device server of the hand, or on a
//! pseudo-terminal, like its serial line.
//!
//! One host at a time: a client is the host from connecting (TCP) or its first byte (pseudo-terminal) until it disconnects; others
//! get a busy message and, over TCP, are disconnected. GOD's output without a host is lost, as on a serial line, and a
//! disconnect aborts what is running; the next host is served once that has ended. A TCP host that only closes its own side (FIN) stays until
//! it has its answers, or another one has waited for [`GRACE_US`]. CAN tools may watch the bus at any time.

use std::error::Error;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread;
use std::time::Duration;

use crate::slcan::Slcan;
use clap::ValueEnum;
use god::Memory;
use hil_experiment::grasp;
use hil_world::hand::Hand;
use hil_world::hand::scene::Scene;
use hil_world::hand::serial::Serial;
use hil_world::plant::Model;
use traces::input::BadInput;

use super::discovery;
use super::event::{Clock, EVENTS, Event, NewClient, Protocol, SLICE_US, WAIT, bad};
use super::link::{CHUNK, Link};
use super::pace::Pace;
use super::pty;
use super::tcp::{self, Client, Refusals};
use super::telnet::{Heard, Telnet};
use crate::output::print;
use crate::state_file::{StateFile, When};
use programs::output::warn;

const ADDRESS: &str = "127.0.0.1:11001";

/// Type-ahead limit, bytes, besides the last chunk. Within it a ^C or a disconnect takes effect at once; bytes beyond it stay in the
/// socket.
const MAX_TYPE_AHEAD: usize = 1 << 16;

/// Maximum number of tools that watch the bus.
const WATCHERS: usize = 4;

/// Time for the feedback to the last control block of a host that has closed its side, µs: 21 questions to boards take half of it.
const FEEDBACK_US: u64 = 20_000;

/// Longest wait for the ends of motions that such a host has begun in the walk-through's grammar, µs: a motor that holds its position
/// (MODE 3) never ends, and a stall takes TSTOP, up to 65 s.
const REPORT_US: u64 = 70_000_000;

/// Time that a host which has closed its side has for its answers while another one waits, µs: enough for a query and most motions.
const GRACE_US: u64 = 2_000_000;

/// Time in which the end of a host's connection is noticed, µs: the kernel may deliver it after the next host's beginning.
const NOTICED_US: u64 = 100_000;

/// The arguments of `hil-sim hand`.
#[derive(clap::Args)]
pub struct HandArgs {
    /// Serve the hand over TCP here; port 0 picks a free one. Prints `gcl HOST:PORT`. Default without --pty: 127.0.0.1:11001.
    #[arg(long, value_name = "HOST:PORT")]
    listen: Option<String>,
    /// Answer hosts that look for hands here; port 0 picks a free one. Prints `discovery HOST:PORT`. Default with --listen: UDP port
    /// 30718, which hands share, for this machine alone if --listen is on loopback.
    #[arg(long, value_name = "HOST:PORT", conflicts_with = "no_discovery")]
    discovery: Option<String>,
    /// Do not answer hosts that look for hands.
    #[arg(long)]
    no_discovery: bool,
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
    let (mut hand, state_file) = open_hand(args)?;
    let read = |path: &Path| grasp::read(path, &hand.pose());
    let scene = args.scenario.as_deref().map_or_else(|| Ok(Scene::default()), read)?;
    hand.set_scene(scene);
    let (sender, events) = sync_channel(EVENTS);
    let address = args.listen.as_deref().or((!args.pty).then_some(ADDRESS));
    if let Some(address) = address {
        let gcl = tcp::listen("--listen", address, Protocol::Gcl, sender.clone())?;
        // Before the line that tells hosts of the hand: it can be discovered from then on.
        let asked = match args.no_discovery {
            true => None,
            false => discovery::answer_questions(args.discovery.as_deref(), &gcl)?,
        };
        print(&format!("gcl {gcl}\n"))?;
        if let Some(address) = asked {
            print(&format!("discovery {address}\n"))?;
        }
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
        new_link(0, sender.clone()).map(|link| Terminal { link: Some(link), new_link: Box::new(new_link) })
    });
    let terminal = terminal.transpose().map_err(|error| tcp::no_thread("--pty", &error))?;
    let serial = Serial::new(args.pace_baud);
    let pace = (args.speed == Speed::One).then(Pace::default);
    let server = Server {
        hand,
        state_file,
        serial,
        telnet: Telnet::default(),
        output: Vec::new(),
        host: Host::None,
        waiting: None,
        terminal,
        watchers: Vec::new(),
        refusals: Refusals::default(),
        events,
        sender,
        links: 0,
        pace,
        warned: false,
        warned_of_threads: false,
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
    hand.memory().report_writes();
    Ok((hand, Some(state_file)))
}

enum Host {
    None,
    Tcp(Link),
    /// A TCP host that sends nothing more: it leaves once it has the answers. `quiet_us`: since when there is nothing more to send.
    Leaving {
        link: Link,
        quiet_us: u64,
    },
    Terminal,
    /// The host has left, and GOD still aborts what it had running: the output of that is not for the next host.
    Left,
}

struct Terminal {
    /// `None` after a host has left, until the threads for the next one can be started.
    link: Option<Link>,
    new_link: Box<dyn Fn(u64, SyncSender<Event>) -> io::Result<Link>>,
}

struct Server {
    hand: Hand,
    state_file: Option<StateFile>,
    serial: Serial,
    /// Of the bytes of the TCP host.
    telnet: Telnet,
    output: Vec<u8>,
    host: Host,
    /// The next host, while the last one is there, and since when, µs.
    waiting: Option<(NewClient, u64)>,
    terminal: Option<Terminal>,
    watchers: Vec<Client>,
    refusals: Refusals,
    events: Receiver<Event>,
    sender: SyncSender<Event>,
    links: u64,
    /// `None`: as fast as possible.
    pace: Option<Pace>,
    warned: bool,
    warned_of_threads: bool,
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
            self.serve_leaving();
            self.serve_waiting();
            self.refusals.serve();
            self.reopen_terminal();
            self.send_frames();
            let wait = if slice_us < target_us { Duration::ZERO } else { WAIT };
            if matches!(self.host, Host::Left) {
                // What the next host sends, and its connection, wait in the channel.
                thread::park_timeout(wait);
                continue;
            }
            match self.events.recv_timeout(wait) {
                Ok(event) => self.handle(event)?,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Ok(()),
            }
        }
        Ok(())
    }

    /// Writes the state before the host sees a prompt (`> `), which promises that values are stored, and for a command that waits for it.
    fn save(&mut self) {
        let Some(state_file) = &mut self.state_file else { return };
        let is_wanted = self.hand.memory().wants_write();
        let when = match (is_wanted, self.output.contains(&b'>')) {
            (true, _) => When::Now,
            (false, true) => When::Prompt,
            (false, false) => When::Pause,
        };
        let saved = state_file.save_changes(&mut self.hand, when);
        if is_wanted {
            self.hand.state_written(saved.is_ok());
        }
        match saved {
            Ok(is_saved) => self.warned &= !is_saved,
            Err(error) if !std::mem::replace(&mut self.warned, true) => {
                warn(&format!("warning: {error}\n  Trying again later."));
            }
            Err(_) => {}
        }
    }

    fn link(&mut self) -> Option<&mut Link> {
        match &mut self.host {
            Host::None | Host::Left => None,
            Host::Tcp(link) | Host::Leaving { link, .. } => Some(link),
            Host::Terminal => self.terminal.as_mut().and_then(|terminal| terminal.link.as_mut()),
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
            Event::InputEnded(number) => self.input_ended(number),
            Event::Gone(number) => self.disconnected(number),
            Event::Frame(_) => {}
            Event::Lost(problem) => return Err(problem.into()),
        }
        Ok(())
    }

    /// Whether the host has closed its side, or has left: the end of its connection and the start of the next come from two threads, in any
    /// order.
    fn is_host_about_to_leave(&self) -> bool {
        match &self.host {
            Host::Tcp(link) => link.has_closed(),
            Host::Leaving { .. } | Host::Left => true,
            Host::None | Host::Terminal => false,
        }
    }

    /// Makes the waiting client the host once the last one is gone, which has [`GRACE_US`] for that; refuses it if that one stays.
    fn serve_waiting(&mut self) {
        let Some((_, since_us)) = &self.waiting else { return };
        let waited_us = self.hand.now_us() - since_us;
        let is_leaving = self.is_host_about_to_leave();
        if waited_us >= GRACE_US
            && is_leaving
            && let Some(number) = self.link().map(|link| link.number)
        {
            self.disconnected(number);
        }
        let is_present = self.link().is_some() && !is_leaving;
        if is_leaving || is_present && waited_us < NOTICED_US {
            return;
        }
        if let Some((client, _)) = self.waiting.take() {
            self.host_arrives(client);
        }
    }

    fn host_connected(&mut self, client: NewClient) {
        let has_host = self.link().is_some() || self.is_host_about_to_leave();
        if self.waiting.is_none() && has_host {
            self.waiting = Some((client, self.hand.now_us()));
        } else {
            self.host_arrives(client);
        }
    }

    /// Makes a client the host, or refuses it if there is one.
    fn host_arrives(&mut self, client: NewClient) {
        if let Some(link) = self.link() {
            let why = format!("{} speaks with the hand, and one host does at a time", link.peer);
            warn(&format!("{} refused: {why}", client.peer));
            self.refusals.refuse(client, &why);
            return;
        }
        self.links += 1;
        if let Some(link) = tcp::accept(client, self.links, self.sender.clone(), &mut self.refusals) {
            warn(&format!("{} is the host", link.peer));
            self.telnet = Telnet::default();
            self.host = Host::Tcp(link);
        }
    }

    fn watcher_connected(&mut self, client: NewClient) {
        if self.watchers.len() >= WATCHERS {
            self.refusals.refuse(client, &format!("{WATCHERS} tools are watching already"));
            return;
        }
        self.links += 1;
        if let Some(link) = tcp::accept(client, self.links, self.sender.clone(), &mut self.refusals) {
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
        let host = match &self.host {
            Host::Tcp(link) | Host::Leaving { link, .. } => Some(link.peer.clone()),
            Host::None | Host::Terminal | Host::Left => None,
        };
        if let Some(link) = self.terminal_link(number) {
            link.chunk_received();
            if let Some(host) = host {
                let why =
                    format!("\r\n\rbusy: {host} speaks with the hand, and one host does at a time\r\n\r");
                // A host that does not read misses this.
                link.send(&mut why.into_bytes());
                link.read_next();
                return;
            }
            if is_free {
                warn(&format!("{} is the host", link.peer));
                self.host = Host::Terminal;
            }
        } else if let Host::Tcp(link) = &mut self.host
            && link.number == number
        {
            link.chunk_received();
            self.received_over_tcp(bytes);
            return;
        } else {
            // From a link that was closed.
            return;
        }
        self.serial.put(bytes, &mut self.hand);
    }

    /// Bytes of a TCP host, with the commands of a Telnet client among them.
    fn received_over_tcp(&mut self, bytes: &[u8]) {
        let (mut heard, is_raw) = (Vec::new(), self.hand.io().is_raw());
        self.telnet.accept(bytes, self.hand.now_us(), is_raw, |item| heard.push(item));
        let mut text = Vec::new();
        for item in heard {
            match item {
                Heard::Byte(byte) => text.push(byte),
                Heard::Answer(answer) => self.output.extend(answer),
                Heard::Break => {
                    self.serial.put(&std::mem::take(&mut text), &mut self.hand);
                    self.serial.put_break(&mut self.hand);
                }
            }
        }
        self.serial.put(&text, &mut self.hand);
    }

    fn terminal_link(&mut self, number: u64) -> Option<&mut Link> {
        self.terminal.as_mut()?.link.as_mut().filter(|link| link.number == number)
    }

    /// A TCP host gets the answers to what it has sent (decision 0031). A watching tool has left.
    fn input_ended(&mut self, number: u64) {
        self.disconnect_watcher(number);
        let quiet_us = self.hand.now_us();
        self.host = match std::mem::replace(&mut self.host, Host::None) {
            Host::Tcp(link) if link.number == number => Host::Leaving { link, quiet_us },
            host => host,
        };
    }

    /// Lets a host that sends nothing more go once it has its answers. RealTime ends without its host. Once GOD waits for a line after a host
    /// has left, another one can come.
    fn serve_leaving(&mut self) {
        let now_us = self.hand.now_us();
        let has_answers = self.serial.is_empty() && self.output.is_empty() && self.hand.io().is_drained();
        if matches!(self.host, Host::Left) && has_answers && self.hand.io().waits_for_line() {
            self.host = Host::None;
        }
        let Host::Leaving { link, quiet_us } = &mut self.host else { return };
        if !has_answers || !link.is_flushed() {
            *quiet_us = now_us;
            return;
        }
        let (number, waited_us) = (link.number, now_us - *quiet_us);
        let io = self.hand.io();
        if io.is_raw() && waited_us >= FEEDBACK_US {
            *quiet_us = now_us;
            self.serial.hang_up(&mut self.hand);
        } else if io.waits_for_line() && (!io.has_reports_due() || waited_us >= REPORT_US) {
            self.disconnected(number);
        }
    }

    /// The terminal of a host that has left serves the next one.
    fn reopen_terminal(&mut self) {
        let Some(terminal) = self.terminal.as_mut().filter(|terminal| terminal.link.is_none()) else {
            return;
        };
        self.links += 1;
        match (terminal.new_link)(self.links, self.sender.clone()) {
            Ok(link) => terminal.link = Some(link),
            Err(error) => {
                if !std::mem::replace(&mut self.warned_of_threads, true) {
                    warn(&format!("warning: --pty: {error}; trying again"));
                }
            }
        }
    }

    fn disconnect_watcher(&mut self, number: u64) {
        self.watchers.retain(|watcher| watcher.link.number != number);
    }

    fn disconnected(&mut self, number: u64) {
        self.disconnect_watcher(number);
        let mut was_host = match &self.host {
            Host::Tcp(link) | Host::Leaving { link, .. } => link.number == number,
            Host::None | Host::Terminal | Host::Left => false,
        };
        if let Some(terminal) = &mut self.terminal
            && let Some(link) = terminal.link.take_if(|link| link.number == number)
        {
            was_host = matches!(self.host, Host::Terminal);
            link.close();
        }
        if was_host {
            if let Host::Tcp(link) | Host::Leaving { link, .. } =
                std::mem::replace(&mut self.host, Host::Left)
            {
                warn(&format!("{} has left", link.peer));
                link.close();
            }
            self.output.clear();
            self.serial.hang_up(&mut self.hand);
            // From here on GOD does not wait for a line before it has handled the hang-up.
            self.hand.run_until(self.hand.now_us());
        }
    }
}
