use super::*;
use std::collections::BTreeSet;

const KEYR: u32 = 0x04;
const SR: u32 = 0x0C;
const CR: u32 = 0x10;
const AR: u32 = 0x14;

const AT: u32 = 40 * PAGE + 8;

fn unlock(flash: &mut Flash, now: Time) {
    for key in KEYS {
        flash.write(KEYR, key, now).expect("a key");
    }
}

fn open(bits: u32) -> Flash {
    let mut flash = Flash::default();
    unlock(&mut flash, 0);
    flash.write(CR, bits, 0).expect("unlocked");
    flash
}

fn half(flash: &mut Flash, offset: u32) -> u32 {
    Flash::read(flash, offset, Size::Half).expect("inside")
}

fn program(flash: &mut Flash, offset: u32, value: u32, now: Time) -> Result<(), AccessError> {
    flash.program(offset, Size::Half, value, now)
}

fn erase(flash: &mut Flash, now: Time) {
    flash.write(AR, FLASH.start + AT, now).expect("written");
    flash.write(CR, cr::PER, now).expect("unlocked");
    flash.write(CR, cr::PER | cr::STRT, now).expect("a page");
}

#[test]
fn wrong_key_locks_until_reset() {
    let mut flash = Flash::default();
    let cr = |flash: &mut Flash| Peripheral::read(flash, CR, 0).expect("CR");
    assert_eq!(cr(&mut flash), cr::LOCK, "after a reset");
    flash.write(CR, cr::PG, 0).expect("ignored");
    assert_eq!(cr(&mut flash), cr::LOCK);
    assert_eq!(program(&mut flash, AT, 1, 0), Err(AccessError::Bus), "locked");
    unlock(&mut flash, 0);
    flash.write(CR, cr::PG, 0).expect("unlocked");
    assert_eq!(cr(&mut flash), cr::PG);
    flash.write(CR, cr::LOCK, 0).expect("locks");
    unlock(&mut flash, 0);
    assert_eq!(cr(&mut flash), 0, "and again");
    // Second key first: locked until the next reset.
    let mut flash = Flash::default();
    flash.write(KEYR, KEYS[1], 0).expect("a key");
    unlock(&mut flash, 0);
    assert_eq!(cr(&mut flash), cr::LOCK);
    flash.reset(0);
    unlock(&mut flash, 0);
    assert_eq!(cr(&mut flash), 0);
}

#[test]
fn half_word_is_programmed_once_except_to_0() {
    let mut flash = open(cr::PG);
    assert_eq!(program(&mut flash, AT, 0x1234, 1000), Ok(()));
    assert_eq!(flash.busy_until, 1000 + 7560, "52.5 us");
    assert_eq!(Peripheral::read(&mut flash, SR, 8559), Ok(sr::BSY));
    assert_eq!(Peripheral::read(&mut flash, SR, 8560), Ok(sr::EOP));
    assert_eq!(half(&mut flash, AT), 0x1234);
    flash.write(SR, sr::EOP, 8560).expect("clears");
    assert_eq!(program(&mut flash, AT, 0x1230, 9000), Ok(()));
    assert_eq!(Peripheral::read(&mut flash, SR, 9000), Ok(sr::PGERR), "not erased, and at once");
    assert_eq!(half(&mut flash, AT), 0x1234);
    flash.write(SR, sr::PGERR, 9000).expect("clears");
    assert_eq!(program(&mut flash, AT, 0, 9000), Ok(()));
    assert_eq!((half(&mut flash, AT), Peripheral::read(&mut flash, SR, 20_000)), (0, Ok(sr::EOP)));
    assert_eq!(flash.operations(), 2);
}

#[test]
fn other_widths_and_odd_addresses_are_bus_errors() {
    let mut flash = open(cr::PG);
    for (offset, size) in [(AT, Size::Byte), (AT, Size::Word), (AT + 1, Size::Half)] {
        assert_eq!(flash.program(offset, size, 0, 0), Err(AccessError::Bus), "{size:?}");
    }
    assert_eq!(flash.operations(), 0);
}

#[test]
fn page_erase_takes_40_ms_and_spares_others() {
    let mut flash = open(0);
    flash.load(FLASH.start + 39 * PAGE, &[0x55; 3 * PAGE as usize]);
    erase(&mut flash, 100);
    assert_eq!(flash.busy_until, 100 + 40_000 * US);
    assert_ne!(Peripheral::read(&mut flash, CR, 200).map(|cr| cr & cr::STRT), Ok(0), "until the end");
    let end = flash.busy_until;
    assert_eq!(Peripheral::read(&mut flash, CR, end), Ok(cr::PER));
    let page = |flash: &Flash, index: usize| {
        flash.bytes.chunks(PAGE as usize).nth(index).is_some_and(|page| page.iter().all(|&byte| byte == 0xFF))
    };
    assert_eq!([38, 39, 40, 41, 42].map(|index| page(&flash, index)), [true, false, true, false, true]);
    let mut flash = open(cr::MER);
    flash.load(FLASH.start, &[0; 5000]);
    flash.write(CR, cr::MER | cr::STRT, 0).expect("all");
    assert!(flash.bytes.iter().all(|&byte| byte == 0xFF));
}

#[test]
fn unmodeled_bits_are_errors() {
    let mut flash = open(0);
    assert!(flash.write(CR, 1 << 4, 0).is_err(), "OPTPG");
    assert!(flash.write(CR, cr::STRT, 0).is_err(), "neither PER nor MER");
    flash.write(AR, 0x2000_0000, 0).expect("written");
    assert!(flash.write(CR, cr::PER | cr::STRT, 0).is_err(), "no page");
    assert!(flash.write(0x00, 3, 0).is_err(), "three wait states");
}

#[test]
fn power_failure_while_programming_leaves_ones() {
    let mut seen = BTreeSet::new();
    for seed in 0..200 {
        let mut flash = open(cr::PG);
        flash.cut_after(1, seed);
        assert_eq!(program(&mut flash, AT, 0x5555, 0), Ok(()));
        assert!(!flash.is_cut());
        assert_eq!(program(&mut flash, AT + 2, 0x0F0F, 10_000), Ok(()));
        assert!(flash.is_cut());
        assert_eq!(program(&mut flash, AT + 4, 1, 20_000), Ok(()), "no effect");
        assert_eq!((half(&mut flash, AT), half(&mut flash, AT + 4)), (0x5555, 0xFFFF));
        let left = half(&mut flash, AT + 2);
        assert_eq!(left & 0x0F0F, 0x0F0F, "ones stay");
        seen.insert(left);
        flash.reset(20_000);
        unlock(&mut flash, 20_000);
        flash.write(CR, cr::PG, 20_000).expect("unlocked");
        assert_eq!(program(&mut flash, AT + 4, 1, 30_000), Ok(()));
        assert_eq!(half(&mut flash, AT + 4), 1, "it works again");
    }
    // 256 are possible; the chance of 200 draws giving no more than 50 is nil.
    assert!(seen.len() > 50, "{}", seen.len());
}

#[test]
fn power_failure_while_erasing_leaves_part_of_the_page() {
    let mut untouched = 0;
    let mut erased = 0;
    let mut between = 0;
    for seed in 0..100 {
        let mut flash = open(0);
        flash.load(FLASH.start, &[0x55; FLASH.len as usize]);
        flash.cut_after(0, seed);
        erase(&mut flash, 0);
        let at = (AT / PAGE * PAGE) as usize;
        let (page, others) =
            (&flash.bytes[at..at + PAGE as usize], [&flash.bytes[..at], &flash.bytes[at + 1024..]]);
        assert!(others.concat().iter().all(|&byte| byte == 0x55));
        let all = |value: u8| page.iter().all(|&byte| byte == value);
        match (all(0x55), all(0xFF)) {
            (true, _) => untouched += 1,
            (_, true) => erased += 1,
            _ => between += 1,
        }
    }
    // A quarter each, and half: none of a hundred is rarer than 1 in 10^12.
    assert!(untouched > 0 && erased > 0 && between > 0, "{untouched} {erased} {between}");
}

#[test]
fn reset_during_an_operation_leaves_it_half_done() {
    let mut left = BTreeSet::new();
    for value in 0..100 {
        let mut flash = open(cr::PG);
        flash.cut_after(1_000, value);
        assert_eq!(program(&mut flash, AT, 0, 0), Ok(()));
        flash.reset(PROGRAM - 1);
        assert_eq!(flash.busy_until, PROGRAM - 1, "no longer busy");
        left.insert(half(&mut flash, AT));
        let mut flash = open(cr::PG);
        assert_eq!(program(&mut flash, AT, 0, 0), Ok(()));
        flash.reset(PROGRAM);
        assert_eq!(half(&mut flash, AT), 0);
    }
    assert!(left.len() > 50, "{}", left.len());
}
