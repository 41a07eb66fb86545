//! The properties that shape a motor's motion, with their defaults per motor kind. Names follow the property
//! table (KP, MT, ...); values are the property's own integers, checked once by [`Config::validate`].

use crate::units::{CountsPerSec, Torque};

/// Which joint a motor drives. The kinds differ only in defaults.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotorKind {
    /// Inner joint of a finger, motors 1 to 3: worm gear, 49 motor revolutions a link revolution.
    Link,
    /// Finger spread, motor 4: back-drivable, with a brake, 18.28 motor revolutions a revolution.
    Spread,
    /// Fingertip, motors 5 to 7: worm gear, 39 motor revolutions a tip revolution.
    Tip,
}

/// All that a host may set on a motor. One field a property; the field's name is the property's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// MT: torque limit, 0..=990 in 1/1024 of peak.
    pub mt: u16,
    /// MV: cruise velocity of moves, 16..=4080 counts/s.
    pub mv: u16,
    /// MCV: cruise velocity when closing, 16..=4080 counts/s.
    pub mcv: u16,
    /// MOV: cruise velocity when opening, 16..=4080 counts/s.
    pub mov: u16,
    /// ACCEL: acceleration is (ACCEL/1024)² counts/ms²; 0..=65535, useful up to about 60; 0 cannot move.
    pub accel: u16,
    /// MPE: arrival window, 0..=32767 counts.
    pub mpe: u16,
    /// HOLD: hold the position after a move (1) or idle (0).
    pub hold: bool,
    /// TSTOP: no count for this long while driven is a stall; 0..=65535 ms, 0 = never.
    pub tstop: u16,
    /// KP: position gain, 0..=32767 torque units per count.
    pub kp: u16,
    /// KD: derivative gain, 0..=32767 in 1/256 torque unit per count/s.
    pub kd: u16,
    /// KI: integral gain, 0..=32767 torque units per count·second.
    pub ki: u16,
    /// KPV: velocity gain of mode 4, 0..=255 in 1/16 torque unit per count/s.
    pub kpv: u16,
    /// HSG: strain above which a move ends, 0..=256; 255 and 256 disable.
    pub hsg: u16,
    /// LSG: strain below which a move ends, 0..=256; 255 and 256 disable.
    pub lsg: u16,
    /// BT: load torque at which a link breaks away, 0..=990 in 1/1024 of peak; 0 = no breakaway.
    pub bt: u16,
    /// BS: a breakaway stops the finger's tip too. Carried in the breakaway event; GOD acts on it.
    pub bs: bool,
    /// IVEL: velocity towards the stop in HI, −4080..=4080 counts/s.
    pub ivel: i16,
    /// IOFF: distance from the stop to zero in HI, −32767..=32767 counts.
    pub ioff: i32,
    /// IHIT: torque limit in HI, 0..=990 in 1/1024 of peak.
    pub ihit: u16,
    /// OTEMP: motor temperature limit in 0.1 °C, −551..=1250; −551 disables.
    pub otemp: i16,
    /// How long the brake takes to let go, ms; 0 for a motor without a brake. Not a property: a fact of the
    /// joint. Electromagnetic power-off brakes of this size release in 10 to 30 ms.
    pub brake_ms: u16,
}

/// A property value outside its range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConfigError {
    /// The property's name.
    pub property: &'static str,
    /// The value found.
    pub found: i32,
    /// The smallest value allowed.
    pub min: i32,
    /// The largest value allowed.
    pub max: i32,
}

impl core::fmt::Display for ConfigError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { property, found, min, max } = self;
        write!(f, "{property} is {found}, but it must be {min} to {max}")
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
    /// The manual's defaults for a kind of motor; where the manual is silent (gains, BT), tuned in simulation
    /// over ±30 % plants (see CHANGELOG and `hil-sim list`).
    #[must_use]
    pub const fn for_motor(kind: MotorKind) -> Self {
        let (accel, hold, tstop, ivel, ioff, bt, brake_ms) = match kind {
            MotorKind::Link => (40, false, 300, -200, 25, 400, 0),
            MotorKind::Spread => (30, true, 400, -200, 0, 0, 30),
            MotorKind::Tip => (30, false, 300, 200, -350, 0, 0),
        };
        Self {
            mt: 750,
            mv: 1000,
            mcv: 1000,
            mov: 1000,
            accel,
            mpe: 4,
            hold,
            tstop,
            // At KP 100 the loop swings at 20 Hz by 8 counts/s, because velocity from 18 counts a revolution is late;
            // at 60 by 3. KI 800 lets ACCEL 1 overcome 0.05 N·m of static friction within TSTOP.
            kp: 60,
            kd: 256,
            ki: 800,
            kpv: 32,
            hsg: 256,
            lsg: 256,
            bt,
            bs: false,
            ivel,
            ioff,
            ihit: 250,
            otemp: 700,
            brake_ms,
        }
    }

    /// Checks every property against its range.
    ///
    /// # Errors
    /// The first property out of range, with what was found and what is allowed.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let rows: [(&'static str, i32, i32, i32); 18] = [
            ("MT", i32::from(self.mt), 0, 990),
            ("MV", i32::from(self.mv), 16, 4080),
            ("MCV", i32::from(self.mcv), 16, 4080),
            ("MOV", i32::from(self.mov), 16, 4080),
            ("ACCEL", i32::from(self.accel), 0, 65535),
            ("MPE", i32::from(self.mpe), 0, 32767),
            ("TSTOP", i32::from(self.tstop), 0, 65535),
            ("KP", i32::from(self.kp), 0, 32767),
            ("KD", i32::from(self.kd), 0, 32767),
            ("KI", i32::from(self.ki), 0, 32767),
            ("KPV", i32::from(self.kpv), 0, 255),
            ("HSG", i32::from(self.hsg), 0, 256),
            ("LSG", i32::from(self.lsg), 0, 256),
            ("BT", i32::from(self.bt), 0, 990),
            ("IVEL", i32::from(self.ivel), -4080, 4080),
            ("IOFF", self.ioff, -32767, 32767),
            ("IHIT", i32::from(self.ihit), 0, 990),
            ("OTEMP", i32::from(self.otemp), -551, 1250),
        ];
        for (property, found, min, max) in rows {
            if found < min || found > max {
                return Err(ConfigError { property, found, min, max });
            }
        }
        Ok(())
    }

    /// A checked speed property (16..=4080) as a velocity.
    #[must_use]
    pub fn speed(counts_per_sec: u16) -> CountsPerSec {
        CountsPerSec::from_int(i16::try_from(counts_per_sec).unwrap_or(i16::MAX))
    }

    /// A checked torque property (0..=990) as a torque.
    #[must_use]
    pub fn torque(units: u16) -> Torque {
        // It is checked, so nothing is to be bounded: each tick asks for one.
        Torque(units.cast_signed())
    }
}
