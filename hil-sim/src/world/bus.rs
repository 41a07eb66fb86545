//! A CAN bus in simulated time: arbitration, delivery, and the bit times each frame takes.
//!
//! Classic CAN at 1 Mbit/s, so a bit is a microsecond. The lowest identifier wins. Frame lengths include stuffing. A corrupted
//! frame costs an error frame and is sent again. A receive FIFO holds three frames; while it is full, each frame that arrives
//! replaces the newest.
//! Not modeled: error counters (a station never goes bus-off), remote and extended frames, and retransmissions without an
//! acknowledgment: a lone station waits until another one is on the bus.
//!
//! Event-driven and deterministic: the same calls give the same traffic, to the microsecond.

mod host;
mod length;
mod medium;
mod station;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, VecDeque};

use tater_wire::Frame;

use host::Host;
pub use host::{Adapter, NoHost, Stamped, TwoHosts};
pub use length::bits;
use length::{ERROR_FRAME, INTERMISSION};
pub use medium::{Clean, Fate, Medium, Noise};
pub use station::{BOARD_US, Station};

/// Frames in a controller's receive FIFO (bxCAN: three; with RFLM = 0 the newest is overwritten).
pub const FIFO: usize = 3;

/// Frames that a tap keeps until they are read: 0.1 s of a full bus.
const TAP: usize = 1024;

/// Counters of the bus traffic.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Bit times in use: frames, error frames, intermissions.
    pub busy_us: u64,
    /// Acknowledged frames.
    pub frames: u64,
    /// Corrupted frames; each was sent again.
    pub errors: u64,
    /// Acknowledged frames by identifier.
    pub by_id: BTreeMap<u16, u64>,
    /// Frames lost because a receive FIFO was full: overwritten by newer ones.
    pub overruns: u64,
    /// Frames that a receiver acknowledged but lost (see [`Medium::delivers`]).
    pub lost: u64,
}

/// A bus with its stations and at most one host.
pub struct Bus<S> {
    now_us: u64,
    slots: Vec<Slot<S>>,
    host: Option<Host>,
    medium: Box<dyn Medium + Send>,
    flight: Option<Flight>,
    /// End of the last intermission.
    free_us: u64,
    stats: Stats,
    tap: Option<VecDeque<Stamped>>,
}

struct Slot<S> {
    station: S,
    cut: bool,
    fifo: VecDeque<Stamped>,
    /// When the station's software read the last frame from the FIFO.
    taken_us: u64,
}

struct Flight {
    frame: Frame,
    /// The sending station; `None`: the host.
    sender: Option<usize>,
    begin_us: u64,
    end_us: u64,
    whole: bool,
}

impl<S: Station> Slot<S> {
    fn is_connected(&self) -> bool {
        !self.cut && self.station.is_on_bus()
    }

    /// When the software reads the next frame from the FIFO. Frames that arrive during a stall are all read in its last
    /// microsecond: their interrupt precedes the program's next step, which may stall again.
    fn delivery_us(&self) -> Option<u64> {
        let latency_us = self.station.latency_us();
        let ready_us = self.fifo.front()?.at_us + latency_us;
        let busy_us = self.station.busy_until_us();
        Some(if ready_us < busy_us { busy_us - 1 } else { ready_us.max(self.taken_us + latency_us) })
    }
}

impl<S: Station> Bus<S> {
    /// A bus at time 0 with a clean cable and no host.
    #[must_use]
    pub fn new(stations: Vec<S>) -> Self {
        let slot = |station| Slot { station, cut: false, fifo: VecDeque::new(), taken_us: 0 };
        Self {
            now_us: 0,
            slots: stations.into_iter().map(slot).collect(),
            host: None,
            medium: Box::new(Clean),
            flight: None,
            free_us: 0,
            stats: Stats::default(),
            tap: None,
        }
    }

    /// Connects a host; `name` identifies it in errors.
    ///
    /// # Errors
    /// A host is connected already: both would be node 0.
    pub fn plug_host(&mut self, name: &str, adapter: Adapter) -> Result<(), TwoHosts> {
        if let Some(host) = &self.host {
            return Err(TwoHosts { present: host.name.clone(), refused: name.to_owned() });
        }
        self.host = Some(Host::new(name.to_owned(), adapter));
        Ok(())
    }

    /// Disconnects the host and discards what it has not sent or received.
    pub fn unplug_host(&mut self) {
        self.host = None;
        if let Some(flight) = self.flight.as_mut().filter(|flight| flight.sender.is_none()) {
            flight.whole = false;
        }
    }

    /// Replaces the cable model.
    pub fn set_medium(&mut self, medium: impl Medium + Send + 'static) {
        self.medium = Box::new(medium);
    }

    /// Cuts or restores a station's cable. A frame that the station is sending is corrupted.
    pub fn cut(&mut self, station: usize, cut: bool) {
        if let Some(slot) = self.slots.get_mut(station) {
            slot.cut = cut;
        }
        if let Some(flight) = self.flight.as_mut().filter(|flight| cut && flight.sender == Some(station)) {
            flight.whole = false;
        }
    }

    /// µs since power-up.
    #[must_use]
    pub const fn now_us(&self) -> u64 {
        self.now_us
    }

    /// The traffic counters.
    #[must_use]
    pub const fn stats(&self) -> &Stats {
        &self.stats
    }

    /// The stations, in the order they were given.
    pub fn stations(&self) -> impl Iterator<Item = &S> {
        self.slots.iter().map(|slot| &slot.station)
    }

    /// A station by its index.
    pub fn station_mut(&mut self, index: usize) -> Option<&mut S> {
        self.slots.get_mut(index).map(|slot| &mut slot.station)
    }

    /// Queues a frame of the host.
    ///
    /// # Errors
    /// No host is connected.
    pub fn send(&mut self, frame: Frame) -> Result<(), NoHost> {
        self.host.as_mut().ok_or(NoHost)?.send(frame, self.now_us);
        Ok(())
    }

    /// Queued frames of the host that are not on the wire yet, the one being sent included.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.host.as_ref().map_or(0, Host::waiting)
    }

    /// Discards the host's queued frames. One that is on the wire is finished.
    pub fn abort_pending(&mut self) {
        let on_wire = self.flight.as_ref().is_some_and(|flight| flight.sender.is_none());
        if let Some(host) = &mut self.host {
            host.abort_pending(on_wire);
        }
    }

    /// The oldest frame that has reached the host by now.
    pub fn receive(&mut self) -> Option<Stamped> {
        self.host.as_mut()?.receive(self.now_us)
    }

    /// Starts or stops recording all frames for [`Self::tapped`]. The tap is passive: it acknowledges nothing.
    pub fn tap(&mut self, on: bool) {
        self.tap = on.then(VecDeque::new);
    }

    /// The next recorded frame. Of more than 1024 unread frames the oldest are dropped.
    pub fn tapped(&mut self) -> Option<Stamped> {
        self.tap.as_mut()?.pop_front()
    }

    /// Advances time up to and including `until_us`.
    pub fn run_until(&mut self, until_us: u64) {
        self.settle();
        while self.now_us < until_us {
            self.step(until_us);
        }
    }

    /// Advances time until a frame reaches the host and returns it; `None` at `deadline_us`.
    pub fn wait(&mut self, deadline_us: u64) -> Option<Stamped> {
        self.settle();
        loop {
            if let Some(stamped) = self.receive() {
                return Some(stamped);
            }
            if self.now_us >= deadline_us {
                return None;
            }
            self.step(deadline_us);
        }
    }

    fn step(&mut self, until_us: u64) {
        let next_us = self.next_us().clamp(self.now_us + 1, until_us.max(self.now_us + 1));
        for slot in &mut self.slots {
            slot.station.advance(next_us);
        }
        self.now_us = next_us;
        self.settle();
    }

    fn next_us(&self) -> u64 {
        let wire_us = match &self.flight {
            Some(flight) => flight.end_us,
            None if self.winner().is_some() => self.free_us,
            None => u64::MAX,
        };
        let host_us = self.host.as_ref().map_or(u64::MAX, |host| host.next_us(self.now_us));
        let slots_us = self.slots.iter().map(|slot| {
            slot.station.next_us().max(self.now_us + 1).min(slot.delivery_us().unwrap_or(u64::MAX))
        });
        slots_us.min().unwrap_or(u64::MAX).min(wire_us).min(host_us)
    }

    /// Processes what is due now: the end of a frame, deliveries, the start of a frame.
    fn settle(&mut self) {
        if let Some(flight) = self.flight.take_if(|flight| flight.end_us <= self.now_us) {
            self.finish(&flight);
        }
        for slot in &mut self.slots {
            if !slot.station.is_on_bus() {
                slot.fifo.clear();
            }
            while slot.delivery_us().is_some_and(|at| at <= self.now_us) {
                slot.taken_us = self.now_us;
                if let Some(Stamped { frame, .. }) = slot.fifo.pop_front() {
                    slot.station.receive(&frame);
                }
            }
        }
        if self.flight.is_none() && self.now_us >= self.free_us {
            self.begin();
        }
    }

    /// Arbitration. Two stations share an identifier only by mistake; then the first one wins.
    fn winner(&self) -> Option<(Option<usize>, Frame)> {
        let host = self.host.as_ref().and_then(|host| host.pending(self.now_us)).map(|frame| (None, frame));
        let connected = self.slots.iter().enumerate().filter(|(_, slot)| slot.is_connected());
        // A frame needs a second node on the bus to be acknowledged.
        if connected.clone().count() + usize::from(self.host.is_some()) < 2 {
            return None;
        }
        let lowest = |(index, slot): (usize, &Slot<S>)| {
            let frame = slot.station.pending().iter().min_by_key(|frame| frame.raw_id())?;
            Some((Some(index), *frame))
        };
        host.into_iter().chain(connected.filter_map(lowest)).min_by_key(|(_, frame)| frame.raw_id())
    }

    fn begin(&mut self) {
        let Some((sender, frame)) = self.winner() else { return };
        let bits = length::bits(&frame);
        let (len, whole) = match self.medium.fate(&frame, bits, self.now_us) {
            Fate::Delivered => (bits, true),
            Fate::Corrupted { at_bit } => (at_bit.min(bits) + ERROR_FRAME, false),
        };
        let end_us = self.now_us + len;
        self.flight = Some(Flight { frame, sender, begin_us: self.now_us, end_us, whole });
    }

    fn finish(&mut self, flight: &Flight) {
        self.free_us = flight.end_us + INTERMISSION;
        self.stats.busy_us += self.free_us - flight.begin_us;
        if !flight.whole {
            self.stats.errors += 1;
            for (index, slot) in self.slots.iter_mut().enumerate().filter(|(_, slot)| slot.is_connected()) {
                slot.station.error(flight.sender == Some(index));
            }
            return;
        }
        let Flight { frame, sender, .. } = *flight;
        self.stats.frames += 1;
        *self.stats.by_id.entry(frame.raw_id()).or_default() += 1;
        let now_us = self.now_us;
        if let Some(tap) = &mut self.tap {
            if tap.len() >= TAP {
                tap.pop_front();
            }
            tap.push_back(Stamped { at_us: now_us, frame });
        }
        for (index, slot) in self.slots.iter_mut().enumerate() {
            if sender == Some(index) {
                slot.station.sent(&frame);
            } else if !slot.is_connected() {
            } else if !self.medium.delivers(&frame, Some(index)) {
                self.stats.lost += 1;
            } else if slot.station.accepts(&frame) {
                if slot.fifo.len() >= FIFO {
                    self.stats.overruns += 1;
                    slot.fifo.pop_back();
                }
                slot.fifo.push_back(Stamped { at_us: now_us, frame });
            }
        }
        let Some(host) = &mut self.host else { return };
        if sender.is_none() {
            host.sent();
        } else if self.medium.delivers(&frame, None) {
            host.hear(frame, now_us);
        } else {
            self.stats.lost += 1;
        }
    }
}
