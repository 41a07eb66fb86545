//! OTEMP: torque derates as the motor warms, by the thermistor and by a model of the winding that the
//! thermistor cannot see in time.
//!
//! The thermistor sits on the housing: OTEMP acts on it. Between winding and housing lies 1.5 K/W, so holding
//! at MT 750 (128 W of copper loss) would put the winding 190 °C above the housing within a minute, long before
//! the thermistor follows. The winding's rise over the thermistor is therefore modelled from the torque.

use crate::units::{DeciCelsius, Torque};

/// A thermistor that reads this or less has a broken wire, which reads -50 °C; no hand works in such cold.
const OPEN: DeciCelsius = DeciCelsius(-400);

/// OTEMP value that disables the limit (manual 5.4.1).
pub const DISABLED: i16 = -551;

/// Torque derates linearly to nothing over this band below OTEMP, 0.1 °C (property table).
const OTEMP_BAND: i32 = 80;

/// Winding temperature at which the model allows no torque, 0.1 °C: insulation class B, 130 °C, the lowest
/// class in use for servo motors (the manual names none).
const WINDING_MAX: i32 = 1300;

/// Band below `WINDING_MAX` over which torque derates, 0.1 °C; wide against the model's error.
const WINDING_BAND: i32 = 200;

/// Steady rise of the winding over the housing is torque² / this, in 0.1 °C per torque unit²:
/// (T/1024)² × 239.5 W × 1.5 K/W × 10.
const RISE_DIVISOR: i32 = 292;

/// Time constant of winding against housing: 10 J/K × 1.5 K/W = 15 s, in ticks.
const RISE_TICKS: i32 = 15_000;

/// The torque limit at no derating: the largest MT.
const FULL: i32 = 990;

/// The thermal state of the winding.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Thermal {
    /// Rise of the winding over the thermistor, 0.1 °C in 1/65536; 0 to 3357 × 65536, which fits.
    rise: i32,
}

impl Thermal {
    /// One tick of 1 ms with the torque applied since the last: the torque limit that the motor's temperature
    /// leaves, 0..=990.
    #[must_use]
    pub fn step(&mut self, applied: Torque, thermistor: DeciCelsius, otemp: i16) -> Torque {
        // |T| ≤ 1024 after the duty clamp at 24 V; a higher bus gives more, and 2047² still fits.
        let torque = i32::from(applied.clamp_abs(Torque(2047)).0);
        let steady = torque.saturating_mul(torque) / RISE_DIVISOR;
        let step = steady.saturating_mul(1 << 16).saturating_sub(self.rise) / RISE_TICKS;
        self.rise = self.rise.saturating_add(step).max(0);
        let thermistor = i32::from(thermistor.0);
        let winding = thermistor.saturating_add(self.rise >> 16);
        let by_winding = derate(winding, WINDING_MAX, WINDING_BAND);
        let by_otemp =
            if otemp == DISABLED { FULL } else { derate(thermistor, i32::from(otemp), OTEMP_BAND) };
        // 0..=990 by `derate`.
        Torque(i16::try_from(by_winding.min(by_otemp)).unwrap_or(0))
    }

    /// Whether the thermistor is at the limit, where torque is cut; or reads so cold that its wire must be broken, and
    /// nobody knows how hot the motor is.
    #[must_use]
    pub fn over(thermistor: DeciCelsius, otemp: i16) -> bool {
        otemp != DISABLED && (thermistor.0 >= otemp || thermistor <= OPEN)
    }

    /// The modelled winding temperature at this thermistor reading.
    #[must_use]
    pub fn winding(&self, thermistor: DeciCelsius) -> DeciCelsius {
        let rise = i16::try_from(self.rise >> 16).unwrap_or(i16::MAX);
        DeciCelsius(thermistor.0.saturating_add(rise))
    }
}

/// `FULL` below the band, nothing at `max`, linear between.
fn derate(temp: i32, max: i32, band: i32) -> i32 {
    max.saturating_sub(temp).clamp(0, band).saturating_mul(FULL) / band
}

#[cfg(test)]
mod tests {
    use super::*;

    const WARM: DeciCelsius = DeciCelsius(400);

    #[test]
    fn derates_over_the_eight_degrees_below_otemp() {
        let rows = [(610, 990), (620, 990), (660, 495), (690, 123), (700, 0), (900, 0)];
        for (temp, most) in rows {
            let limit = Thermal::default().step(Torque::ZERO, DeciCelsius(temp), 700);
            assert_eq!(limit, Torque(most), "at {temp}");
        }
        assert_eq!(Thermal::default().step(Torque::ZERO, DeciCelsius(900), DISABLED), Torque(990));
        assert!(Thermal::over(DeciCelsius(700), 700) && !Thermal::over(DeciCelsius(699), 700));
        assert!(!Thermal::over(DeciCelsius(1250), DISABLED));
    }

    #[test]
    fn a_stall_at_peak_torque_warms_the_winding_as_the_copper_loss_says() {
        let mut thermal = Thermal::default();
        for _ in 0..300 {
            let _ = thermal.step(Torque(1024), WARM, 700);
        }
        // 239.5 W for 0.3 s into 10 J/K is 7.2 °C, less what flows off.
        let rise = thermal.winding(WARM).0 - WARM.0;
        assert!((68..=72).contains(&rise), "{rise}");
    }

    #[test]
    fn pressing_for_ever_settles_below_the_winding_limit() {
        let mut thermal = Thermal::default();
        let mut torque = Torque(990);
        for _ in 0..120_000 {
            torque = thermal.step(torque, WARM, DISABLED).min(Torque(990));
        }
        let winding = thermal.winding(WARM).0;
        assert!(torque < Torque(700) && torque > Torque(300), "{torque:?}");
        assert!((1100..1300).contains(&winding), "{winding}");
        for _ in 0..120_000 {
            let _ = thermal.step(Torque::ZERO, WARM, DISABLED);
        }
        assert!(thermal.winding(WARM).0 - WARM.0 <= 3, "cools down again");
    }
}
