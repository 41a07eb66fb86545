//! Mailboxes.

use super::*;

const NOW: Time = 1000 * BIT;

/// TSR: bits of empty mailboxes.
fn empty(can: &mut Can) -> u32 {
    read(can, TSR, NOW) >> 26 & 7
}

#[test]
fn frame_is_sent_as_in_its_registers() {
    let mut can = on_bus(0);
    request(&mut can, 1, 0x123, NOW);
    assert_eq!(can.pending(), [frame(0x123, &[0xAA, 0xBB])]);
    assert_eq!(read(&mut can, 0x190, NOW), 0x123 << 21 | 1, "TXRQ");
    assert_eq!(empty(&mut can), 0b101);
    write(&mut can, 0x198, 0, NOW);
    assert_eq!(read(&mut can, 0x198, NOW), 0xBBAA, "protected while it waits");
    can.sent(&frame(0x123, &[0xAA, 0xBB]), NOW);
    assert!(can.pending().is_empty());
    assert_eq!(read(&mut can, 0x190, NOW), 0x123 << 21);
    assert_eq!(read(&mut can, TSR, NOW) & 0xFFFF, (RQCP | TXOK) << 8);
    write(&mut can, TSR, RQCP << 8, NOW);
    assert_eq!(read(&mut can, TSR, NOW), 0x1C00_0000, "RQCP clears TXOK too");
}

const RQCP: u32 = 1;
const TXOK: u32 = 2;
const TERR: u32 = 8;

#[test]
fn length_code_above_8_means_8() {
    let mut can = on_bus(0);
    write(&mut can, 0x184, 15, NOW);
    write(&mut can, 0x188, 0x0403_0201, NOW);
    write(&mut can, 0x18C, 0x0807_0605, NOW);
    write(&mut can, 0x180, 5 << 21 | 1, NOW);
    assert_eq!(can.pending(), [frame(5, &[1, 2, 3, 4, 5, 6, 7, 8])]);
}

#[test]
fn remote_and_extended_frames_are_rejected() {
    for bit in [1 << 1, 1 << 2] {
        let mut can = on_bus(0);
        assert!(can.write(0x180, 5 << 21 | bit | 1, NOW).is_err());
    }
}

#[test]
fn all_frames_are_offered_and_low_flags_the_last() {
    let mut can = on_bus(0);
    assert_eq!(read(&mut can, TSR, NOW) >> 24 & 3, 0, "CODE: the first that is empty");
    for (mailbox, id) in [(0, 0x300), (1, 0x400), (2, 0x200)] {
        request(&mut can, mailbox, id, NOW);
    }
    assert_eq!(offered(&can), [0x300, 0x400, 0x200]);
    let status = read(&mut can, TSR, NOW);
    assert_eq!((status >> 24 & 3, status >> 29), (1, 0b010), "the lowest priority is mailbox 1");
    can.sent(&frame(0x200, &[0xAA, 0xBB]), NOW);
    assert_eq!((offered(&can), empty(&mut can)), (vec![0x300, 0x400], 0b100));
    assert_eq!(read(&mut can, TSR, NOW) >> 24 & 3, 2, "CODE: the empty one");
    can.sent(&frame(0x300, &[0xAA, 0xBB]), NOW);
    assert_eq!(read(&mut can, TSR, NOW) >> 29, 0, "LOW: only if two or more wait");
}

#[test]
fn txfp_offers_only_the_oldest_request() {
    let mut can = on_bus(mcr::TXFP);
    for (mailbox, id) in [(2, 0x300), (0, 0x100), (1, 0x200)] {
        request(&mut can, mailbox, id, NOW);
    }
    for id in [0x300, 0x100, 0x200] {
        assert_eq!(offered(&can), [id]);
        can.sent(&frame(id, &[0xAA, 0xBB]), NOW);
    }
    assert!(offered(&can).is_empty());
}

#[test]
fn sent_frame_frees_one_of_two_equal_ones() {
    let mut can = on_bus(0);
    request(&mut can, 0, 7, NOW);
    request(&mut can, 1, 7, NOW);
    can.sent(&frame(7, &[0xAA, 0xBB]), NOW);
    assert_eq!(offered(&can), [7]);
    can.sent(&frame(8, &[]), NOW);
    assert_eq!(offered(&can), [7], "another's frame");
}

#[test]
fn transmit_interrupt_lasts_until_rqcp_is_cleared() {
    let mut can = on_bus(0);
    request(&mut can, 0, 7, NOW);
    can.sent(&frame(7, &[0xAA, 0xBB]), NOW);
    assert!(!can.interrupt_tx());
    write(&mut can, IER, ier::TMEIE, NOW);
    assert!(can.interrupt_tx());
    write(&mut can, TSR, RQCP, NOW);
    assert!(!can.interrupt_tx());
}

#[test]
fn request_can_be_aborted() {
    let mut can = on_bus(0);
    request(&mut can, 1, 7, NOW);
    write(&mut can, TSR, 1 << 15, NOW);
    assert!(can.pending().is_empty());
    assert_eq!(read(&mut can, TSR, NOW) & 0xFF00, RQCP << 8, "not sent");
    can.sent(&frame(7, &[0xAA, 0xBB]), NOW);
    assert_eq!(read(&mut can, TSR, NOW) & 0xFF00, RQCP << 8, "too late");
}

#[test]
fn corrupted_frame_is_repeated_unless_nart() {
    for (once, left) in [(0, 1), (mcr::NART, 0)] {
        let mut can = on_bus(once);
        request(&mut can, 0, 7, NOW);
        can.error(true, NOW);
        assert_eq!(can.pending().len(), left);
        assert_eq!(read(&mut can, TSR, NOW) & 0xF, if left == 1 { TERR } else { TERR | RQCP });
    }
}

#[test]
fn nothing_is_offered_off_the_bus() {
    let mut can = on_bus(0);
    request(&mut can, 0, 7, NOW);
    write(&mut can, MCR, mcr::INRQ, NOW);
    assert!(can.pending().is_empty());
    write(&mut can, MCR, 0, NOW);
    can.advance(NOW + IDLE);
    assert_eq!(offered(&can), [7], "it has waited");
}
