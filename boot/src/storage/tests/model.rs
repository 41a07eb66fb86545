//! Any sequence of calls, compared with a plain map.

use super::*;
use proptest::prelude::*;
use std::collections::BTreeMap;

#[derive(Clone, Debug)]
enum Act {
    Set(Property, i64),
    Forget(Property),
    SavePosition(i32, u8),
    Distrust,
    Count(u32, u32, i16),
    Step(usize, bool),
    Reopen,
}

fn act() -> impl Strategy<Value = Act> {
    let property = || prop::sample::select(stored());
    let value = (property(), any::<prop::sample::Index>()).prop_map(|(property, at)| {
        let row = property.row();
        let span = (row.max - row.min + 1) as usize;
        Act::Set(property, row.min + at.index(span) as i64)
    });
    let value = value.prop_filter(
        "in range",
        |act| matches!(act, Act::Set(property, value) if property.rules().admits(*value)),
    );
    prop_oneof![
        6 => value,
        2 => property().prop_map(Act::Forget),
        1 => (-100..100, 1..7_u8).prop_map(|(position, code)| Act::SavePosition(position, code)),
        1 => Just(Act::Distrust),
        2 => (0..200_u32, 0..20_u32, -5..20_i16).prop_map(|(s, t, h)| Act::Count(s, t, h)),
        4 => (0..30_usize, any::<bool>()).prop_map(|(steps, may_erase)| Act::Step(steps, may_erase)),
        3 => Just(Act::Step(2000, true)),
        1 => Just(Act::Reopen),
    ]
}

#[derive(Clone, Debug, Default, PartialEq)]
struct Model {
    values: BTreeMap<Property, i64>,
    trusted: Option<u8>,
}

impl Model {
    fn of(store: &Store) -> Self {
        let values = ROWS.iter().filter_map(|row| Some((row.property, store.get(row.property)?))).collect();
        Self { values, trusted: store.trusted_position().map(|(_, code)| code) }
    }
}

/// The allowed contents of the flash: the state stored last, or any later one.
struct World {
    store: Store,
    flash: Ram,
    may_be: Vec<Model>,
    counters: Counters,
}

impl World {
    fn now(&mut self) -> Model {
        self.may_be.last().cloned().unwrap_or_default()
    }

    fn act(&mut self, act: &Act) {
        let mut now = self.now();
        match *act {
            Act::Set(property, value) => {
                self.store.set(property, value);
                now.values.insert(property, value);
                now.trusted = now.trusted.filter(|_| property != Property::P);
            }
            Act::Forget(property) => {
                self.store.forget(property);
                now.values.remove(&property);
                now.trusted = now.trusted.filter(|_| property != Property::P);
            }
            Act::SavePosition(position, code) => {
                self.store.save_position(position, code);
                now.values.insert(Property::P, position.into());
                now.trusted = Some(code);
            }
            Act::Distrust => {
                self.store.distrust(&mut self.flash).unwrap();
                now.trusted = None;
                self.may_be.iter_mut().for_each(|model| model.trusted = None);
            }
            Act::Count(seconds, thousands, rise) => {
                let mut counters = self.store.counters();
                counters.upsecs += seconds;
                counters.odometer += thousands;
                counters.ptemp += rise;
                self.store.count(counters);
            }
            Act::Step(steps, may_erase) => {
                for _ in 0..steps {
                    if self.store.step(&mut self.flash, may_erase) == Progress::Done {
                        self.may_be = std::vec![now.clone()];
                        break;
                    }
                }
            }
            Act::Reopen => {
                self.store = Store::open(&self.flash);
                now = Model::of(&self.store);
                assert!(self.may_be.contains(&now), "{now:?}\nis none of {:?}", self.may_be);
                self.may_be.clear();
                let (old, new) = (self.counters, self.store.counters());
                assert!(old.upsecs <= new.upsecs && old.odometer <= new.odometer && old.ptemp <= new.ptemp);
                self.counters = new;
            }
        }
        assert_eq!(Model::of(&self.store), now);
        self.may_be.push(now);
    }
}

proptest! {
    #[test]
    fn any_sequence_of_calls_matches_a_map(acts in prop::collection::vec(act(), 1..120)) {
        let flash = Ram::default();
        let store = Store::open(&flash);
        let mut world =
            World { store, flash, may_be: std::vec![Model::default()], counters: Counters::default() };
        acts.iter().for_each(|act| world.act(act));
        world.act(&Act::Step(2000, true));
        world.act(&Act::Reopen);
    }

    #[test]
    fn any_damage_is_read_without_panic_and_overwritten(
        acts in prop::collection::vec(act(), 1..60),
        damage in prop::collection::vec((0..4096_usize, any::<u16>()), 0..200),
    ) {
        let flash = Ram::default();
        let store = Store::open(&flash);
        let mut world =
            World { store, flash, may_be: std::vec![Model::default()], counters: Counters::default() };
        acts.iter().for_each(|act| world.act(act));
        for (at, word) in damage {
            world.flash.words[at] = word;
        }
        let mut store = Store::open(&world.flash);
        store.set(Property::X3, 1234);
        store.save_position(77, 6);
        // A page that reads differently from before may fail once.
        for _ in 0..3000 {
            if store.step(&mut world.flash, true) == Progress::Done {
                break;
            }
        }
        let open = Store::open(&world.flash);
        prop_assert_eq!(Model::of(&open), Model::of(&store));
        prop_assert_eq!(open.trusted_position(), Some((77, 6)));
    }
}
