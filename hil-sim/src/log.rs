//! `hil-sim log`: records a live board over its bus into a trace, by GETs in a cycle. Only GETs, and one SET: a board in its
//! monitor is woken (STAT 2), as by any host.
//!
//! Rows go into the file each second, whole, and nothing else is kept: a program that is killed leaves what it had recorded, and a recording of
//! days needs no more memory than one of a minute. Parquet keeps its index for the end, so there a kill loses the file.

use std::fs::File;
use std::io::Write;
use std::path::PathBuf;
use std::time::Duration;

use tater_wire::property::Access;
use tater_wire::{Destination, Message, Node, Property};

use super::adapter::{self, Clock, Link};
use super::convert::Pending;
use super::output::check_file;
use programs::interrupt;
use programs::output::warn;
use traces::format::Format;
use traces::input::BadInput;
use traces::names::{RECORDED_BY, TIME, UNTRUSTED, unit};
use traces::numbers::bad;
use traces::table::{Cell, Column, Heading, Kind, Sink, TableError};

/// Time limit of an answer: a board that erases a page (40 ms) answers after it.
const ANSWER: Duration = Duration::from_millis(100);

/// Time limit of a board that wakes: its monitor reads the whole application first.
const WAKE: Duration = Duration::from_secs(5);

/// A board that answers nothing for this long is silent: more than a reset and its monitor take.
const SILENCE: Duration = Duration::from_secs(2);

/// Time between two writes into the file: what a kill loses at most.
const FLUSH: Duration = Duration::from_secs(1);

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
    let mut board = Board { link, node, clock, doubts: 0 };
    let facts = wake(args, &mut board).and_then(|()| facts(args, &mut board));
    let remark = |board: &Board| adapter::remark(board.link.health()).iter().for_each(|text| warn(text));
    if facts.is_err() {
        remark(&board);
    }
    let heading = Heading { columns: columns(), metadata: facts? };
    let wrong = |error: TableError| bad(&args.out.display().to_string(), error);
    let pending = Pending::default();
    let mut sink = format.appending(pending.clone(), &heading).map_err(wrong)?;
    let file = File::create(&args.out).map_err(|error| wrong(TableError::Io(error)))?;
    let mut log = Log { pending, file, rows: 0, untrusted: 0 };
    log.flush().map_err(wrong)?;
    if let Format::Parquet = format {
        warn(&format!(
            "warning: a kill loses {}, since a Parquet file has its index at its end; record .csv or .mcap, and convert it",
            args.out.display()
        ));
    }
    warn(&format!("recording node {}; ^C ends it and keeps the file", args.node));
    let recorded = record(args, &mut board, sink.as_mut(), &mut log, seconds);
    sink.finish().and_then(|()| log.flush()).map_err(wrong)?;
    remark(&board);
    if log.untrusted > 0 {
        warn(&format!(
            "warning: {} of {} rows could not be trusted (column {UNTRUSTED}): answers were damaged, missing or out of range\n  next: check adapter and cable",
            log.untrusted, log.rows
        ));
    }
    recorded?;
    warn(&format!("{}: {} rows of node {}", args.out.display(), log.rows, args.node));
    Ok(())
}

/// The file, and how much is in it.
struct Log {
    /// Rows that are not in the file yet.
    pending: Pending,
    file: File,
    rows: u64,
    untrusted: u64,
}

impl Log {
    /// Writes what is pending. Called between two rows, so that the file has whole ones.
    fn flush(&mut self) -> Result<(), TableError> {
        Ok(self.file.write_all(&self.pending.take())?)
    }
}

fn duration(seconds: Option<f64>) -> Result<Option<Duration>, BadInput> {
    let Some(seconds) = seconds else { return Ok(None) };
    match Duration::try_from_secs_f64(seconds) {
        Ok(duration) if !duration.is_zero() => Ok(Some(duration)),
        _ => Err(BadInput::new("--seconds", "is no duration")
            .found(format!("{seconds:e}"))
            .expected("seconds above 0, and fewer than 1e19")
            .next("give a duration, or omit it and end with ^C")),
    }
}

/// The board at the other end.
struct Board<'a> {
    link: Link,
    node: Node,
    clock: Clock<'a>,
    /// Answers that were missing, or no value of their property.
    doubts: u64,
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
            match Message::parse(&frame).and_then(|message| message.answered()) {
                Some((from, of, Some(value))) if (from, of) == (self.node, property) => {
                    return Ok(Some(value));
                }
                Some((from, of, None)) if (from, of) == (self.node, property) => break,
                _ => {}
            }
        }
        self.doubts += 1;
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
    BadInput::new(place(args), format!("node {} is silent", args.node))
        .found(found)
        .expected("a board with its application running")
        .next("check --node, the board's power, and the cable and termination of the bus")
}

fn foreign(args: &LogArgs, units: i64) -> BadInput {
    BadInput::new(place(args), format!("node {} speaks another hand's units", args.node))
        .found(format!("HOSTUNITS {units}"))
        .expected("HOSTUNITS 0")
        .next("SET HOSTUNITS (127) to 0, and set it again after the recording")
}

fn columns() -> Vec<Column> {
    let time = Column::new(TIME, unit(TIME), Kind::Float).decimals(3);
    let others = COLUMNS.iter().map(|(name, _, _, decimals)| match decimals {
        0 => Column::new(*name, unit(name), Kind::Int).nullable(),
        decimals => Column::new(*name, unit(name), Kind::Float).nullable().decimals(*decimals),
    });
    let untrusted = Column::new(UNTRUSTED, unit(UNTRUSTED), Kind::Int);
    std::iter::once(time).chain(others).chain([untrusted]).collect()
}

/// All properties that can be read, by name: gains, limits and versions.
fn facts(args: &LogArgs, board: &mut Board) -> Result<Vec<(String, String)>, BadInput> {
    let mut facts = vec![
        (RECORDED_BY.to_owned(), format!("hil-sim {}", env!("CARGO_PKG_VERSION"))),
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
            Some(units) if *property == Property::HOSTUNITS && units != 0 => {
                return Err(foreign(args, units));
            }
            Some(value) => facts.push((property.row().name.to_owned(), value.to_string())),
            None if facts.len() == given => return Err(silent(args, "no answer for 2 s")),
            None => warn(&format!("warning: no answer about {}: the metadata lacks it", property.row().name)),
        }
    }
    Ok(facts)
}

/// Records until the time is over or ^C.
fn record(
    args: &LogArgs,
    board: &mut Board,
    sink: &mut dyn Sink,
    log: &mut Log,
    seconds: Option<Duration>,
) -> Result<(), BadInput> {
    let begun = (board.clock)();
    let (mut answered, mut flushed) = (begun, begun);
    let wrong = |error: TableError| bad(&args.out.display().to_string(), error);
    loop {
        let now = (board.clock)();
        if interrupt::interrupted() || seconds.is_some_and(|seconds| now - begun >= seconds) {
            return Ok(());
        }
        if now - flushed >= FLUSH {
            log.flush().map_err(wrong)?;
            flushed = now;
        }
        let (doubts, damaged) = (board.doubts, board.link.health().damaged);
        let mut row = vec![Cell::Float((now - begun).as_secs_f64() * 1000.0)];
        for (_, property, scale, decimals) in COLUMNS {
            let value = board.get(property)?;
            if value.is_some() {
                answered = (board.clock)();
            } else if (board.clock)() - answered >= SILENCE {
                let rows = log.rows;
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
        // A damaged line is mostly that of the answer that is missing.
        let untrusted = (board.doubts - doubts).max(board.link.health().damaged - damaged);
        row.push(Cell::Int(i64::try_from(untrusted).unwrap_or(i64::MAX)));
        sink.row(&row).map_err(wrong)?;
        log.rows += 1;
        log.untrusted += u64::from(untrusted > 0);
    }
}
