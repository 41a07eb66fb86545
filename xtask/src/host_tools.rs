//! The simulated bus as ordinary host tools meet it, in real time: our own download, then a spread driven by python-can
//! over SLCAN and TCP. What python needs is installed below `target/`.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use crate::program::{output, program, root, run, target, typed};
use crate::{Outcome, download, python, tek};

/// From PyPI: python-can for `slcan`, pyserial for its `socket://`. Pinned, so that a failure is ours.
const PACKAGES: [&str; 2] = ["python-can==4.6.1", "pyserial==3.5"];

/// Bytes of the application that is downloaded: a few pages of flash.
const IMAGE: usize = 4096;

/// Downloads to a served board and drives it from python.
///
/// # Errors
/// What failed and how to repeat it; or what is missing to try it.
pub fn check() -> Outcome {
    let python = python::environment("host-tools", &PACKAGES)?;
    run(program("cargo build --quiet --release --package hil-sim"))?;
    let served = serve()?;
    let file = application()?;
    download::download(&download::DownloadArgs::new(file, 4, &served.address)).map_err(String::from)?;
    let mut script = Command::new(python);
    script.arg("tests/host/spread_move.py").arg(&served.address).current_dir(root());
    let said = output(script)?;
    println!("  {}", said.trim_end());
    Ok(())
}

/// A served bus; ends when this is dropped.
struct Served {
    process: Child,
    address: String,
}

impl Drop for Served {
    fn drop(&mut self) {
        // It has ended by itself, or it does so now.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn serve() -> Result<Served, String> {
    let mut command = Command::new(target().join("release/hil-sim"));
    command.args(["bus", "--node", "4", "--slcan", "127.0.0.1:0"]).current_dir(root());
    let line = typed(&command);
    let failed = |what: String| format!("{what}\n  repeat with: {line}");
    let spawned = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
    let process = spawned.map_err(|error| failed(format!("cannot start: {error}")))?;
    let mut served = Served { process, address: String::new() };
    let mut said = String::new();
    if let Some(out) = served.process.stdout.take() {
        BufReader::new(out).read_line(&mut said).map_err(|error| failed(error.to_string()))?;
    }
    let address = said.trim().strip_prefix("slcan ");
    served.address =
        address.ok_or_else(|| failed(format!("found {said:?}, expected `slcan HOST:PORT`")))?.to_owned();
    Ok(served)
}

/// A sealed `.tek` file of an application that a monitor takes.
fn application() -> Result<PathBuf, String> {
    let folder = target().join("host-tools");
    let (bytes, file) = (folder.join("application.bin"), folder.join("application.tek"));
    let mut image = vec![0x5A; IMAGE];
    image[..4].copy_from_slice(&tater_wire::memory::RAM.end().to_le_bytes());
    image[4..8].copy_from_slice(&(tater_wire::memory::APPLICATION.start + 0x101).to_le_bytes());
    // The vectors that the header goes into are reserved.
    image[0x1C..0x2C].fill(0);
    std::fs::write(&bytes, image).map_err(|error| format!("{}: {error}", bytes.display()))?;
    encode(&bytes, &file)?;
    Ok(file)
}

fn encode(bytes: &Path, file: &Path) -> Outcome {
    let chore = tek::Chore::Encode {
        input: bytes.to_owned(),
        base: Some(tater_wire::memory::APPLICATION.start),
        output: file.to_owned(),
        seal: Some(600),
    };
    tek::tek(&chore).map_err(String::from)
}
