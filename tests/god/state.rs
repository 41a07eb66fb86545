//! The state of a hand that survives without power.

use god::Memory;
use god::memory::Stored;
use hil_world::hand::Hand;
use hil_world::hand::state::State;
use hil_world::plant::Model;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use tater_wire::{Body, Destination, Message, Node, Property};

/// Time in which a board wakes, stores, or moves to its stop, us.
const WHILE_US: u64 = 4_000_000;

fn wait(hand: &mut Hand) {
    hand.run_until(hand.now_us() + WHILE_US);
}

/// Sends board 4 a message in GOD's place.
fn send(hand: &mut Hand, message: Option<Message>) {
    hand.bus_mut().send(message.expect("in range").frame()).expect("GOD is plugged in");
}

fn to() -> Destination {
    Destination::Node(Node::new(4).expect("the spread"))
}

fn get(hand: &mut Hand, property: Property) -> i64 {
    hand.bus_mut().tap(true);
    send(hand, Some(Message::get(to(), property)));
    hand.run_until(hand.now_us() + 10_000);
    let frames = std::iter::from_fn(|| hand.bus_mut().tapped());
    let received =
        frames.filter_map(|stamped| Message::parse(&stamped.frame)).find_map(|message| match message.body {
            Body::Set { property: number, value } if Property::of(number) == Some(property) => {
                Some(property.read(value))
            }
            _ => None,
        });
    received.unwrap_or_else(|| panic!("no answer for {property:?}"))
}

fn used() -> Hand {
    let mut hand = Hand::new(Model::Averaged, 1, Memory::default());
    wait(&mut hand);
    send(&mut hand, Message::set(to(), Property::STAT, 2));
    wait(&mut hand);
    send(&mut hand, Message::set(to(), Property::KP, 123));
    send(&mut hand, Message::set(to(), Property::SAVE, -1));
    wait(&mut hand);
    send(&mut hand, Message::set(to(), Property::M, 100));
    wait(&mut hand);
    hand
}

#[test]
fn state_restores_flash_and_positions() {
    let hand = used();
    let state = hand.state();
    assert!((state.boards[3].counts - 100.0).abs() < 2.0, "it has moved: {}", state.boards[3].counts);
    let bytes = state.to_bytes();
    // Seven flashes of 128 KiB are mostly erased.
    assert!(bytes.len() < 100_000, "{}", bytes.len());
    let read = State::from_bytes(&bytes).expect("as written");
    assert_eq!(read, state);
    let mut again = Hand::restore(Model::Averaged, 1, &read).expect("within its stops");
    assert_eq!(again.state(), state, "nothing has changed yet");
    wait(&mut again);
    send(&mut again, Message::set(to(), Property::STAT, 2));
    wait(&mut again);
    assert_eq!(get(&mut again, Property::KP), 123);
}

#[test]
fn revision_grows_with_new_state_only() {
    let mut hand = Hand::new(Model::Averaged, 1, Memory::default());
    wait(&mut hand);
    let before = hand.revision();
    wait(&mut hand);
    assert_eq!(hand.revision(), before, "asleep: nothing new");
    let mut hand = used();
    let before = hand.revision();
    send(&mut hand, Message::set(to(), Property::KP, 99));
    send(&mut hand, Message::set(to(), Property::SAVE, -1));
    wait(&mut hand);
    assert!(hand.revision() > before);
    // A moving motor has no new position yet.
    let before = hand.revision();
    send(&mut hand, Message::set(to(), Property::M, 20));
    hand.run_until(hand.now_us() + 100_000);
    assert_eq!(hand.revision(), before);
    wait(&mut hand);
    let moved = hand.revision();
    assert!(moved > before, "a new position");
    wait(&mut hand);
    assert_eq!(hand.revision(), moved, "no further change");
}

#[test]
fn damaged_state_is_rejected() {
    let state = Hand::new(Model::Averaged, 1, Memory::new(Stored { serial: 7, ..Stored::default() })).state();
    let bytes = state.to_bytes();
    assert_eq!(State::from_bytes(&bytes).expect("as written").god.serial, 7);
    let mut rng = Pcg64Mcg::new(0x57a7e);
    for _ in 0..2_000 {
        let mut bad = bytes.clone();
        if rng.random() {
            bad.truncate(rng.random_range(0..bytes.len()));
        } else {
            let at = rng.random_range(0..bytes.len());
            bad[at] ^= 1 << rng.random_range(0..8);
        }
        assert!(State::from_bytes(&bad).is_err());
    }
    let mut longer = bytes;
    longer.push(0);
    assert!(State::from_bytes(&longer).is_err());
}

#[test]
fn invalid_body_with_valid_checksum_is_rejected() {
    let good = Hand::new(Model::Averaged, 1, Memory::default()).state().to_bytes();
    let body = &good[26..good.len() - 4];
    let sealed = |body: &[u8]| {
        let mut bytes = good[..22].to_vec();
        bytes.extend((body.len() as u32).to_le_bytes());
        bytes.extend(body);
        let mut crc = flate2::Crc::new();
        crc.update(&bytes);
        bytes.extend(crc.sum().to_le_bytes());
        bytes
    };
    assert!(State::from_bytes(&sealed(body)).is_ok());
    let with = |at: usize, value: &[u8]| {
        let mut body = body.to_vec();
        body[at..at + value.len()].copy_from_slice(value);
        State::from_bytes(&sealed(&body)).expect_err("invalid").expected
    };
    assert_eq!(with(0, &f64::NAN.to_le_bytes()), "a position");
    assert_eq!(with(8, &u16::MAX.to_le_bytes()), "pages 0 to 127");
    assert_eq!(with(10, &128u16.to_le_bytes()), "pages 0 to 127");
    for len in (0..body.len()).step_by(97) {
        assert!(State::from_bytes(&sealed(&body[..len])).is_err(), "{len}");
    }
}
