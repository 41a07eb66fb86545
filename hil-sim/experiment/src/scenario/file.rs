//! The structure of a scenario file. These types reject invalid values, so that the parser can name the line; checks across fields
//! are in `read.rs`.

use std::collections::BTreeMap;
use std::fmt;

use serde::Deserialize;
use serde::de::{Deserializer, Error, SeqAccess, Unexpected, Visitor};
use servo_core::mode::Mode;
use tater_wire::MotorKind;
use toml::Spanned;

use hil_world::rig::{Object, RigParams};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct File {
    pub(super) name: String,
    pub(super) about: String,
    pub(super) motor: Motors,
    pub(super) duration_ms: Spanned<Duration>,
    #[serde(default)]
    pub(super) scatter: Spread,
    #[serde(default)]
    pub(super) plant: Numbers,
    pub(super) rig: Option<Spanned<RigParams>>,
    #[serde(default)]
    pub(super) hall_scatter_deg: HallScatter,
    #[serde(default)]
    pub(super) set: Settings,
    pub(super) initial: Option<Spanned<Initial>>,
    #[serde(default)]
    pub(super) at: Vec<Spanned<At>>,
    #[serde(default)]
    pub(super) object: Vec<Spanned<Object>>,
    #[serde(default)]
    pub(super) expect: Vec<Spanned<Expect>>,
}

/// Plant overrides by name; the plant knows the names.
pub(super) type Numbers = BTreeMap<Spanned<String>, Spanned<Number>>;
pub(super) type Settings = BTreeMap<Spanned<String>, Spanned<i64>>;

#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Initial {
    #[serde(default)]
    pub(super) position_counts: Number,
    #[serde(default)]
    pub(super) velocity_counts_s: Number,
    pub(super) winding_c: Option<Number>,
    pub(super) housing_c: Option<Number>,
}

impl From<&Initial> for super::Initial {
    fn from(file: &Initial) -> Self {
        Self {
            position_counts: file.position_counts.0,
            velocity_counts_s: file.velocity_counts_s.0,
            winding_c: file.winding_c.map(|c| c.0),
            housing_c: file.housing_c.map(|c| c.0),
        }
    }
}

/// One timed command: `ms` and one other key.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct At {
    pub(super) ms: u32,
    pub(super) r#move: Option<Position>,
    pub(super) end: Option<Position>,
    pub(super) position: Option<Position>,
    pub(super) mode: Option<ModeName>,
    pub(super) torque: Option<TorqueUnits>,
    pub(super) velocity: Option<VelocityUnits>,
    pub(super) torque_close: Option<Yes>,
    pub(super) torque_open: Option<Yes>,
    pub(super) home: Option<Yes>,
    pub(super) abort: Option<Yes>,
    pub(super) terminate: Option<Yes>,
    pub(super) clear_fault: Option<Yes>,
    pub(super) set: Option<Settings>,
    pub(super) disturbance_n_m: Option<NewtonMeters>,
    pub(super) bus_v: Option<Volts>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Expect {
    pub(super) metric: String,
    pub(super) min: Option<Number>,
    pub(super) max: Option<Number>,
    pub(super) equals: Option<Wanted>,
    pub(super) tolerance: Option<Tolerance>,
    pub(super) from_ms: Option<u32>,
    pub(super) to_ms: Option<u32>,
}

pub(super) enum Wanted {
    Number(f64),
    Text(String),
}

#[derive(Clone, Copy, Default)]
pub(super) struct Number(pub(super) f64);

#[derive(Clone, Copy)]
pub(super) struct Tolerance(pub(super) f64);

/// A torque on the shaft, up to ten times the motor's.
#[derive(Clone, Copy)]
pub(super) struct NewtonMeters(pub(super) f64);

#[derive(Clone, Copy)]
pub(super) struct Volts(pub(super) f64);

#[derive(Clone, Copy, Default)]
pub(super) struct Spread(pub(super) f64);

#[derive(Clone, Copy, Default)]
pub(super) struct HallScatter(pub(super) f64);

#[derive(Clone, Copy)]
pub(super) struct Duration(pub(super) u32);

pub(super) struct Position(pub(super) i32);

pub(super) struct TorqueUnits(pub(super) i16);

pub(super) struct VelocityUnits(pub(super) i16);

/// `true`, the only value of a command without a parameter.
pub(super) struct Yes;

pub(super) struct ModeName(pub(super) Mode);

pub(super) struct Motors(pub(super) Vec<MotorKind>);

/// Implements `Deserialize` for a number in a range, described for the error.
macro_rules! number {
    ($name:ident, $min:expr, $max:expr, $words:literal) => {
        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                struct Bounded;
                impl Visitor<'_> for Bounded {
                    type Value = $name;
                    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                        f.write_str($words)
                    }
                    fn visit_f64<E: Error>(self, value: f64) -> Result<$name, E> {
                        // NaN is in no range.
                        if ($min..=$max).contains(&value) {
                            return Ok($name(value));
                        }
                        Err(E::invalid_value(Unexpected::Float(value), &self))
                    }
                    fn visit_i64<E: Error>(self, value: i64) -> Result<$name, E> {
                        self.visit_f64(value as f64)
                    }
                }
                deserializer.deserialize_any(Bounded)
            }
        }
    };
}

macro_rules! integer {
    ($name:ident, $min:expr, $max:expr, $words:literal) => {
        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                struct Bounded;
                impl Visitor<'_> for Bounded {
                    type Value = $name;
                    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                        f.write_str($words)
                    }
                    fn visit_i64<E: Error>(self, found: i64) -> Result<$name, E> {
                        let value = found.try_into().ok().filter(|value| ($min..=$max).contains(value));
                        value.map($name).ok_or_else(|| E::invalid_value(Unexpected::Signed(found), &self))
                    }
                }
                deserializer.deserialize_any(Bounded)
            }
        }
    };
}

number!(Number, -1e12, 1e12, "a finite number (of the unit that the key's name ends in)");
number!(Tolerance, 0.0, 1e12, "a tolerance, 0 or more");
number!(NewtonMeters, -6.5, 6.5, "a torque at the motor in N·m, -6.5 to 6.5");
number!(Volts, 0.0, 60.0, "a supply voltage, 0 to 60 V");
number!(Spread, 0.0, 0.5, "a relative scatter, 0 to 0.5 (0.3 is ±30 %)");
number!(HallScatter, 0.0, 25.0, "degrees electrical, 0 to 25");
// Ten minutes: a full travel at ACCEL 1 takes 26 s.
integer!(Duration, 1, 600_000, "a whole number of milliseconds, 1 to 600000");
integer!(Position, -32767, 32767, "whole hall counts, -32767 to 32767");
integer!(TorqueUnits, -990, 990, "a torque in 1/1024 of peak, -990 to 990");
integer!(VelocityUnits, -4080, 4080, "a velocity in whole counts/s, -4080 to 4080");

impl<'de> Deserialize<'de> for Yes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match bool::deserialize(deserializer)? {
            true => Ok(Self),
            false => {
                Err(D::Error::invalid_value(Unexpected::Bool(false), &"true (leave the key out for no)"))
            }
        }
    }
}

impl<'de> Deserialize<'de> for ModeName {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        let mode = match name.as_str() {
            "idle" => Mode::Idle,
            "torque" => Mode::Torque,
            "pid" => Mode::Pid,
            "velocity" => Mode::Velocity,
            "trapezoidal" => Mode::Trapezoidal,
            _ => {
                let modes = "\"idle\", \"torque\", \"pid\", \"velocity\" or \"trapezoidal\"";
                return Err(D::Error::invalid_value(Unexpected::Str(&name), &modes));
            }
        };
        Ok(Self(mode))
    }
}

impl<'de> Deserialize<'de> for Wanted {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;
        impl Visitor<'_> for Either {
            type Value = Wanted;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a finite number or a word")
            }
            fn visit_f64<E: Error>(self, value: f64) -> Result<Wanted, E> {
                match value.is_finite() {
                    true => Ok(Wanted::Number(value)),
                    false => Err(E::invalid_value(Unexpected::Float(value), &self)),
                }
            }
            fn visit_i64<E: Error>(self, value: i64) -> Result<Wanted, E> {
                Ok(Wanted::Number(value as f64))
            }
            fn visit_str<E: Error>(self, value: &str) -> Result<Wanted, E> {
                Ok(Wanted::Text(value.to_owned()))
            }
        }
        deserializer.deserialize_any(Either)
    }
}

fn motor<E: Error>(name: &str) -> Result<MotorKind, E> {
    match name {
        "link" => Ok(MotorKind::Link),
        "spread" => Ok(MotorKind::Spread),
        "tip" => Ok(MotorKind::Tip),
        _ => Err(E::invalid_value(
            Unexpected::Str(name),
            &"\"link\", \"spread\" or \"tip\", or a list of them",
        )),
    }
}

impl<'de> Deserialize<'de> for Motors {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct OneOrMore;
        impl<'de> Visitor<'de> for OneOrMore {
            type Value = Motors;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("\"link\", \"spread\" or \"tip\", or a list of them")
            }
            fn visit_str<E: Error>(self, name: &str) -> Result<Motors, E> {
                Ok(Motors(vec![motor(name)?]))
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut names: A) -> Result<Motors, A::Error> {
                let mut motors = Vec::new();
                while let Some(name) = names.next_element::<String>()? {
                    let kind = motor(&name)?;
                    if motors.contains(&kind) {
                        return Err(A::Error::invalid_value(Unexpected::Str(&name), &"each motor once"));
                    }
                    motors.push(kind);
                }
                if motors.is_empty() {
                    return Err(A::Error::invalid_length(0, &self));
                }
                Ok(Motors(motors))
            }
        }
        deserializer.deserialize_any(OneOrMore)
    }
}
