//! A bus through the host library, over SLCAN or a CAN interface, as a [`Link`] with the clock of its caller. Every wait has a deadline.

use std::fmt;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tater_wire::Frame;
use wraptor::{Bus, CallError, ConnectError, Health};

use super::excite::Link;
use traces::input::BadInput;

/// Time since some start, such as the program's.
pub type Clock<'a> = &'a dyn Fn() -> Duration;

/// Timeout for a connection, an adapter that opens, and a frame that it takes.
const PATIENCE: Duration = Duration::from_secs(5);

/// Baud rate of an SLCAN adapter on a serial port; those on USB ignore it.
#[cfg(unix)]
const BAUD: u32 = 115_200;

/// An adapter, as on the command line.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum Adapter {
    /// SLCAN: HOST:PORT, or a serial port if it begins with `/`.
    Slcan(String),
    /// A CAN interface of Linux.
    Can(String),
}

impl fmt::Display for Adapter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Slcan(address) => write!(f, "--slcan {address}"),
            Self::Can(interface) => write!(f, "--can {interface}"),
        }
    }
}

impl Adapter {
    /// The one of the options `--slcan` and `--can`.
    ///
    /// # Errors
    /// Neither is given.
    pub fn named(slcan: Option<&str>, can: Option<&str>) -> Result<Self, BadInput> {
        let slcan = slcan.map(|address| Self::Slcan(address.to_owned()));
        let adapter = slcan.or_else(|| can.map(|interface| Self::Can(interface.to_owned())));
        adapter.ok_or_else(|| bad("the bus", "no adapter is named", "neither --slcan nor --can"))
    }

    /// Opens it at 1 Mbit/s. `interrupted`: whether the user wants to end.
    ///
    /// # Errors
    /// The cause and the next step.
    pub fn open<'a>(
        &self,
        clock: Clock<'a>,
        interrupted: &'a dyn Fn() -> bool,
    ) -> Result<Box<dyn Link + 'a>, BadInput> {
        let place = self.to_string();
        let bus = match self {
            #[cfg(unix)]
            Self::Slcan(path) if path.starts_with('/') => Bus::slcan_serial(path, BAUD, PATIENCE),
            Self::Slcan(address) => Bus::slcan(address, PATIENCE),
            #[cfg(target_os = "linux")]
            Self::Can(interface) => Bus::can(interface),
            #[cfg(not(target_os = "linux"))]
            Self::Can(_) => return Err(bad(&place, "cannot be used", "a system without CAN interfaces")),
        };
        let failed = |error: ConnectError| BadInput {
            next: error.cause.next_step().to_owned(),
            ..bad(&place, "cannot be used", &error.cause.to_string())
        };
        let bus = bus.map_err(failed)?;
        Ok(Box::new(Timed { bus, place, clock, interrupted }))
    }
}

/// A connection with its clock.
struct Timed<'a> {
    bus: Bus,
    place: String,
    clock: Clock<'a>,
    interrupted: &'a dyn Fn() -> bool,
}

impl Timed<'_> {
    fn lost(&self, error: &CallError) -> String {
        BadInput {
            next: "check its cable and power; a motor that a host drives idles by itself after HOSTMS"
                .to_owned(),
            ..bad(&self.place, "the adapter is lost", &error.failure.to_string())
        }
        .to_string()
    }
}

impl Link for Timed<'_> {
    fn now_us(&self) -> u64 {
        u64::try_from((self.clock)().as_micros()).unwrap_or(u64::MAX)
    }

    fn send(&mut self, frame: &Frame) -> Result<(), String> {
        self.bus.send(frame, PATIENCE).map_err(|error| self.lost(&error))
    }

    /// A frame that the adapter keeps refusing is lost: its answer will be missed.
    fn receive(&mut self, until_us: u64) -> Result<Option<(u64, Frame)>, String> {
        let limit = Duration::from_micros(until_us).saturating_sub((self.clock)());
        let frame = self.bus.receive(limit).map_err(|error| self.lost(&error))?;
        Ok(frame.map(|frame| (self.now_us(), frame)))
    }

    fn is_interrupted(&self) -> bool {
        (self.interrupted)()
    }

    fn damaged(&self) -> u64 {
        self.bus.health().damaged
    }

    fn remark(&self) -> Option<String> {
        let Health { refusals, damaged } = self.bus.health();
        let refused =
            (refusals > 0).then(|| format!("refused {refusals} frames, each of which was sent again"));
        let damaged = (damaged > 0).then(|| format!("sent {damaged} damaged lines, which were left out"));
        let all: Vec<String> = refused.into_iter().chain(damaged).collect();
        (!all.is_empty()).then(|| format!("note: the adapter {}; check it and its cable", all.join(" and ")))
    }
}

fn bad(place: &str, problem: &str, found: &str) -> BadInput {
    BadInput::new(place, problem).found(found).expected("an SLCAN adapter at 1 Mbit/s, such as `hil-sim bus --node 4 --slcan 127.0.0.1:0`, or a CAN interface").next("check its address, cable and power, and end other programs that use it")
}
