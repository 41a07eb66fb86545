//! Runs of scenarios: metrics, verdicts, logs, traces, reports, pages.

use std::fmt::Write;

use crate::Record;
use hil_experiment::metrics::METRICS;
use hil_experiment::run::{Options, Outcome, run};
use hil_experiment::scenario::{SHIPPED, Scenario};
use hil_experiment::{folder, page, report};
use hil_world::plant::Model;

/// Runs it and notes the outcome: the main figures to read, and everything that is written of it.
fn note(record: &mut Record, scenario: &Scenario, options: &Options) {
    let outcome = run(scenario, options).expect("its figures are in range");
    let metrics = &outcome.metrics;
    let shown = format!(
        "{}, {:?}: {:?} at {:?} ms, {} of {} met",
        scenario.name,
        options.model,
        metrics.end_reason,
        metrics.end_ms,
        outcome.expectations.iter().filter(|verdict| verdict.ok).count(),
        outcome.expectations.len()
    );
    let written =
        options.trace.then(|| (folder::files(scenario, &outcome, "commit"), page::html(scenario, &outcome)));
    let reports = (report::text(&outcome, 1.5), report::json(&outcome, 1.5), outcome.passed());
    record.note(shown, &(metrics, &outcome.expectations, values(&outcome), reports, written));
    for run in &outcome.runs {
        record.note(format!("    {} {:?}", run.motor.name(), run.log), &(&run.events, &run.windows));
    }
}

/// Each metric of each motor, as its table has it.
fn values(outcome: &Outcome) -> String {
    let mut text = String::new();
    for run in &outcome.runs {
        for metric in &METRICS {
            let (name, unit) = (metric.name, metric.unit());
            let _ = write!(text, "{name} {unit} {} {:?}; ", metric.is_word(), (metric.get)(&run.metrics));
        }
    }
    text
}

/// Those that come with the program; with a trace where it is short.
pub fn shipped() -> Vec<Record> {
    let mut record = Record::new("shipped scenarios");
    for shipped in SHIPPED {
        let scenario = Scenario::find(shipped.name).expect("shipped");
        let trace = scenario.duration_ms <= 2_000;
        note(&mut record, &scenario, &Options { seed: 5, model: Model::Averaged, trace });
    }
    vec![record]
}

/// Every action, expectation and figure of a scenario, on motors that the seed scatters.
const EVERYTHING: &str = r#"
name = "everything"
about = "Each action once, <with> \"signs\" & windows."
motor = ["link", "spread", "tip"]
duration_ms = 1900
scatter = 0.2
hall_scatter_deg = 8
plant = { coulomb_n_m = 0.02, trip_a = 15 }
rig = { rise_delay_us = 30, adc_noise_lsb = 1.5 }
set = { ACCEL = 60, HOLD = 1, MV = 90 }
initial = { position_counts = 20, velocity_counts_s = 30, winding_c = 70, housing_c = 45 }

[[object]]
from_count = 150
side = "closing"
stiffness_n_m_rad = 0.5
damping_n_m_s = 0.005

[[object]]
from_count = 5
side = "opening"
stiffness_n_m_rad = 1.5
damping_n_m_s = 0.001
"#;

const ACTIONS: [&str; 24] = [
    "move = 60",
    "abort = true",
    "abort = true",
    "move = 300",
    "set = { MV = 120, KP = 50 }",
    "bus_v = 21",
    "disturbance_n_m = -0.05",
    "end = 40",
    "mode = \"trapezoidal\"",
    "disturbance_n_m = 0",
    "velocity = -40",
    "mode = \"velocity\"",
    "velocity = 80",
    "mode = \"torque\"",
    "torque = 150",
    "mode = \"pid\"",
    "position = 70",
    "torque_close = true",
    "torque_open = true",
    "bus_v = 14",
    "clear_fault = true",
    "bus_v = 24",
    "clear_fault = true",
    "terminate = true",
];

const EXPECTATIONS: [&str; 8] = [
    "metric = \"position_counts\"\nmin = 1",
    "metric = \"position_counts\"\nmin = 20\nmax = 90\nfrom_ms = 400\nto_ms = 700",
    "metric = \"peak_current_a\"\nmax = 5",
    "metric = \"mode\"\nequals = \"idle\"",
    "metric = \"faults\"\nequals = \"none\"",
    "metric = \"overshoot_counts\"\nequals = 1\ntolerance = 0.5\nfrom_ms = 0\nto_ms = 300",
    "metric = \"refusals\"\nequals = 0",
    "metric = \"settling_ms\"\nmax = 200",
];

fn text(actions: &[&str]) -> String {
    let mut text = EVERYTHING.to_owned();
    for (index, action) in actions.iter().enumerate() {
        let _ = write!(text, "\n[[at]]\nms = {}\n{action}\n", 75 * index);
    }
    for expectation in EXPECTATIONS {
        let _ = write!(text, "\n[[expect]]\n{expectation}\n");
    }
    text
}

pub fn own() -> Vec<Record> {
    let mut record = Record::new("a scenario with everything");
    let scenario = Scenario::parse("everything.toml", &text(&ACTIONS)).unwrap_or_else(|bad| panic!("{bad}"));
    record.note("as it was read", &scenario);
    for model in [Model::Averaged, Model::Switched] {
        note(&mut record, &scenario, &Options { seed: 3, model, trace: true });
    }
    let homing = Scenario::parse("homing.toml", &text(&["home = true", "set = { IVEL = 60 }"]));
    note(
        &mut record,
        &homing.unwrap_or_else(|bad| panic!("{bad}")),
        &Options { seed: 4, model: Model::Averaged, trace: true },
    );
    let mut other = scenario;
    other.scatter = 0.0;
    let overrides = [
        ("plant", "inertia=1.3x"),
        ("plant", "static_n_m=0.06"),
        ("rig", "hall_offset_deg=7"),
        ("supply", "volts=0.9x"),
    ];
    other.override_figures(&overrides).unwrap_or_else(|bad| panic!("{bad}"));
    other.set("kd=77").unwrap_or_else(|bad| panic!("{bad}"));
    record.note(format!("overridden: {}", other.arguments), &other);
    note(&mut record, &other, &Options { seed: 4, model: Model::Averaged, trace: false });
    vec![record]
}
