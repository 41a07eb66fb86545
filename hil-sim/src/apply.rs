//! `hil-sim apply`: writes tuned values to boards and takes them back; `cargo xtask apply` starts it.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde_json::{Value, json};
use tater_wire::{MotorKind, Node as Id};

use super::output::print;
use commission::adapter::Adapter;
use commission::apply::{Board, Broken, Present, State};
use commission::excite::Failure;
use commission::undo::{Kept, Undo, path_of, read_boards, write_back, write_kept};
use hil_tuning::tuned::{Motor, Tuned};
use programs::output::warn;
use programs::{files, interrupt};
use traces::input::BadInput;

#[derive(clap::Args)]
pub struct ApplyArgs {
    /// The file of `hil-sim export`.
    #[arg(value_name = "FILE", default_value = "tuned.json")]
    file: PathBuf,
    /// An SLCAN adapter: HOST:PORT, as served by `hil-sim bus`, or a serial port. With --undo the default is the adapter of the apply.
    #[arg(long, value_name = "HOST:PORT|TTY", required_unless_present_any = ["can", "undo"], conflicts_with = "can")]
    slcan: Option<String>,
    /// A CAN interface of Linux, such as can0.
    #[arg(long, value_name = "IFACE")]
    can: Option<String>,
    /// Only this board: 1 to 3 links, 4 the spread, 5 to 7 tips; repeatable. Default: all with a motor that FILE names.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=31))]
    node: Vec<u8>,
    /// Write the values from before the apply, and store them.
    #[arg(long)]
    undo: bool,
    /// Show the difference and write nothing.
    #[arg(long)]
    dry_run: bool,
    /// Print one JSON object and nothing else.
    #[arg(long)]
    json: bool,
}

/// Returns whether the boards hold what was asked for.
///
/// # Errors
/// A file that may not be applied, no adapter, or a board that is missing or moves: nothing was written.
pub fn apply(args: &ApplyArgs, clock: &dyn Fn() -> Duration) -> Result<bool, Box<dyn Error>> {
    // The first ^C ends with whole boards.
    interrupt::finish_first();
    let path = path_of(&args.file);
    let done = if args.undo { take_back(args, &path, clock) } else { put(args, &path, clock) };
    match done {
        Err(Failure::Interrupted) => {
            warn("interrupted: nothing was written");
            Ok(false)
        }
        Err(failed) => Err(failed.into()),
        Ok(is_done) => Ok(is_done),
    }
}

fn put(args: &ApplyArgs, path: &Path, clock: &dyn Fn() -> Duration) -> Result<bool, Failure> {
    let tuned = Tuned::parse(&args.file.display().to_string(), &read(&args.file)?)?;
    let adapter = adapter(args)?;
    let nodes = nodes(args, &tuned);
    let before = Undo::load(path)?;
    let mut link = adapter.open(clock, &interrupt::interrupted)?;
    let values = |present: &Present| Ok(motor_of(args, &tuned, present)?.values());
    let mut boards = read_boards(link.as_mut(), &nodes, &values, &mut |step| warn(step))?;
    for motor in &tuned.motors {
        if boards.iter().all(|board| Some(board.present.kind) != motor.kind()) {
            warn(&format!("note: {} is left out: --node names no board with such a motor", motor.motor));
        }
    }
    let mut undo = before.clone().unwrap_or_else(|| Undo::new(adapter.clone()));
    undo.keep(path, &boards)?;
    undo.keep_others(&mut boards);
    undo.adapter = adapter;
    let told = Told { args, path, boards: &boards };
    if args.dry_run {
        return told.shown();
    }
    told.difference()?;
    let done = write_kept(link.as_mut(), path, (before, undo), &boards, &mut |step| warn(step))?;
    link.remark().iter().for_each(|text| warn(text));
    told.end(&done)
}

fn take_back(args: &ApplyArgs, path: &Path, clock: &dyn Fn() -> Duration) -> Result<bool, Failure> {
    let Some(mut undo) = Undo::load(path)? else {
        return Err(Failure::from(BadInput::new(path.display().to_string(), "there is nothing to take back").found("no such file").expected(format!("the old values that `apply {}` keeps", args.file.display())).next("name the file that was applied, in its folder; after an undo nothing is left to take back")));
    };
    let is_wanted = |kept: &Kept| args.node.is_empty() || args.node.contains(&kept.node().number());
    if let Some(node) =
        args.node.iter().find(|node| undo.boards.iter().all(|kept| kept.node().number() != **node))
    {
        return Err(Failure::from(
            BadInput::new(
                format!("--node {node}"),
                format!("{} has no old values of this board", path.display()),
            )
            .found(format!("node {node}"))
            .expected(
                undo.boards
                    .iter()
                    .map(|kept| kept.node().number().to_string())
                    .collect::<Vec<_>>()
                    .join(", "),
            )
            .next("name one of those, or omit --node"),
        ));
    }
    let adapter = adapter(args).unwrap_or_else(|_| undo.adapter.clone());
    let mut link = adapter.open(clock, &interrupt::interrupted)?;
    let nodes: Vec<Id> = undo.boards.iter().filter(|kept| is_wanted(kept)).map(Kept::node).collect();
    let values = |present: &Present| undo.values(path, present);
    let mut boards = read_boards(link.as_mut(), &nodes, &values, &mut |step| warn(step))?;
    undo.keep_others(&mut boards);
    let told = Told { args, path, boards: &boards };
    if args.dry_run {
        return told.shown();
    }
    told.difference()?;
    let done = write_back(link.as_mut(), path, &mut undo, &boards, &mut |step| warn(step))?;
    link.remark().iter().for_each(|text| warn(text));
    told.end(&done)
}

fn read(path: &Path) -> Result<String, BadInput> {
    let bad = |problem: &str, found: String| {
        BadInput::new(path.display().to_string(), problem)
            .found(found)
            .expected("a file of `hil-sim export`")
            .next("make it: hil-sim export DIR --to tuned.json")
    };
    files::read_text(path).map_err(|error| bad("cannot be read", error.to_string()))
}

fn adapter(args: &ApplyArgs) -> Result<Adapter, BadInput> {
    Adapter::named(args.slcan.as_deref(), args.can.as_deref())
}

/// The boards that are named, or all of a hand with a motor of the file's.
fn nodes(args: &ApplyArgs, tuned: &Tuned) -> Vec<Id> {
    let hand = |node: &u8| {
        let kind = Id::new(*node).map(MotorKind::of);
        tuned.motors.iter().any(|motor| motor.kind() == kind)
    };
    let mut numbers: Vec<u8> =
        if args.node.is_empty() { (1..=7).filter(hand).collect() } else { args.node.clone() };
    numbers.sort_unstable();
    numbers.dedup();
    numbers.into_iter().filter_map(Id::new).collect()
}

fn motor_of<'a>(args: &ApplyArgs, tuned: &'a Tuned, present: &Present) -> Result<&'a Motor, BadInput> {
    let found = tuned.motors.iter().find(|motor| motor.kind() == Some(present.kind));
    found.ok_or_else(|| {
        BadInput::new(
            args.file.display().to_string(),
            format!("has no values for node {}", present.node.number()),
        )
        .found(format!("its motor is a {} (KIND)", present.kind.name()))
        .expected(tuned.motors.iter().map(|motor| motor.motor.as_str()).collect::<Vec<_>>().join(", "))
        .next("name boards with such a motor (--node), or tune this kind")
    })
}

/// What is printed.
struct Told<'a> {
    args: &'a ApplyArgs,
    path: &'a Path,
    boards: &'a [Board],
}

impl Told<'_> {
    fn difference(&self) -> Result<(), BadInput> {
        if self.args.json {
            return Ok(());
        }
        let mut text = String::new();
        for Board { present, changes, .. } in self.boards {
            text.push_str(&format!("node {}, {}\n", present.node.number(), present.kind.name()));
            for change in changes {
                let name = change.property.row().name;
                let (old, new) = (change.old, change.new);
                text.push_str(&if old == new {
                    format!("  {name:<6} {old:>6}    as it is\n")
                } else {
                    format!("  {name:<6} {old:>6} -> {new}\n")
                });
            }
        }
        print(&text)
    }

    /// The end of a run that writes nothing.
    fn shown(&self) -> Result<bool, Failure> {
        if self.args.json {
            print(&format!("{}\n", self.object(None)))?;
        } else {
            self.difference()?;
            print("nothing was written (--dry-run)\n")?;
        }
        Ok(true)
    }

    fn end(&self, done: &Result<(), Broken>) -> Result<bool, Failure> {
        if self.args.json {
            print(&format!("{}\n", self.object(Some(done))))?;
        }
        let file = self.args.file.display();
        match done {
            Ok(()) if self.args.json => {}
            Ok(()) if self.args.undo => {
                print("written, read back and stored: the boards hold what they held before\n")?;
            }
            Ok(()) => print(&format!(
                "written, read back and stored; the old values are in {}\ntake them back with: cargo xtask apply {file} --undo\n",
                self.path.display()
            ))?,
            Err(broken) => self.broken(broken),
        }
        Ok(done.is_ok())
    }

    fn broken(&self, Broken { failure, states }: &Broken) {
        warn(&format!("error: {failure}"));
        for (board, state) in self.boards.iter().zip(states) {
            warn(&format!("  node {} {}", board.present.node.number(), state.text(self.args.undo)));
        }
        if states.iter().any(|state| matches!(state, State::Unknown { .. })) {
            warn(&format!(
                "  next: when these boards answer again: cargo xtask apply {} --undo; {} has the values from before the apply",
                self.args.file.display(),
                self.path.display()
            ));
        }
    }

    fn object(&self, done: Option<&Result<(), Broken>>) -> Value {
        let state = |index: usize| match done {
            None => State::Untouched,
            Some(Ok(())) => State::New,
            Some(Err(broken)) => broken.states.get(index).copied().unwrap_or(State::Untouched),
        };
        let board = |(index, Board { present, changes, .. }): (usize, &Board)| {
            let changes: Vec<Value> = changes
                .iter()
                .map(|change| json!({ "property": change.property.row().name, "old": change.old, "new": change.new }))
                .collect();
            json!({
                "node": present.node.number(),
                "motor": present.kind.name(),
                "serial": present.serial,
                "changes": changes,
                "state": state(index).name(),
            })
        };
        let problem = match done {
            Some(Err(Broken { failure, .. })) => json!(failure.to_string()),
            _ => Value::Null,
        };
        json!({
            "command": if self.args.undo { "undo" } else { "apply" },
            "file": self.args.file.display().to_string(),
            "undo": self.path.display().to_string(),
            "dry_run": self.args.dry_run,
            "done": matches!(done, Some(Ok(()))),
            "problem": problem,
            "boards": self.boards.iter().enumerate().map(board).collect::<Vec<Value>>(),
        })
    }
}
