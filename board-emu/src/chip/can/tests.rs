mod errors;
mod receive;
mod transmit;

use super::*;

const MCR: u32 = 0x00;
const MSR: u32 = 0x04;
const TSR: u32 = 0x08;
const RF0R: u32 = 0x0C;
const IER: u32 = 0x14;
const ESR: u32 = 0x18;
const BTR: u32 = 0x1C;
const FMR: u32 = 0x200;
const FA1R: u32 = 0x21C;

/// 36 MHz by 2, 18 quanta a bit: 1 + 14 + 3; jump width 2.
const TIMING: u32 = 1 << 24 | 2 << 20 | 13 << 16 | 1;

const JOINED: Time = IDLE;

fn read(can: &mut Can, offset: u32, now: Time) -> u32 {
    can.read(offset, now).expect("a register")
}

fn write(can: &mut Can, offset: u32, value: u32, now: Time) {
    can.write(offset, value, now).expect("modeled");
}

/// A controller on the bus, with these bits in MCR and a filter that accepts all frames into FIFO 0.
fn on_bus(options: u32) -> Can {
    let mut can = Can::default();
    can.set_cycle(4);
    write(&mut can, MCR, mcr::INRQ, 0);
    write(&mut can, BTR, TIMING, 0);
    // Bank 0: an empty mask.
    write(&mut can, FA1R, 1, 0);
    write(&mut can, FMR, 0, 0);
    write(&mut can, MCR, options, 0);
    can.advance(JOINED);
    assert!(can.is_on_bus());
    can
}

fn frame(id: u16, data: &[u8]) -> Frame {
    Frame::from_raw(id, data).expect("11 bits, 8 bytes")
}

fn request(can: &mut Can, mailbox: u32, id: u32, now: Time) {
    let at = 0x180 + 16 * mailbox;
    write(can, at + 4, 2, now);
    write(can, at + 8, 0xBBAA, now);
    write(can, at + 12, 0, now);
    write(can, at, id << 21 | 1, now);
}

fn offered(can: &Can) -> Vec<u16> {
    can.pending().iter().map(Frame::raw_id).collect()
}

#[test]
fn reset_state_is_sleep() {
    let mut can = Can::default();
    // RM0008 24.9.5, table of reset values.
    let table = [
        (MCR, 0x0001_0002),
        (MSR, 0x0000_0C02),
        (TSR, 0x1C00_0000),
        (RF0R, 0),
        (0x10, 0),
        (IER, 0),
        (ESR, 0),
        (BTR, 0x0123_0000),
        (FMR, 0x2A1C_0E01),
        (0x204, 0),
        (0x20C, 0),
        (0x214, 0),
        (FA1R, 0),
    ];
    for (offset, value) in table {
        assert_eq!(read(&mut can, offset, 0), value, "{offset:#x}");
    }
    assert!(!can.is_on_bus() && can.pending().is_empty());
}

#[test]
fn joins_after_initialization_and_11_recessive_bits() {
    let mut can = Can::default();
    can.set_cycle(4);
    let acknowledges = |can: &mut Can, now| read(can, MSR, now) & (msr::INAK | msr::SLAK);
    write(&mut can, MCR, mcr::INRQ, 0);
    assert_eq!(acknowledges(&mut can, 0), msr::INAK);
    write(&mut can, BTR, TIMING, 0);
    write(&mut can, MCR, mcr::SLEEP, 0);
    assert_eq!(acknowledges(&mut can, 0), msr::SLAK);
    write(&mut can, BTR, 0, 0);
    assert_eq!(read(&mut can, BTR, 0), TIMING, "protected outside initialization");
    write(&mut can, MCR, 0, 1000);
    assert_eq!((acknowledges(&mut can, 1000 + IDLE - 1), can.is_on_bus()), (msr::SLAK, false));
    assert_eq!(can.next_event(), 1000 + IDLE);
    assert_eq!((acknowledges(&mut can, 1000 + IDLE), can.is_on_bus()), (0, true));
    write(&mut can, MCR, mcr::INRQ, 5000);
    assert_eq!((acknowledges(&mut can, 5000), can.is_on_bus()), (msr::INAK, false));
}

#[test]
fn joins_after_a_frame_in_progress() {
    let mut can = Can::default();
    can.set_cycle(4);
    write(&mut can, MCR, mcr::INRQ, 0);
    write(&mut can, BTR, TIMING, 0);
    write(&mut can, FA1R, 1, 0);
    write(&mut can, FMR, 0, 0);
    write(&mut can, MCR, 0, 10 * BIT);
    // At least 44 bits long, it ends at 60 us: it began before the controller asked to join.
    can.receive(&frame(0x123, &[]), 60 * BIT);
    assert!(!can.is_on_bus());
    assert_eq!(read(&mut can, RF0R, 60 * BIT), 0, "not heard");
    can.advance(63 * BIT);
    assert!(can.is_on_bus());
    can.receive(&frame(0x123, &[]), 120 * BIT);
    assert_eq!(read(&mut can, RF0R, 120 * BIT), 1);
}

#[test]
fn other_bit_timing_is_rejected() {
    // One quantum more; the other prescaler; the right values at half the clock.
    for (timing, cycle) in [(TIMING + (1 << 16), 4), (TIMING + 1, 4), (TIMING, 8)] {
        let mut can = Can::default();
        can.set_cycle(cycle);
        write(&mut can, MCR, mcr::INRQ, 0);
        write(&mut can, BTR, timing, 0);
        assert!(can.write(MCR, 0, 0).is_err(), "{timing:#x} {cycle}");
    }
}

#[test]
fn master_reset_ends_in_sleep() {
    let mut can = on_bus(mcr::ABOM);
    can.receive(&frame(1, &[]), 200 * BIT);
    write(&mut can, MCR, mcr::RESET, 200 * BIT);
    let [mode, status, fifo] = [MCR, MSR, RF0R].map(|at| read(&mut can, at, 200 * BIT));
    assert_eq!((mode, status & msr::SLAK, fifo), (mcr::AT_RESET, msr::SLAK, 0));
    assert!(!can.is_on_bus());
}

#[test]
fn frame_wakes_it_with_awum() {
    for (automatic, wakes) in [(0, false), (mcr::AWUM, true)] {
        let mut can = on_bus(automatic);
        write(&mut can, IER, ier::WKUIE, JOINED);
        write(&mut can, MCR, automatic | mcr::SLEEP, JOINED);
        can.receive(&frame(1, &[]), 200 * BIT);
        assert!(can.interrupt_status(), "WKUI");
        write(&mut can, MSR, msr::WKUI, 200 * BIT);
        assert!(!can.interrupt_status());
        can.advance(203 * BIT);
        assert_eq!(can.is_on_bus(), wakes);
        assert_eq!(read(&mut can, RF0R, 203 * BIT), 0, "the frame that wakes is not received");
    }
}
