//! Reports of a run for people and programs: text and JSON.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::metrics::{METRICS, Value, end_word, fault_word};
use crate::properties::PROPERTIES;
use crate::run::{Options, Outcome};
use crate::scenario::Scenario;
use hil_world::plant::Model;

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
    faults: Vec<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    wall_s: Option<f64>,
    /// All others by name.
    #[serde(flatten)]
    metrics: BTreeMap<&'static str, serde_json::Value>,
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
    // The object has string keys and finite values only, so serialization cannot fail.
    serde_json::to_string(&object(outcome, Some(wall_s))).unwrap_or_default()
}

/// The same without the wall time: equal runs give equal values.
#[must_use]
pub fn json_value_of(outcome: &Outcome) -> serde_json::Value {
    serde_json::to_value(object(outcome, None)).unwrap_or_default()
}

/// What a folder of `hil-sim run --out` says of its run besides the trace: the result of [`json_value_of`], how to repeat it, and node,
/// properties and metrics of each motor.
#[must_use]
pub fn stored(scenario: &Scenario, outcome: &Outcome, commit: &str) -> serde_json::Value {
    let Options { seed, model, .. } = outcome.options;
    let motors = scenario.cases.iter().zip(&outcome.runs).map(|(case, run)| {
        let properties =
            PROPERTIES.iter().map(|property| (property.name.to_owned(), property.get(&case.config).into()));
        let metrics =
            METRICS.iter().map(|metric| (metric.name.to_owned(), json_value(&(metric.get)(&run.metrics))));
        serde_json::json!({
            "motor": case.motor.name(),
            "node": case.motor.first_node(),
            "properties": properties.collect::<serde_json::Map<_, _>>(),
            "metrics": metrics.collect::<serde_json::Map<_, _>>(),
        })
    });
    let model = model_name(model);
    serde_json::json!({
        "reproduce": format!("hil-sim run {} --seed {seed} --model {model}", scenario.arguments),
        "commit": commit,
        "version": env!("CARGO_PKG_VERSION"),
        "motors": motors.collect::<Vec<_>>(),
        "result": json_value_of(outcome),
    })
}

fn object(outcome: &Outcome, wall_s: Option<f64>) -> Json<'_> {
    let m = &outcome.metrics;
    // serde_json writes a non-finite number as null.
    let expectations = outcome.expectations.iter().map(|verdict| JsonVerdict {
        name: &verdict.name,
        ok: verdict.ok,
        value: json_value(&verdict.value),
        want: &verdict.want,
    });
    Json {
        scenario: &outcome.scenario,
        seed: outcome.options.seed,
        model: model_name(outcome.options.model),
        end_reason: m.end_reason.map(end_word),
        faults: m.faults.iter().map(|fault| fault_word(*fault)).collect(),
        wall_s,
        metrics: METRICS
            .iter()
            .filter(|metric| !["end_reason", "faults"].contains(&metric.name))
            .map(|metric| (metric.name, json_value(&(metric.get)(m))))
            .collect(),
        expectations: expectations.collect(),
    }
}

fn json_value(value: &Value) -> serde_json::Value {
    match value {
        Value::Number(value) => (*value).into(),
        Value::Text(text) => text.as_str().into(),
        Value::Absent => serde_json::Value::Null,
    }
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
