//! `hil-sim log`: records a live board over its bus into a trace, by GETs in a cycle. Only GETs, and one SET: a board in its
//! monitor is woken (STAT 2), as by any host.

use std::path::{Path, PathBuf};
use std::time::Duration;

use tater_wire::property::Access;
use tater_wire::{Destination, Message, Node, Property};

use super::adapter::{Clock, Link};
use super::convert::{self, Format};
use super::interrupt;
use super::output::{check_file, replace_file, warn};
use crate::experiment::input::BadInput;
use crate::experiment::over_can::answer;
use crate::tuning::table::{Cell, Column, Heading, Kind, Sink, TableError};
use crate::tuning::traces::{TIME, unit};

/// Time limit of an answer: a board that erases a page (40 ms) answers after it.
const ANSWER: Duration = Duration::from_millis(100);

/// Time limit of a board that wakes: its monitor reads the whole application first.
const WAKE: Duration = Duration::from_secs(5);

/// A board that answers nothing for this long is silent: more than a reset and its monitor take.
const SILENCE: Duration = Duration::from_secs(2);

/// The arguments of `hil-sim log`.
#[derive(clap::Args)]
pub struct LogArgs {
    /// An SLCAN adapter: HOST:PORT, or a serial port such as /dev/ttyACM0.
    #[arg(long, value_name = "HOST:PORT|TTY", required_unless_present = "can", conflicts_with = "can")]
    slcan: Option<String>,
    /// A CAN interface of Linux, such as can0.
    #[arg(long, value_name = "IFACE")]
    can: Option<String>,
    /// The board.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=31))]
    node: u8,
    /// Seconds to record; default: until ^C.
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// The file to write: .csv, .mcap or .parquet.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

/// A column that the bus can give, its property, the property's units in one of the column, and its digits.
const COLUMNS: [(&str, Property, f64, u8); 12] = [
    ("mode", Property::MODE, 1.0, 0),
    ("position_estimated_counts", Property::P, 1.0, 0),
    ("velocity_estimated_counts_s", Property::VEL, 1.0, 0),
    ("velocity_setpoint_counts_s", Property::VSET, 1.0, 0),
    ("torque_per_1024", Property::T, 1.0, 0),
    ("bus_v", Property::VBUS, 10.0, 1),
    ("bus_a", Property::IMOTOR, 1000.0, 3),
    ("halls_code", Property::HALLS, 1.0, 0),
    ("thermistor_c", Property::THERM, 10.0, 1),
    ("strain", Property::SG, 1.0, 0),
    ("brake_released", Property::B, 1.0, 0),
    ("ERROR", Property::ERROR, 1.0, 0),
];

/// Records a board; `clock` is real time.
///
/// # Errors
/// No such bus, a silent board, or a file that cannot be written. What was recorded before a board fell silent is written.
pub fn log(args: &LogArgs, clock: Clock) -> Result<(), BadInput> {
    let format = Format::of(&args.out)?;
    let seconds = duration(args.seconds)?;
    check_file(&args.out)?;
    let node = Node::new(args.node).ok_or_else(|| silent(args, "no such node"))?;
    // From here ^C ends the recording and not the program.
    interrupt::finish_first();
    let link = Link::open(args.slcan.as_deref(), args.can.as_deref())?;
    let mut board = Board { link, node, clock };
    wake(args, &mut board)?;
    let heading = Heading { columns: columns(), metadata: facts(args, &mut board)? };
    let wrong = |error: TableError| convert::bad(&args.out, error);
    let mut bytes = Vec::new();
    let mut sink = format.sink(&mut bytes, &heading).map_err(wrong)?;
    warn(&format!("recording node {}; ^C ends it and keeps the file", args.node));
    let recorded = record(args, &mut board, sink.as_mut(), seconds);
    sink.finish().map_err(wrong)?;
    drop(sink);
    replace_file(&args.out, &bytes).map_err(|error| wrong(TableError::Io(error)))?;
    let rows = recorded?;
    warn(&format!("{}: {rows} rows of node {}", args.out.display(), args.node));
    Ok(())
}

fn duration(seconds: Option<f64>) -> Result<Option<Duration>, BadInput> {
    let Some(seconds) = seconds else { return Ok(None) };
    match Duration::try_from_secs_f64(seconds) {
        Ok(duration) if !duration.is_zero() => Ok(Some(duration)),
        _ => Err(BadInput {
            place: "--seconds".to_owned(),
            problem: "is no duration".to_owned(),
            found: format!("{seconds:e}"),
            expected: "seconds above 0, and fewer than 1e19".to_owned(),
            next: "give a duration, or omit it and end with ^C".to_owned(),
        }),
    }
}

/// The board at the other end.
struct Board<'a> {
    link: Link,
    node: Node,
    clock: Clock<'a>,
}

impl Board<'_> {
    /// GETs a property; `None` without an answer in [`ANSWER`].
    fn get(&mut self, property: Property) -> Result<Option<i64>, BadInput> {
        let request = Message {
            from: Node::HOST,
            to: Destination::Node(self.node),
            body: tater_wire::Body::Get(property.id()),
        };
        self.link.send(&request.frame())?;
        let deadline = (self.clock)() + ANSWER;
        while let Some(frame) = self.link.receive(deadline.saturating_sub((self.clock)()))? {
            match answer(&frame) {
                Some((from, of, value)) if (from, of) == (self.node, property) => return Ok(Some(value)),
                _ => {}
            }
        }
        Ok(None)
    }
}

/// Waits until the board's application runs.
fn wake(args: &LogArgs, board: &mut Board) -> Result<(), BadInput> {
    let deadline = (board.clock)() + WAKE;
    let (mut stat, mut has_woken) = (None, false);
    while (board.clock)() < deadline && !interrupt::interrupted() {
        stat = board.get(Property::STAT)?.or(stat);
        match stat {
            Some(2) => return Ok(()),
            Some(0) if !has_woken => {
                warn(&format!("node {} is in its monitor; it is woken", args.node));
                has_woken = true;
                if let Some(set) = Message::set(Destination::Node(board.node), Property::STAT, 2) {
                    board.link.send(&set.frame())?;
                }
            }
            _ => {}
        }
    }
    Err(silent(
        args,
        &match stat {
            _ if interrupt::interrupted() => "^C before it answered".to_owned(),
            Some(stat) => format!("STAT {stat}, expected 2"),
            None => "no answer".to_owned(),
        },
    ))
}

fn place(args: &LogArgs) -> String {
    match (&args.slcan, &args.can) {
        (Some(address), _) => format!("--slcan {address}"),
        (None, Some(interface)) => format!("--can {interface}"),
        (None, None) => "hil-sim log".to_owned(),
    }
}

fn silent(args: &LogArgs, found: &str) -> BadInput {
    BadInput {
        place: place(args),
        problem: format!("node {} is silent", args.node),
        found: found.to_owned(),
        expected: "a board with its application running".to_owned(),
        next: "check --node, the board's power, and the cable and termination of the bus".to_owned(),
    }
}

fn columns() -> Vec<Column> {
    let time = Column::new(TIME, unit(TIME), Kind::Float).decimals(3);
    let others = COLUMNS.iter().map(|(name, _, _, decimals)| match decimals {
        0 => Column::new(*name, unit(name), Kind::Int).nullable(),
        decimals => Column::new(*name, unit(name), Kind::Float).nullable().decimals(*decimals),
    });
    std::iter::once(time).chain(others).collect()
}

/// All properties that can be read, by name: gains, limits and versions.
fn facts(args: &LogArgs, board: &mut Board) -> Result<Vec<(String, String)>, BadInput> {
    let mut facts = vec![
        ("recorded_by".to_owned(), format!("hil-sim {}", env!("CARGO_PKG_VERSION"))),
        ("node".to_owned(), args.node.to_string()),
    ];
    let given = facts.len();
    for property in Property::ALL.iter().filter(|property| property.rules().access != Access::WriteOnly) {
        // The application starts after the monitor has acknowledged.
        let patience = if facts.len() == given { SILENCE } else { 2 * ANSWER };
        let deadline = (board.clock)() + patience;
        let value = loop {
            let value = board.get(*property)?;
            if value.is_some() || (board.clock)() >= deadline {
                break value;
            }
        };
        match value {
            Some(value) => facts.push((property.row().name.to_owned(), value.to_string())),
            None if facts.len() == given => return Err(silent(args, "no answer for 2 s")),
            None => warn(&format!("warning: no answer about {}: the metadata lacks it", property.row().name)),
        }
    }
    Ok(facts)
}

/// Records until the time is over or ^C; returns the number of rows.
fn record(
    args: &LogArgs,
    board: &mut Board,
    sink: &mut dyn Sink,
    seconds: Option<Duration>,
) -> Result<u64, BadInput> {
    let begun = (board.clock)();
    let (mut answered, mut rows) = (begun, 0);
    loop {
        let now = (board.clock)();
        if interrupt::interrupted() || seconds.is_some_and(|seconds| now - begun >= seconds) {
            return Ok(rows);
        }
        let mut row = vec![Cell::Float((now - begun).as_secs_f64() * 1000.0)];
        for (_, property, scale, decimals) in COLUMNS {
            let value = board.get(property)?;
            if value.is_some() {
                answered = (board.clock)();
            } else if (board.clock)() - answered >= SILENCE {
                let found =
                    format!("no answer for 2 s after {rows} rows, which {} keeps", args.out.display());
                return Err(silent(args, &found));
            }
            row.push(match decimals {
                0 => value.into(),
                // Integers of a property have 32 bits.
                _ => value.map(|value| value as f64 / scale).into(),
            });
        }
        sink.row(&row).map_err(|error| convert::bad(Path::new(&args.out), error))?;
        rows += 1;
    }
}
