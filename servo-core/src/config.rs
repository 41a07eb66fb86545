//! The properties that shape a motor's motion. A field has the name of the property (KP, MT, ...) and its unit; the ranges
//! and defaults of properties belong to whoever lets a host set them. [`Config::validate`] checks what the servo's arithmetic
//! needs, and no more.

use crate::units::{CountsPerSec, Torque};

/// The largest torque, 1/1024 of peak: what the largest duty gives at 24 V ([`limits`](crate::guard::limits)).
pub(crate) const MAX_TORQUE: u16 = 990;

/// The speeds that the profile can plan, counts/s.
const MIN_SPEED: u16 = 16;
pub(crate) const MAX_SPEED: u16 = 4080;

/// The largest position of a command, counts.
pub(crate) const MAX_POSITION: i32 = 32_767;

/// The largest gain of the PID loop that its fixed-point product holds.
const MAX_GAIN: u16 = 32_767;

/// The largest gain of the velocity loop that its fixed-point product holds.
const MAX_VELOCITY_GAIN: u16 = 255;

/// All that a host may set on a motor. One field a property; the field's name is the property's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// MT: torque limit, in 1/1024 of peak.
    pub mt: u16,
    /// MV: cruise velocity of moves, counts/s.
    pub mv: u16,
    /// MCV: cruise velocity when closing, counts/s.
    pub mcv: u16,
    /// MOV: cruise velocity when opening, counts/s.
    pub mov: u16,
    /// ACCEL: acceleration is (ACCEL/1024)² counts/ms²; useful up to about 60; 0 cannot move.
    pub accel: u16,
    /// MPE: arrival window, counts.
    pub mpe: u16,
    /// HOLD: hold the position after a move (1) or idle (0).
    pub hold: bool,
    /// TSTOP: no count for this long while driven is a stall, ms; 0 = never.
    pub tstop: u16,
    /// KP: position gain, torque units per count.
    pub kp: u16,
    /// KD: derivative gain, 1/256 torque unit per count/s.
    pub kd: u16,
    /// KI: integral gain, torque units per count·second.
    pub ki: u16,
    /// KPV: velocity gain of mode 4, 1/16 torque unit per count/s.
    pub kpv: u16,
    /// HSG: strain above which a move ends; from 255 on disabled.
    pub hsg: u16,
    /// LSG: strain below which a move ends; from 255 on disabled.
    pub lsg: u16,
    /// BT: load torque at which a link breaks away, in 1/1024 of peak; 0 = no breakaway.
    pub bt: u16,
    /// BS: a breakaway stops the finger's tip too. Carried in the breakaway event; GOD acts on it.
    pub bs: bool,
    /// IVEL: velocity towards the stop in HI, counts/s.
    pub ivel: i16,
    /// IOFF: distance from the stop to zero in HI, counts.
    pub ioff: i32,
    /// IHIT: torque limit in HI, in 1/1024 of peak.
    pub ihit: u16,
    /// OTEMP: motor temperature limit in 0.1 °C; −551 disables.
    pub otemp: i16,
    /// How long the brake takes to let go, ms; 0 for a motor without a brake. Not a property: a fact of the
    /// joint. Electromagnetic power-off brakes of this size release in 10 to 30 ms.
    pub brake_ms: u16,
}

/// A value that the servo's arithmetic does not hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ConfigError {
    /// The field's name.
    pub field: &'static str,
    /// The value found.
    pub found: i32,
    /// The smallest value allowed.
    pub min: i32,
    /// The largest value allowed.
    pub max: i32,
}

impl core::fmt::Display for ConfigError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { field, found, min, max } = self;
        write!(f, "{field} is {found}, but it must be {min} to {max}")
    }
}

impl core::error::Error for ConfigError {}

impl Default for Config {
    /// A motor that cannot move: no torque, no gain. Strain and temperature limits are disabled.
    fn default() -> Self {
        Self {
            mt: 0,
            mv: 16,
            mcv: 16,
            mov: 16,
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
            brake_ms: 0,
        }
    }
}

impl Config {
    /// Checks what the servo's arithmetic relies on. Every value of the other fields is safe; whoever sets a property checks
    /// its range.
    ///
    /// # Errors
    /// The first field beyond its bounds, with what was found and what is allowed.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let gain = |value: u16| (i32::from(value), 0, i32::from(MAX_GAIN));
        let torque = |value: u16| (i32::from(value), 0, i32::from(MAX_TORQUE));
        let speed = |value: u16| (i32::from(value), i32::from(MIN_SPEED), i32::from(MAX_SPEED));
        let fields = [
            ("mt", torque(self.mt)),
            ("bt", torque(self.bt)),
            ("ihit", torque(self.ihit)),
            ("mv", speed(self.mv)),
            ("mcv", speed(self.mcv)),
            ("mov", speed(self.mov)),
            ("ivel", (i32::from(self.ivel), -i32::from(MAX_SPEED), i32::from(MAX_SPEED))),
            ("ioff", (self.ioff, -MAX_POSITION, MAX_POSITION)),
            ("kp", gain(self.kp)),
            ("kd", gain(self.kd)),
            ("ki", gain(self.ki)),
            ("kpv", (i32::from(self.kpv), 0, i32::from(MAX_VELOCITY_GAIN))),
        ];
        for (field, (found, min, max)) in fields {
            if found < min || found > max {
                return Err(ConfigError { field, found, min, max });
            }
        }
        Ok(())
    }

    /// A speed of a checked configuration as a velocity.
    #[must_use]
    pub fn speed(counts_per_sec: u16) -> CountsPerSec {
        CountsPerSec::from_int(i16::try_from(counts_per_sec).unwrap_or(i16::MAX))
    }

    /// A torque of a checked configuration.
    #[must_use]
    pub fn torque(units: u16) -> Torque {
        // It is checked, so nothing is to be bounded: each tick asks for one.
        Torque(units.cast_signed())
    }
}
