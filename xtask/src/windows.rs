//! Host programs for Windows, for which the manual's library is: the simulator, the terminal, and section 7's examples in C, under Wine.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::c_library::{self, place};
use crate::program::{built, in_parallel, output, program, run, simulator, succeeds, target, typed};
use crate::served::Served;
use crate::{Outcome, files, setup};

/// The target of the programs.
pub const SYSTEM: &str = "x86_64-pc-windows-gnu";

pub const COMPILER: &str = "x86_64-w64-mingw32-gcc";
pub const INSTALL_COMPILER: &str = "apt-get install gcc-mingw-w64-x86-64";

/// Programs, and how Debian installs them.
const TOOLS: [(&str, &str); 2] = [("wine", "apt-get install wine"), (COMPILER, INSTALL_COMPILER)];

const RUN: &str = "run link-fast";

/// What the programs need of Windows that Debian's Wine lacks.
const LACKING: &str = "xtask/src/windows/bcryptprimitives.c";

/// What the terminal does: it homes a hand and moves it.
const ENTRIES: &str = "HI\nGC\nFGET P\n";

const HAND: &str = "hand --listen 127.0.0.1:0 --speed max";

/// Builds programs and library for Windows, and runs them against the simulator of this system.
///
/// # Errors
/// A tool is missing, or the failed program with a command to repeat it.
pub fn check() -> Outcome {
    for (tool, install) in TOOLS {
        if !succeeds(&format!("{tool} --version")) {
            return Err(format!("{tool} is missing\n  install it (on Debian: {install})"));
        }
    }
    setup::add(SYSTEM)?;
    run(program(&format!("cargo build --quiet --target {SYSTEM} --bin hil-sim --bin wraptor")))?;
    run(program(&format!("cargo build --quiet --target {SYSTEM} --package wraptor-c --lib")))?;
    // Wine makes the last folder itself.
    let wine = target().join("wine");
    std::fs::create_dir_all(&wine).map_err(|error| format!("{}: {error}", wine.display()))?;
    let mut compiler = program(COMPILER);
    compiler.args(["-shared", LACKING, "-ladvapi32", "-o"]).arg(folder().join("bcryptprimitives.dll"));
    run(compiler)?;
    same_run()?;
    terminal()?;
    examples()
}

fn folder() -> PathBuf {
    target().join(SYSTEM).join("debug")
}

/// A program under Wine, which ends after two minutes at most and says nothing of its own.
fn wine(path: &Path) -> Command {
    let mut wine = program("timeout 120 wine");
    wine.arg(path).env("WINEDEBUG", "-all").env("WINEPREFIX", target().join("wine/prefix"));
    wine
}

/// The trace is the same to the last bit on each system.
fn same_run() -> Outcome {
    let (here, there) = (target().join("wine/here"), target().join("wine/there"));
    output(simulator(&format!("{RUN} --out {}", here.display()))?)?;
    let mut run = wine(&folder().join("hil-sim.exe"));
    run.args(RUN.split(' ')).arg("--out").arg(&there);
    let line = typed(&run);
    output(run)?;
    let trace = |folder: &Path| files::read(&folder.join("trace.csv")).map_err(String::from);
    if trace(&here)? != trace(&there)? {
        return Err(format!("another trace than {}\n  repeat with: {line}", here.display()));
    }
    println!("  {RUN}: the same trace");
    Ok(())
}

/// The terminal's last answer is that of this system's terminal.
fn terminal() -> Outcome {
    let script = folder().join("entries.txt");
    files::replace(&script, ENTRIES.as_bytes())?;
    let answer = |mut terminal: Command| {
        let hand = Served::new(HAND)?;
        terminal.args(["--connect", hand.place("gcl")?, "--script"]).arg(&script).stdin(Stdio::null());
        let said = output(terminal)?;
        Ok::<_, String>(said.lines().last().unwrap_or_default().to_owned())
    };
    let (here, there) =
        (answer(Command::new(built("wraptor")?))?, answer(wine(&folder().join("wraptor.exe")))?);
    if here != there {
        return Err(format!("terminal: found {there:?}, expected {here:?} as on this system"));
    }
    println!("  terminal: {there}");
    Ok(())
}

fn examples() -> Outcome {
    let programs = folder().join("section7");
    for library in ["wraptor_c.dll", "bcryptprimitives.dll"] {
        c_library::copy(&folder().join(library), &programs.join(library))?;
    }
    let (names, answers) = (c_library::section7_examples()?, c_library::answers(&programs)?);
    let failures = in_parallel(&names, |name| {
        let path = programs.join(format!("{name}.exe"));
        let mut compiler = program(COMPILER);
        compiler.args(["-std=c99", "-Wall", "-Wextra", "-Werror", "-Iwraptor/c/include"]);
        compiler.arg(format!("wraptor/c/examples/section7/{name}.c")).arg("-o").arg(&path);
        compiler.arg("-L").arg(folder()).arg("-lwraptor_c");
        run(compiler)?;
        let hand = c_library::hand(name)?;
        let (host, port) = place(&hand)?;
        let mut example = wine(&path);
        example.args([host, port, hand.place("discovery")?]).stdin(c_library::input(&answers)?);
        output(example).map(drop)
    });
    if !failures.is_empty() {
        return Err(failures.join("\n"));
    }
    println!("  {} of section 7's examples did what the manual says", names.len());
    Ok(())
}
