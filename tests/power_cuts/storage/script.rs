//! Scripts of calls to a store, and the states that they may leave.

use std::collections::BTreeMap;
use std::ops::Range;

use boot::storage::{Counters, LOSS, Progress, Store};
use hil_world::rig::flash::SimFlash;
use tater_wire::Property;
use tater_wire::property::{ROWS, Stored};

pub fn stored() -> impl Iterator<Item = Property> {
    ROWS.iter().filter(|row| row.stored == Stored::Yes).map(|row| row.property)
}

#[derive(Clone, Copy, Debug)]
pub enum Act {
    Set(Property, i64),
    Forget(Property),
    SavePosition(i32, u8),
    Distrust,
    Count(Counters),
    ResetCounters(Counters),
    Steps { most: usize, bridge_on: bool },
}

#[derive(Clone, Debug, PartialEq)]
pub struct State {
    pub values: BTreeMap<Property, i64>,
    pub trusted: Option<(i32, u8)>,
    pub counters: Counters,
}

impl State {
    pub fn of(store: &Store) -> Self {
        let values = stored().filter_map(|property| Some((property, store.get(property)?))).collect();
        Self { values, trusted: store.trusted_position(), counters: store.counters() }
    }

    pub fn after(mut self, act: &Act) -> Self {
        match *act {
            Act::Set(property, value) => {
                self.values.insert(property, value);
            }
            Act::Forget(property) => {
                self.values.remove(&property);
            }
            Act::SavePosition(position, code) => {
                self.values.insert(Property::P, position.into());
                self.trusted = Some((position, code));
            }
            Act::Distrust => self.trusted = None,
            Act::Count(counters) | Act::ResetCounters(counters) => self.counters = counters,
            Act::Steps { .. } => {}
        }
        self
    }

    /// Whether an interrupted write of `told` may leave the values `self`, ignoring trust.
    pub fn is_left_of(&self, told: &Self) -> bool {
        let within = |left: i64, told: i64, loss: i64| (told - loss..=told).contains(&left);
        let (left, counters) = (self.counters, told.counters);
        self.values == told.values
            && within(left.upsecs.into(), counters.upsecs.into(), LOSS.upsecs.into())
            && within(left.odometer.into(), counters.odometer.into(), LOSS.odometer.into())
            && within(left.ptemp.into(), counters.ptemp.into(), LOSS.ptemp.into())
    }
}

/// The allowed contents of the flash after a script, or after a cut in it.
pub struct MayBe {
    /// The allowed range of states between its acts; the first is the state before all of them.
    pub states: Range<usize>,
    /// Trust in states before this one has been consumed for good,
    pub consumed: usize,
    /// or was being consumed.
    pub consuming: bool,
}

impl MayBe {
    pub fn admits(&self, found: &State, told: &[State]) -> bool {
        self.states.clone().any(|i| {
            let trusted = told[i].trusted.filter(|_| i >= self.consumed);
            found.is_left_of(&told[i])
                && (found.trusted == trusted || self.consuming && found.trusted.is_none())
        })
    }
}

pub fn step(store: &mut Store, flash: &mut SimFlash, most: usize, bridge_on: bool) -> Progress {
    flash.set_bridge_on(bridge_on);
    for _ in 0..most {
        match store.step(flash, !bridge_on) {
            Progress::More => {}
            Progress::Failed(error) if !flash.is_dead() => panic!("the flash failed: {error:?}"),
            other => return other,
        }
    }
    Progress::More
}

pub fn run(script: &[Act], store: &mut Store, flash: &mut SimFlash) -> MayBe {
    let (mut done, mut consumed) = (0, 0);
    for (i, act) in script.iter().enumerate() {
        match *act {
            Act::Set(property, value) => store.set(property, value),
            Act::Forget(property) => store.forget(property),
            Act::SavePosition(position, code) => store.save_position(position, code),
            Act::Count(counters) => store.count(counters),
            Act::ResetCounters(counters) => store.reset_counters(counters),
            Act::Distrust => {
                if store.distrust(flash).is_ok() {
                    consumed = i + 1;
                }
            }
            Act::Steps { most, bridge_on } => {
                if step(store, flash, most, bridge_on) == Progress::Done {
                    done = i + 1;
                }
            }
        }
        if flash.is_dead() {
            return MayBe { states: done..i + 2, consumed, consuming: matches!(act, Act::Distrust) };
        }
    }
    MayBe { states: done..script.len() + 1, consumed, consuming: false }
}
