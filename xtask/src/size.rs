//! `cargo xtask size`: flash, RAM and stack of the two programs of a board, and of GOD on the stub board, from their ELF files.
//!
//! `--check` compares the production images with limits (`LIMITS`), the stack margin, forbidden symbols
//! (`size/forbidden.rs`) and the committed figures (`size/golden.rs`).

mod crates;
mod elf;
mod figures;
mod forbidden;
mod golden;
mod graph;
mod levels;
mod print;
mod stack;
mod thumb;

use serde_json::{Value, json};

use crate::image::{self, Profile};
use crate::program::root;
use crate::{Failure, Outcome, files};
use elf::{Program, plain};
use figures::{Figures, Forbidden, LIMITS, MOST_OF_A_POLL};
use forbidden::Family;
use graph::Graph;
use levels::Task;

const APP: &str = "boards/tater-f103/src/app.rs";

/// Part of the stack that must stay free, in percent. The analysis assumes the worst coincidence of
/// interrupts; the margin covers changes until the next check and a debugger's frames.
const STACK_MARGIN: f64 = 25.0;

const LARGEST: usize = 12;

/// Arguments of `size`.
#[derive(clap::Args)]
pub struct SizeArgs {
    /// With log strings or without; limits and committed figures apply to production
    #[arg(long, value_enum, default_value = "production")]
    profile: Profile,
    /// Fail on an exceeded limit, a forbidden symbol, or a figure that differs from the committed one
    #[arg(long, conflicts_with = "bless")]
    check: bool,
    /// Print the figures as a JSON object, and nothing else, to standard output
    #[arg(long)]
    json: bool,
    /// Write the figures that --check compares with
    #[arg(long)]
    bless: bool,
}

/// # Errors
/// The images cannot be built or read, or a check fails.
pub fn size(args: &SizeArgs) -> Result<(), Failure> {
    if args.profile != Profile::Production && (args.check || args.bless) {
        let what = "the limits and the committed figures are those of production";
        return Err(Failure::Unusable(format!(
            "{what}\n  next: leave --profile out, or --check and --bless"
        )));
    }
    let all = measure(args.profile)?;
    let (faults, failure) = if args.check { judge(&all) } else { (faults(&all), Failure::Judged as _) };
    if args.json {
        files::print(&format!("{:#}\n", object(args.profile, &all, &faults)))?;
    } else {
        files::print(&print::page(args.profile, &all))?;
    }
    if args.bless {
        return golden::bless(&all);
    }
    if args.check { fail(&faults, failure) } else { Ok(()) }
}

fn measure(profile: Profile) -> Result<Vec<Figures>, Failure> {
    let app = root().join(APP);
    let source = String::from_utf8_lossy(&files::read(&app)?).into_owned();
    let tasks = levels::tasks(&source).map_err(|error| Failure::Unusable(format!("{APP}: {error}")))?;
    let images = image::build(profile)?;
    let mut tater = figures("tater", &Program::read(&images.tater)?, &tasks);
    let mut monitor = figures("monitor", &Program::read(&images.monitor)?, &[]);
    let mut god = figures("god", &Program::read(&image::god()?)?, &[]);
    // A future that has ended panics when it is polled again: GOD never ends, and the compiler does not see that.
    god.forbidden.retain(|found| found.family != Family::Panic.name());
    tater.fill(images.tater_bytes);
    monitor.fill(images.monitor_bytes);
    Ok(vec![tater, monitor, god])
}

/// CI step: a short report with all checks.
///
/// # Errors
/// As [`size`] with `--check`.
pub fn check() -> Outcome {
    let all = measure(Profile::Production)?;
    for figures in &all {
        let Figures { name, flash, ram, stack, .. } = figures;
        let worst = stack.as_ref().ok().map(|worst| figures.poll().unwrap_or(worst.bytes()));
        let stack = worst.map_or_else(|| "unknown".into(), |bytes| bytes.to_string());
        println!("  {name}: flash {flash}, static RAM {ram}, stack at worst {stack} bytes");
    }
    let (faults, failure) = judge(&all);
    Ok(fail(&faults, failure)?)
}

fn figures(name: &'static str, program: &Program, tasks: &[Task]) -> Figures {
    let handlers: Vec<String> = tasks.iter().map(|task| task.binds.clone()).collect();
    let mut figures = Figures::new(name, stack::worst(program, tasks));
    for section in &program.sections {
        let (in_flash, in_ram) = (section.in_flash(), section.in_ram());
        figures.sections.push((section.name.clone(), section.len, in_flash, in_ram));
        let crates = crates::of(program, section, &handlers);
        for (sum, counts, by_crate) in [
            (&mut figures.flash, in_flash, &mut figures.flash_by_crate),
            (&mut figures.ram, in_ram, &mut figures.ram_by_crate),
        ] {
            if counts {
                *sum += section.len;
                crates.iter().for_each(|(whose, bytes)| *by_crate.entry(whose.clone()).or_default() += bytes);
            }
        }
        let symbols = crates::extents(program, section).into_iter();
        figures.largest.extend(symbols.filter_map(|(symbol, bytes)| Some((plain(symbol?), bytes))));
    }
    figures.largest.sort_by(|a, b| (b.1, &a.0).cmp(&(a.1, &b.0)));
    figures.largest.truncate(LARGEST);
    let graph = Graph::new(program);
    for symbol in &program.symbols {
        if let Some(family) = forbidden::family(&symbol.name) {
            let (name, family, chain) = (plain(&symbol.name), family.name(), graph.chain(symbol.start));
            figures.forbidden.push(Forbidden { name, family, chain });
        }
    }
    figures
}

fn object(profile: Profile, all: &[Figures], faults: &[String]) -> Value {
    let programs: serde_json::Map<String, Value> =
        all.iter().map(|figures| (figures.name.into(), figures.object())).collect();
    json!({
        "profile": profile.name(),
        "limits": LIMITS.iter().map(|limits| (limits.program.to_owned(), json!({
            "flash_bytes": limits.flash,
            "ram_bytes": limits.ram,
        }))).collect::<serde_json::Map<String, Value>>(),
        "stack_margin_percent_min": STACK_MARGIN,
        "programs": programs,
        "faults": faults,
    })
}

/// Failed checks, without the comparison with the committed figures.
fn faults(all: &[Figures]) -> Vec<String> {
    let mut faults = Vec::new();
    for figures in all {
        let name = figures.name;
        for limits in LIMITS.iter().filter(|limits| limits.program == name) {
            for (what, found, limit) in
                [("flash", figures.flash, limits.flash), ("static RAM", figures.ram, limits.ram)]
            {
                if found > limit {
                    faults.push(format!("{name}: found {found} bytes of {what}, expected {limit} at most"));
                }
            }
        }
        for Forbidden { name: symbol, family, chain } in &figures.forbidden {
            faults.push(format!(
                "{name}: found {symbol} ({family}), expected none; reached by {}\n    next: remove the call, or give a reason in ALLOWED \
                 of xtask/src/size/forbidden.rs",
                chain.join(" > ")
            ));
        }
        match &figures.stack {
            Err(error) => faults.push(format!("{name}: its stack is unknown: {error}")),
            Ok(_) if figures.poll().is_some() => {
                if let Some(poll) = figures.poll().filter(|&poll| poll > MOST_OF_A_POLL) {
                    faults.push(format!("{name}: found {poll} bytes of stack in a poll, expected {MOST_OF_A_POLL} at most"));
                }
            }
            Ok(worst) if worst.margin_percent() < STACK_MARGIN => faults.push(format!(
                "{name}: found {} of {} bytes of stack in use at worst: {:.1} % free, expected at least {STACK_MARGIN} %\n    next: shorten the deepest paths (cargo xtask size)",
                worst.bytes(),
                tater_f103::map::STACK.len,
                worst.margin_percent()
            )),
            Ok(_) => {}
        }
    }
    faults
}

/// All failed checks, and the kind of failure: unreadable committed figures are another.
fn judge(all: &[Figures]) -> (Vec<String>, fn(String) -> Failure) {
    let mut faults = faults(all);
    match golden::differences(all) {
        Ok(differences) => {
            faults.extend(differences);
            (faults, Failure::Judged)
        }
        Err(error) => {
            faults.push(error);
            (faults, Failure::Unusable)
        }
    }
}

fn fail(faults: &[String], failure: fn(String) -> Failure) -> Result<(), Failure> {
    if faults.is_empty() {
        return Ok(());
    }
    Err(failure(format!("the images failed their checks\n  {}", faults.join("\n  "))))
}
