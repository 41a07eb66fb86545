//! A motor board's storage. After any cut every property has its old or its new value, values set together
//! are present together, counters lose at most the stated amount, and the store can be written again.

mod endurance;
mod scenarios;

use hil_sim::rig::flash::SimFlash;
use scenarios::{Act, Scenario};
use std::collections::{BTreeMap, HashSet};
use std::hash::{DefaultHasher, Hasher};
use std::ops::Range;
use std::thread;
use tater_fw::storage::{Counters, LOSS, Progress, Store};
use tater_wire::Property;
use tater_wire::memory::{FLASH, STORAGE};
use tater_wire::property::{ROWS, Stored};

/// The properties that SAVE stores.
fn stored() -> impl Iterator<Item = Property> {
    ROWS.iter().filter(|row| row.stored == Stored::Yes).map(|row| row.property)
}

/// The storage's bytes.
fn bytes(flash: &SimFlash) -> &[u8] {
    let start = (STORAGE.start - FLASH.start) as usize;
    &flash.bytes()[start..start + STORAGE.len as usize]
}

/// The values that a store reads.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct State {
    pub(super) values: BTreeMap<Property, i64>,
    pub(super) trusted: Option<(i32, u8)>,
    pub(super) counters: Counters,
}

impl State {
    pub(super) fn of(store: &Store) -> Self {
        let values = stored().filter_map(|property| Some((property, store.get(property)?))).collect();
        Self { values, trusted: store.trusted_position(), counters: store.counters() }
    }

    fn after(mut self, act: &Act) -> Self {
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

    /// Whether a store with the values `self` may be the result of an interrupted write of `told`, ignoring
    /// trust.
    fn is_left_of(&self, told: &Self) -> bool {
        let within = |left: i64, told: i64, loss: i64| (told - loss..=told).contains(&left);
        let (left, counters) = (self.counters, told.counters);
        self.values == told.values
            && within(left.upsecs.into(), counters.upsecs.into(), LOSS.upsecs.into())
            && within(left.odometer.into(), counters.odometer.into(), LOSS.odometer.into())
            && within(left.ptemp.into(), counters.ptemp.into(), LOSS.ptemp.into())
    }
}

/// The allowed contents of the flash after a script, or after a cut in it.
struct MayBe {
    /// The allowed range of states between its acts; the first is the state before all of them.
    states: Range<usize>,
    /// Trust in states before this one has been consumed for good,
    consumed: usize,
    /// or was being consumed.
    consuming: bool,
}

impl MayBe {
    fn admits(&self, found: &State, told: &[State]) -> bool {
        self.states.clone().any(|i| {
            let trusted = told[i].trusted.filter(|_| i >= self.consumed);
            found.is_left_of(&told[i])
                && (found.trusted == trusted || self.consuming && found.trusted.is_none())
        })
    }
}

/// Steps until everything is stored, the power fails, or an erase is needed but not allowed.
fn step(store: &mut Store, flash: &mut SimFlash, most: usize, bridge_on: bool) -> Progress {
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

/// Runs a script until its end or until the power fails.
fn run(script: &[Act], store: &mut Store, flash: &mut SimFlash) -> MayBe {
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

/// Makes cuts at every operation of scenarios.
#[derive(Default)]
struct Cuts {
    /// Distinct contents right after a cut, hashed.
    states: HashSet<u64>,
    /// Cuts made.
    cuts: usize,
}

impl Cuts {
    fn saw(&mut self, flash: &SimFlash) {
        assert!(flash.is_dead());
        assert_eq!(flash.erased_while_driven(), 0, "a page was erased with the bridge on");
        let mut hasher = DefaultHasher::new();
        hasher.write(bytes(flash));
        self.states.insert(hasher.finish());
        self.cuts += 1;
    }

    /// The write attempted after a cut: two values together.
    fn recovery(state: &State) -> [Act; 3] {
        let other = |property| 1 - state.values.get(&property).copied().unwrap_or(0).clamp(0, 1);
        [
            Act::Set(Property::X6, other(Property::X6)),
            Act::Set(Property::X7, other(Property::X7)),
            Act::Steps { most: 3000, bridge_on: false },
        ]
    }

    /// Power is back, without a second cut: the store is written again. Returns the number of operations.
    fn recover(flash: &SimFlash, state: &State) -> u64 {
        let mut flash = flash.clone();
        let before = flash.operations();
        let script = Self::recovery(state);
        run(&script, &mut Store::open(&flash), &mut flash);
        let wanted = script.iter().fold(state.clone(), State::after);
        let found = State::of(&Store::open(&flash));
        assert!(
            found.values == wanted.values && found.trusted == wanted.trusted,
            "{found:?}\nis not {wanted:?}"
        );
        assert!(found.counters.upsecs >= state.counters.upsecs, "counters stay");
        flash.operations() - before
    }

    /// All cuts of a scenario: `seeds` of each, and after the first `twice` of them a second cut at every
    /// operation of the recovery.
    fn enumerate(&mut self, scenario: &Scenario, seeds: u64, twice: u64) {
        let Scenario { name, flash: initial, script } = scenario;
        let first = State::of(&Store::open(initial));
        let told: Vec<State> = std::iter::once(first.clone())
            .chain(script.iter().scan(first, |state, act| {
                *state = state.clone().after(act);
                Some(state.clone())
            }))
            .collect();
        let mut whole = initial.clone();
        let may_be = run(script, &mut Store::open(initial), &mut whole);
        assert_eq!(may_be.states.len(), 1, "{name} does not come to an end");
        assert!(may_be.admits(&State::of(&Store::open(&whole)), &told), "{name}");
        for operation in initial.operations()..whole.operations() {
            for seed in 0..seeds {
                let mut flash = initial.clone();
                flash.cut_at(operation, seed);
                let may_be = run(script, &mut Store::open(initial), &mut flash);
                self.saw(&flash);
                flash.power_up();
                let state = State::of(&Store::open(&flash));
                assert!(
                    may_be.admits(&state, &told),
                    "{name}, operation {operation}, seed {seed}: {state:#?}\nis none of {:#?}",
                    &told[may_be.states]
                );
                let operations = Self::recover(&flash, &state);
                if seed < twice {
                    self.cut_again(&flash, &state, operations, seed);
                }
            }
        }
    }

    /// A second cut, at every operation of the recovery.
    fn cut_again(&mut self, flash: &SimFlash, state: &State, operations: u64, seed: u64) {
        for operation in 0..operations {
            let mut again = flash.clone();
            again.cut_at(flash.operations() + operation, seed);
            run(&Self::recovery(state), &mut Store::open(flash), &mut again);
            self.saw(&again);
            again.power_up();
            let found = State::of(&Store::open(&again));
            let wanted = Self::recovery(state).iter().fold(state.clone(), State::after);
            assert!(
                found == *state || found.values == wanted.values && found.trusted == wanted.trusted,
                "operation {operation} of the recovery, seed {seed}:\n{found:?}\nis neither {state:?}\nnor {wanted:?}"
            );
            Self::recover(&again, &found);
        }
    }
}

#[test]
fn cut_at_any_operation_leaves_old_or_new_state() {
    let all = scenarios::all();
    let enumerate = |scenarios: &[Scenario]| {
        let mut cuts = Cuts::default();
        for scenario in scenarios {
            cuts.enumerate(scenario, 6, 1);
        }
        cuts
    };
    let (some, others) = all.split_at(5);
    let (mut cuts, other) = thread::scope(|scope| {
        let other = scope.spawn(|| enumerate(others));
        (enumerate(some), other.join().expect("the other half"))
    });
    cuts.states.extend(other.states);
    cuts.cuts += other.cuts;
    println!("figure: power cuts of storage: {} cuts, {} distinct states", cuts.cuts, cuts.states.len());
    // The storage's share of at least 100,000 states.
    assert!(cuts.states.len() >= 60_000, "{}", cuts.states.len());
}
