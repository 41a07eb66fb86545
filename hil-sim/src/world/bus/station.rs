//! What the bus needs of a board: its CAN controller's mailboxes and its time.

use tater_wire::Frame;

/// From the end of a frame to when a board has its answer ready, µs, at worst: a control tick (some 1,200 instructions
/// at 1.5 cycles and 72 MHz: 25) and a hall edge (5) go before it, and its own handling takes some 15.
pub const BOARD_US: u64 = 50;

/// A board on the bus, with its CAN controller's transmit mailboxes; the receive FIFO is the bus's.
///
/// The bus brings all stations to each instant at which something happens on it, and to each [`Station::next_us`];
/// in between, no station can notice another.
pub trait Station {
    /// The station's present time, µs since power-up of the bus.
    fn now_us(&self) -> u64;

    /// Lets time pass up to and including `until_us`; never goes back, and not beyond it.
    ///
    /// A long operation (a flash erase) may begin inside: the state after it may be there at once, if
    /// [`Station::busy_until_us`] says until when the processor really stands still.
    fn advance(&mut self, until_us: u64);

    /// The next instant at which the station may by itself want to send: its next tick or step, after
    /// [`Station::now_us`]. `u64::MAX` if it only answers.
    fn next_us(&self) -> u64;

    /// Until when the processor stands still. At or before [`Station::now_us`] if it runs. What comes meanwhile waits in
    /// the receive FIFO until the last microsecond.
    fn busy_until_us(&self) -> u64;

    /// From the end of a frame to when its program has the answer ready, µs, unless the processor stands still. 0 where the
    /// station has a receive FIFO and a program of its own: it gets a frame when it ends.
    fn latency_us(&self) -> u64 {
        BOARD_US
    }

    /// Whether its CAN controller takes part: a board without power, in reset or booting neither hears nor acknowledges.
    fn is_on_bus(&self) -> bool {
        true
    }

    /// A frame from the receive FIFO, at the station's present time: any frame on the bus but its own.
    fn receive(&mut self, frame: &Frame);

    /// A frame on the wire was destroyed, which it was sending or hearing.
    fn error(&mut self, sending: bool) {
        let _ = sending;
    }

    /// The frames in the transmit mailboxes, in the order of the mailboxes. The controller (bxCAN with TXFP = 0) sends
    /// the lowest identifier first, of equal ones that of the first mailbox. A station that stands still goes on sending.
    fn pending(&self) -> &[Frame];

    /// One of [`Station::pending`] has been sent and acknowledged: its mailbox is free, and more may be put in. A frame that is
    /// not there any more (the station was reset meanwhile) is ignored.
    fn sent(&mut self, frame: &Frame);
}
