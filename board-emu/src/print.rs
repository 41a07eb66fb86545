//! Prints the outcome of a session for people or as JSON.

use board_emu::session::Session;
use hil_experiment::metrics::{METRICS, Value};
use hil_experiment::report;
use hil_experiment::run::Outcome;
use serde_json::{Map, Value as Json, json};

pub struct Told<'a> {
    pub outcome: &'a Outcome,
    pub session: &'a Session,
    /// Expectations that were not judged, with reasons.
    pub gaps: &'a [(&'static str, &'static str)],
    /// Wall-clock time of the whole session, s.
    pub wall_s: f64,
    pub known: &'a dyn Fn(&str) -> bool,
}

impl Told<'_> {
    fn figures(&self) -> Map<String, Json> {
        let figures = serde_json::to_value(self.session.figures);
        let mut map = figures.ok().and_then(|value| value.as_object().cloned()).unwrap_or_default();
        map.insert("realtime_x".to_owned(), json!(self.session.scenario_s / self.session.scenario_wall_s));
        map
    }

    /// One JSON object on one line: the keys of `hil-sim run --json`, and the figures.
    pub fn json(&self) -> String {
        let text = report::json(self.outcome, self.wall_s);
        let mut object: Map<String, Json> = serde_json::from_str(&text).unwrap_or_default();
        object.extend(self.figures());
        let gaps = self.gaps.iter().map(|(name, why)| json!({ "name": name, "why": why }));
        object.insert("not_judged".to_owned(), gaps.collect());
        format!("{}\n", Json::Object(object))
    }

    pub fn text(&self) -> String {
        let ran = &self.session.ran;
        let nodes: Vec<_> = ran.iter().map(|ran| ran.node.number().to_string()).collect();
        let mut text = format!(
            "{} on emulated boards, over CAN (nodes {})\n\n",
            self.outcome.scenario,
            nodes.join(", ")
        );
        for metric in METRICS.iter().filter(|metric| (self.known)(metric.name)) {
            let value = (metric.get)(&self.outcome.metrics);
            if value != Value::Absent {
                text.push_str(&format!(
                    "  {:<26} {:>12}   {}\n",
                    metric.name,
                    value.to_string(),
                    metric.about
                ));
            }
        }
        text.push('\n');
        for (name, value) in self.figures() {
            let value = value.as_f64().map_or_else(String::new, |value| Value::from(value).to_string());
            text.push_str(&format!("  {name:<26} {value:>12}\n"));
        }
        text.push('\n');
        for verdict in &self.outcome.expectations {
            let mark = if verdict.ok { "ok    " } else { "FAILED" };
            text.push_str(&format!(
                "  {mark}  {} = {}, want {}\n",
                verdict.name, verdict.value, verdict.want
            ));
        }
        for (name, why) in self.gaps {
            text.push_str(&format!("  -       {name} is not judged: {why}\n"));
        }
        for ran in ran.iter().filter(|_| !self.outcome.passed()) {
            for (ms, what) in &ran.run.log {
                text.push_str(&format!("  node {} at {ms} ms: {what}\n", ran.node.number()));
            }
        }
        text
    }
}
