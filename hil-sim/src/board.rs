//! A motor board closed around its plant: what the hall interrupt and the control tick do on the metal, in the
//! same order, with the rig in place of the pins.

use heapless::Vec;
use servo_core::sense::commutation::Commutator;
use servo_core::sense::hall::{HallEvent, Wiring};
use servo_core::units::Micros;
use servo_core::{Command, Config, ConfigError, Drive, Event, Refusal, Sense, Servo, Status};

use crate::rig::{Analog, Rig, Truth};

/// Control tick in microseconds (servo_core's TICK_HZ).
const TICK_US: u64 = 1_000_000 / servo_core::num::TICK_HZ as u64;

/// Hall events kept between two ticks. Full speed gives one or two; 16 hold a burst of glitches, and what is
/// lost beyond that the decoder's count still has.
const HALL_EVENTS: usize = 16;

/// One motor board and its plant.
pub struct SimBoard {
    rig: Rig,
    servo: Servo,
    commutator: Commutator,
    events: Vec<HallEvent, HALL_EVENTS>,
    drive: Drive,
    analog: Analog,
    tick_us: u64,
    last_count_us: u64,
}

/// Everything that can be known of a board after a tick.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Time of the tick.
    pub ms: u32,
    /// What the servo says.
    pub status: Status,
    /// Whether the bridge is on.
    pub driven: bool,
    /// Whether the brake is told to release.
    pub brake_released: bool,
    /// What is really so.
    pub truth: Truth,
    /// Hall code.
    pub halls: u8,
    /// What the board measured at the tick.
    pub analog: Analog,
    /// Time of the last hall count, µs.
    pub last_count_us: u64,
    /// The plant's count that the servo calls 0, as [`crate::metrics::Meter`] has followed it.
    pub zero_counts: f64,
}

impl Sample {
    /// The servo's position.
    #[must_use]
    pub fn estimated_counts(&self) -> f64 {
        self.status.position.0.to_num()
    }

    /// The servo's set-point.
    #[must_use]
    pub fn setpoint_counts(&self) -> f64 {
        self.status.setpoint.0.to_num()
    }
}

impl SimBoard {
    /// A board in idle on a rig; the servo knows in which whole count the rotor is.
    ///
    /// # Errors
    /// The first property out of range.
    pub fn new(config: Config, mut rig: Rig) -> Result<Self, ConfigError> {
        let count = rig.truth().counts.round() as i32;
        Ok(Self {
            servo: Servo::new(config, count)?,
            commutator: Commutator::new(Wiring::STANDARD, rig.halls(), count),
            events: Vec::new(),
            drive: Drive { duty: None, brake_released: false },
            analog: rig.analog(),
            tick_us: rig.now_us(),
            last_count_us: rig.now_us(),
            rig,
        })
    }

    /// Asks the servo for something.
    ///
    /// # Errors
    /// Why not.
    pub fn command(&mut self, command: Command) -> Result<(), Refusal> {
        self.servo.command(command)
    }

    /// The servo's present configuration.
    #[must_use]
    pub fn config(&self) -> &Config {
        self.servo.config()
    }

    /// The plant, to disturb it.
    pub fn rig_mut(&mut self) -> &mut Rig {
        &mut self.rig
    }

    /// The servo's next report.
    pub fn event(&mut self) -> Option<Event> {
        self.servo.event()
    }

    /// One millisecond: the plant runs with every hall change commutated at once, then the control tick.
    pub fn step(&mut self) {
        self.tick_us += TICK_US;
        loop {
            let bridge = self.commutator.bridge();
            let change = self.rig.advance(bridge, self.drive.brake_released, self.tick_us);
            let Some(change) = change else { break };
            self.sample_halls(change.code, change.at_us);
        }
        self.sample_halls(self.rig.halls(), self.tick_us);
        self.analog = self.rig.analog();
        self.drive = self.servo.tick(&Sense {
            now: micros(self.tick_us),
            halls: &self.events,
            bus: self.analog.bus,
            current: self.analog.current,
            motor_temp: self.analog.motor_temp,
            strain: self.analog.strain,
            bridge_fault: self.analog.bridge_fault,
            host_lost: false,
        });
        self.events.clear();
        self.commutator.set(self.drive.duty);
    }

    fn sample_halls(&mut self, code: u8, at_us: u64) {
        if let Some(event) = self.commutator.sample(code, micros(at_us)) {
            if matches!(event, HallEvent::Step(_)) {
                self.last_count_us = at_us;
            }
            // A full list drops the newest, as the interrupt's queue does.
            let _ = self.events.push(event);
        }
    }

    /// What can be known now.
    #[must_use]
    pub fn sample(&self) -> Sample {
        Sample {
            ms: (self.tick_us / TICK_US) as u32,
            status: self.servo.status(),
            driven: self.drive.duty.is_some(),
            brake_released: self.drive.brake_released,
            truth: self.rig.truth(),
            halls: self.rig.halls(),
            analog: self.analog,
            last_count_us: self.last_count_us,
            zero_counts: 0.0,
        }
    }
}

/// A time-stamp as the board's 32-bit timer gives it.
fn micros(us: u64) -> Micros {
    Micros(us as u32)
}
