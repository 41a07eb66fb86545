//! `hil-sim gcl`: Grasper Control Language from a file or standard input, in simulated time, as fast as the machine can.

use std::error::Error;
use std::fs::File;
use std::io::{BufRead, BufReader, IsTerminal, Read, stdin};
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::experiment::grasp;
use crate::experiment::input::BadInput;
use crate::experiment::picture;
use crate::experiment::typist::{Answered, Typist};
use crate::world::hand::Hand;
use crate::world::hand::scene::Scene;
use crate::world::plant::Model;
use god::Memory;
use serde::Serialize;

use crate::ports::output::{print, replace};

/// Longest line of a script: more than ten times what the hand takes, so that it can say what is wrong with a line.
const LONGEST: usize = 4096;

/// The arguments of `hil-sim gcl`.
#[derive(clap::Args)]
pub struct GclArgs {
    /// The lines, as they would be typed; without it, standard input. Lines that begin with # are left out.
    #[arg(long, value_name = "FILE")]
    script: Option<PathBuf>,
    /// What is between the fingers: a TOML file such as hil-sim/grasps/ball.toml; without it, nothing.
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Write a picture of the hand as it stands at the end, and faintly as it stood at the start, as SVG.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Print one JSON object and nothing else.
    #[arg(long)]
    json: bool,
    /// Seed of the sensors' noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// All that was said, for programs.
#[derive(Serialize)]
struct Json {
    lines: Vec<Answered>,
    /// What was said after the last one.
    unasked: Vec<String>,
    simulated_s: f64,
    wall_s: f64,
    realtime_x: f64,
}

/// Types the lines; `elapsed` is real time since the start. Returns whether no line came to an error.
///
/// # Errors
/// The script cannot be read; the hand does not prompt any more.
pub fn gcl(args: &GclArgs, elapsed: &dyn Fn() -> Duration) -> Result<bool, Box<dyn Error>> {
    let mut lines = Lines::open(args.script.as_deref())?;
    let begun = elapsed();
    let mut hand = Hand::new(Model::Averaged, args.seed, Memory::default());
    let scene = args.scenario.as_deref().map_or_else(|| Ok(Scene::default()), grasp::read)?;
    hand.set_scene(scene.clone());
    let start = hand.pose();
    let (mut typist, hello) = Typist::new(hand)?;
    let mut answers = Vec::new();
    let mut ok = true;
    if !args.json {
        print(&format!("{}\n", hello.trim().replace('\r', "")))?;
    }
    loop {
        if !args.json && lines.are_typed {
            print("=> ")?;
        }
        let Some(line) = lines.next_line()? else { break };
        let answered = typist.line(&line).map_err(|silent| BadInput {
            place: lines.place(),
            problem: "the hand does not prompt any more".to_owned(),
            found: silent.to_string(),
            expected: format!("a prompt within {} s of simulated time", silent.seconds),
            next: "end a line that goes on for ever with ^C; if it should have ended, report it".to_owned(),
        })?;
        ok &= answered.status == 0;
        if args.json {
            answers.push(answered);
        } else {
            print(&spoken(&answered, !lines.are_typed))?;
        }
    }
    let unasked = typist.unasked();
    if !args.json {
        print(&told(&unasked))?;
    }
    if let Some(path) = &args.report {
        let svg = picture::svg(&scene, &start, &typist.hand().pose(), &title(args));
        replace(path, svg.as_bytes()).map_err(|error| BadInput {
            place: format!("--report {}", path.display()),
            problem: "cannot be written".to_owned(),
            found: error.to_string(),
            expected: "a file in a folder that exists".to_owned(),
            next: "choose another path or free space".to_owned(),
        })?;
    }
    if args.json {
        let simulated_s = typist.hand().now_us() as f64 * 1e-6;
        let wall_s = (elapsed() - begun).as_secs_f64();
        let json = Json { lines: answers, unasked, simulated_s, wall_s, realtime_x: simulated_s / wall_s };
        print(&format!("{}\n", serde_json::to_string(&json)?))?;
    }
    Ok(ok)
}

/// What a picture is of.
fn title(args: &GclArgs) -> String {
    let name = |path: &Option<PathBuf>, or: &str| {
        path.as_deref()
            .and_then(Path::file_stem)
            .map_or(or.to_owned(), |name| name.to_string_lossy().into_owned())
    };
    format!(
        "{}: after {}",
        name(&args.scenario, "nothing between the fingers"),
        name(&args.script, "what was typed")
    )
}

/// What nobody asked for, as on a terminal: each after a prompt.
fn told(unasked: &[String]) -> String {
    unasked.iter().map(|text| format!("=> \n{text}\n")).collect()
}

/// A line and its answer, as on a terminal.
fn spoken(answered: &Answered, echo: bool) -> String {
    let mut text = told(&answered.unasked);
    if echo {
        text.push_str(&format!("=> {}\n", answered.line));
    }
    if !answered.answer.is_empty() {
        text.push_str(&answered.answer);
        text.push('\n');
    }
    text
}

/// Where lines come from.
pub struct Lines {
    from: Box<dyn BufRead>,
    name: String,
    /// A person types them, and sees them.
    pub are_typed: bool,
    number: usize,
}

impl Lines {
    /// Of a file, or of standard input.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn open(script: Option<&Path>) -> Result<Self, BadInput> {
        let Some(path) = script else {
            let are_typed = stdin().is_terminal();
            let from = Box::new(BufReader::new(stdin()));
            return Ok(Self { from, name: "standard input".to_owned(), are_typed, number: 0 });
        };
        let name = format!("--script {}", path.display());
        let from = File::open(path).map_err(|error| BadInput {
            place: name.clone(),
            problem: "cannot be read".to_owned(),
            found: error.to_string(),
            expected: "a file of lines as they would be typed".to_owned(),
            next: "check the path, or leave --script out and give the lines on standard input".to_owned(),
        })?;
        Ok(Self { from: Box::new(BufReader::new(from)), name, are_typed: false, number: 0 })
    }

    /// Where the last line was.
    pub fn place(&self) -> String {
        format!("{}:{}", self.name, self.number)
    }

    /// The next line without its end; `None` at the end.
    ///
    /// # Errors
    /// It cannot be read, is too long, or no text.
    pub fn next_line(&mut self) -> Result<Option<String>, BadInput> {
        loop {
            self.number += 1;
            let mut line = Vec::new();
            let read = (&mut self.from).take(LONGEST as u64 + 1).read_until(b'\n', &mut line);
            let problem = match read {
                Ok(0) => return Ok(None),
                Err(error) => error.to_string(),
                Ok(_) if line.len() > LONGEST => format!("more than {LONGEST} bytes without an end of line"),
                Ok(_) => match String::from_utf8(line) {
                    Ok(line) if line.starts_with('#') => continue,
                    Ok(line) => return Ok(Some(line.trim_end_matches(['\r', '\n']).to_owned())),
                    Err(_) => "bytes that are no UTF-8".to_owned(),
                },
            };
            return Err(BadInput {
                place: self.place(),
                problem: "this line cannot be read".to_owned(),
                found: problem,
                expected: format!("lines of text of up to {LONGEST} bytes"),
                next: "give a text file with a command a line".to_owned(),
            });
        }
    }
}
