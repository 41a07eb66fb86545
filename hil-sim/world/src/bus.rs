//! A CAN bus in simulated time: arbitration, delivery, and the bit times each frame takes.
//!
//! Classic CAN at 1 Mbit/s, so a bit is a microsecond. The lowest identifier wins. Frame lengths include stuffing. A corrupted
//! frame costs an error frame and is sent again. A receive FIFO holds three frames; while it is full, each frame that arrives
//! replaces the newest. A station whose frames are corrupted again and again goes bus-off (ISO 11898-1: its transmit error counter
//! rises by 8 with each and falls by 1 with each frame sent) and comes back after 128 times 11 bits.
//! Not modeled: receive error counters, remote and extended frames, and retransmissions without an acknowledgment: a lone
//! station waits until another one is on the bus.
//!
//! Stations that send one identifier at once do so by mistake: two boards have one number (decision 0078). Equal frames are one frame on the wire. At
//! the first bit that differs, the station whose recessive bit reads dominant has a bit error. While it is error active its error flag
//! destroys the frame of all; once it is error passive (counter above 127) its flag disturbs nobody: the other frame is delivered, then its own.
//! The eight bits for which an error passive station suspends its next frame are not modeled, nor are the host and strangers part of such a conflict.
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

/// A transmit error counter above this is bus-off (ISO 11898-1).
const BUS_OFF: u16 = 255;

/// A transmit error counter above this is error passive (ISO 11898-1).
const PASSIVE: u16 = 127;

/// Time that a station stays bus-off, us: 128 times 11 recessive bits. The controller comes back by itself (bxCAN's ABOM, docs/board.md).
const RECOVERY_US: u64 = 128 * 11;

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
    /// Frames received twice (see [`Fate::Duplicated`]).
    pub duplicates: u64,
    /// How often a station went bus-off.
    pub bus_offs: u64,
    /// Bit errors between stations that sent different frames with one identifier at once.
    pub conflicts: u64,
}

/// A bus with its stations and at most one host.
pub struct Bus<S> {
    now_us: u64,
    slots: Vec<Slot<S>>,
    /// The slots behind these are of guests.
    members: usize,
    host: Option<Host>,
    medium: Box<dyn Medium + Send>,
    flight: Option<Flight>,
    /// End of the last intermission.
    free_us: u64,
    stats: Stats,
    tap: Option<VecDeque<Stamped>>,
    /// Frames of nodes that are no station: a second host, a babbling node.
    strangers: VecDeque<Frame>,
}

struct Slot<S> {
    station: S,
    cut: bool,
    fifo: VecDeque<Stamped>,
    /// When the station's software read the last frame from the FIFO.
    taken_us: u64,
    /// Before this time it sends nothing.
    held_until_us: u64,
    /// Transmit error counter, and the end of its last bus-off.
    errors: u16,
    off_until_us: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sender {
    Host,
    Station(usize),
    Stranger,
    /// A guest that was unplugged meanwhile.
    Gone,
}

struct Flight {
    frame: Frame,
    sender: Sender,
    /// Further stations that send the same frame.
    twins: Vec<usize>,
    begin_us: u64,
    end_us: u64,
    fate: Fate,
}

impl Flight {
    fn is_sent_by(&self, index: usize) -> bool {
        self.sender == Sender::Station(index) || self.twins.contains(&index)
    }
}

impl<S: Station> Slot<S> {
    const fn new(station: S) -> Self {
        Self {
            station,
            cut: false,
            fifo: VecDeque::new(),
            taken_us: 0,
            held_until_us: 0,
            errors: 0,
            off_until_us: 0,
        }
    }

    fn is_connected(&self, now_us: u64) -> bool {
        !self.cut && now_us >= self.off_until_us && self.station.is_on_bus()
    }

    /// Whether it may take part in an arbitration.
    fn may_send(&self, now_us: u64) -> bool {
        self.is_connected(now_us) && self.held_until_us <= now_us
    }

    /// The frame with which it takes part.
    fn offer(&self) -> Option<&Frame> {
        self.station.pending().iter().min_by_key(|frame| frame.raw_id())
    }

    fn is_passive(&self) -> bool {
        if self.station.counts_errors() { self.station.is_error_passive() } else { self.errors > PASSIVE }
    }

    /// It has sent a frame that was corrupted; returns whether it goes bus-off. A station that counts by itself reports that on its own.
    fn fail(&mut self, now_us: u64) -> bool {
        let off = !self.station.counts_errors() && self.count_error(now_us);
        self.station.error(true);
        off
    }

    /// Counts a frame that it could not send; returns whether it goes bus-off.
    fn count_error(&mut self, now_us: u64) -> bool {
        self.errors += 8;
        let off = self.errors > BUS_OFF;
        if off {
            self.errors = 0;
            self.off_until_us = now_us + RECOVERY_US;
        }
        off
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
        Self {
            now_us: 0,
            members: stations.len(),
            slots: stations.into_iter().map(Slot::new).collect(),
            host: None,
            medium: Box::new(Clean),
            flight: None,
            free_us: 0,
            stats: Stats::default(),
            tap: None,
            strangers: VecDeque::new(),
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
        self.break_frame_of(Sender::Host);
    }

    fn break_frame_of(&mut self, sender: Sender) {
        let Some(flight) = &mut self.flight else { return };
        // The frame goes on if another station sends the same.
        flight.twins.retain(|&twin| sender != Sender::Station(twin));
        if flight.sender == sender {
            flight.fate = Fate::Corrupted { at_bit: 0 };
        }
    }

    /// Plugs in a station that is none of [`Self::stations`], such as a spare board. It receives and sends like the others.
    pub fn plug_guest(&mut self, station: S) {
        self.slots.push(Slot::new(station));
    }

    /// Unplugs the guest that has been there longest.
    pub fn unplug_guest(&mut self) -> Option<S> {
        let first = self.members;
        if first >= self.slots.len() {
            return None;
        }
        // The places of the guests behind it change: what they send now is sent again.
        (first..self.slots.len()).for_each(|guest| self.break_frame_of(Sender::Station(guest)));
        if let Some(flight) = &mut self.flight
            && matches!(flight.sender, Sender::Station(sender) if sender >= first)
        {
            flight.sender = Sender::Gone;
        }
        Some(self.slots.remove(first).station)
    }

    /// The guests, the first one first.
    pub fn guests(&self) -> impl Iterator<Item = &S> {
        self.slots.iter().skip(self.members).map(|slot| &slot.station)
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
        if cut {
            self.break_frame_of(Sender::Station(station));
        }
    }

    /// Keeps a station from sending before `until_us`; what it receives is acknowledged as ever.
    pub fn hold(&mut self, station: usize, until_us: u64) {
        if let Some(slot) = self.slots.get_mut(station) {
            slot.held_until_us = until_us;
        }
    }

    /// Puts a station bus-off now, as after 32 corrupted frames.
    pub fn put_bus_off(&mut self, station: usize) {
        let now_us = self.now_us;
        if let Some(slot) = self.slots.get_mut(station) {
            slot.errors = BUS_OFF;
            self.stats.bus_offs += u64::from(slot.count_error(now_us));
            self.break_frame_of(Sender::Station(station));
        }
    }

    /// Queues a frame of a node that is no station and receives nothing: a second host, a babbling node.
    pub fn intrude(&mut self, frame: Frame) {
        self.strangers.push_back(frame);
    }

    /// Frames of strangers that are not sent yet.
    #[must_use]
    pub fn strangers_waiting(&self) -> usize {
        self.strangers.len()
    }

    /// Discards the frames of strangers.
    pub fn silence_strangers(&mut self) {
        self.strangers.clear();
        self.break_frame_of(Sender::Stranger);
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

    /// The stations, in the order they were given, without guests.
    pub fn stations(&self) -> impl Iterator<Item = &S> {
        self.slots.iter().take(self.members).map(|slot| &slot.station)
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
        let on_wire = self.flight.as_ref().is_some_and(|flight| flight.sender == Sender::Host);
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
            None => self.freed_us(),
        };
        let host_us = self.host.as_ref().map_or(u64::MAX, |host| host.next_us(self.now_us));
        let slots_us = self.slots.iter().map(|slot| {
            slot.station.next_us().max(self.now_us + 1).min(slot.delivery_us().unwrap_or(u64::MAX))
        });
        slots_us.min().unwrap_or(u64::MAX).min(wire_us).min(host_us)
    }

    /// The next time at which a station that must not send now may; `u64::MAX` without one.
    fn freed_us(&self) -> u64 {
        let times = self.slots.iter().flat_map(|slot| [slot.held_until_us, slot.off_until_us]);
        times.filter(|&at| at > self.now_us).min().unwrap_or(u64::MAX)
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

    /// Arbitration: the lowest identifier, and of stations that share it the first one.
    fn winner(&self) -> Option<(Sender, Frame)> {
        let now_us = self.now_us;
        let host =
            self.host.as_ref().and_then(|host| host.pending(now_us)).map(|frame| (Sender::Host, frame));
        let stranger = self.strangers.front().map(|frame| (Sender::Stranger, *frame));
        let connected = self.slots.iter().enumerate().filter(|(_, slot)| slot.is_connected(now_us));
        // A frame needs a second node on the bus to be acknowledged.
        let others = usize::from(self.host.is_some()) + usize::from(stranger.is_some());
        if connected.clone().count() + others < 2 {
            return None;
        }
        let free = connected.filter(|(_, slot)| slot.held_until_us <= now_us);
        let offers = free.filter_map(|(index, slot)| Some((Sender::Station(index), *slot.offer()?)));
        let all = host.into_iter().chain(offers).chain(stranger);
        all.min_by_key(|(_, frame)| frame.raw_id())
    }

    fn begin(&mut self) {
        let Some((mut sender, mut frame)) = self.winner() else { return };
        let (mut twins, mut conflict) = (Vec::new(), None);
        if let Sender::Station(first) = sender {
            let rivals = self.rivals(first, &frame);
            if !rivals.is_empty() {
                (twins, conflict) = self.collide(first, rivals);
                let first = twins.remove(0);
                sender = Sender::Station(first);
                frame = self.slots.get(first).and_then(Slot::offer).copied().unwrap_or(frame);
            }
        }
        let bits = length::bits(&frame);
        let fate = self.medium.fate(&frame, bits, self.now_us);
        let fate = match conflict {
            Some(at_bit) => Fate::Corrupted { at_bit },
            None => fate,
        };
        let len = match fate {
            Fate::Delivered => bits,
            Fate::Duplicated => bits + ERROR_FRAME,
            Fate::Corrupted { at_bit } => at_bit.min(bits) + ERROR_FRAME,
        };
        let end_us = self.now_us + len;
        self.flight = Some(Flight { frame, sender, twins, begin_us: self.now_us, end_us, fate });
    }

    /// The stations behind `first` that begin to send a frame of the same identifier now.
    fn rivals(&self, first: usize, frame: &Frame) -> Vec<usize> {
        let behind = self.slots.iter().enumerate().skip(first + 1);
        let is_rival = |slot: &Slot<S>| {
            slot.may_send(self.now_us) && slot.offer().is_some_and(|offer| offer.raw_id() == frame.raw_id())
        };
        behind.filter(|(_, slot)| is_rival(slot)).map(|(index, _)| index).collect()
    }

    /// Stations send one identifier at once. Returns those that go on to send, all the same frame, or, if one of them destroys it, all, and the number of the
    /// bit at which it does.
    fn collide(&mut self, first: usize, rivals: Vec<usize>) -> (Vec<usize>, Option<u64>) {
        let now_us = self.now_us;
        let mut senders = rivals;
        senders.insert(0, first);
        loop {
            let frame =
                |index: usize| self.slots.get(index).and_then(Slot::offer).copied().unwrap_or(Frame::EMPTY);
            let model = frame(senders[0]);
            let apart = |index: usize| length::difference(&model, &frame(index));
            let Some((at_bit, model_is_recessive)) = senders.iter().filter_map(|&index| apart(index)).min()
            else {
                return (senders, None);
            };
            // Those that differ from the model there have the other level.
            let is_recessive = |index: usize| match apart(index) {
                Some((at, _)) if at == at_bit => !model_is_recessive,
                _ => model_is_recessive,
            };
            let (losing, going_on): (Vec<usize>, Vec<usize>) =
                senders.iter().partition(|&&index| is_recessive(index));
            self.stats.conflicts += 1;
            if losing.iter().any(|&index| self.slots.get(index).is_some_and(|slot| !slot.is_passive())) {
                return (senders, Some(at_bit));
            }
            for index in losing {
                if let Some(slot) = self.slots.get_mut(index) {
                    self.stats.bus_offs += u64::from(slot.fail(now_us));
                }
            }
            senders = going_on;
        }
    }

    fn finish(&mut self, flight: &Flight) {
        self.free_us = flight.end_us + INTERMISSION;
        self.stats.busy_us += self.free_us - flight.begin_us;
        let now_us = self.now_us;
        if let Fate::Corrupted { .. } = flight.fate {
            self.stats.errors += 1;
            for (index, slot) in self.slots.iter_mut().enumerate() {
                if !slot.is_connected(now_us) {
                } else if flight.is_sent_by(index) {
                    self.stats.bus_offs += u64::from(slot.fail(now_us));
                } else {
                    slot.station.error(false);
                }
            }
            return;
        }
        let Flight { frame, sender, .. } = *flight;
        let twice = flight.fate == Fate::Duplicated;
        self.stats.frames += 1;
        self.stats.duplicates += u64::from(twice);
        *self.stats.by_id.entry(frame.raw_id()).or_default() += 1;
        if let Some(tap) = &mut self.tap {
            if tap.len() >= TAP {
                tap.pop_front();
            }
            tap.push_back(Stamped { at_us: now_us, frame });
        }
        for (index, slot) in self.slots.iter_mut().enumerate() {
            if flight.is_sent_by(index) {
                if !twice {
                    slot.errors = slot.errors.saturating_sub(1);
                    slot.station.sent(&frame);
                }
            } else if !slot.is_connected(now_us) {
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
        if sender == Sender::Stranger && !twice {
            self.strangers.pop_front();
        }
        let Some(host) = &mut self.host else { return };
        if sender == Sender::Host {
            if !twice {
                host.sent();
            }
        } else if self.medium.delivers(&frame, None) {
            host.hear(frame, now_us);
        } else {
            self.stats.lost += 1;
        }
    }
}
