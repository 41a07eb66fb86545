//! RealTime control: LOOP, its blocks, and what they mean (manual 6).
//!
//! The wire sets the pace: a feedback block begins as soon as its header is there, and each motor's data follow as soon as its board
//! has answered, while the control data are still coming in. What has gone wrong is told in place of the next block's `*`.
//!
//! The motors run in mode 4: the board makes a torque of gain × velocity error. Without X a finger is one unit: its link has the data,
//! and its tip goes along, at a third of the link's joint velocity.

mod blocks;

use core::cell::Cell;
use tater_wire::Property;

use tater_wire::fault::FaultCode;

use crate::boards::Answers;
use crate::god::God;
use crate::io::{ABORT, both};
use crate::motors::{Motor, Motors, Prefix, Selection};
use crate::movement;
use crate::status::Status;
use crate::words::Arguments;
use blocks::{Feedback, Shape};

/// Host silence after which the motors stop, us: a tenth of a revolution of the slowest joint at RealTime's full speed. They stay in RealTime;
/// the next block moves them again.
pub const SILENCE_US: u64 = 250_000;

/// How often boards are spoken to while the host is silent, us: they idle with ERROR 7 after 500 ms without a frame.
const ALIVE_US: u64 = 200_000;

/// The boards' mode meanwhile.
const VELOCITY: i64 = 4;

/// Greatest velocity that a board takes, hall counts/s.
const MOST: i64 = 4080;

/// Velocity of a tip by its link's: a third of the joint's, by the ratios 39 and 49 (manual 1.3.2).
const fn of_tip(link: i64) -> i64 {
    link * 13 / 49
}

/// What ends RealTime.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    /// ^C instead of a header: a plain prompt.
    Host,
    /// Said instead of the next `*`.
    Error(Status),
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
    god.io.set_raw(true);
    god.io.say(b"*").await;
    let end = control.run().await;
    // What comes next is lines again.
    god.io.set_raw(false);
    control.stop().await;
    movement::let_go(god).await;
    god.io.reread();
    match end {
        End::Host => Status::OK,
        End::Error(status) => status,
    }
}

/// RealTime control of some motors.
struct Loop<'a, 'b> {
    god: &'a God<'b>,
    selection: Selection,
    shape: Shape,
    /// The gains that the boards have.
    gains: Cell<Answers>,
    /// What the boards have been told last.
    velocities: Cell<Answers>,
    /// What is to be said instead of the next `*`.
    wrong: Cell<Status>,
    /// When the boards were last spoken to, us.
    spoken_us: Cell<u64>,
}

impl<'a, 'b> Loop<'a, 'b> {
    /// Puts the motors into mode 4 at rest.
    async fn new(god: &'a God<'b>, selection: Selection) -> Self {
        let motors = selection.motors();
        let shape = Shape::of(&god.parameters.borrow(), selection.axes);
        god.boards.set(motors, Property::V, 0).await;
        god.boards.set(motors, Property::MODE, VELOCITY).await;
        let gains = god.boards.get(motors, Property::KPV).await;
        for motor in motors.iter() {
            god.boards.takes(motor);
        }
        let mut velocities = Answers::default();
        motors.iter().for_each(|motor| velocities.put(motor, 0));
        let wrong = if gains.motors() == motors { Status::OK } else { Status::NO_BOARD };
        let spoken_us = Cell::new(god.io.now_us());
        let [gains, velocities] = [gains, velocities].map(Cell::new);
        Self { god, selection, shape, gains, velocities, wrong: Cell::new(wrong), spoken_us }
    }

    /// Block after block, to the end.
    async fn run(&self) -> End {
        loop {
            let header = self.byte().await;
            if header == ABORT {
                return End::Host;
            }
            if !matches!(header, b'A' | b'a' | b'C' | b'c') {
                return End::Error(Status::BAD_HEADER);
            }
            let wrong = self.wrong.get() | self.faults().await;
            if !wrong.is_ok() {
                return End::Error(wrong);
            }
            match header {
                // The data come in while the feedback goes out.
                b'C' => _ = both(self.feed_back(), self.obey()).await,
                b'A' => self.feed_back().await,
                b'c' => {
                    self.obey().await;
                    self.god.io.say(b"*").await;
                }
                _ => self.god.io.say(b"*").await,
            }
        }
    }

    /// The next byte of the host, however long it takes; the motors stop meanwhile.
    async fn byte(&self) -> u8 {
        let silent_us = self.god.io.now_us().saturating_add(SILENCE_US);
        loop {
            let now = self.god.io.now_us();
            let alive_us = self.spoken_us.get().saturating_add(ALIVE_US);
            let wait_us = if self.is_stopped() { alive_us } else { alive_us.min(silent_us) };
            if let Some(byte) = self.god.io.hears(wait_us.max(now)).await {
                return byte;
            }
            if self.god.io.now_us() >= silent_us && !self.is_stopped() {
                self.stop().await;
            } else {
                // Says nothing to them but that somebody is there.
                self.tell().await;
            }
        }
    }

    fn is_stopped(&self) -> bool {
        self.velocities.get().which(|velocity| velocity != 0).is_empty()
    }

    /// All motors to rest.
    async fn stop(&self) {
        let mut rest = Answers::default();
        self.selection.motors().iter().for_each(|motor| rest.put(motor, 0));
        self.velocities.set(rest);
        self.tell().await;
    }

    /// Tells the boards their velocities.
    async fn tell(&self) {
        self.god.boards.set_each(Property::V, &self.velocities.get()).await;
        self.spoken_us.set(self.god.io.now_us());
    }

    /// A control block's data, and what they ask for once all are there.
    async fn obey(&self) {
        let (mut velocities, mut gains) = (Answers::default(), Answers::default());
        for motor in self.selection.axes.iter() {
            let Some(of) = self.shape.of_motor(motor) else { continue };
            if of.velocity {
                let byte = self.byte().await.cast_signed();
                let velocity = (i64::from(byte) * i64::from(of.velocity_coefficient)).clamp(-MOST, MOST);
                velocities.put(motor, velocity);
                if let Some(tip) = self.follows(motor) {
                    velocities.put(tip, of_tip(velocity));
                }
            }
            if of.gain {
                let gain = i64::from(self.byte().await);
                gains.put(motor, gain);
                if let Some(tip) = self.follows(motor) {
                    gains.put(tip, gain);
                }
            }
        }
        // A gain is told where it is another.
        let had = self.gains.get();
        let changed = gains.differing(&had);
        self.gains.set(had.and(&gains));
        self.god.boards.set_each(Property::KPV, &changed).await;
        self.velocities.set(self.velocities.get().and(&velocities));
        self.god.boards.set_each(Property::V, &velocities).await;
        self.spoken_us.set(self.god.io.now_us());
    }

    /// The tip that goes along with a link.
    fn follows(&self, motor: Motor) -> Option<Motor> {
        motor.tip().filter(|_| !self.selection.exclusive)
    }

    /// A feedback block, motor by motor as the answers come.
    async fn feed_back(&self) {
        self.god.boards.ask_ahead(self.selection.axes, self.shape.asks()).await;
        self.spoken_us.set(self.god.io.now_us());
        self.god.io.say(b"*").await;
        for motor in self.selection.axes.iter() {
            let Some(of) = self.shape.of_motor(motor) else { continue };
            let found = self.god.boards.answer_of(motor, of.asks()).await;
            if found.is_none() {
                self.wrong.set(self.wrong.get() | Status::NO_BOARD);
            }
            let reported = self.god.reported.get().get(motor.index()).copied().unwrap_or(0);
            let block = Feedback::of(&of, found.unwrap_or_default(), reported, self.shape.discards);
            let mut all = self.god.reported.get();
            if let Some(place) = all.get_mut(motor.index()) {
                *place = block.reported;
            }
            self.god.reported.set(all);
            self.god.io.say(&block.bytes).await;
        }
        if self.shape.temperature {
            self.god.io.say(&self.god.io.temperature().to_be_bytes()).await;
        }
    }

    /// What boards have reported to be wrong since they were last looked at.
    async fn faults(&self) -> Status {
        let mut status = Status::OK;
        for motor in self.selection.motors().iter() {
            let reported = self.god.boards.takes(motor);
            if reported.end.is_none() && reported.mode.is_none_or(|mode| mode == VELOCITY) {
                continue;
            }
            let one = Motors::NONE.with(motor);
            let error = self.god.boards.get(one, Property::ERROR).await.of(motor);
            status |= match error.map(FaultCode::of) {
                None => Status::NO_BOARD,
                Some(Some(FaultCode::OverTemperature)) => Status::OVER_TEMPERATURE,
                // It has begun anew, and knows nothing.
                Some(Some(FaultCode::Halls) | None) => Status::NOT_INITIALIZED,
                Some(Some(_)) => Status::FAULT,
            };
        }
        status
    }
}
