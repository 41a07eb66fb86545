//! bxCAN at 1 Mbit/s, with filters for what concerns this board (RM0008 24).
//!
//! `bxcan` sets the controller up. Frames are moved here: bxcan 0.8 takes a length code above 8, which any node may send and
//! which means 8, for the length of an array, and panics.

use bxcan::Interrupt;
use stm32f1xx_hal::can::Can as Pins;
use stm32f1xx_hal::gpio::PullUp;
use stm32f1xx_hal::pac::{CAN, can};
use tater_wire::{Destination, Frame, Group, Identifier, Node};

use crate::timing;

/// The controller, on its way onto the bus or on it.
pub struct Can(bxcan::Can<Pins<CAN, PullUp>>);

/// The bits of an identifier that hold the destination.
const DESTINATION: u16 = 0x41F;

/// An identifier in a 16-bit filter is above the bits for remote and extended frames, and three of an extended identifier
/// (RM0008 24.7.4).
const FILTER_SHIFT: u16 = 5;

/// A filter compares the destination, and that the frame is a data frame with an 11-bit identifier.
const FILTER_MASK: u16 = DESTINATION << FILTER_SHIFT | 0b11 << 3;

/// Filter register that lets through what is for one destination: the mask above the identifier.
fn to(destination: Destination) -> u32 {
    let id = Identifier { from: Node::HOST, to: destination }.raw();
    u32::from(FILTER_MASK) << 16 | u32::from(id << FILTER_SHIFT)
}

/// Registers that bxcan has no interface to.
fn registers() -> &'static can::RegisterBlock {
    // SAFETY: the controller belongs to the one `Can` there is; whoever calls this has it, and accesses are volatile.
    unsafe { &*CAN::ptr() }
}

impl Can {
    /// A controller that joins the bus once it has seen it idle; nothing waits for that. It recovers from bus-off by itself and
    /// sends frames in the order of their requests.
    pub fn new(pins: Pins<CAN, PullUp>) -> Self {
        let can =
            bxcan::Can::builder(pins).set_bit_timing(timing::can::REGISTER).set_automatic_retransmit(true);
        registers().mcr().modify(|_, w| w.abom().set_bit().txfp().set_bit());
        let mut can = can.leave_disabled();
        // Requests normal mode. "Would block" means that the bus has not been idle yet.
        let _ = can.enable_non_blocking();
        Self(can)
    }

    /// Lets through what is for all, for a node that is not the host's, and for three groups. For as long as that takes,
    /// some 1 us, nothing is received.
    pub fn set_filters(&mut self, node: Node, groups: [Option<Group>; 3]) {
        let all = to(Destination::Group(Group::ALL));
        let mine = if node == Node::HOST { all } else { to(Destination::Node(node)) };
        let [a, b, c] = groups.map(|group| group.map_or(all, |group| to(Destination::Group(group))));
        let can = registers();
        can.fmr().modify(|_, w| w.finit().set_bit());
        // Three banks of two 16-bit filters with masks, all into FIFO 0: reset state of FM1R, FS1R and FFA1R.
        for (bank, [first, second]) in [(can.fb(0), [all, mine]), (can.fb(1), [a, b]), (can.fb(2), [c, all])]
        {
            // SAFETY: any 32 bits are filters.
            bank.fr1().write(|w| unsafe { w.bits(first) });
            // SAFETY: the same.
            bank.fr2().write(|w| unsafe { w.bits(second) });
        }
        can.fm1r().reset();
        can.fs1r().reset();
        can.ffa1r().reset();
        // SAFETY: a bit a bank.
        can.fa1r().write(|w| unsafe { w.bits(0b111) });
        can.fmr().modify(|_, w| w.finit().clear_bit());
    }

    /// Enables the interrupts for a received frame and for a free mailbox.
    pub fn interrupt(&mut self) {
        self.0.enable_interrupt(Interrupt::Fifo0MessagePending);
        self.0.enable_interrupt(Interrupt::TransmitMailboxEmpty);
    }

    /// Clears the transmit interrupt.
    pub fn sent(&mut self) {
        registers().tsr().write(|w| w.rqcp0().set_bit().rqcp1().set_bit().rqcp2().set_bit());
    }

    /// Waits up to about 1 ms for the mailboxes to empty: long enough for three frames to win arbitration on a live bus.
    pub fn drain(&self) {
        let gone = || {
            let status = registers().tsr().read();
            status.tme0().bit_is_set() && status.tme1().bit_is_set() && status.tme2().bit_is_set()
        };
        let _ = (0..timing::can::DRAIN).any(|_| gone());
    }

    /// The oldest received frame. When the FIFO's three places are full, a new frame replaces the third (RM0008 24.7.3: RFLM is 0).
    pub fn receive(&mut self) -> Option<Frame> {
        let can = registers();
        if can.rf0r().read().fmp().bits() == 0 {
            return None;
        }
        let place = can.rx(0);
        let id = place.rir().read().stid().bits();
        let len = usize::from(place.rdtr().read().dlc().bits()).min(8);
        let [low, high] = [place.rdlr().read().bits(), place.rdhr().read().bits()];
        let bytes = (u64::from(high) << 32 | u64::from(low)).to_le_bytes();
        can.rf0r().write(|w| w.rfom().set_bit());
        Frame::from_raw(id, bytes.get(..len)?)
    }

    /// Hands a frame to a free mailbox; `false` where none is.
    pub fn transmit(&mut self, frame: &Frame) -> bool {
        let can = registers();
        let status = can.tsr().read();
        let free = [status.tme0(), status.tme1(), status.tme2()].map(|empty| empty.bit_is_set());
        let mailboxes = [can.tx(0), can.tx(1), can.tx(2)];
        let Some((mailbox, _)) = mailboxes.into_iter().zip(free).find(|&(_, free)| free) else {
            return false;
        };
        let mut bytes = [0; 8];
        frame.data().iter().zip(&mut bytes).for_each(|(&from, to)| *to = from);
        let bits = u64::from_le_bytes(bytes);
        let [low, high] = [bits, bits >> 32].map(|half| u32::try_from(half & 0xFFFF_FFFF).unwrap_or(0));
        // SAFETY: four bits, up to 8.
        mailbox.tdtr().write(|w| unsafe { w.dlc().bits(frame.data().len().to_le_bytes()[0]) });
        // SAFETY: any 32 bits are data.
        mailbox.tdlr().write(|w| unsafe { w.bits(low) });
        // SAFETY: the same.
        mailbox.tdhr().write(|w| unsafe { w.bits(high) });
        // SAFETY: 11 bits: an identifier.
        mailbox.tir().write(|w| unsafe { w.stid().bits(frame.id().raw()).txrq().set_bit() });
        true
    }
}
