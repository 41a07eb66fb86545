//! `hil-sim log`: records a live board over its bus into a trace.
//!
//! Rows go into the file each second, whole, and nothing else is kept: a program that is killed leaves what it had recorded, and a recording of
//! days needs no more memory than one of a minute. Parquet keeps its index for the end, so there a kill loses the file.

use std::error::Error;
use std::fs::File;
use std::io::Write;
use std::path::PathBuf;
use std::time::Duration;

use tater_wire::Node;

use super::convert::Pending;
use super::output::check_file;
use commission::adapter::{Adapter, Clock};
use commission::recording::Recording;
use programs::interrupt;
use programs::output::warn;
use traces::format::Format;
use traces::input::BadInput;
use traces::names::UNTRUSTED;
use traces::numbers::bad;
use traces::table::TableError;

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

/// Records a board; `clock` is real time.
///
/// # Errors
/// No such bus, a silent board, or a file that cannot be written. What was recorded before a board fell silent is written.
pub fn log(args: &LogArgs, clock: Clock) -> Result<(), Box<dyn Error>> {
    let format = Format::of(&args.out)?;
    let seconds = duration(args.seconds)?;
    check_file(&args.out)?;
    // From here ^C ends the recording and not the program.
    interrupt::finish_first();
    let adapter = Adapter::named(args.slcan.as_deref(), args.can.as_deref())?;
    let mut link = adapter.open(clock, &interrupt::interrupted)?;
    let place = adapter.to_string();
    let mut recording = Recording::new(link.as_mut(), &place, Node::new(args.node).unwrap_or(Node::HOST));
    let remark = |recording: &Recording| recording.remark().iter().for_each(|text| warn(text));
    let program = format!("hil-sim {}", env!("CARGO_PKG_VERSION"));
    let heading = recording.heading(&program, &mut |step| warn(step));
    if heading.is_err() {
        remark(&recording);
    }
    let heading = heading?;
    let wrong = |error: TableError| bad(&args.out.display().to_string(), error);
    let pending = Pending::default();
    let mut sink = format.appending(pending.clone(), &heading).map_err(wrong)?;
    let mut file = File::create(&args.out).map_err(|error| wrong(TableError::Io(error)))?;
    let mut flush = || Ok(file.write_all(&pending.take())?);
    flush().map_err(wrong)?;
    if let Format::Parquet = format {
        warn(&format!(
            "warning: a kill loses {}, since a Parquet file has its index at its end; record .csv or .mcap, and convert it",
            args.out.display()
        ));
    }
    warn(&format!("recording node {}; ^C ends it and keeps the file", args.node));
    let us = seconds.map(|seconds| u64::try_from(seconds.as_micros()).unwrap_or(u64::MAX));
    let recorded = recording.record(sink.as_mut(), &mut flush, &args.out, us);
    sink.finish().and_then(|()| flush()).map_err(wrong)?;
    remark(&recording);
    let Recording { rows, untrusted, .. } = recording;
    if untrusted > 0 {
        warn(&format!(
            "warning: {untrusted} of {rows} rows could not be trusted (column {UNTRUSTED}): answers were damaged, missing or out of range\n  next: check adapter and cable"
        ));
    }
    recorded?;
    warn(&format!("{}: {rows} rows of node {}", args.out.display(), args.node));
    Ok(())
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
