//! Storage after any cut: each property old or new, values set together both present, counters within their bound, writable.

mod endurance;
mod scenarios;
mod script;

use boot::storage::{Counters, LOSS, Progress, Store};
use hil_world::rig::flash::SimFlash;
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};
use scenarios::Scenario;
pub(super) use script::State;
use script::{Act, run, step, stored};
use std::collections::HashSet;
use std::hash::{DefaultHasher, Hasher};
use tater_f103::map::{FLASH, STORAGE};
use tater_wire::Property;

fn bytes(flash: &SimFlash) -> &[u8] {
    let start = (STORAGE.start - FLASH.start) as usize;
    &flash.bytes()[start..start + STORAGE.len as usize]
}

#[derive(Default)]
struct Cuts {
    /// Distinct contents right after a cut, hashed.
    states: HashSet<u64>,
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

    fn and(mut self, other: Self) -> Self {
        self.states.extend(other.states);
        self.cuts += other.cuts;
        self
    }

    fn recovery(state: &State) -> [Act; 3] {
        let other = |property| 1 - state.values.get(&property).copied().unwrap_or(0).clamp(0, 1);
        [
            Act::Set(Property::X6, other(Property::X6)),
            Act::Set(Property::X7, other(Property::X7)),
            Act::Steps { most: 3000, bridge_on: false },
        ]
    }

    /// Writes the store again. Returns the number of operations.
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

    /// `seeds` cuts of each operation; after the first `twice` a second cut at every operation of the recovery.
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
    let enumerate = |mut cuts: Cuts, scenario: &Scenario| {
        cuts.enumerate(scenario, 6, 1);
        cuts
    };
    let cuts = scenarios::all().par_iter().fold(Cuts::default, enumerate).reduce(Cuts::default, Cuts::and);
    println!("figure: power cuts of storage: {} cuts, {} distinct states", cuts.cuts, cuts.states.len());
    // The storage's share of at least 100,000 states.
    assert!(cuts.states.len() >= 60_000, "{}", cuts.states.len());
}
