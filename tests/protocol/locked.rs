//! No frame reads or writes memory by address, and a locked property changes only once after LOCK's sequence.

use boot::Flash;
use proptest::prelude::*;
use tater_f103::map::{APPLICATION, FLASH, MONITOR, RAM, STORAGE};
use tater_wire::property::{Access, ROWS, barrett};
use tater_wire::{Body, Destination, Frame, Group, Property, Torques, Value};

use super::board::Bench;

fn flash(bench: &mut Bench) -> Vec<u16> {
    let flash = &bench.board().flash;
    (FLASH.start..FLASH.end()).step_by(2).map(|address| flash.half_word(address)).collect()
}

fn all(bench: &mut Bench) -> Vec<Option<i64>> {
    ROWS.iter().map(|row| bench.get(row.property)).collect()
}

/// Every number with every data length, filled with addresses and other bytes.
fn frames(to: u16) -> impl Iterator<Item = Frame> {
    let starts = [MONITOR, APPLICATION, STORAGE, FLASH, RAM].map(|area| area.start);
    let fillings =
        starts.map(u32::to_le_bytes).into_iter().chain([[0; 4], [0xFF; 4], [1, 0, 0, 0], [0x5A; 4]]);
    fillings.flat_map(move |[a, b, c, d]| {
        (0..=u8::MAX).flat_map(move |first| {
            let data = [first, 0, a, b, c, d, a, b];
            (1..=8).map(move |len| Frame::from_raw(to, &data[..len]).expect("11 bits, 8 bytes"))
        })
    })
}

#[test]
fn only_table_properties_answer_and_only_storage_writes_flash() {
    // To the own node, from the host and from another board; to everybody; to the packed torques' group.
    for to in [1, 5 << 5 | 1, 0x400, 0x401] {
        let mut bench = Bench::new(1);
        let memory = flash(&mut bench);
        let mut answered = [false; 128];
        for frame in frames(to) {
            let _ = bench.send(&frame);
            for message in bench.said() {
                let &[asked, ..] = frame.data() else { panic!("{frame:?} is answered by {message:?}") };
                let Some(property) = Property::of(asked) else {
                    // A SET has the number beyond 127. It is not answered, but a motion that it asks for and that is refused is reported, as is its mode.
                    let report =
                        |of: Property, value| Body::Set { property: of.id(), value: Value::Short(value) };
                    let reports = [report(Property::END, 3), report(Property::MODE, 0)];
                    if asked > 127 && reports.contains(&message.body) {
                        continue;
                    }
                    let Body::Set { value: Value::Short(0) | Value::Long(0), .. } = message.body else {
                        panic!("{frame:?} is answered by {message:?}")
                    };
                    assert!(asked < 128, "{frame:?} is answered by {message:?}");
                    answered[usize::from(asked)] = true;
                    continue;
                };
                let value = match message.body {
                    Body::Set { value, .. } => property.read(value),
                    Body::Position(counts) => i64::from(counts),
                    body => panic!("{frame:?} is answered by {body:?}"),
                };
                let unread = property.row().access == Access::WriteOnly && value == 0;
                assert!(unread || property.row().admits(value), "{property:?} reads {value}");
                answered[usize::from(asked)] = true;
            }
            bench.tater.store();
        }
        for id in 0..128_u8 {
            let barretts = id < barrett::BARRETTS;
            assert_eq!(answered[usize::from(id)], barretts || Property::of(id).is_some(), "number {id}");
        }
        assert!(bench.board().flash.operations > 0, "storage has been at work");
        let changed = memory.into_iter().zip(flash(&mut bench)).enumerate().filter(|(_, (a, b))| a != b);
        for (index, _) in changed {
            let address = FLASH.start + 2 * u32::try_from(index).expect("64 Ki half-words");
            assert!(STORAGE.holds(address.into(), 2), "{address:#X}");
        }
    }
}

#[test]
fn number_without_a_row_has_no_effect() {
    // ADDR (6) and VALUE (7) of Barrett's boards are among them.
    assert!(Property::of(6).is_none() && Property::of(7).is_none());
    for to in [1, 5 << 5 | 1, 0x400] {
        let mut bench = Bench::new(1);
        let (memory, before) = (flash(&mut bench), all(&mut bench));
        for frame in frames(to) {
            let Some(&id) = frame.data().first().filter(|&id| Property::of(id & 0x7F).is_none()) else {
                continue;
            };
            // A GET of a number of Barrett's reads 0.
            let answers = id < barrett::BARRETTS;
            assert_eq!(bench.send(&frame).is_ok(), answers, "{frame:?}");
            assert_eq!(bench.said().len(), usize::from(answers), "{frame:?}");
        }
        assert!(bench.board().resets.is_empty());
        assert_eq!(bench.board().flash.operations, 0);
        assert!(flash(&mut bench) == memory && all(&mut bench) == before);
    }
}

const KEYS: [i64; 5] = [18384, 23, 3145, 1024, 1];

#[derive(Clone, Copy, Debug)]
enum Try {
    NextKey,
    /// The key after the last one sent, whatever came between.
    Onward,
    Key(i64),
    Locked(usize, i64),
    Default(usize),
    Unlocked(i64),
    /// A SET of a property that cannot be set, or of no property.
    Refused(u8),
    Ask(u8),
    Packed,
}

fn attempt() -> impl Strategy<Value = Try> {
    prop_oneof![
        30 => Just(Try::NextKey),
        10 => Just(Try::Onward),
        2 => prop_oneof![prop::sample::select(&KEYS[..]), -2..32_768_i64].prop_map(Try::Key),
        5 => (0..8_usize, prop_oneof![-1..40_i64, any::<i32>().prop_map(i64::from)])
            .prop_map(|(which, value)| Try::Locked(which, value)),
        1 => (0..8_usize).prop_map(Try::Default),
        1 => any::<i16>().prop_map(|value| Try::Unlocked(value.into())),
        1 => prop::sample::select(&[0_u8, 4, 6, 7, 12, 115][..]).prop_map(Try::Refused),
        2 => (0..128_u8).prop_map(Try::Ask),
        1 => Just(Try::Packed),
    ]
}

fn next_key(last: i64) -> i64 {
    let at = KEYS.iter().position(|&key| key == last).map_or(0, |at| at + 1);
    KEYS[at % KEYS.len()]
}

/// A model of the lock: the number of correct keys in a row, and the values of the locked properties.
struct Model {
    keys: Vec<i64>,
    values: Vec<i64>,
}

impl Model {
    fn is_open(&self) -> bool {
        self.keys == KEYS
    }

    fn key(&mut self, value: i64) {
        self.keys.push(value);
        if !KEYS.starts_with(&self.keys) {
            self.keys.clear();
            self.keys.extend((value == KEYS[0]).then_some(value));
        }
    }

    fn other(&mut self) {
        if !self.is_open() {
            self.keys.clear();
        }
    }

    /// Closes the lock; returns whether it was open.
    fn locked(&mut self) -> bool {
        let open = self.is_open();
        self.keys.clear();
        open
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, ..ProptestConfig::default() })]
    #[test]
    fn locked_property_changes_once_after_the_sequence(
        attempts in prop::collection::vec(attempt(), 60),
    ) {
        let rows: Vec<_> = ROWS.iter().filter(|row| row.access == Access::Locked).collect();
        prop_assert_eq!(rows.len(), 8);
        let mut bench = Bench::new(2);
        let read = |bench: &mut Bench| -> Vec<i64> {
            rows.iter().map(|row| bench.get(row.property).expect("can be read")).collect()
        };
        let defaults = read(&mut bench);
        let mut last = 0;
        let mut model = Model { keys: Vec::new(), values: defaults.clone() };
        for attempt in attempts {
            match attempt {
                // While the lock is open no keys are sent, or it would hardly ever be used.
                Try::NextKey | Try::Onward if model.is_open() => {}
                Try::NextKey | Try::Onward | Try::Key(_) => {
                    last = match attempt {
                        Try::Key(value) => value,
                        Try::Onward => next_key(last),
                        _ => KEYS[model.keys.len()],
                    };
                    let _ = bench.set(Property::LOCK, last);
                    model.key(last);
                }
                Try::Locked(which, value) => {
                    let property = rows[which].property;
                    let taken = bench.set(property, value).is_ok();
                    // −1 of an unsigned property is its largest value.
                    let value = property.read(property.write(value).expect("fits 32 bits"));
                    let expected = model.locked() && rows[which].admits(value);
                    if expected {
                        model.values[which] = value;
                    }
                    prop_assert_eq!(taken, expected);
                }
                Try::Default(which) => {
                    let taken = bench.set(Property::DEF, rows[which].property.id().into()).is_ok();
                    model.other();
                    let expected = model.locked();
                    if expected {
                        // Stored as the board is shipped, not by default.
                        let wiring = rows[which].property == Property::WIRING;
                        model.values[which] = if wiring { 0 } else { defaults[which] };
                    }
                    prop_assert_eq!(taken, expected);
                }
                Try::Unlocked(value) => {
                    bench.set(Property::X1, value).expect("in range");
                    model.other();
                }
                Try::Refused(id) => {
                    let body = Body::Set { property: id, value: Value::Short(1) };
                    prop_assert!(bench.say(bench.own(), 0, body).is_err());
                    model.other();
                }
                Try::Ask(id) => {
                    let _ = bench.say(bench.own(), 0, Body::Get(id));
                }
                Try::Packed => {
                    let torques = Torques::new(&[1, 2, 3, 4]).expect("four");
                    let _ = bench.say(Destination::Group(Group::LOW), 0, Body::Torques(torques));
                    model.other();
                }
            }
            prop_assert_eq!(&read(&mut bench), &model.values);
        }
    }
}
