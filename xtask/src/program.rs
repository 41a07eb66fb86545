//! Starts other programs in the project's root. Errors include the command that repeats them.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

pub fn root() -> PathBuf {
    // The checkout may have moved since the build: prefer cargo's present value.
    let manifest = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_else(|_| env!("CARGO_MANIFEST_DIR").into());
    Path::new(&manifest).parent().map_or_else(PathBuf::new, Path::to_path_buf)
}

pub fn target() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), |folder| root().join(folder))
}

/// A program to start in the project's root; `line` is split at blanks.
pub fn program(line: &str) -> Command {
    let mut words = line.split_whitespace();
    let mut command = Command::new(words.next().unwrap_or_default());
    // Set where tests are timed (ci.rs); a cargo that sees it compiles everything anew.
    command.args(words).current_dir(root()).env_remove("RUSTC_BOOTSTRAP");
    command
}

/// The command line as typed in the project's root.
pub fn typed(command: &Command) -> String {
    let quoted = |word: String| if word.contains(' ') { format!("'{word}'") } else { word };
    let variables = command.get_envs().filter_map(|(name, value)| {
        Some(format!("{}={}", name.to_string_lossy(), quoted(value?.to_string_lossy().into_owned())))
    });
    let words = std::iter::once(command.get_program()).chain(command.get_args());
    let words = words.map(|word| quoted(word.to_string_lossy().into_owned()));
    variables.chain(words).collect::<Vec<_>>().join(" ")
}

/// Runs a program on the shared terminal.
///
/// # Errors
/// The program cannot be started or fails; with the command to repeat it.
pub fn run(mut command: Command) -> Result<(), String> {
    let line = typed(&command);
    match command.status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(format!("{status}\n  repeat with: {line}")),
        Err(error) => Err(format!("cannot start: {error}\n  repeat with: {line}")),
    }
}

/// Path of the project's own program, or of an example such as `examples/run_speed`, with the checks' profile; all are built at once.
///
/// # Errors
/// The build's.
pub fn built(name: &str) -> Result<PathBuf, String> {
    static ONCE: Mutex<bool> = Mutex::new(false);
    let mut is_built = ONCE.lock().unwrap_or_else(PoisonError::into_inner);
    if !*is_built {
        run(program("cargo build --quiet --bins --examples"))?;
        *is_built = true;
    }
    Ok(target().join("debug").join(name))
}

/// The simulator with a line of arguments, in the project's root.
///
/// # Errors
/// The build's.
pub fn simulator(line: &str) -> Result<Command, String> {
    let mut simulator = Command::new(built("hil-sim")?);
    simulator.args(line.split_whitespace()).current_dir(root());
    Ok(simulator)
}

/// Path of a cargo tool, installed below the target folder if it is missing.
///
/// # Errors
/// The installation's.
pub fn installed(tool: &str, version: &str) -> Result<PathBuf, String> {
    let tools = target().join("tools");
    let path = tools.join("bin").join(tool);
    if !path.exists() {
        // Not optimized: each compiles for minutes, and is busy for seconds.
        let mut install =
            program(&format!("cargo install {tool} --version {version} --locked --debug --quiet --root"));
        install.arg(&tools);
        run(install)?;
    }
    Ok(path)
}

/// Runs a program and returns its standard output; standard error goes to the terminal.
///
/// # Errors
/// As [`run`], with the output.
pub fn output(mut command: Command) -> Result<String, String> {
    let line = typed(&command);
    let output = command
        .stderr(Stdio::inherit())
        .output()
        .map_err(|error| format!("cannot start: {error}\n  repeat with: {line}"))?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    if output.status.success() {
        return Ok(text);
    }
    Err(format!("{}\n{}\n  repeat with: {line}", output.status, text.trim_end()))
}

/// Runs a program and returns its standard output followed by its standard error.
///
/// # Errors
/// As [`output`].
pub fn output_of_both(mut command: Command) -> Result<String, String> {
    let line = typed(&command);
    let output = command.output().map_err(|error| format!("cannot start: {error}\n  repeat with: {line}"))?;
    let text =
        [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
    if output.status.success() {
        return Ok(text);
    }
    Err(format!("{}\n{}\n  repeat with: {line}", output.status, text.trim_end()))
}

/// Processes each item once, one on each processor at a time; returns the errors. Where the system refuses threads, fewer at a time.
pub fn in_parallel<T: Sync>(work: &[T], each: impl Fn(&T) -> Result<(), String> + Sync) -> Vec<String> {
    let workers = std::thread::available_parallelism().map_or(1, usize::from);
    let (next, errors) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    let run = || {
        while let Some(piece) = work.get(next.fetch_add(1, Ordering::Relaxed)) {
            if let Err(error) = each(piece) {
                errors.lock().unwrap_or_else(PoisonError::into_inner).push(error);
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..workers {
            let _ = std::thread::Builder::new().spawn_scoped(scope, run);
        }
        run();
    });
    errors.into_inner().unwrap_or_else(PoisonError::into_inner)
}

/// Whether a program can be started and succeeds; hides its output.
pub fn succeeds(line: &str) -> bool {
    let mut command = program(line);
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

#[cfg(test)]
mod tests {
    use super::in_parallel;

    #[test]
    fn parallel_work_runs_once_and_returns_errors() {
        let done = std::sync::atomic::AtomicU32::new(0);
        let mut errors = in_parallel(&[1, 2, 3, 4, 5], |n| {
            done.fetch_add(10_u32.pow(*n), std::sync::atomic::Ordering::Relaxed);
            if n % 2 == 0 { Err(n.to_string()) } else { Ok(()) }
        });
        errors.sort();
        assert_eq!((done.into_inner(), errors.concat().as_str()), (111_110, "24"));
    }
}
