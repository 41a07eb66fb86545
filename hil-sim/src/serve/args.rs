//! The boards on the bus and the host's connection.

use std::path::PathBuf;

use boot::Chip;
use hil_experiment::motor_file::MotorFile;
use hil_world::board::SimBoard;
use hil_world::node::{Node, store};
use tater_wire::{MotorKind, Node as Id, Property};
use traces::input::BadInput;

use super::event::bad;
use crate::figures::Figures;

/// A hand alone, and a hand beside an arm.
const fn is_node(id: &u8) -> bool {
    matches!(id, 1..=7 | 11..=17)
}

/// The arguments of `hil-sim bus`.
#[derive(clap::Args)]
pub struct BusArgs {
    /// A board on the bus: 1 to 3 links, 4 the spread, 5 to 7 tips; 11 to 17 the same of a hand beside an arm.
    #[arg(long, value_name = "N")]
    node: Option<String>,
    /// Several boards, such as 1-7 or 11,12,13,14.
    #[arg(long, value_name = "LIST")]
    nodes: Option<String>,
    /// Serve SLCAN over TCP here; port 0 picks a free one. The first line of output is `slcan HOST:PORT`.
    #[arg(long, value_name = "HOST:PORT")]
    slcan: Option<String>,
    /// Connect to a CAN interface of Linux, such as vcan0.
    #[arg(long, value_name = "IFACE")]
    can: Option<String>,
    /// Answer each line of a TCP client with a line of JSON: true position, velocity, torque and contact of each motor. Prints `truth
    /// HOST:PORT`.
    #[arg(long, value_name = "HOST:PORT")]
    pub truth: Option<String>,
    /// Units of values on the bus: 0 this project's, 280 those of a BH8-280. Stored on every board, as SET and SAVE of HOSTUNITS do.
    #[arg(long, value_name = "0|280", default_value_t = 0)]
    host_units: i64,
    /// Seed of the sensor noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// A motor that a file describes, on every board (docs/motor.md).
    #[arg(long, value_name = "FILE")]
    motor: Option<PathBuf>,
    #[command(flatten)]
    figures: Figures,
}

pub enum Place<'a> {
    Slcan(&'a str),
    Can(&'a str),
}

impl BusArgs {
    /// # Errors
    /// No boards, or not exactly one host.
    pub fn host(&self) -> Result<Place<'_>, BadInput> {
        let boards = self.node.is_some() || self.nodes.is_some();
        let (add_boards, add_host) = ("--node 4 or --nodes 1-7", "--slcan 127.0.0.1:0 or --can vcan0");
        let (found, next) = match (boards, &self.slcan, &self.can) {
            (true, Some(address), None) => return Ok(Place::Slcan(address)),
            (true, None, Some(interface)) => return Ok(Place::Can(interface)),
            (_, Some(_), Some(_)) => {
                ("two hosts", "omit --slcan or --can: each host would be node 0".to_owned())
            }
            (true, None, None) => ("no host", format!("add {add_host}")),
            (false, None, None) => ("no boards and no host", format!("add {add_boards}, and {add_host}")),
            (false, ..) => ("no boards", format!("add {add_boards}")),
        };
        let expected = "boards (--node or --nodes) and one host (--slcan or --can)";
        Err(bad("hil-sim bus".to_owned(), found, expected, &next))
    }

    /// The boards with their motors, at power-up.
    pub fn boards(&self) -> Result<Vec<Node>, BadInput> {
        let mut ids = Vec::new();
        for (option, list) in [("--node", &self.node), ("--nodes", &self.nodes)] {
            if let Some(list) = list {
                ids.extend(parse(list).ok_or_else(|| {
                    bad(
                        format!("{option} {list}"),
                        list,
                        "nodes from 1 to 7 or 11 to 17, such as 4 or 1-7 or 11,12,13,14",
                        "name the boards on the bus",
                    )
                })?);
            }
        }
        ids.sort_unstable();
        ids.dedup();
        if !Property::HOSTUNITS.rules().admits(self.host_units) {
            return Err(bad(
                format!("--host-units {}", self.host_units),
                &self.host_units.to_string(),
                "0, this project's units, or 280, a BH8-280's",
                "omit the option for 0",
            ));
        }
        let motor_file = self.motor.as_deref().map(MotorFile::read).transpose()?;
        let figures = Figures { motor_file, ..self.figures.clone() };
        let board = |id: u8| {
            let id = Id::new(id).unwrap_or(Id::HOST);
            let seed = self.seed ^ u64::from(id.number());
            let kind = MotorKind::of(id);
            let mut board = SimBoard::new(figures.motor(kind, 0.0, seed)?, id);
            if let Some(file) = &figures.motor_file {
                file.store(kind, &mut board);
            }
            store(board.flash(), Property::HOSTUNITS, self.host_units);
            Ok(Node::new(board))
        };
        ids.into_iter().map(board).collect()
    }
}

fn parse(list: &str) -> Option<Vec<u8>> {
    let mut ids = Vec::new();
    for part in list.split(',') {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let number = |text: &str| text.trim().parse::<u8>().ok().filter(is_node);
        let (first, last) = (number(first)?, number(last)?);
        if first > last || !(first..=last).all(|id| is_node(&id)) {
            return None;
        }
        ids.extend(first..=last);
    }
    Some(ids)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn node_list_parses_or_is_refused() {
        assert_eq!(parse("4"), Some(vec![4]));
        assert_eq!(parse("1-7"), Some((1..=7).collect()));
        assert_eq!(parse("1, 4-5"), Some(vec![1, 4, 5]));
        assert_eq!(parse("11-14,17"), Some(vec![11, 12, 13, 14, 17]));
        for list in
            ["", "0", "8", "10", "18", "7-11", "1-17", "5-4", "1-", "-", "a", "1,,2", "1-3-5", "256", "+"]
        {
            assert_eq!(parse(list), None, "{list}");
        }
    }
}
