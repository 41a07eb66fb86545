//! The servo of one hall-commutated brushless motor of a robot hand: motion only.
//!
//! Hall edges, analog readings and commands go in; a bridge duty and a brake state come out. The crate knows no register,
//! bus or clock: time is passed in. It has no heap and no floating point, because it runs on a Cortex-M3; all arithmetic
//! is fixed point ([`units`], [`num`]).
//!
//! [`servo`] composes the rest and fixes the order in which it runs. [`command`] has its inputs and outputs, [`motor`] the description of
//! motor and board from which every threshold is computed, [`config`] the properties that shape a motion, and [`mode`] the control modes. [`sense`] turns hall codes into position and
//! velocity, [`motion`] moves the set-point and turns errors into torque, and [`guard`] limits or ends a motion.
//!
//! # Example
//!
//! A loop closed around a plant of three lines, which turns at once as fast as its voltage allows:
//!
//! ```
//! use servo_core::sense::hall::{HallDecoder, Wiring};
//! use servo_core::units::{DeciCelsius, Micros, MilliAmps, MilliVolts};
//! use servo_core::{Command, Config, EndReason, Sense, Servo};
//!
//! let config = Config { mt: 750, mv: 1000, mcv: 1000, mov: 1000, accel: 30, mpe: 4, kp: 60, kd: 256, ..Config::default() };
//! let mut servo = Servo::new(config, 0);
//! let mut decoder = HallDecoder::new(Wiring::STANDARD, Wiring::STANDARD.code(0), 0);
//! servo.command(Command::Move(90)).expect("idle accepts a move");
//!
//! let (mut now, mut duty, mut millicounts) = (Micros(0), 0, 0);
//! while servo.telemetry().end.is_none() {
//!     for _ in 0..5 {
//!         now = now.wrapping_add(Micros(200));
//!         // The plant: 1056 counts/s at full duty, in thousandths of a count, and the code of the sector it is in.
//!         millicounts += duty * 1056 / 5 / 32_768;
//!         let sector = ((millicounts + 500_i32).div_euclid(1000)).rem_euclid(6);
//!         let code = Wiring::STANDARD.code(u8::try_from(sector).expect("0 to 5"));
//!         if let Some(event) = decoder.sample(code, now) {
//!             servo.hall(&event);
//!         }
//!     }
//!     let drive = servo.tick(&Sense {
//!         now,
//!         bus: MilliVolts(24_000),
//!         current: MilliAmps(0),
//!         motor_temp: DeciCelsius(300),
//!         strain: 128,
//!         host_lost: false,
//!     });
//!     duty = drive.duty.map_or(0, |duty| i32::from(duty.0.to_bits()));
//! }
//! assert_eq!(servo.telemetry().end, Some(EndReason::Arrived));
//! assert!((86..=94).contains(&servo.telemetry().position.round()));
//! ```
#![no_std]
#![forbid(unsafe_code)]
// The control path does not panic and does not index out of bounds; a test may.
#![cfg_attr(
    not(test),
    deny(
        clippy::indexing_slicing,
        clippy::string_slice,
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable
    )
)]

pub mod command;
pub mod config;
pub mod guard;
pub mod mode;
pub mod motion;
pub mod motor;
pub mod num;
pub mod sense;
pub mod servo;
pub mod units;
pub mod way;

pub use command::{Command, Drive, EndReason, Event, Refusal, Sense, Telemetry};
pub use config::Config;
pub use motor::Motor;
pub use servo::Servo;
