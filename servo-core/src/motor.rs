//! The motor and its board as they are described: what every other number of the servo is computed from.
//!
//! Torques are in units of 1/1024 of the torque at the peak current, voltages in units of 1/1024 of what drives that current through the
//! winding at rest: R·MPK. Of the hand's motor that is 24 V, so that its unit of voltage is 24 V/1024 (decision 0002). With c = 3·POLES/2π counts a
//! radian, K the EMF and B the acceleration of a unit,
//!
//! ```text
//! K = Kt/c / (R·MPK/1024)     B = Kt·MPK/1024 / J · c     1/τ = B·K
//! ```
//!
//! # What can be driven
//!
//! A board without a current loop sets a voltage. It drives a motor whose description is within these limits ([`Unfit`]):
//!
//! * The supply pushes no more than 4.5 times the peak current through the winding at rest: beyond that an EMF that is wrong by 5 % is a
//!   quarter of the peak torque.
//! * R·J/Kt² is 1 ms or more: the law acts once a millisecond.
//! * It turns at 6,000 counts/s or less without load: six edges a tick.
//! * Its current is one that the board can measure and switch, its supply one that the board can take.
//! * Its winding heats by 100 K/s or less at peak current: the thermal model takes a step each 16 ms.

use crate::num::{half_up, nearest, root_within, saturating_u16, wide};

/// A motor with its load, in the properties that describe it. A field is named after its property and holds the property's own integer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Motor {
    /// POLES: poles of the rotor, 4 to 40.
    pub poles: u8,
    /// MR: resistance line to line at 25 °C, mΩ.
    pub mr: u32,
    /// MPK: peak current of a phase, mA.
    pub mpk: u16,
    /// MVN: nominal voltage of the supply, 0.1 V.
    pub mvn: u16,
    /// MWX: highest temperature of the winding, 0.1 °C.
    pub mwx: u16,
    /// MWJ: heat capacity of the winding, 0.01 J/K.
    pub mwj: u16,
    /// MWR: thermal resistance from winding to housing, 0.01 K/W.
    pub mwr: u16,
    /// MKA: acceleration of the motor and its joint a torque unit, in 1/16 count/s².
    pub mka: u16,
    /// MKE: EMF in 1/4096 torque unit per count/s.
    pub mke: u16,
    /// MFC: Coulomb friction in torque units.
    pub mfc: u16,
    /// MFS: friction at rest in torque units; at least MFC.
    pub mfs: u16,
    /// MTE: electrical time constant L/R in µs.
    pub mte: u16,
}

/// What a board is built of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Parts {
    /// Period of the PWM, ns.
    pub pwm_ns: u32,
    /// Dead time of a leg, ns.
    pub dead_ns: u32,
    /// Forward voltage of a diode of the bridge, mV.
    pub diode_mv: u32,
    /// Largest phase current that the bridge switches without its break input, mA.
    pub most_ma: u32,
    /// A step of the converter of the supply current, µA.
    pub step_ua: u32,
    /// Supply voltages between which the bridge works, mV.
    pub bus_mv: (u32, u32),
    /// Capacitance at the bridge, µF.
    pub capacitance_uf: u32,
}

/// What follows from a board's parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BoardFigures {
    /// Half a period of the PWM, 1/1024 µs.
    pub(crate) half_period: u32,
    /// Duty that dead time takes of the supply, 1/32768, and that of a quarter of a millivolt that two diodes take.
    pub(crate) dead: i32,
    pub(crate) diodes: i32,
    /// Least and largest peak current of a motor, mA: 32 steps of the converter, and two thirds of what the bridge switches.
    peak_ma: (u16, u16),
    /// Largest current of a motor whose terminals are shorted, mA: four fifths of what the bridge switches.
    pub(crate) shorted_ma: u16,
    /// What the capacitors take from 7/8 of the highest voltage on, µJ.
    room_uj: u32,
    /// Lowest and highest nominal voltage of a supply, 0.1 V, that may be a fifth lower and a quarter higher.
    supply: (u16, u16),
}

impl BoardFigures {
    /// The hand's motor board (docs/board.md).
    pub const TATER: Self = Self::new(&Parts {
        pwm_ns: 50_000,
        dead_ns: 500,
        diode_mv: 800,
        most_ma: 25_000,
        step_ua: 9_766,
        bus_mv: (16_000, 32_000),
        capacitance_uf: 2_200,
    });

    /// Of a board with these parts.
    #[must_use]
    pub const fn new(parts: &Parts) -> Self {
        let Parts { pwm_ns, dead_ns, diode_mv, most_ma, step_ua, bus_mv, capacitance_uf } = *parts;
        let (pwm, dead) = (wide(pwm_ns), wide(dead_ns));
        let (low_mv, high_mv) = bus_mv;
        Self {
            half_period: nearest(pwm * 1024, 2000),
            dead: nearest(dead << 15, pwm).cast_signed(),
            diodes: nearest((dead * wide(diode_mv)) << 14, pwm).cast_signed(),
            peak_ma: (saturating_u16(step_ua * 32 / 1000 + 1), saturating_u16(most_ma * 2 / 3)),
            // mV² · µF are pJ; ½ of 1 − 49/64.
            room_uj: nearest(wide(capacitance_uf) * wide(high_mv) * wide(high_mv) * 15, 128_000_000),
            shorted_ma: saturating_u16(most_ma * 4 / 5),
            supply: (saturating_u16(low_mv * 5 / 400), saturating_u16(high_mv * 4 / 500)),
        }
    }
}

/// Why a board cannot drive a motor as it is described: property FIT.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Unfit {
    /// POLES: less than 4, or odd.
    Poles,
    /// MR, MPK, MVN: the supply would push more than 4.5 times the peak current through the winding.
    Current,
    /// MKA, MKE: R·J/Kt² is below 1 ms.
    Light,
    /// MKE, MVN: more than 6,000 counts/s without load.
    Fast,
    /// MPK: more than two thirds of what the bridge switches, or less than 32 steps of the current's converter.
    Range,
    /// MVN: the board is for another supply.
    Supply,
    /// MR, MPK, MWJ, MWR: the winding heats by more than 100 K/s at peak current, or its time constant is below a second.
    Heat,
    /// MTE: above 5 ms, or MR · MPK below 1 V or above 50 V.
    Winding,
    /// MFC, MFS: more than 400 of 1024.
    Friction,
}

impl Unfit {
    /// What FIT reads.
    #[must_use]
    pub const fn code(self) -> u8 {
        match self {
            Self::Poles => 1,
            Self::Current => 2,
            Self::Light => 3,
            Self::Fast => 4,
            Self::Range => 5,
            Self::Supply => 6,
            Self::Heat => 7,
            Self::Winding => 8,
            Self::Friction => 9,
        }
    }

    /// Each.
    pub const ALL: [Self; 9] = [
        Self::Poles,
        Self::Current,
        Self::Light,
        Self::Fast,
        Self::Range,
        Self::Supply,
        Self::Heat,
        Self::Winding,
        Self::Friction,
    ];

    /// What is wrong, and what would be right; for people.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Self::Poles => "the number of poles is odd, or below 4",
            Self::Current => {
                "the supply pushes more than 4.5 times the peak current through the winding at rest, which needs a current loop"
            }
            Self::Light => "the mechanical time constant R*J/Kt^2 is below 1 ms, a tick of the servo",
            Self::Fast => {
                "the motor turns at more than 6000 counts/s without load, faster than the hall sensors are read"
            }
            Self::Range => {
                "the peak current is not between 32 steps of the board's converter and two thirds of what its bridge switches"
            }
            Self::Supply => "the board is for supplies of 20 to 25.6 V",
            Self::Heat => "the winding heats by more than 100 K/s at peak current, or cools within a second",
            Self::Friction => "friction takes more than 40 % of the peak torque",
            Self::Winding => {
                "the electrical time constant is above 5 ms, or peak current times resistance below 1 V or above 50 V"
            }
        }
    }
}

/// Most that the supply may push, over the peak current: see the module.
const MOST_RATIO_TENTHS: u32 = 45;
/// Largest 1/τ, 1/s, and speed without load, counts/s.
const MOST_RATE: u32 = 1000;
const MOST_SPEED: u32 = 6000;
/// Fastest heating, 0.1 K/s, and shortest time constant of a winding, ms.
const MOST_HEATING: u32 = 1000;
const LEAST_WINDING_MS: u32 = 1000;
/// Longest electrical time constant, µs.
const MOST_LAG_US: u16 = 5000;
/// Torque with which a motor is sure to brake, two thirds of MT by default, and what MT has beyond: a motor that all of MT brakes from any speed
/// is not limited.
const MOST_TORQUE: u32 = 500;
const MORE_TORQUE: u32 = 250;
/// Voltage of 1024 units, mV.
const LEAST_FULL_MV: u32 = 1_000;
const MOST_FULL_MV: u32 = 50_000;
/// Most friction, torque units.
const MOST_FRICTION: u16 = 400;

impl Motor {
    /// The hand's motor (decision 0003) with 2e-5 kg·m²: 0.0651 V·s/rad, friction of 0.03 and 0.04 N·m.
    pub const HAND: Self = Self {
        poles: 6,
        mr: 2405,
        mpk: 9980,
        mvn: 240,
        mwx: 1300,
        mwj: 1000,
        mwr: 150,
        mka: 1454,
        mke: 3971,
        mfc: 47,
        mfs: 63,
        mte: 333,
    };

    /// Nothing is known: cannot be driven.
    pub const UNKNOWN: Self = Self {
        poles: 0,
        mr: 0,
        mpk: 0,
        mvn: 0,
        mwx: 0,
        mwj: 0,
        mwr: 0,
        mka: 0,
        mke: 0,
        mfc: 0,
        mfs: 0,
        mte: 0,
    };

    /// Whether a board can drive it.
    ///
    /// # Errors
    /// Why not: the first reason in the order of their numbers.
    pub fn check(&self, board: &BoardFigures) -> Result<(), Unfit> {
        if self.poles < 4 || !self.poles.is_multiple_of(2) {
            return Err(Unfit::Poles);
        }
        let full = self.full_mv();
        let within = |value: u16, (low, high): (u16, u16)| low <= value && value <= high;
        if u32::from(self.mvn) * 1000 > full * MOST_RATIO_TENTHS {
            return Err(Unfit::Current);
        }
        // MKA and MKE make 1/τ in 2^-16.
        if u32::from(self.mka) * u32::from(self.mke) > MOST_RATE << 16 {
            return Err(Unfit::Light);
        }
        if self.no_load() > MOST_SPEED {
            return Err(Unfit::Fast);
        }
        if !within(self.mpk, board.peak_ma) {
            return Err(Unfit::Range);
        }
        if !within(self.mvn, board.supply) {
            return Err(Unfit::Supply);
        }
        if self.peak_mw() > MOST_HEATING * u32::from(self.mwj) || self.winding_ms() < LEAST_WINDING_MS {
            return Err(Unfit::Heat);
        }
        if self.mte > MOST_LAG_US || !(LEAST_FULL_MV..=MOST_FULL_MV).contains(&full) {
            return Err(Unfit::Winding);
        }
        if self.stiction() > MOST_FRICTION { Err(Unfit::Friction) } else { Ok(()) }
    }

    /// MFS as it counts.
    #[must_use]
    pub const fn stiction(&self) -> u16 {
        if self.mfs > self.mfc { self.mfs } else { self.mfc }
    }

    /// Voltage of 1024 units, R · MPK, in mV, to the nearest 10 mV.
    #[inline(never)]
    #[must_use]
    pub fn full_mv(&self) -> u32 {
        // mΩ · mA is µV.
        let hundredths = half_up(u64::from(self.mr) * u64::from(self.mpk), 10_000);
        hundredths.saturating_mul(10)
    }

    /// Speed without load at the nominal voltage, counts/s.
    #[must_use]
    pub fn no_load(&self) -> u32 {
        // 1024 · 4096 / 100 of 0.1 V over mV.
        let full = u64::from(self.full_mv()) * u64::from(self.mke);
        half_up(u64::from(self.mvn) * (100 * 1024 * 4096), full)
    }

    /// Largest speed from which a supply that takes nothing back lets it brake, counts/s; `None`: from any.
    ///
    /// With a torque of 500 units it returns (E − 500)²·τ/2 from an EMF of E units, the rest heats the winding. That much must fit the board's
    /// capacitors, from a supply of 7/8 of the bridge's highest voltage, 28 V of 32.
    #[must_use]
    pub fn most_speed(&self, board: &BoardFigures) -> Option<u16> {
        // 2 · 1024² of µJ over mW · τ, and MKA · MKE is 2^16/τ: 4/125.
        let energy = u64::from(board.room_uj) * u64::from(self.mka) * u64::from(self.mke) * 4;
        let square = half_up(energy, u64::from(self.peak_mw()) * 125);
        let most = MOST_TORQUE + root_within(square, 0, 4096);
        let reached = half_up(u64::from(self.mvn) * 700 * 1024, u64::from(self.full_mv()) * 6);
        // MKE is 4096 · K.
        (most + MORE_TORQUE < reached).then(|| saturating_u16((most << 12) / u32::from(self.mke).max(1)))
    }

    /// Power in the winding at peak current, mW.
    #[must_use]
    pub fn peak_mw(&self) -> u32 {
        half_up(u64::from(self.full_mv()) * u64::from(self.mpk), 1000)
    }

    /// Thermal time constant of the winding, ms.
    #[must_use]
    pub fn winding_ms(&self) -> u32 {
        // 0.01 J/K · 0.01 K/W are 0.1 ms.
        u32::from(self.mwj) * u32::from(self.mwr) / 10
    }

    // --- the same in units of a data sheet -------------------------------------------------------------------

    /// IPNM: torque units per newton meter, of a peak torque in whole mN·m: 650 of the hand's motor.
    #[must_use]
    pub fn units_per_n_m(&self) -> u32 {
        let peak_mn_m = half_up(u64::from(self.mkt()) * u64::from(self.mpk), 1_000_000);
        half_up(1024 * 1000, peak_mn_m.into())
    }

    /// MKT: torque constant in µN·m/A, which is the EMF in µV·s/rad.
    #[must_use]
    pub fn mkt(&self) -> u32 {
        half_up(u64::from(self.mke) * self.kt_unit() * 100_000, KT_E5)
    }

    /// Takes MKT, and leaves MKA.
    pub fn set_mkt(&mut self, mkt: u32) {
        self.mke = saturating_u16(half_up(u64::from(mkt) * KT_E5, self.kt_unit() * 100_000)).max(LEAST);
    }

    /// MJ: inertia of the motor and its load in 1e-11 kg·m².
    #[must_use]
    pub fn mj(&self) -> u32 {
        half_up(self.torque_e5(), u64::from(self.mka) * 100_000)
    }

    /// Takes MJ.
    pub fn set_mj(&mut self, mj: u32) {
        self.mka = saturating_u16(half_up(self.torque_e5(), u64::from(mj) * 100_000)).max(LEAST);
    }

    /// ML: inductance line to line in 0.1 µH.
    #[must_use]
    pub fn ml(&self) -> u32 {
        half_up(u64::from(self.mte) * u64::from(self.mr), 100)
    }

    /// Takes ML.
    pub fn set_ml(&mut self, ml: u32) {
        self.mte = saturating_u16(half_up(u64::from(ml) * 100, u64::from(self.mr))).min(MOST_MTE);
    }

    /// MKT is MKE · this / 4392.26: 4096 · 1024 · 2π/6 of 10^-6 V·s/rad over 10^-3 V.
    #[inline(never)]
    fn kt_unit(&self) -> u64 {
        u64::from(self.poles / 2) * u64::from(self.full_mv())
    }

    /// MKA · MJ: 16/1024 · 6/2π of 10^-6 N·m/A · 10^-3 A over 10^-11 kg·m², times 10^5.
    #[inline(never)]
    fn torque_e5(&self) -> u64 {
        u64::from(self.mkt()) * u64::from(self.mpk) * u64::from(self.poles / 2) * 149_208
    }
}

/// Bounds of the properties MKA, MKE and MTE: a figure beyond them leaves the motor unfit.
const LEAST: u16 = 16;
const MOST_MTE: u16 = 20_000;

/// 4392.26488 · 10^5.
const KT_E5: u64 = 439_226_488;

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    const BOARD: BoardFigures = BoardFigures::TATER;

    /// Motors that the board can drive, over the whole range.
    pub(crate) fn any_fitting() -> impl Strategy<Value = Motor> {
        let electric = (310_u16..16_600, 9_u32..45, 200_u16..256, 50_u64..3000, 2_u8..=20);
        let mechanic = (10_u64..2000, 0_u16..400, 0_u16..400, 10_u16..=5000);
        let thermal = (600_u16..1800, 1_u32..100, 10_u32..600);
        (electric, mechanic, thermal).prop_filter_map("fits", |(electric, mechanic, thermal)| {
            let (mpk, ratio, mvn, no_load, pairs) = electric;
            let (tau, mfc, mfs, mte) = mechanic;
            let (mwx, kelvin, tenths) = thermal;
            let mut motor = Motor { poles: 2 * pairs, mpk, mvn, mfc, mfs, mte, mwx, ..Motor::HAND };
            motor.mr = u32::from(mvn) * 1_000_000 / (u32::from(mpk) * ratio);
            let full = u64::from(motor.full_mv().max(1));
            motor.mke = saturating_u16(half_up(u64::from(mvn) * 100 * 1024 * 4096, full * no_load));
            motor.mka = saturating_u16(half_up(65_536_000 * 10, u64::from(motor.mke) * tau));
            motor.mwj = saturating_u16(motor.peak_mw() / (10 * kelvin)).max(1);
            motor.mwr = saturating_u16(tenths * 1000 / u32::from(motor.mwj)).max(1);
            let is_exact = motor.mke < u16::MAX && motor.mka >= 16;
            (is_exact && motor.check(&BOARD).is_ok()).then_some(motor)
        })
    }

    /// MKA 1454: 0.6496 N·m/1024 / 2e-5 kg·m² · 18/2π. MKE 3971: 0.0651 V·s/rad · 2π/18 over 24 V/1024.
    #[test]
    fn hands_motor_is_the_one_of_decision_0003() {
        let hand = Motor::HAND;
        assert_eq!(hand.check(&BOARD), Ok(()));
        assert_eq!((hand.full_mv(), hand.no_load(), hand.units_per_n_m()), (24_000, 1056, 1575));
        assert_eq!((hand.peak_mw(), hand.winding_ms(), hand.most_speed(&BOARD)), (239_520, 15_000, None));
        assert_eq!((hand.mkt(), hand.mj(), hand.ml()), (65_094, 1_999_956, 8009));
        let mut same = hand;
        same.set_mkt(65_100);
        same.set_mj(2_000_000);
        same.set_ml(8000);
        assert_eq!(same, hand);
    }

    #[test]
    fn description_that_the_board_cannot_drive_is_refused_with_its_reason() {
        let hand = Motor::HAND;
        for (motor, why) in [
            (Motor::UNKNOWN, Unfit::Poles),
            (Motor { poles: 7, ..hand }, Unfit::Poles),
            (Motor { mwj: 0, ..hand }, Unfit::Heat),
            (Motor { mr: 534, ..hand }, Unfit::Current),
            (Motor { mka: 16_504, ..hand }, Unfit::Light),
            (Motor { mke: 698, ..hand }, Unfit::Fast),
            (Motor { mpk: 16_667, mr: 1440, ..hand }, Unfit::Range),
            (Motor { mpk: 312, mr: 76_923, ..hand }, Unfit::Range),
            (Motor { mvn: 199, ..hand }, Unfit::Supply),
            (Motor { mvn: 257, ..hand }, Unfit::Supply),
            (Motor { mwj: 239, mwr: 500, ..hand }, Unfit::Heat),
            (Motor { mwr: 9, ..hand }, Unfit::Heat),
            (Motor { mte: 5001, ..hand }, Unfit::Winding),
            (Motor { mfc: 401, ..hand }, Unfit::Friction),
        ] {
            assert_eq!(motor.check(&BOARD), Err(why), "{motor:?}");
        }
        for motor in [
            Motor { mr: 535, mke: 17_850, mka: 300, mwj: 300, mwr: 500, ..hand },
            Motor { mka: 16_503, ..hand },
            Motor { mke: 700, ..hand },
            Motor { mpk: 16_666, mr: 1440, ..hand },
            Motor { mvn: 200, ..hand },
            Motor { mvn: 256, ..hand },
            Motor { mwj: 240, mwr: 500, ..hand },
            Motor { mte: 5000, ..hand },
        ] {
            assert_eq!(motor.check(&BOARD), Ok(()), "{motor:?}");
        }
    }

    proptest! {
        /// Each figure of a data sheet is one of the description within half of the description's step.
        #[test]
        fn data_sheet_and_description_are_two_views(motor in any_fitting()) {
            prop_assume!(motor.mj() < u32::MAX);
            let mut again = motor;
            again.set_mkt(motor.mkt());
            again.set_mj(motor.mj());
            again.set_ml(motor.ml());
            let near = |a: u16, b: u16| a.abs_diff(b) <= 1;
            prop_assert!(near(again.mke, motor.mke) && near(again.mka, motor.mka) && near(again.mte, motor.mte),
                "{:?} {:?}", again, motor);
        }
    }
}
