//! Reports of a run for people and programs: text, JSON, and an HTML page with charts.

mod chart;
mod page;

pub use page::html;

use serde::Serialize;

use crate::experiment::metrics::{METRICS, Value, end_word, fault_word};
use crate::experiment::run::Outcome;
use crate::world::plant::Model;

/// The inverter model's name, as on the command line.
#[must_use]
pub fn model_name(model: Model) -> &'static str {
    match model {
        Model::Averaged => "averaged",
        Model::Switched => "switched",
    }
}

/// A missing value is null; nothing is ever NaN.
#[derive(Serialize)]
struct Json<'a> {
    scenario: &'a str,
    seed: u64,
    model: &'static str,
    end_reason: Option<&'static str>,
    end_ms: Option<f64>,
    arrival_ms: Option<f64>,
    overshoot_counts: Option<f64>,
    final_error_counts: Option<f64>,
    tracking_rms_counts: Option<f64>,
    peak_torque: Option<f64>,
    peak_current_a: Option<f64>,
    peak_winding_c: Option<f64>,
    hold_error_counts: Option<f64>,
    faults: Vec<&'static str>,
    sim_s: Option<f64>,
    wall_s: Option<f64>,
    expectations: Vec<JsonVerdict<'a>>,
}

#[derive(Serialize)]
struct JsonVerdict<'a> {
    name: &'a str,
    ok: bool,
    value: serde_json::Value,
    want: &'a str,
}

/// One JSON object on one line.
#[must_use]
pub fn json(outcome: &Outcome, wall_s: f64) -> String {
    let m = &outcome.metrics;
    // serde_json writes a non-finite number as null.
    let expectations = outcome.expectations.iter().map(|verdict| JsonVerdict {
        name: &verdict.name,
        ok: verdict.ok,
        value: match &verdict.value {
            Value::Number(value) => (*value).into(),
            Value::Text(text) => text.as_str().into(),
            Value::Absent => serde_json::Value::Null,
        },
        want: &verdict.want,
    });
    let object = Json {
        scenario: &outcome.scenario,
        seed: outcome.options.seed,
        model: model_name(outcome.options.model),
        end_reason: m.end_reason.map(end_word),
        end_ms: m.end_ms,
        arrival_ms: m.arrival_ms(),
        overshoot_counts: m.overshoot_counts,
        final_error_counts: m.final_error_counts,
        tracking_rms_counts: m.tracking_rms_counts,
        peak_torque: Some(m.peak_torque),
        peak_current_a: Some(m.peak_current_a),
        peak_winding_c: Some(m.peak_winding_c),
        hold_error_counts: m.hold_error_counts,
        faults: m.faults.iter().map(|fault| fault_word(*fault)).collect(),
        sim_s: Some(m.sim_s),
        wall_s: Some(wall_s),
        expectations: expectations.collect(),
    };
    // The object has string keys and finite values only, so serialization cannot fail.
    serde_json::to_string(&object).unwrap_or_default()
}

/// Metrics and expectations for a terminal.
#[must_use]
pub fn text(outcome: &Outcome, wall_s: f64) -> String {
    let mut text = format!(
        "{} (seed {}, {} inverter)\n\n",
        outcome.scenario,
        outcome.options.seed,
        model_name(outcome.options.model)
    );
    for metric in &METRICS {
        let value = (metric.get)(&outcome.metrics);
        if value != Value::Absent {
            text.push_str(&format!("  {:<26} {:>12}   {}\n", metric.name, value.to_string(), metric.about));
        }
    }
    text.push('\n');
    for verdict in &outcome.expectations {
        let mark = if verdict.ok { "ok    " } else { "FAILED" };
        text.push_str(&format!("  {mark}  {} = {}, want {}\n", verdict.name, verdict.value, verdict.want));
    }
    let sim_s = outcome.metrics.sim_s;
    text.push_str(&format!("\n  {sim_s:.3} s simulated in {wall_s:.3} s ({:.0} ×)\n", sim_s / wall_s));
    text
}
