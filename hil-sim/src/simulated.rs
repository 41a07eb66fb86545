//! Boards of a simulated bus as the link of commands that are made for real ones.

use tater_wire::Frame;

use commission::excite::Link;
use hil_world::bus::{Adapter, Bus, Station};
use hil_world::node::Node;

/// Boards of a simulated bus, in simulated time.
pub struct Simulated<S = Node> {
    bus: Bus<S>,
}

impl<S: Station> Simulated<S> {
    /// A host on a bus with one board that has been powered.
    #[must_use]
    pub fn new(board: S) -> Self {
        Self::with(vec![board])
    }

    /// A host on a bus with boards that have been powered.
    #[must_use]
    pub fn with(boards: Vec<S>) -> Self {
        let mut bus = Bus::new(boards);
        // A new bus has no host.
        let _ = bus.plug_host("excite", Adapter::default());
        Self { bus }
    }

    /// The first board, to read its truth.
    #[must_use]
    pub fn board(&self) -> Option<&S> {
        self.bus.stations().next()
    }

    /// The bus, to do to boards what a host cannot.
    pub const fn bus_mut(&mut self) -> &mut Bus<S> {
        &mut self.bus
    }
}

impl<S: Station> Link for Simulated<S> {
    fn now_us(&self) -> u64 {
        self.bus.now_us()
    }

    fn send(&mut self, frame: &Frame) -> Result<(), String> {
        self.bus.send(*frame).map_err(|error| error.to_string())
    }

    fn receive(&mut self, until_us: u64) -> Result<Option<(u64, Frame)>, String> {
        Ok(self.bus.wait(until_us).map(|stamped| (stamped.at_us, stamped.frame)))
    }

    fn is_interrupted(&self) -> bool {
        false
    }
}
