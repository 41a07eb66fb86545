//! The shipped scenarios over CAN alone, on native boards: a host's measurements match the direct ones.

use hil_experiment::metrics::{Metrics, Value, find};
use hil_experiment::over_can::{BoardResult, Job, OverCan, POLL_MS, gap, judge, parked};
use hil_experiment::run::{Options, rig, run};
use hil_experiment::scenario::{Case, SHIPPED, Scenario};
use hil_world::board::SimBoard;
use hil_world::node::Node;
use hil_world::plant::Model;
use tater_wire::Node as Id;

const OPTIONS: Options = Options { seed: 1, model: Model::Averaged, trace: false };

pub(super) fn native(scenario: &Scenario, case: &Case, poll_ms: u32) -> BoardResult {
    native_at(scenario, case, poll_ms, (1, 0), false)
}

/// As [`native`], with another noise seed, and another phase of the tick in the host's millisecond, us. `turned`: the board has
/// seen its motor turn, as an emulated one has to; else it is told, as one without a bus, so that both know the rotor's place
/// in its cell equally well.
pub(super) fn native_at(
    scenario: &Scenario,
    case: &Case,
    poll_ms: u32,
    (seed, phase_us): (u64, u64),
    turned: bool,
) -> BoardResult {
    let node = Id::new(case.motor.first_node()).expect("a node");
    let options = Options { seed, ..OPTIONS };
    let at_first = parked(scenario, case, &options).expect("the scenario's reader has checked it");
    let rig = rig(scenario, case, &options).expect("the same");
    let job = Job { node, case: case.clone(), rig, judged: true, windows: scenario.windows() };
    let mut host = OverCan::new(vec![(node, Node::new(SimBoard::new(at_first, node)))]);
    host.phase_us = phase_us;
    let mut up = host.power_on().and_then(|()| host.wake());
    if turned && scenario.rig.is_wired_as_standard() {
        up = up.and_then(|()| host.turn_once());
    } else if scenario.rig.is_wired_as_standard() {
        host.bus_mut().station_mut(0).expect("one board").trust_direction();
    }
    let ran = up.and_then(|()| host.run(scenario, vec![job], poll_ms));
    ran.unwrap_or_else(|trouble| panic!("{}: {trouble}", scenario.name)).remove(0)
}

fn shipped() -> impl Iterator<Item = Scenario> {
    SHIPPED.iter().map(|shipped| Scenario::find(shipped.name).expect("shipped"))
}

/// Allowed difference of a figure from `direct`, a run that reads the servo's state. The ADC noise has other values at each tick.
fn tolerance(name: &str, direct: f64) -> Option<f64> {
    match name {
        // A tick; or the effect of a thermistor's noise on a fault after half a minute.
        "end_ms" | "arrival_ms" | "rise_ms" => Some((0.005 * direct).max(1.0)),
        // A rotor that settles slowly passes the bound of a count with any noise.
        "settling_ms" => Some((0.05 * direct).max(5.0)),
        "iae" | "itae" | "heat_j" => Some((0.05 * direct).max(0.05)),
        "speed_at_end_counts_s" => Some((0.1 * direct).max(10.0)),
        // P is a whole number: half a count, and the rotor moves while it is read.
        "hold_error_counts" | "peak_hold_error_counts" => Some(0.75),
        // HI's zero is derived from P: up to a count.
        "count_error_counts" => Some(1.0),
        // The same motor under the same commands.
        "sim_s" | "ends" | "refusals" | "homed" | "breakaway_counts" => Some(0.0),
        // A crawl sticks and slips, and may rest within half of MPE 4.
        "overshoot_counts" | "final_error_counts" | "position_counts" => Some(2.0),
        // A load that drives the spread pumps its capacitor up to 28 V; noise says in which tick braking goes into the winding.
        "peak_winding_c" => Some((0.01 * direct).max(0.1)),
        // Peaks of a noisy signal.
        // A motor over CAN has turned once before: what it has learned and where in its cell it begins differ, so does its first kick.
        "peak_torque" => Some((0.16 * direct.abs()).max(1.0)),
        "peak_speed_counts_s" => Some((0.2 * direct.abs()).max(1.0)),
        "peak_current_a" | "velocity_counts_s" => Some((0.03 * direct.abs()).max(1.0)),
        _ => None,
    }
}

fn differences(direct: &Metrics, over_can: &Metrics) -> Vec<String> {
    // After the end of a move its duration depends on the noise; the time of a stall is an expectation.
    let compared = |name: &str| name != "end_after_last_count_ms";
    let differs = |metric: &hil_experiment::metrics::Metric| {
        let (a, b) = ((metric.get)(direct), (metric.get)(over_can));
        let same = match (&a, &b) {
            (Value::Number(a), Value::Number(b)) => {
                tolerance(metric.name, *a).is_some_and(|most| (a - b).abs() <= most)
            }
            _ => a == b,
        };
        (!same && compared(metric.name) && gap(metric, POLL_MS).is_none())
            .then(|| format!("{}: {a} and {b}", metric.name))
    };
    hil_experiment::metrics::METRICS.iter().filter_map(differs).collect()
}

#[test]
fn shipped_scenarios_over_can_match_direct_runs() {
    let mut wrong = Vec::new();
    for scenario in shipped() {
        let direct = run(&scenario, &OPTIONS).expect("a valid scenario");
        for (case, direct) in scenario.cases.iter().zip(&direct.runs) {
            let ran = native(&scenario, case, POLL_MS);
            let (outcome, _) = judge(&scenario, std::slice::from_ref(&ran), &OPTIONS, POLL_MS);
            assert!(!outcome.expectations.is_empty(), "{}: something is judged", scenario.name);
            for verdict in outcome.expectations.iter().filter(|verdict| !verdict.ok) {
                let (name, value, want) = (&verdict.name, &verdict.value, &verdict.want);
                wrong.push(format!("{}: {name} = {value}, want {want} {:?}", scenario.name, ran.run.log));
            }
            // In mode 2, T reads the command, 0. A rotor that coasts before it is driven ends elsewhere (native boards by up to 7 counts,
            // docs/emulation.md). A glitch's effect on the torque depends on its time within the tick, and noise decides when a crawl slips.
            let told = |difference: &String| {
                let untold: &[&str] = match &*scenario.name {
                    "coast-low-ke" => &["peak_torque", "position_counts"],
                    "hall-glitch" => &["peak_torque"],
                    "slow-crawl" => &["settling_ms", "rise_ms", "iae", "itae", "speed_at_end_counts_s"],
                    _ => &[],
                };
                !untold.iter().any(|name| difference.starts_with(&format!("{name}:")))
            };
            for difference in differences(&direct.metrics, &ran.run.metrics).into_iter().filter(told) {
                wrong.push(format!("{} ({:?}): {difference}", scenario.name, case.motor));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn expectations_unknown_over_can_are_reported_and_not_judged() {
    let scenario = Scenario::find("hall-glitch").expect("shipped");
    let ran = native(&scenario, &scenario.cases[0], POLL_MS);
    let (outcome, gaps) = judge(&scenario, &[ran], &OPTIONS, POLL_MS);
    assert_eq!(gaps.iter().map(|gap| gap.0).collect::<Vec<_>>(), ["glitches"]);
    assert_eq!(outcome.expectations.len() + gaps.len(), scenario.expectations.len());
    let torque = find("peak_torque").expect("a metric");
    assert!(gap(torque, POLL_MS).is_none() && gap(torque, 0).is_some(), "T is known if it is polled");
}
