//! Filters and FIFOs.

use super::*;

const NOW: Time = 1000 * BIT;
const RFOM: u32 = 1 << 5;

/// Filter registers: RM0008 24.9.4.
fn filtered(registers: &[(u32, u32)]) -> Can {
    let mut can = on_bus(0);
    write(&mut can, FMR, 1, NOW);
    for &(offset, value) in registers {
        write(&mut can, offset, value, NOW);
    }
    write(&mut can, FMR, 0, NOW);
    can
}

fn filter(can: &mut Can, id: u16) -> Option<(u32, u32)> {
    can.receive(&frame(id, &[]), NOW);
    (0..2).find_map(|fifo| {
        let register = RF0R + 4 * fifo;
        let pending = read(can, register, NOW) & 3;
        let number = read(can, 0x1B4 + 16 * fifo, NOW) >> 8 & 0xFF;
        write(can, register, RFOM, NOW);
        (pending > 0).then_some((fifo, number))
    })
}

#[test]
fn received_frame_stays_until_released() {
    let mut can = on_bus(0);
    can.receive(&frame(0x321, &[1, 2, 3, 4, 5]), NOW);
    can.receive(&frame(0x322, &[9]), NOW);
    assert_eq!(read(&mut can, RF0R, NOW), 2);
    let place = [0x1B0, 0x1B4, 0x1B8, 0x1BC].map(|at| read(&mut can, at, NOW));
    assert_eq!(place, [0x321 << 21, 5, 0x0403_0201, 5]);
    write(&mut can, RF0R, RFOM, NOW);
    assert_eq!((read(&mut can, RF0R, NOW), read(&mut can, 0x1B0, NOW)), (1, 0x322 << 21));
    write(&mut can, RF0R, RFOM, NOW);
    write(&mut can, RF0R, RFOM, NOW);
    assert_eq!(read(&mut can, RF0R, NOW), 0);
}

#[test]
fn fourth_frame_overruns_by_rflm() {
    for (locked, last) in [(0, 4), (mcr::RFLM, 3)] {
        let mut can = on_bus(locked);
        (1..=3).for_each(|id| can.receive(&frame(id, &[]), NOW));
        assert_eq!(read(&mut can, RF0R, NOW), 3 | 1 << 3, "FULL");
        can.receive(&frame(4, &[]), NOW);
        assert_eq!(read(&mut can, RF0R, NOW), 3 | 1 << 3 | 1 << 4, "FOVR");
        let ids = [1, 2, last].map(|id| {
            let found = read(&mut can, 0x1B0, NOW) >> 21;
            write(&mut can, RF0R, RFOM, NOW);
            (found, id)
        });
        assert!(ids.iter().all(|(found, id)| found == id), "{ids:?}");
        write(&mut can, RF0R, 3 << 3, NOW);
        assert_eq!(read(&mut can, RF0R, NOW), 0, "flags are cleared by writing them");
    }
}

#[test]
fn fifo_interrupts_have_separate_enables() {
    for (frames, enable) in [(1, 1 << 1), (3, 1 << 2), (4, 1 << 3)] {
        let mut can = on_bus(0);
        write(&mut can, IER, enable, NOW);
        for id in 0..frames {
            assert!(!can.interrupt_rx(0), "{enable:#x} after {id}");
            can.receive(&frame(id, &[]), NOW);
        }
        assert!(can.interrupt_rx(0) && !can.interrupt_rx(1), "{enable:#x}");
    }
}

#[test]
fn frame_without_active_filter_is_dropped() {
    let mut can = on_bus(0);
    write(&mut can, FMR, 1, NOW);
    assert_eq!(filter(&mut can, 5), None);
    write(&mut can, FMR, 0, NOW);
    assert_eq!(filter(&mut can, 5), Some((0, 0)));
    write(&mut can, FA1R, 0, NOW);
    assert_eq!(filter(&mut can, 5), None);
}

#[test]
fn filter_registers_are_write_protected() {
    let mut can = on_bus(0);
    for (register, value) in [(0x204, 1), (0x20C, 1), (0x214, 1), (0x240, 77)] {
        write(&mut can, register, value, NOW);
        assert_eq!(read(&mut can, register, NOW), 0, "{register:#x}: bank 0 is active");
    }
    write(&mut can, 0x248, 77, NOW);
    assert_eq!(read(&mut can, 0x248, NOW), 77, "bank 1 is not");
    assert!(can.write(0x2B0, 0, NOW).is_err(), "there are 14 banks");
}

/// A destination on this bus: the mask ignores the sender's five bits.
#[test]
fn bank_holds_two_masks_of_16_bits() {
    // Identifier in the lower half, mask in the upper; the lowest five bits: remote, extended, and three of the latter.
    let mask = 0x41F << 5 | 3 << 3;
    let banks = [(0x240, mask << 16 | 3 << 5), (0x244, mask << 16 | 0x400 << 5), (FA1R, 1)];
    let mut can = filtered(&banks);
    assert_eq!(filter(&mut can, 0x003), Some((0, 0)));
    assert_eq!(filter(&mut can, 0x3E3), Some((0, 0)), "any sender");
    assert_eq!(filter(&mut can, 0x400), Some((0, 1)));
    assert_eq!((filter(&mut can, 0x004), filter(&mut can, 0x403)), (None, None));
    // A mask that requires a remote frame accepts no data frame.
    let mut can = filtered(&[(0x240, mask << 16 | 3 << 5 | 1 << 4), (0x244, u32::MAX), (FA1R, 1)]);
    assert_eq!(filter(&mut can, 0x003), None);
}

#[test]
fn lists_and_wide_filters_and_their_numbers() {
    // Bank 0: list of 16 bits, numbers 0 to 3. Bank 1: mask of 32 bits, number 4. Bank 2: list of 32 bits, 5 and 6. Bank 3:
    // into FIFO 1, numbers of its own. Bank 4: not active, 7 and 8. Bank 5: mask of 16 bits, 9 and 10.
    let mask16 = 0x7FF << 21 | 0x7FF << 5;
    let mut can = filtered(&[
        (0x204, 0b00_0101),
        (0x20C, 0b00_1110),
        (0x214, 0b00_1000),
        (FA1R, 0b10_1111),
        (0x240, 0x11 << 21 | 0x10 << 5),
        (0x244, 0x13 << 21 | 0x12 << 5),
        (0x248, 0x20 << 21),
        (0x24C, 0x7FE << 21),
        (0x250, 0x30 << 21),
        (0x254, 0x31 << 21),
        (0x258, 0x40 << 21),
        (0x25C, 0x7FF << 21),
        (0x260, 0x50 << 5 | 0x7FF << 21),
        (0x264, 0x50 << 5 | 0x7FF << 21),
        (0x268, 0x50 << 5 | mask16 & 0xFFFF_0000),
        (0x26C, 0x51 << 5 | mask16 & 0xFFFF_0000),
    ]);
    let numbers = [
        (0x10, 0, 0),
        (0x11, 0, 1),
        (0x12, 0, 2),
        (0x13, 0, 3),
        (0x20, 0, 4),
        (0x21, 0, 4),
        (0x30, 0, 5),
        (0x31, 0, 6),
        (0x40, 1, 0),
        (0x50, 0, 9),
        (0x51, 0, 10),
    ];
    for (id, fifo, number) in numbers {
        assert_eq!(filter(&mut can, id), Some((fifo, number)), "{id:#x}");
    }
    assert_eq!(filter(&mut can, 0x14), None);
}

#[test]
fn filter_priority_is_width_then_list_then_number() {
    let all16 = [(0x240, 5 << 5), (0x244, 5 << 5)];
    // Bank 0: two masks of 16 bits that accept all. Bank 1: list of 16 bits. Bank 2: mask of 32 bits that
    // accepts all. Bank 3: list of 32 bits.
    let banks = [
        (0x204, 0b1010),
        (0x20C, 0b1100),
        (0x248, 5 << 5),
        (0x24C, 5 << 5),
        (0x258, 5 << 21),
        (0x25C, 5 << 21),
    ];
    // Numbers: 0 and 1; 2 to 5; 6; 7 and 8.
    for (active, number) in [(0b1111, 7), (0b0111, 6), (0b0011, 2), (0b0001, 0)] {
        let mut can = filtered(&[&all16[..], &banks[..], &[(FA1R, active)]].concat());
        assert_eq!(filter(&mut can, 5), Some((0, number)), "{active:#b}");
    }
}

#[test]
fn frame_during_initialization_is_ignored() {
    let mut can = on_bus(0);
    write(&mut can, MCR, mcr::INRQ, NOW);
    can.receive(&frame(5, &[]), NOW);
    assert_eq!(read(&mut can, RF0R, NOW), 0);
}
