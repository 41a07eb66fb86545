//! The blocks of RealTime (manual 6.2): their layout by the parameters, and the bytes of a motor's feedback. Values of several bytes are
//! big-endian (decision 0026).

use heapless::Vec;

use crate::boards::Ahead;
use crate::memory::Parameters;
use crate::motors::{COUNT, Motor, Motors};
use crate::parameter::Kept;
use crate::units;

/// Most bytes of a motor's feedback: velocity 1, strain 1, position 4, change of position 1.
pub(super) const MAX_FEEDBACK: usize = 7;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct MotorLayout {
    /// LCV.
    pub velocity: bool,
    /// LCVC.
    pub velocity_coefficient: u8,
    /// LCPG.
    pub gain: bool,
    /// LCT: the motor is driven by torque, in mode 2.
    pub torque: bool,
    /// LFV.
    pub feeds_velocity: bool,
    /// LFVC, not 0.
    pub feedback_coefficient: u8,
    /// LFS.
    pub feeds_strain: bool,
    /// LFAP: 0, 1 (four bytes) or 2 (two bytes).
    pub feeds_position: u8,
    /// LFDP.
    pub feeds_change: bool,
    /// LFDPC, not 0.
    pub change_coefficient: u8,
}

/// The format of the hand's temperature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Temperature {
    /// LFT is 0.
    None,
    /// Two bytes, 0.1 °C.
    Tenths,
    /// One byte, signed, °C: COMPAT 262.
    Degrees,
}

/// The layout of the blocks, which cannot change during RealTime.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    motors: [Option<MotorLayout>; COUNT],
    /// LFT.
    pub temperature: Temperature,
    /// LFDPD.
    pub discards: bool,
}

impl Layout {
    pub fn of(parameters: &Parameters, axes: Motors) -> Self {
        let compat_262 = parameters.hand.compat_262;
        let mut motors = [None; COUNT];
        for motor in axes.iter() {
            let places = (motors.get_mut(motor.index()), parameters.motors.get(motor.index()));
            let (Some(place), Some(of)) = places else { continue };
            *place = Some(MotorLayout {
                velocity: of.value(Kept::Lcv) != 0,
                velocity_coefficient: of.value(Kept::Lcvc),
                gain: of.value(Kept::Lcpg) != 0,
                torque: compat_262 && of.value(Kept::Lct) != 0,
                feeds_velocity: of.value(Kept::Lfv) != 0,
                feedback_coefficient: of.value(Kept::Lfvc).max(1),
                feeds_strain: of.value(Kept::Lfs) != 0,
                feeds_position: match of.value(Kept::Lfap) {
                    1 if compat_262 => 2,
                    lfap => lfap,
                },
                feeds_change: of.value(Kept::Lfdp) != 0,
                change_coefficient: of.value(Kept::Lfdpc).max(1),
            });
        }
        let temperature = match (parameters.hand.lft, compat_262) {
            (false, _) => Temperature::None,
            (true, false) => Temperature::Tenths,
            (true, true) => Temperature::Degrees,
        };
        Self { motors, temperature, discards: parameters.hand.lfdpd }
    }

    pub fn of_axis(&self, motor: Motor) -> Option<MotorLayout> {
        self.motors.get(motor.index()).copied().flatten()
    }

    pub fn control_bytes(&self) -> usize {
        let bytes =
            |of: &MotorLayout| usize::from(of.velocity) + usize::from(of.gain) + 2 * usize::from(of.torque);
        self.motors.iter().flatten().map(bytes).sum()
    }

    /// The motors that are driven by torque.
    pub fn by_torque(&self) -> Motors {
        Motors::ALL.iter().filter(|&motor| self.of_axis(motor).is_some_and(|of| of.torque)).collect()
    }

    /// The properties that some board has to be asked for.
    pub fn asks(&self) -> Ahead<bool> {
        let each = self.motors.iter().flatten().map(MotorLayout::asks);
        each.fold(Ahead::default(), |all, of| Ahead {
            position: all.position || of.position,
            velocity: all.velocity || of.velocity,
            strain: all.strain || of.strain,
        })
    }
}

impl Temperature {
    /// The bytes of a temperature of 0.1 °C.
    pub fn bytes(self, tenths: i16) -> Vec<u8, 2> {
        let mut bytes = Vec::new();
        let _ = match self {
            Self::None => Ok(()),
            Self::Tenths => bytes.extend_from_slice(&tenths.to_be_bytes()),
            Self::Degrees => {
                bytes.extend_from_slice(&clipped((i64::from(tenths) + 5).div_euclid(10)).to_be_bytes())
            }
        };
        bytes
    }
}

impl MotorLayout {
    pub fn asks(&self) -> Ahead<bool> {
        Ahead {
            position: self.feeds_position != 0 || self.feeds_change,
            velocity: self.feeds_velocity,
            strain: self.feeds_strain,
        }
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Feedback {
    pub bytes: Vec<u8, MAX_FEEDBACK>,
    /// The position that the host knows after it, GCL counts.
    pub reported: i32,
}

impl Feedback {
    /// The feedback of a board's answers, hall counts; `reported` is the position that the host knew before, GCL counts.
    pub fn of(of: &MotorLayout, found: Ahead<i64>, reported: i32, discards: bool) -> Self {
        let mut bytes = Vec::new();
        let mut put = |piece: &[u8]| {
            // MAX_FEEDBACK is the sum of all pieces.
            let _ = bytes.extend_from_slice(piece);
        };
        let position = i32::try_from(units::gcl_from_halls(found.position)).unwrap_or(i32::MAX);
        if of.feeds_velocity {
            put(&clipped(found.velocity / i64::from(of.feedback_coefficient)).to_be_bytes());
        }
        if of.feeds_strain {
            put(&[u8::try_from(found.strain.clamp(0, 255)).unwrap_or(u8::MAX)]);
        }
        match of.feeds_position {
            0 => {}
            2 => {
                let [_, _, high, low] = position.to_be_bytes();
                put(&[high, low]);
            }
            _ => put(&position.to_be_bytes()),
        }
        if !of.feeds_change {
            return Self { bytes, reported };
        }
        let coefficient = i64::from(of.change_coefficient);
        let change = (i64::from(position) - i64::from(reported)) / coefficient;
        let sent = clipped(change);
        put(&sent.to_be_bytes());
        let reported = if discards && change != i64::from(sent) {
            position
        } else {
            // Towards the position, and not beyond it.
            reported.wrapping_add(i32::from(sent).wrapping_mul(i32::from(of.change_coefficient)))
        };
        Self { bytes, reported }
    }
}

fn clipped(value: i64) -> i8 {
    i8::try_from(value).unwrap_or(if value < 0 { i8::MIN } else { i8::MAX })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec;

    const EMPTY: MotorLayout = MotorLayout {
        velocity: false,
        velocity_coefficient: 8,
        gain: false,
        torque: false,
        feeds_velocity: false,
        feedback_coefficient: 8,
        feeds_strain: false,
        feeds_position: 0,
        feeds_change: false,
        change_coefficient: 1,
    };

    fn at(position: i64) -> Ahead<i64> {
        Ahead { position, velocity: -100, strain: 77 }
    }

    fn bytes(of: MotorLayout, found: Ahead<i64>) -> vec::Vec<u8> {
        Feedback::of(&of, found, 0, false).bytes.to_vec()
    }

    #[test]
    fn feedback_is_big_endian_in_the_manuals_order() {
        let all = MotorLayout {
            feeds_velocity: true,
            feeds_strain: true,
            feeds_position: 1,
            feeds_change: true,
            change_coefficient: 100,
            ..EMPTY
        };
        // -100 / 8 = -12; 331 · 55 = 18205 = 0x471D; 18205 / 100 = 182, more than a byte.
        assert_eq!(bytes(all, at(331)), [0xF4, 77, 0, 0, 0x47, 0x1D, 127]);
        let short = MotorLayout { feeds_position: 2, ..EMPTY };
        assert_eq!(bytes(short, at(-25)), (-1375_i16).to_be_bytes());
        let long = MotorLayout { feeds_position: 1, ..EMPTY };
        assert_eq!(bytes(long, at(-158)), (-8690_i32).to_be_bytes());
        assert_eq!(bytes(EMPTY, at(5)), []);
    }

    #[test]
    fn temperature_is_two_bytes_of_tenths_or_one_of_degrees() {
        for (tenths, degrees) in
            [(350, 35), (354, 35), (355, 36), (-4, 0), (-6, -1), (-550, -55), (1250, 125)]
        {
            assert_eq!(Temperature::Tenths.bytes(tenths).as_slice(), tenths.to_be_bytes());
            assert_eq!(Temperature::Degrees.bytes(tenths).as_slice(), i8::to_be_bytes(degrees), "{tenths}");
            assert!(Temperature::None.bytes(tenths).is_empty());
        }
    }

    /// Manual 6.2.3: LFDPC 2, reported 1500, and 2000 at once. A hall count is 55 GCL counts, so from 1500 on: 36 counts are 1980.
    #[test]
    fn change_beyond_a_byte_is_sent_later_or_discarded() {
        let of = MotorLayout { feeds_change: true, change_coefficient: 2, ..EMPTY };
        let sent = |reported, discards| {
            let feedback = Feedback::of(&of, at(36), reported, discards);
            (feedback.bytes[0].cast_signed(), feedback.reported)
        };
        assert_eq!(sent(1500, false), (127, 1754));
        assert_eq!(sent(1754, false), (113, 1980));
        assert_eq!(sent(1980, false), (0, 1980));
        assert_eq!(sent(1500, true), (127, 1980));
        assert_eq!(sent(1980, true), (0, 1980));
    }

    proptest! {
        #[test]
        fn sum_of_changes_arrives_at_the_position(
            from in -32_767i32..=32_767, to in -595i64..=595, coefficient in 1u8..=255,
        ) {
            let of = MotorLayout { feeds_change: true, change_coefficient: coefficient, ..EMPTY };
            let (mut host, mut reported) = (from, from);
            for _ in 0..600 {
                let feedback = Feedback::of(&of, at(to), reported, false);
                host += i32::from(feedback.bytes[0].cast_signed()) * i32::from(coefficient);
                reported = feedback.reported;
                prop_assert_eq!(host, reported);
            }
            let left = i64::from(host) - units::gcl_from_halls(to);
            prop_assert!(left.abs() < i64::from(coefficient), "{} left", left);
        }
    }
}
