//! `hil-sim excite`: the move that `identify` needs, on a simulated board in simulated time or on a real one.

use std::error::Error;
use std::path::PathBuf;
use std::time::Duration;

use tater_wire::Node as Id;

use super::adapter::{Slcan, interface};
use super::identify::MotorName;
use super::interrupt;
use super::output::{print, replace_file, warn};
use crate::experiment::input::BadInput;
use crate::experiment::run::{Options, node_of, rig};
use crate::experiment::scenario::Scenario;
use crate::tuning::excite::{Failure, Link, Simulated, csv, excite as run};
use crate::world::board::SimBoard;
use crate::world::node::Node;
use crate::world::plant::Model;

#[derive(clap::Args)]
pub struct ExciteArgs {
    /// A simulated board of this motor.
    #[arg(long, value_enum, required_unless_present_any = ["slcan", "can"], conflicts_with_all = ["slcan", "can"])]
    motor: Option<MotorName>,
    /// Set a figure of the simulated motor, such as inertia=1.3x (see `list --plant`); repeatable.
    #[arg(long, value_name = "NAME=VALUE", conflicts_with_all = ["slcan", "can"])]
    plant: Vec<String>,
    /// Set a figure of the simulated sensors; repeatable.
    #[arg(long, value_name = "NAME=VALUE", conflicts_with_all = ["slcan", "can"])]
    rig: Vec<String>,
    /// Set the simulated supply, such as volts=22.
    #[arg(long, value_name = "NAME=VALUE", conflicts_with_all = ["slcan", "can"])]
    supply: Vec<String>,
    /// Seed of the simulated noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// A board on an SLCAN adapter over TCP.
    #[arg(long, value_name = "HOST:PORT", requires = "node", conflicts_with = "can")]
    slcan: Option<String>,
    /// A board on a CAN interface of Linux, such as can0.
    #[arg(long, value_name = "IFACE", requires = "node")]
    can: Option<String>,
    /// The real board's node: 1 to 3 links, 4 the spread, 5 to 7 tips. ITS MOTOR WILL MOVE over its whole range.
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=31), conflicts_with = "motor")]
    node: Option<u8>,
    /// The recording.
    #[arg(long, value_name = "TRACE.csv")]
    out: PathBuf,
}

/// Returns whether a recording was made.
pub fn excite(args: &ExciteArgs, clock: &dyn Fn() -> Duration) -> Result<bool, Box<dyn Error>> {
    // The first ^C idles the motor and restores the board's properties.
    interrupt::finish_first();
    let (mut link, node): (Box<dyn Link>, Id) = match (&args.slcan, &args.can, args.motor) {
        (Some(address), _, _) => (Box::new(Slcan::connect(address, clock)?), id(args.node)),
        (None, Some(name), _) => (interface(name, clock)?, id(args.node)),
        (None, None, motor) => {
            let motor = motor.unwrap_or(MotorName::Link);
            (Box::new(simulated(args, motor)?), id(Some(node_of(motor.kind()))))
        }
    };
    let done = run(link.as_mut(), node, &mut |step| warn(&format!("node {}: {step}", node.number())));
    let recorded = match done {
        Ok(recorded) => recorded,
        Err(Failure::Interrupted) => return Ok(false),
        Err(Failure::Failed(text)) => return Err(text.into()),
    };
    replace_file(&args.out, csv(&recorded).as_bytes()).map_err(|e| BadInput {
        place: format!("--out {}", args.out.display()),
        problem: "cannot be written".to_owned(),
        found: e.to_string(),
        expected: "a file in an existing folder".to_owned(),
        next: "choose another path or free space".to_owned(),
    })?;
    print(&format!("{}: {} rows\n", args.out.display(), recorded.rows.len()))?;
    Ok(true)
}

fn id(node: Option<u8>) -> Id {
    node.and_then(Id::new).unwrap_or(Id::HOST)
}

fn simulated(args: &ExciteArgs, motor: MotorName) -> Result<Simulated, Box<dyn Error>> {
    let name = match motor {
        MotorName::Link => "link",
        MotorName::Spread => "spread",
        MotorName::Tip => "tip",
    };
    let text = format!(
        "name = 'excite'\nabout = 'the move that identify needs'\nmotor = '{name}'\nduration_ms = 1\ninitial = {{ position_counts = 60 }}\n"
    );
    let mut scenario = Scenario::parse("excite", &text)?;
    for (option, assignments) in [("plant", &args.plant), ("rig", &args.rig), ("supply", &args.supply)] {
        for assignment in assignments {
            scenario.override_figure(option, assignment)?;
        }
    }
    let options = Options { seed: args.seed, model: Model::Averaged, trace: false };
    let case = scenario.cases.first().ok_or("a scenario has a motor")?;
    let rig = rig(&scenario, case, &options)?;
    Ok(Simulated::new(Node::awake(SimBoard::new(rig, id(Some(node_of(motor.kind())))))))
}
