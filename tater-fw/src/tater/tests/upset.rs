//! Any frames, any sensor readings: no panic, no value out of its range, no drive beyond its bounds.

use super::board::Bench;
use crate::motion;
use proptest::prelude::*;
use servo_core::sense::commutation::Bridge;
use servo_core::units::{DeciCelsius, MilliAmps, MilliVolts};
use std::vec::Vec;
use tater_wire::property::ROWS;
use tater_wire::{Destination, Frame, Group, Node, Property};

#[derive(Clone, Debug)]
enum Step {
    Frame(u16, Vec<u8>),
    Ticks(u8, i8),
    Analog(u16, i16, i16, u8),
    BadHalls(u8),
    Slow,
    Store,
    Room(u8),
}

/// Frames of any content, most of them to node 1 or its groups, and most of those a GET or SET of a row.
fn frame() -> impl Strategy<Value = Step> {
    let id = prop_oneof![4 => Just(1_u16), 2 => Just(0x401_u16), 1 => Just(0x400_u16), 1 => 0..0x800_u16];
    let data = prop_oneof![
        1 => prop::collection::vec(any::<u8>(), 0..=8),
        2 => (0..ROWS.len()).prop_map(|row| std::vec![ROWS[row].property.id()]),
        8 => (0..ROWS.len(), any::<i32>(), 0..32_u32, prop::bool::ANY).prop_map(|(row, value, shift, wide)| {
            let [a, b, c, d] = (value >> shift).to_le_bytes();
            let id = 0x80 | ROWS[row].property.id();
            if wide { std::vec![id, 0, a, b, c, d] } else { std::vec![id, 0, a, b] }
        }),
        1 => prop::collection::vec(any::<u8>(), 2..=7)
            .prop_map(|rest| [&[0x80 | Property::T.id()], &rest[..]].concat()),
    ];
    (id, data).prop_map(|(id, data)| Step::Frame(id, data))
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        60 => frame(),
        30 => (1..40_u8, -8..=8_i8).prop_map(|(ticks, by)| Step::Ticks(ticks, by)),
        2 => (prop_oneof![3 => Just(24_000_u16), 1 => any::<u16>()], any::<i16>(), -600..1300_i16, any::<u8>())
            .prop_map(|(bus, current, temp, strain)| Step::Analog(bus, current, temp, strain)),
        1 => any::<u8>().prop_map(Step::BadHalls),
        2 => Just(Step::Slow),
        4 => Just(Step::Store),
        1 => (0..20_u8).prop_map(Step::Room),
    ]
}

fn apply(bench: &mut Bench, step: Step) {
    match step {
        Step::Frame(id, data) => {
            let frame = Frame::from_raw(id, &data).expect("11 bits and 8 bytes at most");
            let _ = bench.send(&frame);
        }
        Step::Ticks(ticks, by) => {
            let count = bench.count;
            bench.tick_to(count + i32::from(by));
            bench.ticks(usize::from(ticks));
        }
        Step::Analog(bus, current, temp, strain) => {
            let analog = bench.board().analog_mut();
            analog.bus = MilliVolts(bus);
            analog.current = MilliAmps(current);
            analog.motor_temp = DeciCelsius(temp);
            analog.board_temp = DeciCelsius(temp);
            analog.strain = strain;
        }
        Step::BadHalls(code) => bench.board().halls = code,
        Step::Slow => {
            let now = bench.now;
            bench.tater.housekeeping(now);
        }
        Step::Store => {
            bench.tater.store();
        }
        Step::Room(room) => bench.board().room = usize::from(room),
    }
}

fn check(bench: &mut Bench) {
    for property in motion::PROPERTIES {
        let value = motion::get(bench.tater.servo.config(), property);
        assert!(value.is_some_and(|value| property.rules().admits(value.into())), "{property:?} {value:?}");
    }
    let drive = bench.tater.drive();
    // 990/1024 (guard/limits).
    assert!(drive.duty.is_none_or(|duty| i32::from(duty.0.to_bits()).abs() <= 990 * 32), "{drive:?}");
    let board = bench.board();
    assert!(drive.duty.is_some() || board.bridge == Bridge::Off);
    assert_eq!(board.flash.erased_while_driven, 0);
    assert!(board.resets.iter().all(|reset| *reset == (false, false)));
    for message in bench.said() {
        assert_eq!(message.from.number(), 1);
        let host = [Group::POSITIONS, Group::REPLIES].map(Destination::Group).contains(&message.to);
        assert!(host || matches!(message.to, Destination::Node(node) if node != Node::HOST), "{message:?}");
    }
}

fn check_all_reads(bench: &mut Bench) {
    bench.board().room = usize::MAX;
    bench.tater.flush();
    // A frame may have set HOSTUNITS 280: OTEMP then reads 70, for 70 °C, which is no value of the row.
    bench.set(Property::HOSTUNITS, 0).expect("never refused");
    for row in ROWS {
        let Some(value) = bench.get(row.property) else { continue };
        let fits = match row.property {
            // 22 bits.
            Property::P => (-(1 << 21)..1 << 21).contains(&value),
            _ => row.admits(value),
        };
        assert!(fits, "{} reads {value}", row.name);
    }
}

proptest! {
    // 1000 times 100 frames and intervals of ticks.
    #![proptest_config(ProptestConfig { cases: 1000, ..ProptestConfig::default() })]
    #[test]
    fn any_frames_and_readings_keep_the_board_in_its_bounds(steps in prop::collection::vec(step(), 100)) {
        let mut bench = Bench::new(1);
        for step in steps {
            apply(&mut bench, step);
            check(&mut bench);
        }
        check_all_reads(&mut bench);
    }
}
