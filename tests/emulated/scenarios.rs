//! The shipped scenarios on the image, over CAN, with rotors compared to those of native boards.

use std::iter::once;

use board_emu::session::{Nodes, Session, buses, run};
use hil_experiment::over_can::compare::{Difference, Path};
use hil_experiment::over_can::{POLL_MS, judge};
use hil_experiment::run::Options;
use hil_experiment::scenario::{SHIPPED, Scenario};
use hil_world::plant::Model;

use super::bench::production;
use crate::over_can::native_at;
use board_emu::image::Programs;

const OPTIONS: Options = Options { seed: 1, model: Model::Averaged, trace: false };

/// Largest distance from the native rotor at the same time, counts, and difference of a move's duration, ms.
const APART_COUNTS: f64 = 1.0;
const APART_MS: f64 = 2.0;
/// The same in HI: each of its three stages may begin a tick later on the image.
const APART_HOMING_MS: f64 = 3.0;

/// Seeds of noise and phases of the tick in the host's millisecond, us: native boards that are equally valid.
const NATIVES: [(u64, u64); 6] = [(1, 0), (2, 150), (3, 300), (4, 450), (5, 600), (6, 800)];

/// Stick-slip, a rotor that coasts before it is driven, and one that a load breaks loose: native boards differ by more. Their spread is the
/// limit.
const CHANCE: [&str; 3] = ["slow-crawl", "coast-low-ke", "spread-hold-disturbance"];

/// Distance of an emulated run from the nearest native one, and spread of the native ones.
fn apart(emulated: &Path, natives: &[Path]) -> (Difference, Difference) {
    let nearest = natives.iter().map(|native| emulated.difference(native));
    let nearest = nearest.min_by(|a, b| a.counts.total_cmp(&b.counts)).expect("several");
    let pairs = natives.iter().flat_map(|a| natives.iter().map(|b| a.difference(b)));
    let none = Difference { counts: 0.0, end_ms: 0.0, other_ends: false };
    let spread = pairs.fold(none, |most, pair| Difference {
        counts: most.counts.max(pair.counts),
        end_ms: most.end_ms.max(pair.end_ms),
        other_ends: most.other_ends || pair.other_ends,
    });
    (nearest, spread)
}

fn session(scenario: &Scenario, nodes: Nodes, programs: &Programs, download: bool) -> Session {
    let clock = || 0.0;
    let ran = run(scenario, nodes, programs, &OPTIONS, (POLL_MS, download), &mut |_| Ok(()), &clock);
    ran.unwrap_or_else(|trouble| panic!("{}: {trouble}", scenario.name))
}

#[test]
fn shipped_scenarios_pass_on_the_image_and_on_native_boards_near_it() {
    let Some(programs) = production() else { return };
    let mut wrong = Vec::new();
    for shipped in SHIPPED {
        let scenario = Scenario::find(shipped.name).expect("shipped");
        // The first board downloads its program over the bus, from erased flash.
        let first = shipped.name == SHIPPED[0].name;
        let session = session(&scenario, Nodes::Count(1), &programs, first);
        let natives = NATIVES.map(|native| {
            let ran = |case| native_at(&scenario, case, POLL_MS, native, true);
            scenario.cases.iter().map(ran).collect::<Vec<_>>()
        });
        for (board, ran) in once(&session.ran).chain(&natives).enumerate() {
            let (outcome, _) = judge(&scenario, ran, &OPTIONS, POLL_MS);
            let board =
                board.checked_sub(1).map_or("the image".to_owned(), |at| format!("native {:?}", NATIVES[at]));
            for verdict in outcome.expectations.iter().filter(|verdict| !verdict.ok) {
                let (name, value, want) = (&verdict.name, &verdict.value, &verdict.want);
                wrong.push(format!("{}, {board}: {name} = {value}, want {want}", scenario.name));
            }
        }
        for (at, (case, ran)) in scenario.cases.iter().zip(&session.ran).enumerate() {
            let paths: Vec<Path> = natives.iter().map(|ran| ran[at].path.clone()).collect();
            let (apart, natives) = apart(&ran.path, &paths);
            let (name, motor) = (&scenario.name, case.motor);
            println!(
                "figure: {name} ({motor:?}): {:.2} counts, {:.2} ms from a native board; these {:.2} and {:.2} from each other",
                apart.counts, apart.end_ms, natives.counts, natives.end_ms
            );
            let (counts, ms) = if CHANCE.contains(&&**name) {
                (APART_COUNTS.max(natives.counts), APART_MS.max(natives.end_ms))
            } else {
                (APART_COUNTS, if name.starts_with("homing") { APART_HOMING_MS } else { APART_MS })
            };
            if apart.counts > counts || apart.end_ms > ms || apart.other_ends {
                wrong.push(format!("{name} ({motor:?}): {apart:?} {:?}", ran.run.log));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn boards_are_selected_by_count_or_range() {
    let of = |name: &str, nodes: &str| {
        let scenario = Scenario::find(name).expect("shipped");
        buses(&scenario, nodes.parse().expect("nodes"))
    };
    assert_eq!(of("spread-full-travel", "1"), Ok(vec![vec![4]]));
    assert_eq!(of("spread-full-travel", "3"), Ok(vec![vec![1, 2, 4]]));
    assert_eq!(of("spread-full-travel", "7"), Ok(vec![(1..=7).collect()]));
    assert_eq!(of("spread-full-travel", "3-5"), Ok(vec![vec![3, 4, 5]]));
    assert_eq!(of("homing", "1"), Ok(vec![vec![1], vec![4], vec![5]]), "one after another");
    assert_eq!(of("homing", "3"), Ok(vec![vec![1, 4, 5]]));
    assert!(of("homing", "2").is_err_and(|error| error.contains("3 or more")));
    assert!(of("spread-full-travel", "1-3").is_err_and(|error| error.contains("include one of nodes [4]")));
    for wrong in ["0", "8", "5-3", "1-8", "", "all"] {
        assert!(wrong.parse::<Nodes>().is_err(), "{wrong}");
    }
}

#[test]
fn three_boards_home_on_one_bus() {
    let Some(programs) = production() else { return };
    let scenario = Scenario::find("homing").expect("shipped");
    let session = session(&scenario, Nodes::Count(3), &programs, false);
    let (outcome, _) = judge(&scenario, &session.ran, &OPTIONS, POLL_MS);
    assert_eq!(outcome.expectations.len(), 3 * scenario.expectations.len());
    assert!(outcome.passed(), "{:?}", outcome.expectations);
}
