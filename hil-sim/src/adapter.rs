//! A host's connection to a bus, over SLCAN or a CAN interface: the host library's, with the clock of commands that record. Every wait has a
//! deadline.

use std::time::Duration;

use tater_wire::Frame;
use wraptor::{Bus, CallError, ConnectError, Health};

use commission::excite;
use programs::interrupt;
use traces::input::BadInput;

/// Real time since the program started.
pub type Clock<'a> = &'a dyn Fn() -> Duration;

/// Timeout for a connection, an adapter that opens, and a frame that it takes.
const PATIENCE: Duration = Duration::from_secs(5);

/// Baud rate of an SLCAN adapter on a serial port; those on USB ignore it.
#[cfg(unix)]
const BAUD: u32 = 115_200;

/// A connection to a bus.
pub struct Link {
    bus: Bus,
    /// The option that names it.
    place: String,
}

impl Link {
    /// Opens the adapter that a command line names, at 1 Mbit/s. An SLCAN address that begins with `/` is a serial port.
    ///
    /// # Errors
    /// The cause and the next step.
    pub fn open(slcan: Option<&str>, can: Option<&str>) -> Result<Self, BadInput> {
        let place = match (slcan, can) {
            (Some(address), _) => format!("--slcan {address}"),
            (None, Some(interface)) => format!("--can {interface}"),
            (None, None) => return Err(bad("the bus", "no adapter is named", "neither --slcan nor --can")),
        };
        let failed = |error: ConnectError| BadInput {
            next: error.cause.next_step().to_owned(),
            ..bad(&place, "cannot be used", &error.cause.to_string())
        };
        let bus = match (slcan, can) {
            #[cfg(unix)]
            (Some(path), _) if path.starts_with('/') => Bus::slcan_serial(path, BAUD, PATIENCE),
            (Some(address), _) => Bus::slcan(address, PATIENCE),
            #[cfg(target_os = "linux")]
            (None, Some(interface)) => Bus::can(interface),
            (None, _) => return Err(bad(&place, "cannot be used", "a system without CAN interfaces")),
        };
        Ok(Self { bus: bus.map_err(failed)?, place })
    }

    /// Sends a frame.
    ///
    /// # Errors
    /// The bus is lost.
    pub fn send(&mut self, frame: &Frame) -> Result<(), BadInput> {
        self.bus.send(frame, PATIENCE).map_err(|error| self.lost(&error))
    }

    /// What the adapter has not carried at the first attempt.
    pub const fn health(&self) -> Health {
        self.bus.health()
    }

    /// The next frame; `None` if none comes within the limit. A frame that the adapter keeps refusing is lost: its answer will be missed.
    ///
    /// # Errors
    /// The bus is lost.
    pub fn receive(&mut self, limit: Duration) -> Result<Option<Frame>, BadInput> {
        self.bus.receive(limit).map_err(|error| self.lost(&error))
    }

    fn lost(&self, error: &CallError) -> BadInput {
        BadInput {
            next: "check its cable and power; a motor that a host drives idles by itself after HOSTMS"
                .to_owned(),
            ..bad(&self.place, "the adapter is lost", &error.failure.to_string())
        }
    }
}

/// What an adapter has not carried at the first attempt.
pub fn remark(Health { refusals, damaged }: Health) -> Option<String> {
    let refused = (refusals > 0).then(|| format!("refused {refusals} frames, each of which was sent again"));
    let damaged = (damaged > 0).then(|| format!("sent {damaged} damaged lines, which were left out"));
    let all: Vec<String> = refused.into_iter().chain(damaged).collect();
    (!all.is_empty()).then(|| format!("note: the adapter {}; check it and its cable", all.join(" and ")))
}

/// A connection with its clock.
struct Timed<'a> {
    link: Link,
    clock: Clock<'a>,
}

/// The adapter that a command line names, for commands that record.
///
/// # Errors
/// Those of [`Link::open`].
pub fn open<'a>(
    slcan: Option<&str>,
    can: Option<&str>,
    clock: Clock<'a>,
) -> Result<Box<dyn excite::Link + 'a>, BadInput> {
    Ok(Box::new(Timed { link: Link::open(slcan, can)?, clock }))
}

impl excite::Link for Timed<'_> {
    fn now_us(&self) -> u64 {
        u64::try_from((self.clock)().as_micros()).unwrap_or(u64::MAX)
    }

    fn send(&mut self, frame: &Frame) -> Result<(), String> {
        self.link.send(frame).map_err(|lost| lost.to_string())
    }

    fn receive(&mut self, until_us: u64) -> Result<Option<(u64, Frame)>, String> {
        let limit = Duration::from_micros(until_us).saturating_sub((self.clock)());
        let frame = self.link.receive(limit).map_err(|lost| lost.to_string())?;
        Ok(frame.map(|frame| (self.now_us(), frame)))
    }

    fn is_interrupted(&self) -> bool {
        interrupt::interrupted()
    }

    fn remark(&self) -> Option<String> {
        remark(self.link.health())
    }
}

fn bad(place: &str, problem: &str, found: &str) -> BadInput {
    BadInput::new(place, problem).found(found).expected("an SLCAN adapter at 1 Mbit/s, such as `hil-sim bus --node 4 --slcan 127.0.0.1:0`, or a CAN interface").next("check its address, cable and power, and end other programs that use it")
}
