//! btutil: lists, renumbers and downloads. It waits for each answer and each request without a time limit.

use hil_world::bus::Station;
use tater_f103::map::APPLICATION;
use tater_wire::FaultCode;

use super::can::{Host, emulated, native};
use crate::emulated::bench::production;
use crate::protocol::download::file;

const VERS: u8 = 0;
const ROLE: u8 = 1;
const SN: u8 = 2;
const ID: u8 = 3;
const ERROR: u8 = 4;
const STAT: u8 = 5;
const ADDR: u8 = 6;
const VALUE: u8 = 7;
const LOCK: u8 = 13;
const SAVE: u8 = 30;

/// LOCK and SAVE in the monitor.
const MONITORS_LOCK: u8 = 8;
const MONITORS_SAVE: u8 = 9;

const UNLOCK: [i32; 5] = [18384, 23, 3145, 1024, 1];

/// In the place of forever.
const FOREVER_MS: u64 = 30_000;

fn wait_for<S: Station>(host: &mut Host<S>, node: u16, property: u8) -> i32 {
    host.get_within(node, property, FOREVER_MS).unwrap_or_else(|| panic!("{property} of {node}: it hangs"))
}

/// STAT of each node, VERS of the monitor and of the application, and back to the monitor.
fn enumerates<S: Station>(host: &mut Host<S>, node: u16) {
    for other in (1..32).filter(|&other| other != node) {
        assert_eq!(host.get_within(other, STAT, 1), None, "node {other}");
    }
    assert_eq!(wait_for(host, node, STAT), 0);
    assert_eq!(wait_for(host, node, VERS), 600);
    host.set(node, STAT, 2);
    host.sleep_ms(1000);
    assert_eq!(wait_for(host, node, VERS), 600);
    host.set(node, STAT, 0);
    host.sleep_ms(500);
}

/// The parameters of its list, in its order, of a board that is awake; and memory, which a board never shows.
fn lists<S: Station>(host: &mut Host<S>, node: u16) {
    host.set(node, STAT, 2);
    host.sleep_ms(1000);
    let list = [
        SN, VERS, ROLE, 82, 48, 87, 88, 56, 68, 50, 94, 93, 91, 92, 86, 43, 61, 62, 85, 70, 10, 90, 26, 27,
        28, 40, 41,
    ];
    for property in list {
        wait_for(host, node, property);
    }
    for address in [0, 28900, 0x0800, -1] {
        host.set(node, ADDR, address);
        assert_eq!((wait_for(host, node, ADDR), wait_for(host, node, VALUE)), (0, 0), "no memory");
    }
    host.set(node, STAT, 0);
    host.sleep_ms(1000);
    assert_eq!((wait_for(host, node, ADDR), wait_for(host, node, VALUE)), (0, 0), "nor in the monitor");
}

/// Unlocks, sets and stores ID, waits, and sets STAT 0: in the application, then in the monitor.
fn renumbers<S: Station>(host: &mut Host<S>, from: u16, through: u16, to: u16) {
    host.set(from, STAT, 2);
    host.sleep_ms(1000);
    for (from, to, lock, save) in [(from, through, LOCK, SAVE), (through, to, MONITORS_LOCK, MONITORS_SAVE)] {
        for key in UNLOCK {
            host.set(from, lock, key);
        }
        host.set(from, ID, to.into());
        host.set(from, save, ID.into());
        host.sleep_ms(5000);
        host.set(from, STAT, 0);
        host.sleep_ms(1000);
        assert_eq!(host.get_within(from, STAT, 20), None, "{from} is {to} now");
        assert_eq!((wait_for(host, to, STAT), wait_for(host, to, ID)), (0, to.into()));
    }
}

/// Its downloader: one character for each frame that arrives. Returns how many it has sent of how many.
fn download<S: Station>(host: &mut Host<S>, node: u16, file: &[u8]) -> (usize, usize) {
    host.set(node, STAT, 0);
    host.sleep_ms(1000);
    host.clear();
    host.set(node, VERS, 0xAA);
    // It skips the first character of a line, and stops at one below '0'.
    let characters: Vec<u8> = file
        .split_inclusive(|&byte| byte == b'\n')
        .flat_map(|line| line.iter().skip(1).copied().take_while(|&character| character >= b'0'))
        .collect();
    for (sent, &character) in characters.iter().enumerate() {
        if host.read(FOREVER_MS).is_none() {
            return (sent, characters.len());
        }
        host.send(node, &[character]);
    }
    (characters.len(), characters.len())
}

/// A file for another address, as a file of another board is: refused at its first record.
fn refuses_a_foreign_file<S: Station>(host: &mut Host<S>, node: u16) {
    let mut foreign = Vec::new();
    for line in tater_wire::tek::Encoder::new(APPLICATION.end(), &[0x55; 2000]).expect("addresses fit") {
        foreign.extend_from_slice(line.as_bytes());
    }
    foreign.extend_from_slice(tater_wire::tek::end(APPLICATION.end()).as_bytes());
    let (sent, all) = download(host, node, &foreign);
    assert_eq!(sent, all, "it waits forever for the next request");
    // It sleeps 2 s, and enumerates.
    host.sleep_ms(2000);
    host.clear();
    assert_eq!(wait_for(host, node, ERROR), i32::from(FaultCode::AddressRange.code()));
    assert_eq!(wait_for(host, node, STAT), 0);
    host.set(node, STAT, 2);
    host.sleep_ms(1000);
    assert_eq!(wait_for(host, node, STAT), 2, "the old application is still there");
}

#[test]
fn native_board_is_enumerated_listed_and_renumbered() {
    let mut host = native(&[1]);
    enumerates(&mut host, 1);
    lists(&mut host, 1);
    renumbers(&mut host, 1, 4, 14);
}

#[test]
fn native_board_refuses_a_foreign_file_and_lets_its_host_finish() {
    let mut host = native(&[14]);
    refuses_a_foreign_file(&mut host, 14);
    // A damaged record in the middle of a file for this board.
    let mut damaged = file(&hil_world::node::placeholder_application());
    let middle = damaged.len() / 2;
    let digit = (middle..).find(|&at| damaged[at].is_ascii_digit()).expect("a digit");
    damaged[digit] ^= 1;
    let (sent, all) = download(&mut host, 14, &damaged);
    assert_eq!(sent, all);
    host.sleep_ms(2000);
    host.clear();
    assert_eq!(wait_for(&mut host, 14, ERROR), i32::from(FaultCode::BadChecksum.code()));
}

#[test]
fn emulated_board_does_the_same() {
    let Some(programs) = production() else { return };
    let mut host = emulated(&programs, &[14]);
    enumerates(&mut host, 14);
    lists(&mut host, 14);
    refuses_a_foreign_file(&mut host, 14);
    host.set(14, STAT, 0);
    host.sleep_ms(1000);
    renumbers(&mut host, 14, 5, 15);
}
