//! Plays the torture chamber until it finds a defect.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::switch::VARIABLE;
use crate::program::typed;

/// Seeds of one start of the simulator, so that a seed without an end is noticed.
const PART: u64 = 20;

/// Short seeds that take as long as one of `hil-sim torture --long`.
pub const PER_LONG: u64 = 50;

/// Time for one seed on a busy core, on average: 0.3 s on a quiet one, and four times as long where boards do not answer.
const SEED: Duration = Duration::from_secs(20);

/// In place of an invariant: a seed has no end.
pub const ENDLESS: &str = "no end";

/// A build of the simulator, and the defect that it has if its bodies are switched.
#[derive(Clone, Copy)]
pub struct Simulator<'a> {
    pub path: &'a Path,
    pub planted: Option<&'a str>,
}

/// The search for one defect, with seeds from 0 on.
pub struct Trial<'a> {
    pub simulator: Simulator<'a>,
    /// The same without a defect.
    pub unchanged: &'a Path,
    /// Where the simulator's output is kept: its name without `.json` and `.txt`.
    pub results: &'a Path,
    pub seeds: u64,
    /// Whether they are the long ones.
    pub is_long: bool,
    pub jobs: usize,
    /// The invariants of which one must break.
    pub until: &'a [String],
    /// Whether a seed without an end is a find.
    pub or_endless: bool,
}

/// What the seeds have found.
#[derive(Debug, Default, PartialEq)]
pub struct Found {
    /// The first seed that broke an expected invariant, and which.
    pub caught: Option<(u64, String)>,
    /// Seeds before it that broke other invariants.
    pub others: BTreeMap<String, u32>,
    /// Seeds that break an expected invariant without the defect as well, which shows nothing.
    pub failing: Vec<u64>,
    /// Seeds that were played, and their simulated time.
    pub seeds: u64,
    pub simulated_s: f64,
}

impl Found {
    /// What else the seeds have shown, for a person.
    pub fn notes(&self) -> String {
        let others = self.others.iter().map(|(name, count)| format!("{name} {count}"));
        let failing = self.failing.iter().map(|seed| format!("seed {seed} fails without it"));
        others.chain(failing).collect::<Vec<_>>().join(", ")
    }
}

/// Seeds that were played together.
#[derive(Debug, PartialEq)]
struct Part {
    failures: Vec<(u64, String)>,
    simulated_s: f64,
}

impl Part {
    fn parse(text: &str) -> Result<Self, String> {
        let value: Value = serde_json::from_str(text).map_err(|error| format!("results: {error}"))?;
        let rows = value["failures"].as_array().ok_or("results: expected failures")?;
        let failure = |row: &Value| Some((row["seed"].as_u64()?, row["invariant"].as_str()?.to_owned()));
        let failures: Option<Vec<_>> = rows.iter().map(failure).collect();
        let hours = value["hand_hours"].as_f64().ok_or("results: expected hand_hours")?;
        let failures = failures.ok_or("results: expected seed and invariant")?;
        Ok(Self { failures, simulated_s: 3600.0 * hours })
    }
}

impl Trial<'_> {
    /// Plays seeds until one breaks an expected invariant and holds without the defect.
    ///
    /// # Errors
    /// The simulator cannot be started, or its output has another form.
    pub fn run(&self) -> Result<Found, String> {
        let unchanged = Simulator { path: self.unchanged, planted: None };
        self.search(
            |at, seeds| self.play(self.simulator, at, seeds),
            |at, seeds| self.play(unchanged, at, seeds),
        )
    }

    /// `play` plays so many seeds with the defect, `without` without it; `None` if they have no end.
    fn search(
        &self,
        play: impl Fn(u64, u64) -> Result<Option<Part>, String>,
        without: impl Fn(u64, u64) -> Result<Option<Part>, String>,
    ) -> Result<Found, String> {
        let mut found = Found::default();
        while found.seeds < self.seeds {
            let (at, seeds) = (found.seeds, self.part().min(self.seeds - found.seeds));
            let Some(part) = play(at, seeds)? else {
                if without(at, seeds)?.is_none() {
                    return Err(format!(
                        "the seeds {at} to {} have no end without the defect either",
                        at + seeds - 1
                    ));
                }
                found.caught = self.or_endless.then(|| (at, ENDLESS.to_owned()));
                *found.others.entry(ENDLESS.to_owned()).or_default() += u32::from(!self.or_endless);
                break;
            };
            found.simulated_s += part.simulated_s;
            let first = part.failures.iter().filter(|(_, name)| self.until.contains(name)).min();
            for (seed, name) in &part.failures {
                if first.is_none_or(|(first, _)| seed < first) {
                    *found.others.entry(name.clone()).or_default() += 1;
                }
            }
            let Some((seed, name)) = first else {
                found.seeds += seeds;
                continue;
            };
            found.seeds = seed + 1;
            if without(*seed, 1)?.is_some_and(|part| part.failures.is_empty()) {
                found.caught = Some((*seed, name.clone()));
                break;
            }
            found.failing.push(*seed);
        }
        Ok(found)
    }

    /// Seeds of one start.
    const fn part(&self) -> u64 {
        if self.is_long { 1 } else { PART }
    }

    fn play(&self, simulator: Simulator, at: u64, seeds: u64) -> Result<Option<Part>, String> {
        let mut command = simulator.torture();
        command.args(["--seed", &at.to_string(), "--seeds", &seeds.to_string(), "--json", "--no-shrink"]);
        command.args(["--jobs", &self.jobs.to_string(), "--until", &self.until.join(",")]);
        command.args(self.is_long.then_some("--long"));
        let (results, messages) = (self.results.with_extension("json"), self.results.with_extension("txt"));
        let file = |path: &Path| File::create(path).map_err(|error| format!("{}: {error}", path.display()));
        // Files, not pipes: nobody reads before the end.
        command.stdin(Stdio::null()).stdout(file(&results)?).stderr(file(&messages)?);
        let line = typed(&command);
        let explained = |error: String| format!("{error}\n  repeat with: {line}");
        let short = if self.is_long { PER_LONG * seeds } else { seeds };
        let deadline = SEED * u32::try_from(short).unwrap_or(u32::MAX);
        let ended = ended(&mut command, deadline).map_err(&explained)?;
        if let Some(status) = ended.filter(|status| !matches!(status.code(), Some(0 | 1))) {
            return Err(explained(status.to_string()));
        }
        if ended.is_none() {
            return Ok(None);
        }
        let text = std::fs::read_to_string(&results).map_err(|error| explained(error.to_string()))?;
        Part::parse(&text).map(Some).map_err(explained)
    }
}

impl Simulator<'_> {
    fn torture(self) -> Command {
        let mut command = Command::new(self.path);
        command.arg("torture").env("RUST_BACKTRACE", "0").env(VARIABLE, self.planted.unwrap_or_default());
        command
    }

    /// The names of all invariants.
    ///
    /// # Errors
    /// The simulator cannot be started.
    pub fn invariants(self) -> Result<Vec<String>, String> {
        let mut command = self.torture();
        command.arg("--list");
        let text = crate::program::output(command)?;
        let rows = text.lines().skip_while(|line| !line.starts_with("| Invariant")).skip(2);
        let rows = rows.take_while(|line| line.starts_with('|'));
        Ok(rows.filter_map(|row| Some(row.split('|').nth(1)?.trim().to_owned())).collect())
    }

    /// Everything that the report of a seed says: its world, its end and the last events of all boards.
    ///
    /// # Errors
    /// The simulator cannot be started, or writes no report.
    pub fn report(self, seed: u64, path: &Path) -> Result<String, String> {
        let _ = std::fs::remove_file(path);
        let mut command = self.torture();
        command.args(["--seed", &seed.to_string(), "--replay"]).arg(path);
        let line = typed(&command);
        // A seed that fails has a report as well.
        command.output().map_err(|error| format!("{error}\n  repeat with: {line}"))?;
        std::fs::read_to_string(path).map_err(|error| format!("{error}\n  repeat with: {line}"))
    }
}

/// Runs a program, and kills it at its deadline. Returns how it ended by itself.
///
/// # Errors
/// It cannot be started.
pub fn ended(command: &mut Command, deadline: Duration) -> Result<Option<ExitStatus>, String> {
    command.spawn().and_then(|child| end(child, deadline)).map_err(|error| error.to_string())
}

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
        std::thread::park_timeout(Duration::from_millis(20));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A search for `prompt` or `abort` among 50 seeds; which seeds fail with the defect, and which without.
    fn search(with: &[(u64, &str)], without: &[u64], endless: Option<u64>, or_endless: bool) -> Found {
        let until = ["prompt".to_owned(), "abort".to_owned()];
        let nowhere = Path::new("");
        let simulator = Simulator { path: nowhere, planted: None };
        let trial = Trial {
            simulator,
            unchanged: nowhere,
            results: nowhere,
            seeds: 50,
            is_long: false,
            jobs: 1,
            until: &until,
            or_endless,
        };
        let play = |at: u64, seeds: u64| {
            let range = at..at + seeds;
            let failures: Vec<(u64, String)> = with
                .iter()
                .filter(|(seed, _)| range.contains(seed))
                .map(|&(seed, name)| (seed, name.to_owned()))
                .collect();
            let is_endless = endless.is_some_and(|seed| range.contains(&seed));
            Ok((!is_endless).then_some(Part { failures, simulated_s: 10.0 }))
        };
        let alone = |at: u64, _: u64| {
            let failures = without.iter().filter(|&&seed| seed == at).map(|&seed| (seed, "abort".to_owned()));
            Ok(Some(Part { failures: failures.collect(), simulated_s: 0.0 }))
        };
        trial.search(play, alone).expect("played")
    }

    #[test]
    fn first_seed_of_an_expected_invariant_catches() {
        let found = search(&[(3, "energy"), (12, "abort"), (5, "energy"), (9, "prompt")], &[], None, true);
        assert_eq!(found.caught, Some((9, "prompt".to_owned())));
        assert_eq!((found.seeds, found.notes().as_str()), (10, "energy 2"));
    }

    #[test]
    fn other_invariants_do_not_catch() {
        let found = search(&[(3, "energy"), (33, "energy")], &[], None, true);
        assert_eq!((found.caught.as_ref(), found.seeds, found.simulated_s), (None, 50, 30.0));
        assert_eq!(found.notes(), "energy 2");
    }

    #[test]
    fn seed_that_fails_without_the_defect_does_not_catch() {
        let found = search(&[(9, "prompt"), (12, "abort")], &[9], None, true);
        assert_eq!(found.caught, Some((12, "abort".to_owned())));
        assert_eq!(found.notes(), "seed 9 fails without it");
    }

    #[test]
    fn seed_without_an_end_catches_where_anything_may() {
        assert_eq!(search(&[], &[], Some(25), true).caught, Some((20, ENDLESS.to_owned())));
        let found = search(&[], &[], Some(25), false);
        assert_eq!((found.caught.as_ref(), found.notes().as_str()), (None, "no end 1"));
    }

    #[test]
    fn results_without_their_fields_are_an_error() {
        let text = r#"{ "hand_hours": 0.5, "failures": [{ "seed": 3, "invariant": "abort" }] }"#;
        let part = Part { failures: vec![(3, "abort".to_owned())], simulated_s: 1800.0 };
        assert_eq!(Part::parse(text), Ok(part));
        assert!(Part::parse("{}").is_err());
    }

    #[test]
    fn program_without_an_end_is_killed() {
        // The compiler, since whoever runs this test has it: it reads a program from a pipe that nobody closes.
        let mut waiting = Command::new("rustc");
        waiting.arg("-").stdin(Stdio::piped());
        assert_eq!(ended(&mut waiting, Duration::from_millis(1)), Ok(None));
        let mut version = Command::new("rustc");
        version.arg("--version").stdout(Stdio::null());
        let end = ended(&mut version, Duration::from_secs(60));
        assert!(end.is_ok_and(|end| end.is_some_and(|it| it.success())));
    }
}
