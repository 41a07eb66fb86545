//! RealTime control: LOOP, its blocks, and what they mean (manual 6).
//!
//! The wire sets the pace: a feedback block begins as soon as its header is there, and each motor's data follow as soon as its board
//! has answered, while the control data are still coming in. What has gone wrong is told in place of the next block's `*`; what the host says
//! on top of that, or the rest of that block, is heard out before: it is no line.
//!
//! The motors run in mode 4: the board makes a torque of gain × velocity error. Without X a finger is one unit: its link has the data,
//! and its tip goes along, at a third of the link's joint velocity. To press on something is no error: a motor that stalls is off (or holds its
//! place, by HOLD) until the next control block, which drives it again.

mod blocks;

use core::cell::Cell;

use tater_wire::Property;
use tater_wire::fault::FaultCode;

use crate::boards::{Answers, STALLED, VELOCITY};
use crate::god::God;
use crate::io::{ABORT, Io, join};
use crate::motors::{Motor, Motors, Prefix, Selection};
use crate::movement;
use crate::status::Status;
use crate::units;
use crate::words::Arguments;
use blocks::{Feedback, Shape};

/// Host silence after which the motors stop, us: a tenth of a revolution of the slowest joint at RealTime's full speed. They stay in RealTime;
/// the next block moves them again. In a block it ends the block, and nothing of it is obeyed.
pub const SILENCE_US: u64 = 250_000;

/// How often each board is spoken to, us: it idles with ERROR 7 after 500 ms without a frame.
const ALIVE_US: u64 = 200_000;

/// Host silence after which it has said all that it was about to say before it could see an error, us: a byte takes 16.7 ms at 600 baud, 1 ms
/// at 9600, and a USB adapter keeps bytes back for 16 ms. The error comes well within the 100 ms that clients wait for a block's `*`.
const QUIET_US: u64 = 20_000;

/// How long a host is heard out that does not fall silent, us; but a block's data to their end.
const HEARD_OUT_US: u64 = 1_000_000;

/// How long a board may take until it drives in mode 4, us: the spread's brake lets go in 30 ms.
const SETS_OUT_US: u64 = 40_000;

/// Greatest velocity that a board takes, hall counts/s.
const MOST: i64 = 4080;

/// What ends RealTime.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    /// ^C instead of a header: a plain prompt.
    Host,
    /// Said instead of the next `*`, after so many data bytes of the block that is not obeyed.
    Error(Status, usize),
}

/// LOOP.
pub(crate) async fn execute(god: &God<'_>, prefix: Prefix, arguments: Arguments<'_>) -> Status {
    if let Err(status) = arguments.none() {
        return status;
    }
    let selection = match movement::take_over(god, prefix).await {
        Ok(selection) => selection,
        Err(status) => return status,
    };
    let control = Loop::new(god, selection).await;
    let refusal = control.set_out().await;
    if !refusal.is_ok() {
        control.end().await;
        return refusal;
    }
    god.io.enter_raw();
    god.io.write(b"*").await;
    let end = control.run().await;
    control.end().await;
    let status = match end {
        End::Host => Status::OK,
        End::Error(status, data) => {
            hear_out(god.io, data).await;
            status
        }
    };
    // What comes next is lines again.
    god.io.leave_raw();
    status
}

/// Hears what a host says that does not know yet that RealTime is over: so many data bytes, and whatever else until it waits for an answer.
/// A ^C, if it is not one of these data and is the last of it, aborts.
async fn hear_out(io: &Io, data: usize) {
    let end_us = io.after_us(HEARD_OUT_US);
    let (mut heard, mut last) = (0_usize, None);
    while heard < data || io.now_us() < end_us {
        let Some(byte) = io.read(io.after_us(QUIET_US)).await else { break };
        last = Some(byte).filter(|_| heard >= data);
        heard = heard.saturating_add(1);
    }
    if last == Some(ABORT) {
        io.abort();
    }
}

/// RealTime control of some motors.
struct Loop<'a, 'b> {
    god: &'a God<'b>,
    selection: Selection,
    shape: Shape,
    /// The gains that the boards had before.
    own_gains: Answers,
    /// The gains that the boards have.
    gains: Cell<Answers>,
    /// What the boards have been told last.
    velocities: Cell<Answers>,
    /// Motors that have stalled: the next control block drives them again.
    stalled: Cell<Motors>,
    /// Those whose boards have stopped answering.
    silent: Cell<Motors>,
    /// When all of the boards were last spoken to, us.
    spoken_us: Cell<u64>,
}

impl<'a, 'b> Loop<'a, 'b> {
    /// Puts the motors into mode 4 at rest. What they report from now on is of that.
    async fn new(god: &'a God<'b>, selection: Selection) -> Self {
        let motors = selection.motors();
        let shape = Shape::of(&god.parameters.borrow(), selection.axes);
        let gains = god.boards.get(motors, Property::KPV).await;
        let mut velocities = Answers::default();
        motors.iter().for_each(|motor| {
            velocities.set(motor, 0);
            god.boards.take_reported(motor);
        });
        god.boards.set_each(Property::V, &velocities).await;
        god.boards.set(motors, Property::MODE, VELOCITY).await;
        Self {
            god,
            selection,
            shape,
            own_gains: gains,
            gains: Cell::new(gains),
            velocities: Cell::new(velocities),
            stalled: Cell::default(),
            silent: Cell::new(motors.difference(gains.motors())),
            spoken_us: Cell::new(god.io.now_us()),
        }
    }

    /// Waits until all are under way. Returns what is against it.
    async fn set_out(&self) -> Status {
        self.god.io.sleep_until(self.god.io.after_us(SETS_OUT_US)).await;
        self.look(self.selection.motors()).await
    }

    /// Block after block, to the end.
    async fn run(&self) -> End {
        loop {
            let Some(header) = self.byte().await else { continue };
            // A LF that belongs to the CR of LOOP's line; any other is no header.
            if self.god.io.is_second_line_end(Some(header).filter(|&byte| byte == b'\n')) {
                continue;
            }
            let data = match header {
                ABORT => return End::Host,
                b'C' | b'c' => self.shape.control_bytes(),
                b'A' | b'a' => 0,
                _ => return End::Error(Status::BAD_HEADER, 0),
            };
            let wrong = self.faults().await;
            if !wrong.is_ok() {
                return End::Error(wrong, data);
            }
            match header {
                // The data come in while the feedback goes out.
                b'C' => _ = join(self.feed_back(), self.obey()).await,
                b'A' => self.feed_back().await,
                b'c' => {
                    // A block that broke off is none, and has no answer.
                    if self.obey().await.is_some() {
                        self.write(b"*").await;
                    }
                }
                _ => self.write(b"*").await,
            }
        }
    }

    /// All that was begun is ended.
    async fn end(&self) {
        // Velocities that have not left yet are void.
        self.god.io.drop_frames();
        self.stop().await;
        movement::let_go(self.god, self.silent.get()).await;
    }

    /// The next byte of the host; `None` after [`SILENCE_US`] without one: the motors stand then. Each board is spoken to meanwhile.
    async fn byte(&self) -> Option<u8> {
        let silent_us = self.god.io.after_us(SILENCE_US);
        loop {
            let alive_us = self.spoken_us.get().saturating_add(ALIVE_US);
            if self.god.io.now_us() >= alive_us {
                // Says nothing to them but that somebody is there.
                self.tell().await;
                continue;
            }
            if let Some(byte) = self.god.io.read(alive_us.min(silent_us)).await {
                return Some(byte);
            }
            if self.god.io.now_us() >= silent_us {
                if !self.is_stopped() {
                    self.stop().await;
                }
                return None;
            }
        }
    }

    fn is_stopped(&self) -> bool {
        self.velocities.get().filter(|velocity| velocity != 0).is_empty()
    }

    /// All motors to rest.
    async fn stop(&self) {
        let mut rest = Answers::default();
        self.selection.motors().iter().for_each(|motor| rest.set(motor, 0));
        self.velocities.set(rest);
        self.tell().await;
    }

    /// Tells the boards their velocities.
    async fn tell(&self) {
        self.god.boards.set_each(Property::V, &self.velocities.get()).await;
        self.spoken_us.set(self.god.io.now_us());
    }

    /// A control block's data, and what they ask for once all are there; `None` if they break off.
    async fn obey(&self) -> Option<()> {
        let (mut velocities, mut gains) = (Answers::default(), Answers::default());
        for motor in self.selection.axes.iter() {
            let Some(of) = self.shape.of_motor(motor) else { continue };
            if of.velocity {
                let byte = self.byte().await?.cast_signed();
                let velocity = (i64::from(byte) * i64::from(of.velocity_coefficient)).clamp(-MOST, MOST);
                velocities.set(motor, velocity);
                if let Some(tip) = self.follows(motor) {
                    velocities.set(tip, units::of_tip_along(velocity));
                }
            }
            if of.gain {
                let gain = i64::from(self.byte().await?);
                gains.set(motor, gain);
                if let Some(tip) = self.follows(motor) {
                    gains.set(tip, gain);
                }
            }
        }
        // A gain is told where it is another.
        let had = self.gains.get();
        let changed = gains.different_from(&had);
        self.gains.set(had.overridden_by(&gains));
        movement::lend(self.god, Property::KPV, &changed, &self.own_gains).await;
        self.velocities.set(self.velocities.get().overridden_by(&velocities));
        self.god.boards.set_each(Property::V, &velocities).await;
        if velocities.motors() == self.selection.motors() {
            self.spoken_us.set(self.god.io.now_us());
        }
        self.god.boards.set(self.stalled.take(), Property::MODE, VELOCITY).await;
        Some(())
    }

    /// Writes bytes to the host. One that does not read for [`SILENCE_US`] stops the motors, and its ^C ends RealTime though nobody
    /// reads it as a header.
    async fn write(&self, bytes: &[u8]) {
        let io = self.god.io;
        let silent_us = io.after_us(SILENCE_US);
        loop {
            let alive_us = self.spoken_us.get().saturating_add(ALIVE_US);
            let deadline_us = if io.now_us() < silent_us { alive_us.min(silent_us) } else { alive_us };
            let written = io.wait_until(deadline_us, || {
                if io.now_us() >= silent_us && io.last_rx() == Some(ABORT) {
                    io.abort();
                }
                io.try_write(bytes).then_some(())
            });
            if written.await.is_some() {
                return;
            }
            if io.now_us() >= silent_us && !self.is_stopped() {
                self.stop().await;
            } else {
                self.tell().await;
            }
        }
    }

    /// The tip that goes along with a link.
    fn follows(&self, motor: Motor) -> Option<Motor> {
        motor.tip().filter(|_| !self.selection.exclusive)
    }

    /// A feedback block, motor by motor as the answers come.
    async fn feed_back(&self) {
        self.god.boards.ask_ahead(self.selection.axes, self.shape.asks()).await;
        self.write(b"*").await;
        for motor in self.selection.axes.iter() {
            let Some(of) = self.shape.of_motor(motor) else { continue };
            let found = self.god.boards.answer_of(motor, of.asks()).await;
            if found.is_none() {
                self.silent.set(self.silent.get().with(motor));
            }
            let reported = self.god.reported.get().get(motor.index()).copied().unwrap_or(0);
            let block = Feedback::of(&of, found.unwrap_or_default(), reported, self.shape.discards);
            let mut all = self.god.reported.get();
            if let Some(place) = all.get_mut(motor.index()) {
                *place = block.reported;
            }
            self.god.reported.set(all);
            self.write(&block.bytes).await;
        }
        if self.shape.temperature {
            self.write(&self.god.io.temperature().to_be_bytes()).await;
        }
    }

    /// What is wrong, by what boards have reported since they were last looked at, and by those that have not answered.
    async fn faults(&self) -> Status {
        if self.god.io.is_bus_down() {
            self.silent.set(self.selection.motors());
            return Status::NO_BOARD;
        }
        let mut motors = Motors::NONE;
        for motor in self.selection.motors().iter() {
            let reported = self.god.boards.take_reported(motor);
            if reported.end.is_some() || reported.mode.is_some() {
                motors = motors.with(motor);
            }
        }
        self.look(motors).await
    }

    /// What is wrong with motors that should be in mode 4; those that have only stalled are to be driven again.
    async fn look(&self, motors: Motors) -> Status {
        let boards = &self.god.boards;
        let modes = boards.get(motors, Property::MODE).await;
        let out = modes.filter(|mode| mode != VELOCITY);
        let errors = boards.get(out, Property::ERROR).await;
        let lost = movement::lost(self.god, out).await;
        let stalled = boards.get(out, Property::END).await.filter(|end| end == STALLED);
        let answering = modes.motors().difference(out.difference(errors.motors()));
        self.silent.set(self.silent.get().union(motors.difference(answering)));
        let mut status = if self.silent.get().is_empty() { Status::OK } else { Status::NO_BOARD };
        for motor in errors.motors().iter() {
            status |= match errors.get(motor).and_then(FaultCode::of) {
                Some(FaultCode::OverTemperature) => Status::OVER_TEMPERATURE,
                _ if lost.has(motor) => Status::NOT_INITIALIZED,
                None | Some(FaultCode::Storage) if stalled.has(motor) => {
                    self.stalled.set(self.stalled.get().with(motor));
                    Status::OK
                }
                // It cannot forget a stored position, so it does not move.
                Some(FaultCode::Storage) => Status::NOT_STORED,
                // Another host of the bus has ended it, if no fault has.
                _ => Status::FAULT,
            };
        }
        status
    }
}
