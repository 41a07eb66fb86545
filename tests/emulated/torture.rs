//! Seeds of the torture chamber on flashed images: the image has the verdict of native boards.

use std::collections::BTreeSet;

use board_emu::board::Board;
use board_emu::image::Programs;
use board_emu::session::load;
use god::Memory;
use hil_torture::case::{Case, MOTORS};
use hil_torture::fault::{Subject, node_of};
use hil_torture::kinds::{FaultKind, Kinds};
use hil_torture::play::{rig, with_scene};
use hil_torture::program::Act;
use hil_torture::{Outcome, native, play};
use hil_world::hand::Hand;
use rayon::iter::{IntoParallelIterator, ParallelIterator};

use super::bench::production;

/// Faults of a native board's program, clock or flash.
const NATIVE: Kinds = Kinds::of(&[
    FaultKind::FlashCut,
    FaultKind::BitFlip,
    FaultKind::WornPage,
    FaultKind::MarginalErase,
    FaultKind::ClockDrift,
    FaultKind::BoardHang,
    FaultKind::SameNumber,
]);

/// Longest program, ms: seven emulated boards are about as fast as real ones, and the recovery takes 8 s.
const STOP_MS: u64 = 4_000;

/// Longest time of a babbling node, ms: the interrupts of a full bus on seven boards cost 20 times as long.
const BABBLE_MS: u64 = 100;

/// Seeds among which the sample is chosen.
const SEEDS: u64 = 600;

/// Largest distance between a joint after a native and after an emulated recovery, counts: O ends within MPE of its goal, half a count
/// and a cell (tests/arrival.rs), on either side.
const APART: f64 = 2.0;

/// A seed's case, without what only native boards have. The chamber downloads another application than the image. Its faults come
/// earlier by the share that the program is shorter.
fn case(seed: u64) -> Case {
    let mut case = Case::draw(seed);
    let stop_ms = case.stop_ms.min(STOP_MS);
    case.faults.retain(|fault| !NATIVE.meets(Kinds::of(&[fault.kind])));
    for fault in &mut case.faults {
        fault.from_ms = fault.from_ms * stop_ms / case.stop_ms;
        if fault.kind == FaultKind::Babble {
            fault.for_ms = fault.for_ms.min(BABBLE_MS);
        }
    }
    case.steps.retain(|step| !matches!(step.act, Act::Download(_)));
    Case { stop_ms, ..case }
}

fn kinds(seed: u64) -> BTreeSet<FaultKind> {
    case(seed).faults.iter().map(|fault| fault.kind).collect()
}

/// Few seeds whose faults together are of every kind that an emulated board can have: each time the one with the most new ones.
fn sample() -> Vec<u64> {
    let mut all: Vec<(u64, BTreeSet<FaultKind>)> = (0..SEEDS).map(|seed| (seed, kinds(seed))).collect();
    let mut seeds = Vec::new();
    while let Some((seed, new)) = all.iter().rev().max_by_key(|(_, kinds)| kinds.len()).cloned()
        && !new.is_empty()
    {
        seeds.push(seed);
        all.iter_mut().for_each(|(_, kinds)| kinds.retain(|kind| !new.contains(kind)));
    }
    seeds
}

fn emulated(case: &Case, programs: &Programs) -> Hand<Board> {
    let board = |motor: usize| {
        let rig = rig(case, motor).expect("in range");
        let mut board = Board::new(rig, node_of(motor), programs, case.seed.wrapping_add(motor as u64));
        load(&mut board, programs);
        board.power_on();
        board
    };
    with_scene(case, Hand::with((0..MOTORS).map(board).collect(), Memory::default()))
}

/// The invariant that does not hold, and whether the hand has recovered.
fn verdict(outcome: &Outcome) -> (Option<&'static str>, bool) {
    (outcome.violation.as_ref().map(|violation| violation.invariant), outcome.recovered_ms.is_some())
}

fn apart<A: Subject, B: Subject>(a: &Hand<A>, b: &Hand<B>) -> f64 {
    a.pose().iter().zip(b.pose()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Plays a seed on native and on emulated boards; returns how their verdicts differ, if they do.
fn difference(seed: u64, programs: &Programs) -> Option<String> {
    let case = case(seed);
    let (native, rotors) = play(&case, native(&case).expect("in range"));
    let (emulated, emulated_rotors) = play(&case, emulated(&case, programs));
    let counts = apart(&rotors, &emulated_rotors);
    println!(
        "figure: emulated torture: seed {seed}, {} kinds of fault: recovered in {:?} and {:?} ms, {counts:.1} counts apart",
        kinds(seed).len(),
        native.recovered_ms,
        emulated.recovered_ms
    );
    let agrees =
        verdict(&native) == (None, true) && verdict(&emulated) == verdict(&native) && counts <= APART;
    (!agrees).then(|| format!("seed {seed}: {:?}, emulated {:?}", native.violation, emulated.violation))
}

#[test]
fn native_and_emulated_verdicts_agree() {
    // In parallel, because a seed takes 8 s. Programs stay on their thread.
    let differences =
        sample().into_par_iter().map_init(production, |programs, seed| difference(seed, programs.as_ref()?));
    let wrong: Vec<String> = differences.flatten().collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn sample_has_every_kind_of_fault_of_an_emulated_board() {
    let found: BTreeSet<FaultKind> = sample().into_iter().flat_map(kinds).collect();
    let rows = hil_torture::kinds::ROWS.iter().map(|row| row.kind);
    let expected: BTreeSet<FaultKind> = rows.filter(|&kind| !NATIVE.meets(Kinds::of(&[kind]))).collect();
    assert_eq!(found, expected);
    assert!(sample().len() <= 10, "{:?} take longer than a minute", sample());
}

/// The chamber would notice a broken image: here one whose first word, the stack pointer, is lost.
#[test]
fn damaged_image_breaks_image_runs() {
    let Some(mut programs) = production() else { return };
    let case = Case { faults: Vec::new(), ..case(0) };
    programs.monitor[..4].fill(0);
    let (outcome, _) = play(&case, emulated(&case, &programs));
    let found = outcome.violation.clone().expect("a violation");
    assert_eq!(found.invariant, "image-runs", "{found:?}");
    let (native, _) = play(&case, native(&case).expect("in range"));
    assert_ne!(verdict(&native), verdict(&outcome));
}
