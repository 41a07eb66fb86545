//! A simulated hand or bus in a process of its own.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

use crate::emu;
use crate::program::{built, root, typed};

/// The simulator, which ends with this.
pub struct Served {
    process: Child,
    line: String,
    /// Its printed endpoints: kind and address.
    doors: Vec<(String, String)>,
}

impl Drop for Served {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Served {
    /// Starts hil-sim.
    ///
    /// # Errors
    /// It cannot be started.
    pub fn new(args: &str) -> Result<Self, String> {
        let mut command = Command::new(built("hil-sim")?);
        command.args(args.split(' '));
        Self::start(command)
    }

    /// Starts a hand of emulated boards.
    ///
    /// # Errors
    /// Image or emulator cannot be built or started.
    pub fn emulated() -> Result<Self, String> {
        let (emulator, image) = emu::build()?;
        let mut command = Command::new(emulator);
        command.args(["--listen", "127.0.0.1:0", "--image"]).arg(image);
        Self::start(command)
    }

    /// Starts a simulator and reads its endpoints, one line for each option that requests one.
    fn start(mut command: Command) -> Result<Self, String> {
        command.current_dir(root());
        let line = typed(&command);
        let failed = |what: String| format!("{what}\n  repeat with: {line}");
        let spawned = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
        let process = spawned.map_err(|error| failed(format!("cannot start: {error}")))?;
        let doors = ["--listen", "--pty", "--slcan", "--discovery"]
            .iter()
            .filter(|door| command.get_args().any(|arg| arg == **door))
            .count();
        let mut served = Self { process, line: line.clone(), doors: Vec::new() };
        let Some(out) = served.process.stdout.take() else { return Ok(served) };
        for said in BufReader::new(out).lines().take(doors) {
            let said = said.map_err(|error| failed(error.to_string()))?;
            let (kind, place) = said.split_once(' ').unwrap_or((&said, ""));
            served.doors.push((kind.to_owned(), place.to_owned()));
        }
        Ok(served)
    }

    /// Where an endpoint is.
    ///
    /// # Errors
    /// There is none of this kind.
    pub fn place(&self, kind: &str) -> Result<&str, String> {
        let door = self.doors.iter().find(|door| door.0 == kind).map(|door| door.1.as_str());
        door.ok_or_else(|| {
            format!("found {:?}, expected `{kind} PLACE`\n  repeat with: {}", self.doors, self.line)
        })
    }
}
