//! What arrives at a connection, and what ends a wait for it.

use std::sync::mpsc::SyncSender;

use tater_wire::Frame;

pub(crate) enum Event {
    Bytes(Vec<u8>),
    #[cfg_attr(not(target_os = "linux"), expect(dead_code, reason = "CAN interfaces are Linux's"))]
    Frame(Frame),
    Gone(String),
    /// [`Waker::wake`].
    Woken,
}

/// Ends the wait of `Port::receive` in another thread.
pub(crate) struct Waker(SyncSender<Event>);

impl Waker {
    pub const fn new(events: SyncSender<Event>) -> Self {
        Self(events)
    }

    pub fn wake(&self) {
        // A full channel has something to receive.
        let _ = self.0.try_send(Event::Woken);
    }
}
