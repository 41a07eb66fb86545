//! The table of a sweep: its columns, and a run as a line of CSV.

use super::{Run, Sweep};
use hil_experiment::metrics::{METRICS, Value};
use hil_experiment::run::Outcome;
use serde::{Deserialize, Serialize};
use traces::input::BadInput;
use traces::table::Kind;

/// A column of the results, as `sweep.json` describes it. Its cells may be empty where a run has no such value, but not those about the run itself.
/// Integers are 0 to 2^63 − 1; a number is the shortest text that reads back as the same 64 bits.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ResultColumn {
    /// Its name, unique.
    pub name: String,
    /// Its unit; empty for words and plain numbers.
    pub unit: String,
    /// What its cells are.
    #[serde(with = "KindByName")]
    pub kind: Kind,
    /// Its meaning.
    pub about: String,
}

/// [`Kind`] by the names of `sweep.json`.
#[derive(Serialize, Deserialize)]
#[serde(remote = "Kind")]
enum KindByName {
    #[serde(rename = "number")]
    Float,
    #[serde(rename = "whole")]
    Int,
    #[serde(rename = "text")]
    Text,
}

impl Sweep {
    /// The columns: those about the run, the parameters, the metrics.
    #[must_use]
    pub fn columns(&self) -> Vec<ResultColumn> {
        let column = |name: &str, unit: &str, kind, about: &str| ResultColumn {
            name: name.to_owned(),
            unit: unit.to_owned(),
            kind,
            about: about.to_owned(),
        };
        let mut columns = vec![
            column("index", "", Kind::Int, "number of the run in the sweep"),
            column("passed", "", Kind::Int, "1 if the scenario's expectations were met"),
            column("error", "", Kind::Text, "why the run could not be made"),
            column("seed", "", Kind::Int, "seed of noise and scatter"),
            column("commit", "", Kind::Text, "commit of hil-sim"),
            column("scenario", "", Kind::Text, "name in the sweep"),
        ];
        columns.extend(self.axes.iter().map(|axis| {
            let unit = if axis.is_factor { "x" } else { axis.unit };
            let about = match axis.option {
                "set" => "property of the servo",
                "plant" => "figure of the plant",
                "rig" => "figure of the sensors",
                _ => "figure of the supply",
            };
            column(&axis.column(), unit, Kind::Float, about)
        }));
        columns.extend(METRICS.iter().map(|metric| {
            let kind = if metric.is_word() { Kind::Text } else { Kind::Float };
            column(metric.name, metric.unit(), kind, metric.about)
        }));
        columns
    }

    /// The line of a run, with its line end.
    #[must_use]
    pub fn csv_line(&self, run: &Run, outcome: &Result<Outcome, BadInput>, commit: &str) -> String {
        let mut line = run.index.to_string();
        let passed = outcome.as_ref().is_ok_and(Outcome::passed);
        push(&mut line, if passed { "1" } else { "0" });
        let error = outcome.as_ref().err().map_or_else(String::new, |bad| {
            let BadInput { place, problem, found, expected, .. } = bad;
            format!("{place}: {problem}; found {found}; expected {expected}")
        });
        push(&mut line, &error);
        push(&mut line, &run.seed.to_string());
        push(&mut line, commit);
        push(&mut line, &self.entries[run.entry].name);
        for value in &run.values {
            push(&mut line, &value.to_string());
        }
        for metric in &METRICS {
            match outcome.as_ref().map(|outcome| (metric.get)(&outcome.metrics)) {
                // A negative zero as 0.
                Ok(Value::Number(value)) => push(&mut line, &(value + 0.0).to_string()),
                Ok(Value::Text(text)) => push(&mut line, &text),
                Ok(Value::Absent) | Err(_) => push(&mut line, ""),
            }
        }
        line.push('\n');
        line
    }
}

/// Appends a cell: quoted where it has a comma, a quote or an end of line (RFC 4180), and always on one line.
fn push(line: &mut String, cell: &str) {
    line.push(',');
    if cell.contains([',', '"', '\n', '\r']) {
        line.push('"');
        line.push_str(&cell.replace('"', "\"\"").replace(['\n', '\r'], " "));
        line.push('"');
    } else {
        line.push_str(cell);
    }
}

/// The first line of the CSV, with its line end.
#[must_use]
pub fn head(columns: &[ResultColumn]) -> String {
    let mut line = String::new();
    columns.iter().for_each(|column| push(&mut line, &column.name));
    line.remove(0);
    line.push('\n');
    line
}

/// The cells of a line of CSV without its line end; `None` where a quote is open at its end.
#[must_use]
pub fn fields(line: &str) -> Option<Vec<String>> {
    let mut fields = vec![String::new()];
    let (mut quoted, mut rest) = (false, line.chars().peekable());
    while let Some(c) = rest.next() {
        let last = fields.last_mut()?;
        match (c, quoted) {
            ('"', true) if rest.next_if_eq(&'"').is_some() => last.push('"'),
            ('"', _) => quoted = !quoted,
            (',', false) => fields.push(String::new()),
            _ => last.push(c),
        }
    }
    (!quoted).then_some(fields)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_read_back() {
        let mut line = "0".to_owned();
        let cells = ["", "halls, over-current", "a \"b\"", "x", ","];
        cells.iter().for_each(|cell| push(&mut line, cell));
        let read = fields(&line).expect("whole");
        assert_eq!(read[0], "0");
        assert_eq!(read[1..], cells);
        assert_eq!(fields("1,\"half"), None);
    }
}
