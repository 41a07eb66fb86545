//! `hil-sim bus`: the simulated bus in real time, for CAN tools. One host at a time, by SLCAN over TCP or on a CAN interface.

use std::error::Error;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread;
use std::time::Duration;

use super::args::{BusArgs, Place};
use super::can::CanPort;
use super::event::{Arrival, Clock, Door, EVENTS, Event, SLICE_US, WAIT};
use super::pace::Pace;
use super::tcp::{self, Client};
use crate::ports::output::{print, tell};
use crate::ports::slcan::Slcan;
use crate::world::bus::{Adapter, Bus, Station};

/// Frames that a host may have in the adapter; what it sends beyond that stays in its socket.
const QUEUE: usize = 64;

/// Serves boards as the arguments say, until the clock ends.
///
/// # Errors
/// The arguments cannot be served: the address is taken, there is no such interface.
pub fn bus(args: &BusArgs, clock: Clock) -> Result<(), Box<dyn Error>> {
    let place = args.host()?;
    let mut bus = Bus::new(args.boards()?);
    let (sender, events) = sync_channel(EVENTS);
    let host = match place {
        Place::Slcan(address) => {
            let address = tcp::listen("--slcan", address, Door::Slcan, sender.clone())?;
            print(&format!("slcan {address}\n"))?;
            Host::None
        }
        Place::Can(interface) => {
            let port = CanPort::open(interface)?;
            bus.plug_host(interface, Adapter::default())?;
            print(&format!("can {interface}\n"))?;
            port.watch(sender.clone());
            Host::Can(port)
        }
    };
    Server { bus, events, sender, host, held: Vec::new(), clients: 0, pace: Pace::default() }.run(clock)
}

/// Who is node 0.
enum Host {
    None,
    Slcan(Client),
    Can(CanPort),
}

struct Server<S> {
    bus: Bus<S>,
    events: Receiver<Event>,
    /// For the threads of clients to come.
    sender: SyncSender<Event>,
    host: Host,
    /// Bytes of the client for which there was no room in the adapter yet.
    held: Vec<u8>,
    /// Clients so far.
    clients: u64,
    pace: Pace,
}

impl<S: Station> Server<S> {
    fn run(mut self, clock: Clock) -> Result<(), Box<dyn Error>> {
        while let Some(real_us) = clock() {
            let (target_us, late) = self.pace.target(real_us, self.bus.now_us());
            if let Some(text) = late {
                tell(&text);
            }
            let slice_us = target_us.min(self.bus.now_us() + SLICE_US);
            self.bus.run_until(slice_us);
            self.answer();
            self.feed();
            let wait = if slice_us < target_us { Duration::ZERO } else { WAIT };
            if self.bus.waiting() >= QUEUE {
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
        match event {
            Event::Client(arrival) => self.client(arrival),
            Event::Bytes(number, bytes) if self.is_client(number) => {
                self.held.extend(bytes);
                if let Host::Slcan(client) = &mut self.host {
                    client.link.has_come();
                }
                self.feed();
            }
            Event::Gone(number) if self.is_client(number) => self.leave("has left"),
            // Of a client that has been sent away already.
            Event::Bytes(..) | Event::Gone(_) => {}
            Event::Frame(frame) => self.bus.send(frame)?,
            Event::Lost(problem) => return Err(problem.into()),
        }
        Ok(())
    }

    fn is_client(&self, number: u64) -> bool {
        matches!(&self.host, Host::Slcan(client) if client.link.number == number)
    }

    /// Lets a client be the host, if the place is free.
    fn client(&mut self, arrival: Arrival) {
        if let Err(two) = self.bus.plug_host(&arrival.peer, Adapter::default()) {
            tell(&two.to_string());
            tcp::refuse(arrival, &two.to_string());
            return;
        }
        self.clients += 1;
        match tcp::accept(arrival, self.clients, self.sender.clone()) {
            Ok(link) => {
                tell(&format!("{} is the host", link.peer));
                self.host = Host::Slcan(Client::new(link, Slcan::default()));
            }
            // It has gone already.
            Err(_) => self.bus.unplug_host(),
        }
    }

    fn leave(&mut self, why: &str) {
        if let Host::Slcan(client) = std::mem::replace(&mut self.host, Host::None) {
            tell(&format!("{} {why}", client.link.peer));
            client.link.close();
        }
        self.held.clear();
        self.bus.unplug_host();
    }

    /// Bytes to frames, while there is room for frames.
    fn feed(&mut self) {
        let Host::Slcan(client) = &mut self.host else { return };
        let mut taken = 0;
        for &byte in &self.held {
            if self.bus.waiting() >= QUEUE {
                break;
            }
            taken += 1;
            if let Some(frame) = client.push(byte) {
                // It is plugged in.
                let _ = self.bus.send(frame);
            }
        }
        self.held.drain(..taken);
        if self.held.is_empty() {
            client.link.go_on();
        }
    }

    /// What the bus has for the host.
    fn answer(&mut self) {
        while let Some(stamped) = self.bus.receive() {
            match &mut self.host {
                Host::Slcan(client) => client.frame(&stamped),
                Host::Can(port) => port.send(&stamped.frame),
                Host::None => {}
            }
        }
        if let Host::Slcan(client) = &mut self.host
            && !client.flush()
        {
            self.leave("does not read what it is told");
        }
    }
}
