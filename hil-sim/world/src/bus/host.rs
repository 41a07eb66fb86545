//! The host on the bus: node 0, behind an adapter with a queue.

use std::collections::VecDeque;
use std::fmt;

use tater_wire::Frame;

/// Delays of a host's CAN adapter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Adapter {
    /// From the host's program to the adapter's transmit queue, µs.
    pub out_us: u64,
    /// From the end of a frame on the bus to the host's program, µs.
    pub in_us: u64,
}

/// A frame with its time stamp.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamped {
    /// End of the frame on the bus plus the adapter's delay, µs since the bus powered up.
    pub at_us: u64,
    /// The frame.
    pub frame: Frame,
}

/// A second host wanted to connect.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TwoHosts {
    /// The connected host.
    pub present: String,
    /// The refused host.
    pub refused: String,
}

impl fmt::Display for TwoHosts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "two hosts: {} cannot be on the bus with {}, both would be node 0; disconnect one of them",
            self.refused, self.present
        )
    }
}

impl std::error::Error for TwoHosts {}

/// A frame was to be sent without a host on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoHost;

impl fmt::Display for NoHost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("no host is plugged into the bus")
    }
}

impl std::error::Error for NoHost {}

/// The adapter sends in order and never loses a received frame.
pub(super) struct Host {
    pub(super) name: String,
    adapter: Adapter,
    out: VecDeque<Stamped>,
    inbox: VecDeque<Stamped>,
}

impl Host {
    pub(super) const fn new(name: String, adapter: Adapter) -> Self {
        Self { name, adapter, out: VecDeque::new(), inbox: VecDeque::new() }
    }

    pub(super) fn send(&mut self, frame: Frame, now_us: u64) {
        self.out.push_back(Stamped { at_us: now_us + self.adapter.out_us, frame });
    }

    pub(super) fn waiting(&self) -> usize {
        self.out.len()
    }

    pub(super) fn abort_pending(&mut self, on_wire: bool) {
        self.out.truncate(usize::from(on_wire));
    }

    pub(super) fn pending(&self, now_us: u64) -> Option<Frame> {
        self.out.front().filter(|out| out.at_us <= now_us).map(|out| out.frame)
    }

    pub(super) fn sent(&mut self) {
        self.out.pop_front();
    }

    pub(super) fn hear(&mut self, frame: Frame, now_us: u64) {
        self.inbox.push_back(Stamped { at_us: now_us + self.adapter.in_us, frame });
    }

    pub(super) fn receive(&mut self, now_us: u64) -> Option<Stamped> {
        self.inbox.pop_front_if(|stamped| stamped.at_us <= now_us)
    }

    pub(super) fn next_us(&self, now_us: u64) -> u64 {
        let fronts = [self.out.front(), self.inbox.front()];
        fronts.into_iter().flatten().map(|s| s.at_us).filter(|&at| at > now_us).min().unwrap_or(u64::MAX)
    }
}
