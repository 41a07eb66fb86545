//! The torture chamber itself: that every fault bites and heals, that checks can fail, that runs repeat, and a sample of seeds.

use std::collections::BTreeSet;

use hil_torture::case::{Case, Fault, World};
use hil_torture::kinds::{FaultKind, ROWS};
use hil_torture::program::{Act, Step};
use hil_torture::{Outcome, Selection, Violation, run, shrink};
use rand_pcg::Pcg64Mcg;
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};
use tater_wire::FaultCode;

/// Seeds of the sample in the tests; `cargo xtask ci` plays a thousand, always the same, and `cargo xtask fresh` new ones.
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
        is_long: false,
        is_plain: false,
        steps: vec![
            line(0, "HI"),
            line(4_000, "M 9000"),
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

/// Times of faults, ms. Each kind meets something at one of them: a motion, a stored value, a host's line.
const TIMES: [u64; 6] = [4_200, 1_000, 7_200, 5_600, 6_030, 8_600];

fn fault(kind: FaultKind, seed: u64) -> Fault {
    let mut rng = Pcg64Mcg::new(u128::from(seed) << 8 | 1);
    let drawn = Fault::draw(kind, &mut rng, 12_000);
    let from_ms = TIMES[seed as usize % TIMES.len()];
    Fault { from_ms, for_ms: 1_200, ..drawn }
}

/// Times and places at which a kind is tried until it bites.
const TRIES: u64 = 18;

/// The page's table of what was measured.
const MEASURED: &str = "| Fault | ERROR | ERR | Recovered in, s |\n| --- | --- | --- | --- |\n";

/// What a kind does at each of the times of [`fault`] at which it bites, taken together; `None` if it does not bite in all tries.
fn measured(kind: FaultKind, twin: &Outcome) -> Option<Outcome> {
    let mut all: Option<Outcome> = None;
    for seed in 0..TRIES {
        if seed >= TIMES.len() as u64 && all.is_some() {
            break;
        }
        let outcome = run(&session(Some(fault(kind, seed))));
        if outcome.digest == twin.digest {
            continue;
        }
        all = Some(match all {
            None => outcome,
            Some(all) => Outcome {
                errors: all.errors | outcome.errors,
                statuses: all.statuses | outcome.statuses,
                recovered_ms: all.recovered_ms.zip(outcome.recovered_ms).map(|(a, b)| a.max(b)),
                violation: all.violation.or(outcome.violation),
                ..all
            },
        });
    }
    all
}

fn measured_row(name: &str, outcome: &Outcome) -> String {
    let bits = |bits: u64| (0..64).filter(move |bit| bits >> bit & 1 == 1);
    let text = |values: Vec<String>| if values.is_empty() { "-".to_owned() } else { values.join(", ") };
    let error = |code: u32| {
        let fault = FaultCode::of(code.into()).expect("a value of the table");
        format!("{code} {}", fault.row().name)
    };
    let errors = text(bits(outcome.errors).map(error).collect());
    let statuses = text(bits(outcome.statuses).map(|bit| (1_u64 << bit).to_string()).collect());
    let recovered_s = outcome.recovered_ms.map_or("never".to_owned(), |ms| ms.div_ceil(1_000).to_string());
    format!("| {name} | {errors} | {statuses} | {recovered_s} |\n")
}

#[test]
fn every_fault_bites_is_cleared_and_the_hand_recovers() {
    let twin = run(&session(None));
    assert_eq!(twin.violation, None);
    assert_eq!((twin.errors, twin.statuses), (0, 0), "without a fault nothing is reported");
    let mut wrong = Vec::new();
    let mut table = MEASURED.to_owned() + &measured_row("none", &twin);
    // In parallel, because it is the longest test of the binary.
    let outcomes: Vec<_> = ROWS.par_iter().map(|row| measured(row.kind, &twin)).collect();
    for (row, outcome) in ROWS.iter().zip(outcomes) {
        let Some(outcome) = outcome else {
            wrong.push(format!("{}: the trace is that of the fault-free twin", row.name));
            continue;
        };
        table += &measured_row(row.name, &outcome);
        if outcome.violation.is_some() || outcome.recovered_ms.is_none() {
            wrong.push(format!("{}: {:?}", row.name, outcome.violation));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    table.lines().skip(2).for_each(|row| println!("figure: fault, ERROR, ERR, s: {row}"));
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/torture.md");
    let page = std::fs::read_to_string(path).expect("committed");
    if std::env::var_os("BLESS_TORTURE").is_some() {
        let (before, rest) = page.split_once(MEASURED).expect("the page has the table");
        let after: String = rest.split_inclusive('\n').skip_while(|line| line.starts_with('|')).collect();
        std::fs::write(path, format!("{before}{table}{after}")).expect("writable");
    } else {
        assert!(
            page.contains(&table),
            "docs/torture.md has another table of what was measured: if the change is intended, \
             BLESS_TORTURE=1 cargo test -p system-tests every_fault_bites rewrites it\n{table}"
        );
    }
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
    let invariants: BTreeSet<&str> = hil_torture::INVARIANTS.iter().map(|invariant| invariant.name).collect();
    assert_eq!(invariants.len(), hil_torture::INVARIANTS.len());
}

#[test]
fn docs_have_the_tables() {
    let page = include_str!("../docs/torture.md");
    assert!(
        page.contains(&hil_torture::report::tables()),
        "docs/torture.md: replace its tables by those of `hil-sim torture --list`"
    );
}

/// The last column, what the seeds reach, is compared by `cargo xtask ci`.
#[test]
fn safety_page_has_the_promises_of_the_checks() {
    let page = include_str!("../docs/safety.md");
    for row in hil_torture::report::promises() {
        assert!(page.lines().any(|line| line.starts_with(&row)), "docs/safety.md lacks {row}");
    }
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

/// Ten minutes of simulated time at least, a replay line of its own, and the same run again.
#[test]
fn long_seed_heats_a_winding_and_holds() {
    let case = Case::draw_long(2);
    assert!(case.is_long && case.stop_ms >= 600_000 && case != Case::draw(2));
    let line = hil_torture::report::replay_line(&case, &Selection::default());
    assert_eq!(line, "hil-sim torture --seed 2 --long --replay");
    let outcome = run(&case);
    assert_eq!(outcome.violation, None);
    assert!(outcome.peaks[0] > 60.0, "the hottest winding has {:.0} C", outcome.peaks[0]);
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
