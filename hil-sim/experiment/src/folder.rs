//! The folder that a run leaves.

use crate::page;
use crate::report::stored;
use crate::run::Outcome;
use crate::scenario::Scenario;
use crate::trace::{Trace, write_csv};

/// The files of a folder of `hil-sim run --out`, by name: the trace, what [`stored`] says, the page. `commit` is the program's.
///
/// # Panics
/// Never: memory takes the trace.
#[must_use]
pub fn files(scenario: &Scenario, outcome: &Outcome, commit: &str) -> [(&'static str, Vec<u8>); 3] {
    let traces: Vec<Trace> = outcome.runs.iter().filter_map(|run| run.trace.clone()).collect();
    let mut csv = Vec::new();
    write_csv(&mut csv, &traces).expect("memory takes any bytes");
    let json = format!("{:#}\n", stored(scenario, outcome, commit));
    let html = page::html(scenario, outcome);
    [("trace.csv", csv), ("run.json", json.into_bytes()), ("report.html", html.into_bytes())]
}
