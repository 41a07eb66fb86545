//! The bus's view of a board: transmit mailboxes and time.

use tater_wire::Frame;

/// Worst-case time from the end of a frame to the board's answer in a mailbox, µs: a control tick (some 1,200 instructions
/// at 1.5 cycles and 72 MHz: 25) and a hall edge (5) run first, and the handling takes about 15.
pub const BOARD_US: u64 = 50;

/// A board on the bus with its transmit mailboxes; the bus models the receive FIFO. The bus advances all stations to each
/// bus event and to each [`Station::next_us`].
pub trait Station {
    /// The station's present time, µs since power-up of the bus.
    fn now_us(&self) -> u64;

    /// Advances to exactly `until_us`. The result of a flash erase that starts inside may be visible at once if
    /// [`Station::busy_until_us`] returns the end of the stall.
    fn advance(&mut self, until_us: u64);

    /// The next time at which the station may send without a request; `u64::MAX` if it only answers.
    fn next_us(&self) -> u64;

    /// End of the processor's stall; at or before [`Station::now_us`] if it runs.
    fn busy_until_us(&self) -> u64;

    /// Time from the end of a frame until its answer is ready, µs; 0 for a station that models its own receive FIFO.
    fn latency_us(&self) -> u64 {
        BOARD_US
    }

    /// Whether its CAN controller is active. A board without power, in reset or booting neither receives nor acknowledges.
    fn is_on_bus(&self) -> bool {
        true
    }

    /// Whether the receive filters pass a frame into the FIFO.
    fn accepts(&self, frame: &Frame) -> bool {
        let _ = frame;
        true
    }

    /// A frame from the receive FIFO at the station's present time; never one of its own.
    fn receive(&mut self, frame: &Frame);

    /// Whether the station models its own error counters, and so takes itself off the bus.
    fn counts_errors(&self) -> bool {
        false
    }

    /// Whether a station that counts errors itself is error passive: its error flag disturbs no other frame.
    fn is_error_passive(&self) -> bool {
        false
    }

    /// A frame that it was sending or receiving was corrupted.
    fn error(&mut self, sending: bool) {
        let _ = sending;
    }

    /// The frames in the transmit mailboxes, in mailbox order. The controller (bxCAN with TXFP = 0) sends the lowest identifier
    /// first, and of equal ones that of the lowest mailbox. A stalled station keeps sending.
    fn pending(&self) -> &[Frame];

    /// One of [`Station::pending`] was acknowledged. Ignored if the frame is gone (the station was reset meanwhile).
    fn sent(&mut self, frame: &Frame);
}
