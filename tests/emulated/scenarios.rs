//! The shipped scenarios on the image, over CAN alone, and their motors beside those of native boards.

use board_emu::session::{Nodes, Session, buses, run};
use hil_sim::over_can::{POLL_MS, judge};
use hil_sim::scenario::{SHIPPED, Scenario};
use hil_sim::{Model, Options};

use super::bench::production;
use crate::over_can::native;
use board_emu::image::Programs;

const OPTIONS: Options = Options { seed: 1, model: Model::Averaged, trace: false };

/// How far a rotor may be from the native board's at the same time, counts, and the duration of a move, ms: the issue's.
const APART_COUNTS: f64 = 1.0;
const APART_MS: f64 = 2.0;

fn session(scenario: &Scenario, nodes: Nodes, programs: &Programs, download: bool) -> Session {
    let clock = || 0.0;
    let ran = run(scenario, nodes, programs, &OPTIONS, (POLL_MS, download), &mut |_| Ok(()), &clock);
    ran.unwrap_or_else(|trouble| panic!("{}: {trouble}", scenario.name))
}

#[test]
fn every_shipped_scenario_passes_on_the_image_and_moves_as_natively() {
    let Some(programs) = production() else { return };
    let mut wrong = Vec::new();
    for shipped in SHIPPED {
        let scenario = Scenario::find(shipped.name).expect("shipped");
        // The first board gets its program over the bus, from erased flash.
        let first = shipped.name == SHIPPED[0].name;
        let session = session(&scenario, Nodes::Count(1), &programs, first);
        let (outcome, _) = judge(&scenario, &session.ran, &OPTIONS, POLL_MS);
        for verdict in outcome.expectations.iter().filter(|verdict| !verdict.ok) {
            let (name, value, want) = (&verdict.name, &verdict.value, &verdict.want);
            wrong.push(format!("{}: {name} = {value}, want {want}", scenario.name));
        }
        for (case, ran) in scenario.cases.iter().zip(&session.ran) {
            let apart = ran.path.difference(&native(&scenario, case, POLL_MS).path);
            let (name, motor) = (&scenario.name, case.motor);
            println!("figure: {name} ({motor:?}): {:.2} counts, {:.2} ms apart", apart.counts, apart.end_ms);
            if apart.counts > APART_COUNTS || apart.end_ms > APART_MS || apart.other_ends {
                wrong.push(format!("{name} ({motor:?}): {apart:?} {:?}", ran.run.log));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn boards_are_chosen_by_number_or_by_range_with_the_scenarios_motors_first() {
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
fn three_boards_on_one_bus_home_at_once() {
    let Some(programs) = production() else { return };
    let scenario = Scenario::find("homing").expect("shipped");
    let session = session(&scenario, Nodes::Count(3), &programs, false);
    let (outcome, _) = judge(&scenario, &session.ran, &OPTIONS, POLL_MS);
    assert_eq!(outcome.expectations.len(), 3 * scenario.expectations.len());
    assert!(outcome.passed(), "{:?}", outcome.expectations);
}
