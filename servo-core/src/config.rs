//! The properties that shape a motor's motion. A field is named after its property and holds the property's own integer.
//!
//! Ranges and defaults are not decided here: a board takes them from its property table before it configures the servo.
//! Every value that a field can hold is safe. Speeds are clamped to 16..=4080 counts/s in moves, torques to what the
//! bridge can do, and gains saturate.

use crate::motor::{BoardFigures, Motor};
use crate::units::{CountsPerSec, Torque};

/// The configuration of a motor, one field a property.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// MT: torque limit in 1/1024 of peak.
    pub mt: u16,
    /// MV: cruise velocity of moves in counts/s.
    pub mv: u16,
    /// MCV: cruise velocity when closing in counts/s; a move uses the lower of MV and MCV.
    pub mcv: u16,
    /// MOV: cruise velocity when opening in counts/s; a move uses the lower of MV and MOV.
    pub mov: u16,
    /// ACCEL: acceleration is (ACCEL/1024)² counts/ms². 0 cannot move.
    pub accel: u16,
    /// MPE: arrival window in counts.
    pub mpe: u16,
    /// HOLD: after a motion, hold the position (`true`) or idle.
    pub hold: bool,
    /// TSTOP: no hall count for this long while driven is a stall; ms, 0 = never.
    pub tstop: u16,
    /// KP: position gain in torque units per count.
    pub kp: u16,
    /// KD: derivative gain in 1/256 torque unit per count/s.
    pub kd: u16,
    /// KI: integral gain in torque units per count·second.
    pub ki: u16,
    /// KPV: velocity gain of mode 4 in 1/16 torque unit per count/s.
    pub kpv: u16,
    /// HSG: strain above which a move ends; 0, 255 and more disable it.
    pub hsg: u16,
    /// LSG: strain below which a move ends; 0, 255 and more disable it.
    pub lsg: u16,
    /// BT: load torque at which a link breaks away, in 1/1024 of peak; 0 = never.
    pub bt: u16,
    /// BS: a breakaway stops the finger's tip as well. The servo only reports it.
    pub bs: bool,
    /// IVEL: velocity towards the stop in HI, in counts/s.
    pub ivel: i16,
    /// IOFF: distance from the stop to zero in HI, in counts.
    pub ioff: i32,
    /// IHIT: torque limit while HI seeks the stop, in 1/1024 of peak.
    pub ihit: u16,
    /// OTEMP: motor temperature limit in 0.1 °C; −551 disables it.
    pub otemp: i16,
    /// KBW: bandwidth of the position loop in 0.1 Hz, from which the gains are computed; 0: KP, KD and KPV.
    pub kbw: u16,
    /// The motor and its joint, by the properties that describe them.
    pub motor: Motor,
    /// The board. A fact, not a property.
    pub board: &'static BoardFigures,
    /// Release time of the brake in ms; 0 for a motor without one. A fact of the joint, not a property.
    pub brake_ms: u16,
}

impl Default for Config {
    /// The hand's motor, which cannot move: no torque, no gain. Strain and temperature limits are disabled.
    fn default() -> Self {
        Self {
            mt: 0,
            mv: 0,
            mcv: 0,
            mov: 0,
            accel: 0,
            mpe: 0,
            hold: false,
            tstop: 0,
            kp: 0,
            kd: 0,
            ki: 0,
            kpv: 0,
            hsg: 256,
            lsg: 256,
            bt: 0,
            bs: false,
            ivel: 0,
            ioff: 0,
            ihit: 0,
            otemp: -551,
            kbw: 0,
            motor: Motor::HAND,
            board: &BoardFigures::TATER,
            brake_ms: 0,
        }
    }
}

pub(crate) fn speed(counts_per_sec: u16) -> CountsPerSec {
    CountsPerSec::from_int(i16::try_from(counts_per_sec).unwrap_or(i16::MAX))
}

pub(crate) fn torque(units: u16) -> Torque {
    Torque(i16::try_from(units).unwrap_or(i16::MAX))
}
