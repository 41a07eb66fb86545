//! bxCAN: mailboxes, filters, two FIFOs, initialisation and sleep, errors (RM0008 24).

use super::{Access, Peripheral};
use crate::time::Time;
use tater_wire::Frame;

/// The CAN controller.
#[derive(Clone, Debug, Default)]
pub struct Can;

impl Can {
    /// As after a reset: asleep, off the bus.
    pub fn reset(&mut self) {}

    /// Whether it takes part in the bus: left initialisation, and not bus-off.
    #[must_use]
    pub fn is_on_bus(&self) -> bool {
        false
    }

    /// What is in the transmit mailboxes, in their order.
    #[must_use]
    pub fn pending(&self) -> &[Frame] {
        &[]
    }

    /// A frame of the mailboxes has been sent and acknowledged.
    pub fn sent(&mut self, frame: &Frame, now: Time) {
        let _ = (frame, now);
    }

    /// A frame that somebody else sent: through the filters into a FIFO.
    pub fn receive(&mut self, frame: &Frame, now: Time) {
        let _ = (frame, now);
    }

    /// Whether an empty mailbox interrupts.
    #[must_use]
    pub fn interrupt_tx(&self) -> bool {
        false
    }

    /// Whether a FIFO interrupts.
    #[must_use]
    pub fn interrupt_rx(&self, fifo: usize) -> bool {
        let _ = fifo;
        false
    }

    /// Whether a status change or an error interrupts.
    #[must_use]
    pub fn interrupt_status(&self) -> bool {
        false
    }
}

impl Peripheral for Can {
    fn read(&mut self, _offset: u32, _now: Time) -> Access<u32> {
        Err("nothing of it is".to_owned())
    }

    fn write(&mut self, _offset: u32, _value: u32, _now: Time) -> Access<()> {
        Err("nothing of it is".to_owned())
    }
}
