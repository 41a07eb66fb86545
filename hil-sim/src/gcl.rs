//! `hil-sim gcl`: Grasper Control Language from a file or standard input, in simulated time, as fast as the machine can.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Duration;

use god::Memory;
use god::io::ABORT;
use serde::Serialize;

use super::lines::Lines;
use super::output::print;
use hil_experiment::events::{self, Event};
use hil_experiment::typist::{NoPrompt, Reply, Typist};
use hil_experiment::{grasp, picture};
use hil_world::hand::Hand;
use hil_world::hand::scene::Scene;
use hil_world::plant::Model;
use programs::files;
use programs::output::warn;
use traces::input::BadInput;

/// Most lines with --json, whose object holds all replies: a day of typing, and under a gigabyte of the longest answers.
const MAX_JSON_LINES: usize = 100_000;

/// The arguments of `hil-sim gcl`.
#[derive(clap::Args)]
pub struct GclArgs {
    /// A file with one line per command; default: standard input. Lines that start with # are skipped.
    #[arg(long, value_name = "FILE")]
    script: Option<PathBuf>,
    /// Objects between the fingers: a TOML file such as hil-sim/grasps/ball.toml; default: none.
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Draw the hand at the end, and faintly at the start, into an SVG file.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Print the last events of GOD and the boards to standard error at the end; with --json, as `events` of the object.
    #[arg(long)]
    events: bool,
    /// Print one JSON object and nothing else.
    #[arg(long)]
    json: bool,
    /// Seed of the sensor noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

#[derive(Serialize)]
struct Json {
    lines: Vec<Reply>,
    /// Unsolicited output after the last line.
    #[serde(rename = "unasked")]
    unsolicited: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    events: Option<Vec<Event>>,
    simulated_s: f64,
    wall_s: f64,
    realtime_x: f64,
}

/// Types the lines; `clock` is real time. Returns whether no line ended in an error.
///
/// # Errors
/// The script cannot be read, or the hand does not prompt in time.
pub fn gcl(args: &GclArgs, clock: &dyn Fn() -> Duration) -> Result<bool, Box<dyn Error>> {
    let mut lines = Lines::open(args.script.as_deref())?;
    let start = clock();
    let mut hand = Hand::new(Model::Averaged, args.seed, Memory::default());
    let read = |path: &Path| grasp::read(path, &hand.pose());
    let scene = args.scenario.as_deref().map_or_else(|| Ok(Scene::default()), read)?;
    hand.set_scene(scene.clone());
    let start_pose = hand.pose();
    let (mut typist, banner) = Typist::new(hand)?;
    if !args.json {
        print(&format!("{}\n", banner.trim().replace('\r', "")))?;
    }
    let (replies, ok) = run_lines(args, &mut lines, &mut typist)?;
    let unsolicited = typist.unsolicited();
    let events = args.events.then(|| events::of_hand(typist.hand()));
    if !args.json {
        print(&after_prompts(&unsolicited))?;
        warn_events(events.as_deref().unwrap_or_default());
    }
    if let Some(path) = &args.report {
        let svg = picture::svg(&scene, &start_pose, &typist.hand().pose(), &title(args));
        files::replace(path, svg.as_bytes()).map_err(|error| {
            BadInput::new(format!("--report {}", path.display()), "cannot be written")
                .found(error.to_string())
                .expected("a file in an existing folder")
                .next("choose another path or free space")
        })?;
    }
    if args.json {
        let simulated_s = typist.hand().now_us() as f64 * 1e-6;
        let wall_s = (clock() - start).as_secs_f64();
        let realtime_x = simulated_s / wall_s;
        let json = Json { lines: replies, unsolicited, events, simulated_s, wall_s, realtime_x };
        print(&format!("{}\n", serde_json::to_string(&json)?))?;
    }
    Ok(ok)
}

/// The replies for --json, and whether no line ended in an error. Without --json the replies are printed and dropped: the input may
/// have no end.
fn run_lines(args: &GclArgs, lines: &mut Lines, typist: &mut Typist) -> Result<(Vec<Reply>, bool), BadInput> {
    let (mut replies, mut ok) = (Vec::new(), true);
    loop {
        if !args.json && lines.are_typed {
            print("=> ")?;
        }
        let Some(line) = lines.next_line()? else { return Ok((replies, ok)) };
        check(&line, || lines.place())?;
        if args.json && replies.len() >= MAX_JSON_LINES {
            return Err(too_many(lines.place()));
        }
        let reply = typist.run_line(&line).map_err(|no_prompt| {
            warn_events(&events::of_hand(typist.hand()));
            timed_out(lines.place(), &no_prompt)
        })?;
        ok &= reply.status == 0;
        if args.json {
            replies.push(reply);
        } else {
            print(&transcript(&reply, !lines.are_typed))?;
        }
    }
}

/// Refuses what the hand would answer with ERR 128, and says where it is: bytes that are neither printable ASCII nor a key (^C, tab, backspace,
/// delete). Nothing of the line runs, as in the hand.
fn check(line: &str, place: impl Fn() -> String) -> Result<(), BadInput> {
    let is_typed = |byte: u8| matches!(byte, b' '..=0x7F | ABORT | b'\t' | 8);
    let Some(at) = line.bytes().position(|byte| !is_typed(byte)) else { return Ok(()) };
    let byte = line.as_bytes()[at];
    let mark = if line.starts_with('\u{FEFF}') { ", of a byte order mark" } else { "" };
    Err(BadInput::new(place(), "the hand does not take this line")
        .found(format!("byte 0x{byte:02X} in column {}{mark}", at + 1))
        .expected("ASCII text, as a person types it")
        .next("save the file as plain ASCII; packets and control blocks are for programs: hil-sim hand"))
}

fn too_many(place: String) -> BadInput {
    BadInput::new(place, "too many lines for one JSON object")
        .found(format!("more than {MAX_JSON_LINES} lines"))
        .expected("an input that ends")
        .next("split the script, or omit --json")
}

fn timed_out(place: String, no_prompt: &NoPrompt) -> BadInput {
    BadInput::new(place, "the hand did not prompt")
        .found(no_prompt.to_string())
        .expected(format!("a prompt within {} s of simulated time", no_prompt.limit_s))
        .next("end a line that never ends by itself with ^C; otherwise report this with the events above")
}

fn warn_events(events: &[Event]) {
    if !events.is_empty() {
        warn(events::text(events).trim_end());
    }
}

fn title(args: &GclArgs) -> String {
    let name = |path: &Option<PathBuf>, or: &str| {
        path.as_deref()
            .and_then(Path::file_stem)
            .map_or(or.to_owned(), |name| name.to_string_lossy().into_owned())
    };
    format!(
        "{}: after {}",
        name(&args.scenario, "nothing between the fingers"),
        name(&args.script, "the lines typed")
    )
}

fn after_prompts(unsolicited: &[String]) -> String {
    unsolicited.iter().map(|text| format!("=> \n{text}\n")).collect()
}

fn transcript(reply: &Reply, echo: bool) -> String {
    let mut text = after_prompts(&reply.unsolicited);
    if echo {
        text.push_str(&format!("=> {}\n", reply.line));
    }
    if !reply.answer.is_empty() {
        text.push_str(&reply.answer);
        text.push('\n');
    }
    text
}
