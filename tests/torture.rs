//! The torture chamber itself: that every fault bites and heals, that checks can fail, that runs repeat, and a sample of seeds.

use std::collections::BTreeSet;

use hil_sim::torture::case::{Case, Fault, World};
use hil_sim::torture::kinds::{FaultKind, ROWS};
use hil_sim::torture::program::{Act, Step};
use hil_sim::torture::{Outcome, Selection, Violation, run, shrink};
use rand_pcg::Pcg64Mcg;

/// Seeds of the sample in the tests; `cargo xtask ci` plays fresh ones for minutes.
const SEEDS: u64 = 40;

/// The seeds that have ever failed, with what they found: each is played again.
const FAILED: &str = include_str!("torture/failed.txt");

fn line(at_ms: u64, text: &str) -> Step {
    Step { at_ms, act: Act::Line { text: text.to_owned(), patience_ms: Some(6_000) } }
}

/// A hand that homes, moves, saves and streams blocks, in which every kind of fault finds something to break.
fn session(fault: Option<Fault>) -> Case {
    let block = |velocity: u8| ([&b"C"[..], &[velocity, 32].repeat(7)].concat(), 20);
    let blocks: Vec<_> = (0..40).map(|at| block(if at < 20 { 20 } else { 236 })).collect();
    Case {
        seed: 7,
        world: World::nominal(),
        is_plain: false,
        steps: vec![
            line(0, "HI"),
            line(4_000, "M 12000"),
            line(5_500, "SO"),
            line(6_000, "FSAVE"),
            Step { at_ms: 7_000, act: Act::Loop { prefix: "X1234567".to_owned(), blocks } },
            line(8_500, "TC"),
            line(10_000, "O"),
            line(11_500, "PGET PTEMP"),
        ],
        faults: fault.into_iter().collect(),
        stop_ms: 12_000,
    }
}

fn fault(kind: FaultKind, seed: u64) -> Fault {
    let mut rng = Pcg64Mcg::new(u128::from(seed) << 8 | 1);
    let drawn = Fault::draw(kind, &mut rng, 12_000);
    // Each of them meets something in one of its seeds: a motion, a stored value, a host's line.
    let from_ms = [4_200, 1_000, 7_200, 5_600, 6_030, 8_600][seed as usize % 6];
    Fault { from_ms, for_ms: 1_200, ..drawn }
}

/// Times and places at which a kind is tried until it bites.
const TRIES: u64 = 18;

#[test]
fn every_fault_bites_is_cleared_and_the_hand_recovers() {
    let twin = run(&session(None));
    assert_eq!(twin.violation, None);
    let mut wrong = Vec::new();
    println!("figure: faults: kind, try that bites, ERROR values, recovery");
    for row in ROWS {
        let outcomes = (0..TRIES).map(|seed| run(&session(Some(fault(row.kind, seed)))));
        let Some((tries, outcome)) = (1..).zip(outcomes).find(|(_, outcome)| outcome.digest != twin.digest)
        else {
            wrong.push(format!("{}: the trace is that of the fault-free twin", row.name));
            continue;
        };
        let Outcome { violation, recovered_ms, errors, .. } = outcome;
        let codes: Vec<u32> = (0..64).filter(|code| errors >> code & 1 == 1).collect();
        println!("figure: fault {}: {tries}, {codes:?}, {recovered_ms:?} ms", row.name);
        if violation.is_some() || recovered_ms.is_none() {
            wrong.push(format!("{}: {violation:?}", row.name));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn names_and_rows_are_unique_and_in_order() {
    assert!(ROWS.len() >= 25, "{}", ROWS.len());
    for (at, row) in ROWS.iter().enumerate() {
        assert_eq!(row.kind as usize, at, "{}", row.name);
        assert_eq!(row.kind.row().name, row.name);
    }
    let names: BTreeSet<&str> = ROWS.iter().map(|row| row.name).collect();
    assert_eq!(names.len(), ROWS.len());
    let invariants: BTreeSet<&str> =
        hil_sim::torture::INVARIANTS.iter().map(|invariant| invariant.name).collect();
    assert_eq!(invariants.len(), hil_sim::torture::INVARIANTS.len());
}

#[test]
fn docs_have_the_tables() {
    let page = include_str!("../docs/torture.md");
    assert!(
        page.contains(&hil_sim::torture::report::tables()),
        "docs/torture.md: replace its tables by those of `hil-sim torture --list`"
    );
}

#[test]
fn same_seed_gives_the_same_run() {
    for seed in [3, 11] {
        let [a, b] = [(); 2].map(|()| run(&Case::draw(seed)));
        assert_eq!((a.digest, a.ms, a.prompts), (b.digest, b.ms, b.prompts), "seed {seed}");
    }
    assert_ne!(run(&Case::draw(3)).digest, run(&Case::draw(11)).digest);
}

#[test]
fn a_sample_of_seeds_holds() {
    let failed: Vec<String> = (0..SEEDS)
        .filter_map(|seed| {
            let violation = run(&Case::draw(seed)).violation?;
            Some(format!("seed {seed}: {violation:?}"))
        })
        .collect();
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

#[test]
fn every_seed_that_ever_failed_holds() {
    let mut seeds = 0;
    for line in FAILED.lines().filter(|line| !line.starts_with('#')) {
        let seed = line.split_whitespace().next().and_then(|word| word.parse().ok()).expect("a seed first");
        assert_eq!(run(&Case::draw(seed)).violation, None, "{line}");
        seeds += 1;
    }
    assert!(seeds > 5, "{seeds}");
}

/// A failure that needs one fault and one step of many is shrunk to these.
#[test]
fn failure_shrinks_to_what_it_needs() {
    let case =
        (0..).map(Case::draw).find(|case| case.faults.len() >= 8 && case.steps.len() >= 20).expect("one");
    let (kind, act) = (case.faults[5].kind, case.steps[9].act.clone());
    let mut fails = |case: &Case| {
        let found = case.faults.iter().any(|fault| fault.kind == kind)
            && case.steps.iter().any(|step| step.act == act);
        let violation =
            found.then(|| Violation { invariant: "planted", ms: 1, node: 0, found: String::new() });
        Outcome { violation, ..Outcome::default() }
    };
    let violation = fails(&case).violation.expect("it fails");
    let shrunk = shrink(&case, &violation, &mut fails, &mut || true);
    let left = case.select(&shrunk.selection);
    assert_eq!((left.steps.len(), left.faults.len()), (1, 1), "{:?}", shrunk.selection);
    assert!(left.stop_ms <= 2 && shrunk.runs < 200, "{shrunk:?}");
    // Without time it stays as it was.
    let whole = shrink(&case, &violation, &mut fails, &mut || false);
    assert_eq!(case.select(&whole.selection), case);
}

#[test]
fn selection_keeps_the_numbers_of_the_case() {
    let case = Case::draw(5);
    assert_eq!(case.select(&Selection::default()), case);
    let selection = Selection { steps: Some(vec![1, 99_999]), faults: Some(Vec::new()), stop_ms: Some(500) };
    let part = case.select(&selection);
    assert_eq!((part.steps, part.faults.len(), part.stop_ms), (vec![case.steps[1].clone()], 0, 500));
}
