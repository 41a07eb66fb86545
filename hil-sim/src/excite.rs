//! `hil-sim excite`: the move that `identify` needs, on a simulated board in simulated time or on a real one.

use std::error::Error;
use std::path::PathBuf;
use std::time::Duration;

use tater_wire::{MotorKind, Node as Id};

use super::convert;
use super::figures::{Figures, MotorArg};
use super::output::{check_file, print};
use super::simulated::Simulated;
use commission::adapter::Adapter;
use hil_experiment::motor_file::MotorFile;

use commission::excite::{Failure, Link, csv, excite as run};
use hil_world::board::SimBoard;
use hil_world::node::Node;
use programs::interrupt;
use programs::output::warn;
use traces::format::Format;
use traces::input::BadInput;

#[derive(clap::Args)]
pub struct ExciteArgs {
    /// A simulated board of this motor: link, spread or tip, or a file that describes another (docs/motor.md).
    #[arg(long, value_name = "MOTOR", required_unless_present_any = ["slcan", "can"], conflicts_with_all = ["slcan", "can"])]
    motor: Option<MotorArg>,
    #[command(flatten)]
    figures: Figures,
    /// Seed of the simulated noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// A board on an SLCAN adapter: HOST:PORT, or a serial port such as /dev/ttyACM0.
    #[arg(long, value_name = "HOST:PORT|TTY", requires = "node", conflicts_with_all = ["can", "plant", "rig", "supply"])]
    slcan: Option<String>,
    /// A board on a CAN interface of Linux, such as can0.
    #[arg(long, value_name = "IFACE", requires = "node")]
    can: Option<String>,
    /// The real board's node: 1 to 3 links, 4 the spread, 5 to 7 tips. ITS MOTOR WILL MOVE over its whole range.
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=31), conflicts_with = "motor")]
    node: Option<u8>,
    /// The recording: .csv, .mcap or .parquet.
    #[arg(long, value_name = "TRACE")]
    out: PathBuf,
}

/// Returns whether a recording was made.
pub fn excite(args: &ExciteArgs, clock: &dyn Fn() -> Duration) -> Result<bool, Box<dyn Error>> {
    // The first ^C idles the motor and restores the board's properties.
    interrupt::finish_first();
    check_file(&args.out)?;
    let format = Format::of(&args.out)?;
    let (mut link, node): (Box<dyn Link>, Id) = match args.node {
        Some(node) => {
            let adapter = Adapter::named(args.slcan.as_deref(), args.can.as_deref())?;
            (adapter.open(clock, &interrupt::interrupted)?, id(Some(node)))
        }
        None => {
            let (kind, file) = args.motor.as_ref().map_or(Ok((MotorKind::Link, None)), MotorArg::read)?;
            (Box::new(simulated(args, kind, file)?), id(Some(kind.first_node())))
        }
    };
    let done = run(link.as_mut(), node, &mut |step| warn(&format!("node {}: {step}", node.number())));
    let recorded = match done {
        Ok(recorded) => recorded,
        Err(Failure::Interrupted) => return Ok(false),
        Err(failed) => return Err(failed.into()),
    };
    convert::write(&args.out, format, csv(&recorded))?;
    print(&format!("{}: {} rows\n", args.out.display(), recorded.rows.len()))?;
    Ok(true)
}

fn id(node: Option<u8>) -> Id {
    node.and_then(Id::new).unwrap_or(Id::HOST)
}

fn simulated(
    args: &ExciteArgs,
    kind: MotorKind,
    motor_file: Option<MotorFile>,
) -> Result<Simulated, BadInput> {
    let figures = Figures { motor_file, ..args.figures.clone() };
    let mut board = SimBoard::new(figures.motor(kind, 60.0, args.seed)?, id(Some(kind.first_node())));
    if let Some(file) = &figures.motor_file {
        file.store(kind, &mut board);
    }
    Ok(Simulated::new(Node::awake(board)))
}
