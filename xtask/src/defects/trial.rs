//! Plays the torture chamber until it finds a defect.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::program::typed;

/// The seeds of one defect.
pub struct Trial<'a> {
    pub simulator: &'a Path,
    /// Where the simulator's output is kept: its name without `.json` and `.txt`.
    pub results: &'a Path,
    pub seeds: u32,
}

/// What the seeds have found.
#[derive(Debug, PartialEq)]
pub struct Found {
    /// The first seed that broke an expected invariant, and which.
    caught: Option<(u64, String)>,
    /// Seeds before it that broke other invariants.
    others: BTreeMap<String, u32>,
    /// Seeds that were played, their simulated time and their real time, s.
    seeds: u64,
    simulated_s: f64,
    seconds: f64,
    ended: bool,
}

impl Found {
    pub fn seed(&self) -> Option<u64> {
        self.caught.as_ref().map(|(seed, _)| *seed)
    }

    /// Why an expected invariant was not broken, as far as the seeds say.
    pub fn why(&self) -> String {
        if !self.ended {
            return format!(": they had no end within {} s", self.seconds.round());
        }
        if self.others.is_empty() { String::new() } else { format!(", but by {}", self.others()) }
    }

    fn others(&self) -> String {
        self.others.iter().map(|(name, count)| format!("{name} {count}")).collect::<Vec<_>>().join(", ")
    }

    /// The cells of the table: invariant, seeds, simulated and real seconds, others.
    pub fn cells(&self) -> String {
        let (by, seeds) = match &self.caught {
            Some((seed, invariant)) => (invariant.as_str(), seed + 1),
            None => ("**not caught**", self.seeds),
        };
        format!("{by} | {seeds} | {:.0} | {:.1} | {}", self.simulated_s, self.seconds, self.others())
    }

    fn parse(text: &str, expected: &[String]) -> Result<Self, String> {
        let value: Value = serde_json::from_str(text).map_err(|error| format!("results: {error}"))?;
        let rows = value["failures"].as_array().ok_or("results: expected failures")?;
        let failure = |row: &Value| Some((row["seed"].as_u64()?, row["invariant"].as_str()?.to_owned()));
        let failures: Vec<(u64, String)> =
            rows.iter().map(failure).collect::<Option<_>>().ok_or("results: expected seed and invariant")?;
        let caught = failures.iter().filter(|(_, name)| expected.contains(name)).min().cloned();
        let mut others = BTreeMap::new();
        for (seed, name) in &failures {
            if !expected.contains(name) && caught.as_ref().is_none_or(|(first, _)| seed < first) {
                *others.entry(name.clone()).or_default() += 1;
            }
        }
        let seeds = value["seeds"].as_u64().ok_or("results: expected seeds")?;
        let number = |name: &str| value[name].as_f64().ok_or_else(|| format!("results: expected {name}"));
        let (simulated_s, seconds) = (3600.0 * number("hand_hours")?, number("wall_s")?);
        Ok(Self { caught, others, seeds, simulated_s, seconds, ended: true })
    }
}

impl Trial<'_> {
    /// Plays seeds from 0 on until one breaks an expected invariant.
    ///
    /// # Errors
    /// The simulator cannot be started, or its output has another form.
    pub fn run(&self, expected: &[String], deadline: Duration) -> Result<Found, String> {
        let mut command = Command::new(self.simulator);
        command.args(["torture", "--seed", "0", "--seeds", &self.seeds.to_string(), "--json", "--no-shrink"]);
        command.args(["--until", &expected.join(",")]).env("RUST_BACKTRACE", "0");
        let (results, messages) = (self.results.with_extension("json"), self.results.with_extension("txt"));
        let file = |path: &Path| File::create(path).map_err(|error| format!("{}: {error}", path.display()));
        // Files, not pipes: nobody reads before the end.
        command.stdin(Stdio::null()).stdout(file(&results)?).stderr(file(&messages)?);
        let line = typed(&command);
        let explained = |error: String| format!("{error}\n  repeat with: {line}");
        let begun = Instant::now();
        let ended = command
            .spawn()
            .and_then(|child| end(child, deadline))
            .map_err(|error| explained(error.to_string()))?;
        if let Some(status) = ended.filter(|status| !matches!(status.code(), Some(0 | 1))) {
            return Err(explained(status.to_string()));
        }
        if ended.is_none() {
            let seconds = begun.elapsed().as_secs_f64();
            return Ok(Found {
                caught: None,
                others: BTreeMap::new(),
                seeds: 0,
                simulated_s: 0.0,
                seconds,
                ended: false,
            });
        }
        let text = std::fs::read_to_string(&results).map_err(|error| explained(error.to_string()))?;
        Found::parse(&text, expected).map_err(explained)
    }
}

/// Waits for a program, and kills it at its deadline. Returns how it ended by itself.
fn end(mut child: Child, deadline: Duration) -> std::io::Result<Option<ExitStatus>> {
    let until = Instant::now() + deadline;
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status));
        }
        if Instant::now() >= until {
            child.kill()?;
            child.wait()?;
            return Ok(None);
        }
        std::thread::park_timeout(Duration::from_millis(50));
    }
}

/// Whether every invariant holds in a seed.
///
/// # Errors
/// The simulator cannot be started.
pub fn holds(simulator: &Path, seed: u64) -> Result<bool, String> {
    let mut command = Command::new(simulator);
    command.args(["torture", "--seed", &seed.to_string(), "--json", "--no-shrink"]);
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let line = typed(&command);
    command.status().map(|status| status.success()).map_err(|error| format!("{error}\n  repeat with: {line}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(failures: &str) -> Found {
        let text =
            format!(r#"{{ "seeds": 40, "hand_hours": 0.5, "wall_s": 7.25, "failures": [{failures}] }}"#);
        Found::parse(&text, &["prompt".to_owned(), "abort".to_owned()]).expect("complete")
    }

    fn failure(seed: u32, invariant: &str) -> String {
        format!(r#"{{ "seed": {seed}, "invariant": "{invariant}" }}"#)
    }

    #[test]
    fn first_seed_of_an_expected_invariant_catches() {
        let rows = [failure(3, "energy"), failure(12, "abort"), failure(5, "energy"), failure(9, "prompt")];
        let found = found(&rows.join(","));
        assert_eq!(found.seed(), Some(9));
        assert_eq!(found.cells(), "prompt | 10 | 1800 | 7.2 | energy 2");
    }

    #[test]
    fn other_invariants_do_not_catch() {
        let found = found(&failure(3, "energy"));
        assert_eq!(found.seed(), None);
        assert_eq!(
            (found.cells().as_str(), found.why().as_str()),
            ("**not caught** | 40 | 1800 | 7.2 | energy 1", ", but by energy 1")
        );
        assert!(Found::parse("{}", &[]).is_err());
    }

    #[test]
    fn program_without_an_end_is_killed() {
        let child = |seconds: &str| Command::new("sleep").arg(seconds).spawn().expect("there is sleep");
        assert_eq!(end(child("60"), Duration::from_millis(1)).expect("killed"), None);
        assert!(end(child("0"), Duration::from_secs(60)).expect("ended").is_some_and(|it| it.success()));
    }
}
