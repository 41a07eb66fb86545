//! RealTime control: LOOP, its blocks, and what they do (manual 6).
//!
//! The wire sets the pace: a feedback block begins as soon as its header is there, and each motor's data follow as soon as its board has
//! answered, while the control data are still coming in. An error is reported in place of the next block's `*`, after the host's remaining
//! bytes have been discarded, so that they are not read as a line.
//!
//! The motors run in mode 4: the board's torque is gain × velocity error. Without X a finger is one unit: its link has the data, and its tip
//! follows at a third of the link's joint angle ([`follow`]). Pressing on an object is no error: a motor that stalls is off (or holds its place, by HOLD)
//! until the next control block, which drives it again.
//!
//! # Deadlines
//! Motors stop when the host is silent, or does not read, for [`SILENCE_US`]. A dead bus ends RealTime with ERR 1 in place of the next `*`; ^C
//! ends it within 0.5 s in any case.

mod blocks;
mod follow;

use core::cell::Cell;
use core::pin::pin;

use tater_wire::fault::FaultCode;
use tater_wire::{EndCode, ModeCode, Property};

use crate::boards::Answers;
use crate::god::God;
use crate::grammar::Arguments;
use crate::io::{ABORT, Io, NEVER, join};
use crate::motors::{COUNT, Motor, Motors, Prefix, Selection};
use crate::movement;
use crate::status::Status;
use crate::{order, query};
use blocks::{Feedback, Layout};
use follow::{Finger, Follower};

/// Host silence after which the motors stop, µs: a tenth of a revolution of the slowest joint at RealTime's full speed. They stay in
/// RealTime; the next block moves them again. A block that is broken off for so long is dropped.
pub const SILENCE_US: u64 = 250_000;

/// Interval of keep-alives to each board, µs: it idles with ERROR 7 after HOSTMS, 2 s, without a frame (decision 0013).
const KEEPALIVE_US: u64 = 200_000;

/// Host silence after which it has sent everything that it began before it could see an error, µs: a byte takes 16.7 ms at 600 baud, 1 ms
/// at 9600, and a USB adapter holds bytes back for 16 ms. The error is reported well within the 100 ms that clients wait for a block's `*`.
const QUIET_US: u64 = 20_000;

/// Longest time of discarding after an error, µs: at least 50 bytes, more than any block has.
const DISCARD_US: u64 = 1_000_000;

/// Time that a board may take until it drives in mode 4, µs: the spread's brake releases in 30 ms.
const DRIVE_US: u64 = 40_000;

/// Interval at which tips follow their links, µs: twice their travel in it at full speed is less than the reach of a hall count.
const FOLLOW_US: u64 = 10_000;

const MAX_VELOCITY: i64 = Property::V.rules().max();

const MAX_TORQUE: i64 = Property::T.rules().max();

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    /// ^C instead of a header: the prompt without an error.
    Host,
    /// An error in place of the next `*`, after so many data bytes of a block that is discarded.
    Error(Status, usize),
}

pub(crate) async fn execute(god: &God<'_>, prefix: Prefix, arguments: Arguments<'_>) -> Status {
    if let Err(status) = arguments.none() {
        return status;
    }
    let selection = match movement::begin_realtime(god, prefix).await {
        Ok(selection) => selection,
        Err(status) => return status,
    };
    let control = Loop::new(god, selection).await;
    let refusal = control.wait_for_drive().await;
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
            discard_input(god.io, data).await;
            status
        }
    };
    god.io.leave_raw();
    status
}

/// Discards what the host sends before it knows that RealTime is over: `data` bytes of a block, and what follows until it waits for an
/// answer. ^C aborts if it is the last byte and not one of the data.
async fn discard_input(io: &Io, data: usize) {
    let end_us = io.after_us(DISCARD_US);
    let (mut count, mut last) = (0_usize, None);
    while io.now_us() < end_us {
        let Some(byte) = io.read(io.after_us(QUIET_US)).await else { break };
        last = Some(byte).filter(|_| count >= data);
        count = count.saturating_add(1);
    }
    if last == Some(ABORT) {
        io.abort();
    }
}

/// Puts motors into mode 4, those `by_torque` into mode 2.
async fn drive(god: &God<'_>, motors: Motors, by_torque: Motors) {
    god.boards.set(motors.difference(by_torque), Property::MODE, ModeCode::Velocity.into()).await;
    god.boards.set(motors.intersection(by_torque), Property::MODE, ModeCode::Torque.into()).await;
}

struct Loop<'a, 'b> {
    god: &'a God<'b>,
    selection: Selection,
    layout: Layout,
    own_gains: Answers,
    gains: Cell<Answers>,
    velocities: Cell<Answers>,
    /// Of the motors in mode 2 (LCT).
    torques: Cell<Answers>,
    /// Motors that have stalled: the next control block drives them again.
    stalled: Cell<Motors>,
    silent: Cell<Motors>,
    sent_us: Cell<u64>,
    /// Of the tips that follow their links.
    followers: Cell<[Option<Follower>; COUNT]>,
    /// The time at which they follow next; `None` until the host has moved something.
    follow_us: Cell<Option<u64>>,
}

impl<'a, 'b> Loop<'a, 'b> {
    /// Puts the motors into mode 4, with LCT into mode 2, at rest. What boards reported before is dropped.
    async fn new(god: &'a God<'b>, selection: Selection) -> Self {
        let motors = selection.motors();
        let layout = Layout::of(&god.memory.parameters(), selection.axes);
        let gains = god.boards.get(motors, Property::KPV).await;
        let torques = Answers::uniform(layout.by_torque(), 0);
        let velocities = Answers::uniform(motors.difference(torques.motors()), 0);
        let mut followers = [None; COUNT];
        let tips = selection.followers;
        let from = god.boards.get(tips.union(tips.links()), Property::P).await;
        for tip in tips.iter() {
            let link = tip.link().and_then(|link| from.get(link));
            if let (Some(place), Some(link), Some(tip)) =
                (followers.get_mut(tip.index()), link, from.get(tip))
            {
                *place = Some(Follower::new(link, tip));
            }
        }
        motors.iter().for_each(|motor| _ = god.boards.take_reported(motor));
        god.boards.set_each(Property::V, &velocities).await;
        drive(god, motors, torques.motors()).await;
        Self {
            god,
            selection,
            layout,
            own_gains: gains,
            gains: Cell::new(gains),
            velocities: Cell::new(velocities),
            torques: Cell::new(torques),
            stalled: Cell::default(),
            silent: Cell::new(motors.difference(gains.motors())),
            sent_us: Cell::new(god.io.now_us()),
            followers: Cell::new(followers),
            follow_us: Cell::new(None),
        }
    }

    /// Waits until all boards drive their motors. Returns why some do not.
    async fn wait_for_drive(&self) -> Status {
        self.god.boards.listen_until(self.god.io.after_us(DRIVE_US)).await;
        self.check(self.selection.motors()).await
    }

    async fn run(&self) -> End {
        loop {
            let Some(header) = self.read_byte().await else { continue };
            // The LF after the CR of LOOP's line; any other is a bad header.
            if self.god.io.is_second_line_end(Some(header).filter(|&byte| byte == b'\n')) {
                continue;
            }
            let data = match header {
                ABORT => return End::Host,
                b'C' | b'c' => self.layout.control_bytes(),
                b'A' | b'a' => 0,
                _ => return End::Error(Status::BAD_HEADER, 0),
            };
            let fault = self.faults().await;
            if !fault.is_ok() {
                return End::Error(fault, data);
            }
            match header {
                // The data arrive while the feedback leaves.
                b'C' => {
                    let (_, control) = join(pin!(self.write_feedback()), pin!(self.read_control())).await;
                    if control.is_none() && self.is_aborted() {
                        return End::Host;
                    }
                }
                b'A' => self.write_feedback().await,
                b'c' => match self.read_control().await {
                    Some(()) => self.write(b"*").await,
                    // A block that broke off is not answered.
                    None if self.is_aborted() => return End::Host,
                    None => {}
                },
                _ => self.write(b"*").await,
            }
        }
    }

    /// Whether a block that broke off has ended in ^C: a host that was interrupted within one sends nothing else.
    fn is_aborted(&self) -> bool {
        self.god.io.last_rx() == Some(ABORT)
    }

    async fn end(&self) {
        // Velocities that have not left yet are void.
        self.god.io.drop_frames();
        self.stop().await;
        movement::end_realtime(self.god, self.silent.get()).await;
    }

    /// Reads a byte and sends keep-alives meanwhile. After [`SILENCE_US`] without a byte it stops the motors and returns `None`.
    async fn read_byte(&self) -> Option<u8> {
        let silent_us = self.god.io.after_us(SILENCE_US);
        loop {
            let keepalive_us = self.sent_us.get().saturating_add(KEEPALIVE_US);
            if self.god.io.now_us() >= keepalive_us {
                // A keep-alive: repeats the present velocities.
                self.send_velocities().await;
                continue;
            }
            self.follow().await;
            let due_us = keepalive_us.min(silent_us).min(self.follow_us.get().unwrap_or(NEVER));
            if let Some(byte) = self.god.io.read(due_us).await {
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
        let driven = |of: &Cell<Answers>| !of.get().filter(|value| value != 0).is_empty();
        !driven(&self.velocities) && !driven(&self.torques)
    }

    async fn stop(&self) {
        self.follow_us.set(None);
        self.velocities.set(self.velocities.get().map(|_, _| 0));
        self.torques.set(self.torques.get().map(|_, _| 0));
        self.send_velocities().await;
    }

    async fn send_velocities(&self) {
        self.god.boards.set_each(Property::V, &self.velocities.get()).await;
        self.god.boards.set_each(Property::T, &self.torques.get()).await;
        self.sent_us.set(self.god.io.now_us());
    }

    /// Reads a control block's data, and obeys them once all are there; `None` if they break off.
    async fn read_control(&self) -> Option<()> {
        let (mut velocities, mut gains, mut torques) =
            (Answers::default(), Answers::default(), Answers::default());
        for motor in self.selection.axes.iter() {
            let Some(of) = self.layout.of_axis(motor) else { continue };
            if of.velocity {
                let byte = self.read_byte().await?.cast_signed();
                let velocity =
                    (i64::from(byte) * i64::from(of.velocity_coefficient)).clamp(-MAX_VELOCITY, MAX_VELOCITY);
                velocities.set(motor, velocity);
            }
            if of.gain {
                let gain = i64::from(self.read_byte().await?);
                gains.set(motor, gain);
                if let Some(tip) = self.follower(motor) {
                    gains.set(tip, gain);
                }
            }
            if of.torque {
                let bytes = [self.read_byte().await?, self.read_byte().await?];
                torques.set(motor, i64::from(i16::from_be_bytes(bytes)).clamp(-MAX_TORQUE, MAX_TORQUE));
            }
        }
        let had = self.gains.get();
        let changed = gains.different_from(&had);
        self.gains.set(had.overridden_by(&gains));
        order::override_property(self.god, Property::KPV, &changed, &self.own_gains).await;
        // A torque drives its motor: a velocity has no effect in mode 2.
        let velocities = Answers::from_fn(self.velocities.get().motors(), |motor| velocities.get(motor));
        self.velocities.set(self.velocities.get().overridden_by(&velocities));
        self.torques.set(torques);
        self.god.boards.set_each(Property::V, &velocities).await;
        self.god.boards.set_each(Property::T, &torques).await;
        if velocities.motors().union(torques.motors()) == self.selection.motors() {
            self.sent_us.set(self.god.io.now_us());
        }
        let stalled = self.stalled.take();
        self.note_stalled_links(stalled);
        if self.follow_us.get().is_none() && !self.selection.followers.is_empty() {
            self.follow_us.set(Some(self.god.io.now_us()));
        }
        drive(self.god, stalled, torques.motors()).await;
        Some(())
    }

    /// Where a tip and its link were by their last answers.
    fn finger(&self, tip: Motor) -> Option<Finger> {
        let link = tip.link()?;
        let of_link = self.god.boards.latest(link);
        Some(Finger {
            link: of_link.position?,
            link_velocity: of_link.velocity?,
            tip: self.god.boards.latest(tip).position?,
            // A link that is driven by torque has none.
            wanted: self.velocities.get().get(link).or(of_link.velocity)?,
        })
    }

    fn update_follower<T>(&self, tip: Motor, update: impl FnOnce(&mut Follower) -> T) -> Option<T> {
        let mut followers = self.followers.get();
        let updated = followers.get_mut(tip.index())?.as_mut().map(update);
        self.followers.set(followers);
        updated
    }

    fn note_stalled_links(&self, stalled: Motors) {
        for tip in self.selection.followers.intersection(stalled.tips()).iter() {
            if let Some(finger) = self.finger(tip) {
                self.update_follower(tip, |follower| follower.link_stalled(finger));
            }
        }
    }

    /// Lets tips follow their links, if it is time for it, and asks for what the next time needs.
    async fn follow(&self) {
        let now_us = self.god.io.now_us();
        let Some(due_us) = self.follow_us.get().filter(|&due_us| now_us >= due_us) else { return };
        // Before the first wait: a block is read and written at the same time.
        self.follow_us.set(Some(now_us.saturating_add(FOLLOW_US)));
        let step_us = now_us.saturating_sub(due_us).saturating_add(FOLLOW_US);
        let mut velocities = Answers::default();
        for tip in self.selection.followers.difference(self.stalled.get()).iter() {
            let Some(finger) = self.finger(tip) else { continue };
            if let Some(velocity) = self.update_follower(tip, |follower| follower.step(finger, step_us)) {
                velocities.set(tip, velocity.clamp(-MAX_VELOCITY, MAX_VELOCITY));
            }
        }
        let changed = velocities.different_from(&self.velocities.get());
        self.velocities.set(self.velocities.get().overridden_by(&velocities));
        self.god.boards.set_each(Property::V, &changed).await;
        let tips = self.selection.followers;
        self.god.boards.ask_latest(tips.union(tips.links()), Property::P).await;
        self.god.boards.ask_latest(tips.links(), Property::VEL).await;
    }

    /// Writes bytes to the host. If it does not read for [`SILENCE_US`], the motors stop, and a ^C as the last byte ends RealTime.
    async fn write(&self, bytes: &[u8]) {
        let io = self.god.io;
        let silent_us = io.after_us(SILENCE_US);
        loop {
            let keepalive_us = self.sent_us.get().saturating_add(KEEPALIVE_US);
            self.follow().await;
            let deadline_us =
                if io.now_us() < silent_us { keepalive_us.min(silent_us) } else { keepalive_us };
            let deadline_us = deadline_us.min(self.follow_us.get().unwrap_or(NEVER));
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
            } else if io.now_us() >= keepalive_us {
                self.send_velocities().await;
            }
        }
    }

    fn follower(&self, motor: Motor) -> Option<Motor> {
        motor.tip().filter(|&tip| self.selection.followers.has(tip))
    }

    /// Writes a feedback block, motor by motor as the answers come in.
    async fn write_feedback(&self) {
        self.god.boards.ask_ahead(self.selection.axes, self.layout.asks()).await;
        self.write(b"*").await;
        for motor in self.selection.axes.iter() {
            let Some(of) = self.layout.of_axis(motor) else { continue };
            let found = self.god.boards.answer_of(motor, of.asks()).await;
            if found.is_none() {
                self.silent.set(self.silent.get().with(motor));
            }
            let reported = self.god.session.reported(motor);
            let block = Feedback::of(&of, found.unwrap_or_default(), reported, self.layout.discards);
            self.god.session.set_reported(motor, block.reported);
            self.write(&block.bytes).await;
        }
        let temperature = self.layout.temperature.bytes(self.god.io.temperature());
        if !temperature.is_empty() {
            self.write(&temperature).await;
        }
    }

    /// The status by the hand's temperature, the boards' reports since the last call and missing answers.
    async fn faults(&self) -> Status {
        if query::is_too_hot(self.god) {
            return Status::OVER_TEMPERATURE;
        }
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
        self.check(motors).await
    }

    /// The status of motors that should be in mode 4 or 2; those that have only stalled are noted for the next control block.
    async fn check(&self, motors: Motors) -> Status {
        let boards = &self.god.boards;
        let modes = boards.get(motors, Property::MODE).await;
        let by_torque = self.torques.get().motors();
        let is = |wanted: ModeCode| modes.filter(|mode| ModeCode::of(mode) == Some(wanted));
        let driven =
            is(ModeCode::Velocity).difference(by_torque).union(is(ModeCode::Torque).intersection(by_torque));
        let out = modes.motors().difference(driven);
        let errors = boards.get(out, Property::ERROR).await;
        let lost = query::uninitialized(self.god, out).await;
        let stalled =
            boards.get(out, Property::END).await.filter(|end| EndCode::of(end) == Some(EndCode::Stalled));
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
                // Its flash cannot forget a stored position, so its board does not let it move.
                Some(FaultCode::Storage) => Status::NOT_STORED,
                // A fault, or another host on the bus, has ended it.
                _ => Status::FAULT,
            };
        }
        status
    }
}
