//! `hil-sim bus`: the simulated bus in real time, for CAN tools. One host at a time, by SLCAN over TCP or on a CAN interface.

use std::error::Error;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread;
use std::time::Duration;

use super::args::{BusArgs, Place};
use super::can::CanPort;
use super::event::{Clock, EVENTS, Event, NewClient, Protocol, SLICE_US, WAIT};
use super::pace::Pace;
use super::tcp::{self, Client, Refusals};
use super::truth;
use crate::output::print;
use crate::slcan::Slcan;
use hil_world::bus::{Adapter, Bus, Station};
use programs::output::warn;

/// Frames queued in the adapter; further ones stay in the host's socket.
const QUEUE: usize = 64;

/// Longest time from the start of a connection to the report of the end of the one before it, µs.
const ORDER_US: u64 = 50_000;

/// Longest time for the last frames of a host that has closed, µs: on a dead bus they never leave.
const LAST_FRAMES_US: u64 = 500_000;

/// # Errors
/// The address is in use, or there is no such interface.
pub fn bus(args: &BusArgs, clock: Clock) -> Result<(), Box<dyn Error>> {
    let place = args.host()?;
    let mut bus = Bus::new(args.boards()?);
    let (sender, events) = sync_channel(EVENTS);
    let host = match place {
        Place::Slcan(address) => {
            let address = tcp::listen("--slcan", address, Protocol::Slcan, sender.clone())?;
            print(&format!("slcan {address}\n"))?;
            Host::None
        }
        Place::Can(interface) => {
            let port = CanPort::open(interface)?;
            bus.plug_host(interface, Adapter::default())?;
            print(&format!("can {interface}\n"))?;
            port.watch(sender.clone())?;
            Host::Can(port)
        }
    };
    if let Some(address) = &args.truth {
        print(&format!("truth {}\n", tcp::listen("--truth", address, Protocol::Truth, sender.clone())?))?;
    }
    Server {
        bus,
        events,
        sender,
        host,
        truth: truth::line,
        askers: truth::Clients::default(),
        waiting: None,
        refusals: Refusals::default(),
        leaves_us: None,
        unparsed: Vec::new(),
        clients: 0,
        pace: Pace::default(),
    }
    .run(clock)
}

enum Host {
    None,
    Slcan(Client),
    Can(CanPort),
}

struct Server<S> {
    bus: Bus<S>,
    /// A line about the plants, and who asks for it.
    truth: fn(&Bus<S>) -> String,
    askers: truth::Clients,
    events: Receiver<Event>,
    sender: SyncSender<Event>,
    host: Host,
    /// Who wants to be the host, and until when it is not known whether the present one leaves, µs.
    waiting: Option<(NewClient, u64)>,
    refusals: Refusals,
    /// Bytes received while the adapter's queue was full.
    unparsed: Vec<u8>,
    /// Until when a host that has closed is kept, so that its last frames leave; µs.
    leaves_us: Option<u64>,
    clients: u64,
    pace: Pace,
}

impl<S: Station> Server<S> {
    fn run(mut self, clock: Clock) -> Result<(), Box<dyn Error>> {
        while let Some(real_us) = clock() {
            let (target_us, late) = self.pace.target(real_us, self.bus.now_us());
            if let Some(text) = late {
                warn(&text);
            }
            let slice_us = target_us.min(self.bus.now_us() + SLICE_US);
            self.bus.run_until(slice_us);
            self.send_frames();
            self.feed();
            let (bus, truth) = (&self.bus, self.truth);
            self.askers.serve(|| truth(bus));
            self.let_go();
            self.refuse_waiting();
            self.refusals.serve();
            let wait = if slice_us < target_us { Duration::ZERO } else { WAIT };
            // Frames stay in the interface. A client's bytes stay in its socket, and its end and the next client are noticed.
            if matches!(self.host, Host::Can(_)) && self.bus.waiting() >= QUEUE {
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

    fn handle(&mut self, event: Event) -> Result<(), Box<dyn Error>> {
        if self.askers.handle(&event) {
            return Ok(());
        }
        match event {
            Event::Client(client) if client.protocol == Protocol::Truth => {
                self.clients += 1;
                self.askers.connected(client, self.clients, self.sender.clone(), &mut self.refusals);
            }
            Event::Client(client) => self.connected(client),
            Event::Bytes(number, bytes) if self.is_client(number) => {
                self.unparsed.extend(bytes);
                if let Host::Slcan(client) = &mut self.host {
                    client.link.chunk_received();
                }
                self.feed();
            }
            Event::InputEnded(number) | Event::Gone(number) if self.is_client(number) => {
                self.leaves_us.get_or_insert(self.bus.now_us() + LAST_FRAMES_US);
                self.let_go();
            }
            // From a client that was disconnected.
            Event::Bytes(..) | Event::InputEnded(_) | Event::Gone(_) => {}
            Event::Frame(frame) => self.bus.send(frame)?,
            Event::Lost(problem) => return Err(problem.into()),
        }
        Ok(())
    }

    fn is_client(&self, number: u64) -> bool {
        matches!(&self.host, Host::Slcan(client) if client.link.number == number)
    }

    /// Makes a client the host. Where there is one it waits: the end of one connection and the start of the next come from two threads, in
    /// any order.
    fn connected(&mut self, client: NewClient) {
        if self.waiting.is_none() && matches!(self.host, Host::Slcan(_)) {
            self.waiting = Some((client, self.bus.now_us() + ORDER_US));
            return;
        }
        if let Err(two) = self.bus.plug_host(&client.peer, Adapter::default()) {
            warn(&two.to_string());
            self.refusals.refuse(client, &two.to_string());
            return;
        }
        self.clients += 1;
        match tcp::accept(client, self.clients, self.sender.clone(), &mut self.refusals) {
            Some(link) => {
                warn(&format!("{} is the host", link.peer));
                self.host = Host::Slcan(Client::new(link, Slcan::default()));
            }
            None => self.bus.unplug_host(),
        }
    }

    /// Refuses the client that waits if the host stays.
    fn refuse_waiting(&mut self) {
        // On a dead bus the queue stays full, and the reader does not reach the end.
        let has_left = matches!(&self.host, Host::Slcan(host) if host.link.has_closed());
        let is_late = |&(_, until_us): &(NewClient, u64)| self.bus.now_us() >= until_us + LAST_FRAMES_US;
        if has_left && self.waiting.as_ref().is_some_and(is_late) {
            self.disconnect("has left");
            return;
        }
        let stays = matches!(&self.host, Host::Slcan(host) if !host.link.has_closed());
        let is_over = |&(_, until_us): &(NewClient, u64)| stays && self.bus.now_us() >= until_us;
        if self.waiting.as_ref().is_some_and(is_over)
            && let Some((client, _)) = self.waiting.take()
            && let Err(two) = self.bus.plug_host(&client.peer, Adapter::default())
        {
            warn(&two.to_string());
            self.refusals.refuse(client, &two.to_string());
        }
    }

    /// Disconnects a host that has closed, once its frames are on the wire: an adapter sends what it has taken.
    fn let_go(&mut self) {
        let is_empty = self.unparsed.is_empty() && self.bus.waiting() == 0;
        if self.leaves_us.is_some_and(|until_us| is_empty || self.bus.now_us() >= until_us) {
            self.disconnect("has left");
        }
    }

    fn disconnect(&mut self, why: &str) {
        self.leaves_us = None;
        if let Host::Slcan(client) = std::mem::replace(&mut self.host, Host::None) {
            warn(&format!("{} {why}", client.link.peer));
            client.link.close();
        }
        self.unparsed.clear();
        self.bus.unplug_host();
        if let Some((next, _)) = self.waiting.take() {
            self.connected(next);
        }
    }

    fn feed(&mut self) {
        let Host::Slcan(client) = &mut self.host else { return };
        let mut taken = 0;
        for &byte in &self.unparsed {
            if self.bus.waiting() >= QUEUE {
                break;
            }
            taken += 1;
            if let Some(frame) = client.push(byte) {
                // The host is connected.
                let _ = self.bus.send(frame);
            }
        }
        self.unparsed.drain(..taken);
        if self.unparsed.is_empty() {
            client.link.read_next();
        }
    }

    fn send_frames(&mut self) {
        while let Some(stamped) = self.bus.receive() {
            match &mut self.host {
                Host::Slcan(client) => client.frame(&stamped),
                Host::Can(port) => port.send(&stamped.frame),
                Host::None => {}
            }
        }
        // What a host that has closed does not read, it does not miss.
        if let Host::Slcan(client) = &mut self.host
            && !client.flush()
            && self.leaves_us.is_none()
        {
            self.disconnect("does not read; disconnected");
        }
    }
}
