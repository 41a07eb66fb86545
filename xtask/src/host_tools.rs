//! Tests the simulation with real host tools in real time: a download and a spread move by python-can over
//! SLCAN and TCP, and a whole hand driven by pyserial as its real clients do. Python packages are installed
//! below `target/`.

use std::path::{Path, PathBuf};
use std::process::Command;

use tater_wire::Node;

use crate::program::{output, root, target};
use crate::served::Served;
use crate::{Outcome, download, python, tek};

/// From PyPI: python-can for `slcan`, pyserial for `socket://` and the hand's clients. Pinned, so that a
/// failure is this project's.
const PACKAGES: [&str; 2] = ["python-can==4.6.1", "pyserial==3.5"];

const IMAGE: usize = 4096;

/// A hand with an object to grasp, its bus open to an observer; on a pseudo-terminal if possible.
const GRASP: &str = if cfg!(unix) {
    "hand --listen 127.0.0.1:0 --pty --slcan 127.0.0.1:0 --scenario hil-sim/grasps/ball.toml"
} else {
    "hand --listen 127.0.0.1:0 --slcan 127.0.0.1:0 --scenario hil-sim/grasps/ball.toml"
};

/// Fewest RealTime blocks a second over TCP, even on a busy machine. The bus allows 320; ends that wait for
/// each other's acknowledgement (Nagle) reach 25.
const LEAST_TCP: &str = "80";

/// The same at [`BAUD`], where the wire allows 75.
const LEAST_SERIAL: &str = "35";
const BAUD: &str = "38400";

/// The board of the spread.
const SPREAD: Node = Node::new(4).expect("0 to 31");

/// # Errors
/// The failed check with a command to repeat it, or the missing tool.
pub fn check() -> Outcome {
    let python = python::environment("host-tools", &PACKAGES)?;
    let script = |name: &str, args: &[&str]| {
        let mut script = Command::new(&python);
        script.arg(format!("tests/host/{name}.py")).args(args).current_dir(root());
        output(script).map(|said| said.lines().for_each(|line| println!("  {line}")))
    };
    let board = Served::new("bus --node 4 --slcan 127.0.0.1:0")?;
    let address = board.place("slcan")?;
    let file = application()?;
    download::download(&download::DownloadArgs::new(file, SPREAD, address)).map_err(String::from)?;
    script("spread_move", &[address])?;
    drop(board);
    let hand = Served::new(GRASP)?;
    let tcp = format!("socket://{}", hand.place("gcl")?);
    let ports = [tcp.as_str()].into_iter().chain(hand.place("pty"));
    script("hand_clients", &[hand.place("slcan")?].into_iter().chain(ports).collect::<Vec<_>>())?;
    drop(hand);
    let hand = Served::new("hand --listen 127.0.0.1:0")?;
    script("hand_rate", &[&format!("socket://{}", hand.place("gcl")?), LEAST_TCP])?;
    drop(hand);
    if cfg!(unix) {
        let hand = Served::new("hand --pty --pace-baud")?;
        script("hand_rate", &[hand.place("pty")?, LEAST_SERIAL, BAUD])?;
    }
    Ok(())
}

/// A sealed `.tek` file of an application that a monitor accepts.
///
/// # Errors
/// It cannot be written.
pub fn application() -> Result<PathBuf, String> {
    let folder = target().join("host-tools");
    std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let (bytes, file) = (folder.join("application.bin"), folder.join("application.tek"));
    let mut image = vec![0x5A; IMAGE];
    image[..4].copy_from_slice(&tater_f103::map::RAM.end().to_le_bytes());
    image[4..8].copy_from_slice(&(tater_f103::map::APPLICATION.start + 0x101).to_le_bytes());
    // The vectors that hold the header are reserved.
    image[0x1C..0x2C].fill(0);
    std::fs::write(&bytes, image).map_err(|error| format!("{}: {error}", bytes.display()))?;
    encode(&bytes, &file)?;
    Ok(file)
}

fn encode(bytes: &Path, file: &Path) -> Outcome {
    let chore = tek::Chore::Encode {
        input: bytes.to_owned(),
        base: Some(tater_f103::map::APPLICATION.start),
        output: file.to_owned(),
        seal: Some(600),
        replace_seal: false,
    };
    tek::tek(&chore).map_err(String::from)
}
