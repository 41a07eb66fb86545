//! `hil-sim worker`: one JSON job a line in, one JSON result a line out, so that any engine can spread runs over processes.

use std::collections::BTreeMap;
use std::error::Error;
use std::io::{self, BufRead, ErrorKind, Read, Write};
use std::path::PathBuf;

use serde::Deserialize;
use serde_json::{Map, Value, json};

use super::figures::Figures;
use super::output::COMMIT;
use hil_experiment::motor_file::MotorFile;
use hil_experiment::report::json_value_of;
use hil_experiment::run::{Options, run};
use hil_experiment::scenario::Scenario;
use hil_world::plant::Model;
use traces::input::{BadInput, shorten};

/// Longest job, bytes: a scenario file of its greatest size, escaped, and the rest.
const MOST_BYTES: u64 = 4 << 20;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Job {
    #[serde(default)]
    id: Value,
    /// A shipped scenario or a file.
    scenario: Option<String>,
    /// The text of a scenario.
    toml: Option<String>,
    /// The file of a motor, in the place of the scenario's.
    motor: Option<PathBuf>,
    #[serde(default)]
    set: Overrides,
    #[serde(default)]
    plant: Overrides,
    #[serde(default)]
    rig: Overrides,
    #[serde(default)]
    supply: Overrides,
    #[serde(default = "one")]
    seed: u64,
    #[serde(default)]
    model: ModelName,
}

const fn one() -> u64 {
    1
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
enum ModelName {
    #[default]
    Averaged,
    Switched,
}

/// `{"KP": 120, "inertia": "1.3x"}`, applied by name, or `["KP=120"]`, applied in order.
#[derive(Deserialize)]
#[serde(untagged)]
enum Overrides {
    Named(BTreeMap<String, Value>),
    Listed(Vec<String>),
}

impl Default for Overrides {
    fn default() -> Self {
        Self::Listed(Vec::new())
    }
}

impl Overrides {
    fn assignments(&self) -> Vec<String> {
        match self {
            Self::Listed(list) => list.clone(),
            Self::Named(named) => named
                .iter()
                .map(|(name, value)| match value {
                    Value::String(text) => format!("{name}={text}"),
                    other => format!("{name}={other}"),
                })
                .collect(),
        }
    }
}

/// Answers the jobs of standard input until it ends, or until nobody reads the results.
///
/// # Errors
/// Standard input or output fails.
pub fn worker() -> Result<bool, Box<dyn Error>> {
    let done = answer_all(&mut io::stdin().lock(), &mut io::stdout().lock());
    match done {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(Box::new(
            BadInput::new("standard input or output", "failed")
                .found(e.to_string())
                .expected("a pipe or a file")
                .next("start the worker again"),
        )),
        _ => Ok(true),
    }
}

fn answer_all(jobs: &mut impl BufRead, results: &mut impl Write) -> io::Result<()> {
    let mut line = Vec::new();
    for number in 1.. {
        line.clear();
        if jobs.take(MOST_BYTES).read_until(b'\n', &mut line)? == 0 {
            return Ok(());
        }
        let is_whole = line.ends_with(b"\n") || (line.len() as u64) < MOST_BYTES;
        if !is_whole {
            skip_line(jobs)?;
        }
        let line = line.trim_ascii();
        if line.is_empty() {
            continue;
        }
        let answer = if is_whole { answer(line, number) } else { too_long(number) };
        writeln!(results, "{answer}")?;
        results.flush()?;
    }
    Ok(())
}

fn skip_line(jobs: &mut impl BufRead) -> io::Result<()> {
    loop {
        let rest = jobs.fill_buf()?;
        let (used, ends) = match rest.iter().position(|byte| *byte == b'\n') {
            Some(at) => (at + 1, true),
            None => (rest.len(), rest.is_empty()),
        };
        jobs.consume(used);
        if ends {
            return Ok(());
        }
    }
}

fn too_long(number: u64) -> Value {
    let bad = BadInput::new(format!("standard input:{number}"), "the job is too long")
        .found(format!("more than {MOST_BYTES} bytes without a line end"))
        .expected("one JSON object a line")
        .next("name a scenario's file instead of its text");
    refusal(&Value::Null, &bad)
}

/// A job is an object: serde would also take its values in a list.
fn object(line: &[u8]) -> serde_json::Result<Job> {
    let value: Map<String, Value> = serde_json::from_slice(line)?;
    serde_json::from_value(Value::Object(value))
}

fn answer(line: &[u8], number: u64) -> Value {
    let job: Job = match object(line) {
        Ok(job) => job,
        Err(e) => {
            // The caller's own number for the job, if it can be read.
            let id = serde_json::from_slice::<Value>(line).ok().and_then(|job| job.get("id").cloned());
            let bad = BadInput::new(format!("standard input:{number}"), e.to_string())
                .found(shorten(&String::from_utf8_lossy(line)))
                .expected("a JSON object with scenario or toml, and motor, set, plant, rig, supply, seed, model, id")
                .next("see docs/sweep.md");
            return refusal(&id.unwrap_or_default(), &bad);
        }
    };
    // A defect of the simulator ends one job, not the worker.
    let done = std::panic::catch_unwind(|| result(&job)).unwrap_or_else(|_| {
        Err(BadInput::new("simulator", "it panicked")
            .found(format!("job of line {number}"))
            .expected("a result")
            .next("report it"))
    });
    match done {
        Ok((passed, result)) => {
            json!({"id": job.id, "ok": true, "passed": passed, "commit": COMMIT, "result": result})
        }
        Err(bad) => refusal(&job.id, &bad),
    }
}

fn refusal(id: &Value, bad: &BadInput) -> Value {
    let BadInput { place, problem, found, expected, next } = bad;
    let error = json!({
        "message": bad.to_string(), "place": place, "problem": problem, "found": found, "expected": expected, "next": next,
    });
    json!({"id": id, "ok": false, "error": error})
}

fn result(job: &Job) -> Result<(bool, Value), BadInput> {
    let mut scenario = match (&job.scenario, &job.toml) {
        (Some(name), None) => Scenario::find(name)?,
        (None, Some(text)) => Scenario::parse("toml", text)?,
        (name, _) => {
            return Err(BadInput::new("job", "needs one scenario")
                .found(
                    if name.is_some() { "scenario and toml" } else { "neither scenario nor toml" }.to_owned(),
                )
                .expected("scenario, a name or a file; or toml, a text")
                .next("give one of the two"));
        }
    };
    if let Some(path) = &job.motor {
        scenario.take_motor(&MotorFile::read(path)?)?;
    }
    for assignment in job.set.assignments() {
        scenario.set(&assignment)?;
    }
    let figures = Figures {
        plant: job.plant.assignments(),
        rig: job.rig.assignments(),
        supply: job.supply.assignments(),
        motor_file: None,
    };
    figures.apply(&mut scenario)?;
    let model = match job.model {
        ModelName::Averaged => Model::Averaged,
        ModelName::Switched => Model::Switched,
    };
    let options = Options { seed: job.seed, model, trace: false };
    let outcome = run(&scenario, &options).map_err(|e| {
        BadInput::new(scenario.arguments.clone(), format!("{} is out of range", e.field))
            .found(e.found.to_string())
            .expected(e.expected)
            .next("correct the job")
    })?;
    Ok((outcome.passed(), json_value_of(&outcome)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn job_beyond_the_greatest_length_is_one_error_and_the_next_is_answered() {
        let mut input = vec![b'x'; MOST_BYTES as usize + 10];
        input.extend_from_slice(b"\n{\"id\": 2}\n");
        let mut out = Vec::new();
        answer_all(&mut input.as_slice(), &mut out).expect("memory");
        let answers: Vec<Value> =
            out.split(|b| *b == b'\n').filter_map(|line| serde_json::from_slice(line).ok()).collect();
        assert_eq!(answers.len(), 2);
        assert_eq!(answers[0]["error"]["problem"], "the job is too long");
        assert_eq!(
            (&answers[1]["id"], &answers[1]["error"]["problem"]),
            (&2.into(), &"needs one scenario".into())
        );
    }
}
