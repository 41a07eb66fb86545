//! OTEMP: reduces torque as the motor warms, by the thermistor and by a model of the winding (decision 0014).
//!
//! The thermistor sits on the housing. Between winding and housing of the hand's motor are 1.5 K/W, so holding at MT 750 (128 W of copper loss)
//! would put the winding 190 °C above the housing within a minute, long before the thermistor follows. The winding's rise
//! over the thermistor is therefore modeled from the torque T, with R·MPK² (239.5 W), MWR and τ = MWR·MWJ (15 s):
//!
//! ```text
//! d(rise)/dt = ((T/1024)² · R·MPK² · MWR − rise) / τ
//! ```
//!
//! The model must not start colder than the winding is (decision 0051), so a start assumes one of [`Start`]. The flash keeps
//! one bit beyond a loss of power, the hot mark. While it is missing, the winding may not pass 30 K less than its limit, so a start without
//! the mark may assume that; with it the limit. Of the hand's motor they are 100 and 130 °C.

use crate::motor::Motor;
use crate::num::{half_up, saturating_i16, saturating_signed, saturating_u16};
use crate::units::{DeciCelsius, Torque};
use core::num::NonZeroU32;

/// A reading this low or lower is a broken wire, which reads −50 °C.
const OPEN: DeciCelsius = DeciCelsius(-400);

/// OTEMP value that disables the limit (manual 5.4.1).
pub const DISABLED: i16 = -551;

/// Band below OTEMP over which torque decreases linearly to zero, 0.1 °C.
const OTEMP_BAND: i32 = 80;

/// Band below the winding's limit over which torque decreases, 0.1 °C; wide compared to the model's error.
const WINDING_BAND: i32 = 200;

/// What the winding must stay below its limit while the flash has no hot mark, 0.1 K: a start without a mark assumes that.
const UNMARKED_BELOW: i32 = 300;

/// Band below that; narrow, because the mark is there before the winding gets into it.
const UNMARKED_BAND: i32 = 20;

/// The hot mark is wanted before that band, by what the winding heats at peak current in so many ms: 3 K of the hand's motor. A mark waits for
/// a record that is being written, up to 140 half-words.
const MARK_MS: u32 = 125;

/// The mark is removed so far below the limit without one, 0.1 K: a winding needs 4.7 s or more to get there, which bounds the wear.
const UNMARK_BELOW: i32 = 200;

/// Longest time for which an interrupted program may have heated the winding since it last stored its rise, ms: the longest that the watchdog
/// takes.
const INTERRUPTED_MS: u32 = 667;

/// What is in `squares` at most, 0.1 K, and what rounding the rise down loses.
const PENDING: i32 = 5;

/// Ticks of 1 ms between two judgments: far below the 15 s of the winding and the minutes of the housing.
pub const TICKS: u8 = 16;

/// Largest T² that the model counts. |T| ≤ 1024 at 24 V; a higher bus gives more, which no motor survives anyway.
const MAX_SQUARED: u32 = 2047 * 2047;

/// Largest steady rise that is counted, 0.1 K: twice 2^16 of them fit 32 bits.
const MOST_RISE: u32 = 14_350;

/// Torque limit of a cool motor: the largest MT.
const FULL: i16 = 990;

/// How a winding heats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Winding {
    /// Winding temperature at which the model allows no torque, 0.1 °C. 130 °C of the hand's motor: insulation class B, the lowest class in use
    /// for servo motors (the manual names none).
    max: i16,
    /// Steady rise is T² / this in 0.1 °C.
    rise_divisor: NonZeroU32,
    /// Twice τ in steps of `TICKS`.
    rise_half_steps: NonZeroU32,
    /// The hot mark is wanted from here on, and obsolete below, 0.1 °C.
    mark_from: i16,
    unmark_below: i16,
    /// What an interrupted program may have heated the winding since it last stored its rise, 0.1 K.
    uncounted: u16,
}

impl Winding {
    /// Of a motor that fits.
    #[must_use]
    pub fn new(motor: &Motor) -> Self {
        let max = i32::from(motor.mwx);
        let power_mw = u64::from(motor.peak_mw());
        // mW over 0.01 J/K are 0.1 K/s.
        let heats = |ms: u32| half_up(power_mw * u64::from(ms), u64::from(motor.mwj) * 1000);
        let unmarked = max - UNMARKED_BELOW;
        let mark_from = unmarked - UNMARKED_BAND - heats(MARK_MS).cast_signed();
        // mW · 0.01 K/W are 10^-4 of 0.1 K.
        let steady = power_mw * u64::from(motor.mwr);
        Self {
            max: saturating_i16(max),
            rise_divisor: NonZeroU32::new(half_up(10_000 << 20, steady)).unwrap_or(NonZeroU32::MIN),
            rise_half_steps: NonZeroU32::new(motor.winding_ms() / 8).unwrap_or(NonZeroU32::MIN),
            mark_from: saturating_i16(mark_from),
            unmark_below: saturating_i16(unmarked - UNMARK_BELOW),
            uncounted: saturating_u16(heats(INTERRUPTED_MS)),
        }
    }

    /// What an interrupted program may have heated the winding since it last stored its rise, 0.1 K.
    #[must_use]
    pub const fn uncounted(&self) -> u16 {
        self.uncounted
    }
}

/// The thermal state of the winding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Thermal {
    /// Rise of the winding over the thermistor in 2^-16 · 0.1 °C; at most [`MOST_RISE`].
    rise: i32,
    /// Sum of T²/256 since the last judgment; 16 squares fit.
    squares: u32,
    /// Ticks to the next judgment, 0 to `TICKS` − 1; with [`LOOK`], the thermistor is read before that.
    due: u8,
    /// What the first judgment takes the rise from.
    start: Option<Start>,
    /// Whether the flash has the hot mark.
    marked: bool,
    /// Winding temperature, torque limit and over-temperature at the last reading.
    winding: i16,
    most: i16,
    over: bool,
}

/// What is known of the winding when a program starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// The rise over the thermistor at an ordered reset, 0.1 K.
    Reset(u16),
    /// The rise that a program stored up to 0.1 s before it was interrupted.
    Interrupted(u16),
    /// Nothing, and the flash has the hot mark: it is as hot as it may get.
    Marked,
    /// Nothing, and the flash has no hot mark: it is as hot as it may get without one.
    Unmarked,
}

/// What the flash has to be told about the winding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HotMark {
    /// To be stored before the winding may get hotter.
    Wanted,
    /// To be removed.
    Obsolete,
    /// As it is.
    Right,
}

/// In `due`: the last reading of the thermistor is outdated.
const LOOK: u8 = 0x80;

impl Default for Thermal {
    /// A winding as warm as its housing, with the hot mark: [`Self::start`] follows on a board.
    fn default() -> Self {
        Self {
            rise: 0,
            squares: 0,
            due: LOOK,
            start: None,
            marked: true,
            winding: 0,
            most: FULL,
            over: false,
        }
    }
}

impl Thermal {
    /// One tick of 1 ms with the torque applied since the last; the first and every `TICKS`-th judge. Returns whether this
    /// one found the motor too hot: see [`Self::over`].
    pub fn step(&mut self, of: &Winding, applied: Torque, thermistor: DeciCelsius, otemp: i16) -> bool {
        self.warm_by(applied);
        if (1..TICKS).contains(&self.due) {
            self.due -= 1;
            return false;
        }
        self.judge(of, thermistor, otemp)
    }

    /// Sets what is known of the winding, before the first step.
    pub const fn start(&mut self, start: Start) {
        self.start = Some(start);
    }

    /// Reports whether the flash has the hot mark. It must be `false` before the mark is removed, and `true` only once it is there.
    pub const fn set_marked(&mut self, marked: bool) {
        if marked != self.marked {
            self.marked = marked;
            self.due |= LOOK;
        }
    }

    /// Whether the hot mark is as it should be; `moving`: a motion is on or ordered.
    #[must_use]
    pub const fn hot_mark(&self, of: &Winding, moving: bool) -> HotMark {
        if self.start.is_some() {
            HotMark::Right
        } else if self.marked {
            if self.winding < of.unmark_below { HotMark::Obsolete } else { HotMark::Right }
        } else if moving && self.winding >= of.mark_from {
            HotMark::Wanted
        } else {
            HotMark::Right
        }
    }

    /// The rise to be kept over a reset, 0.1 K; `None` before the first judgment.
    #[must_use]
    pub fn rise(&self) -> Option<u16> {
        if self.start.is_some() { None } else { u16::try_from((self.rise >> 16) + PENDING).ok() }
    }

    fn warm_by(&mut self, applied: Torque) {
        let torque = i32::from(applied.0);
        self.squares += (torque * torque).cast_unsigned() >> 8;
    }

    /// Makes the next step read the thermistor: after a new OTEMP or a cleared fault. The model's steps keep their time.
    pub const fn look_next(&mut self) {
        self.due |= LOOK;
        self.over = false;
    }

    /// Torque limit by temperature, 0..=990.
    #[must_use]
    pub const fn most(&self) -> Torque {
        Torque(self.most)
    }

    /// Whether the thermistor is at OTEMP, or reads like a broken wire, which hides the motor's temperature.
    #[must_use]
    pub const fn over(&self) -> bool {
        self.over
    }

    #[inline(never)]
    fn judge(&mut self, of: &Winding, thermistor: DeciCelsius, otemp: i16) -> bool {
        if let Some(start) = self.start.take() {
            self.rise = i32::from(start.rise(of, thermistor)) << 16;
        }
        match (self.due & !LOOK).checked_sub(1) {
            None => self.warm(of),
            Some(left) => self.due = left,
        }
        let warm = i32::from(thermistor.0);
        self.winding = self.winding(thermistor).0;
        let max = i32::from(of.max);
        let (max, band) =
            if self.marked { (max, WINDING_BAND) } else { (max - UNMARKED_BELOW, UNMARKED_BAND) };
        let by_winding = derate(self.winding.into(), max, band);
        let by_otemp = if otemp == DISABLED { FULL } else { derate(warm, i32::from(otemp), OTEMP_BAND) };
        self.most = by_winding.min(by_otemp);
        self.over = otemp != DISABLED && (thermistor.0 >= otemp || thermistor <= OPEN);
        self.over
    }

    /// One step of `TICKS` ms.
    fn warm(&mut self, of: &Winding) {
        // Mean of 16 squares, each of which was divided by 256.
        let squared = (self.squares << 4).min(MAX_SQUARED);
        self.squares = 0;
        self.due = TICKS - 1;
        let steady = saturating_signed((squared / of.rise_divisor).min(MOST_RISE) << 16);
        let change = (steady - self.rise).saturating_mul(2);
        let step = change.signum() * (change.unsigned_abs() / of.rise_half_steps).cast_signed();
        self.rise = self.rise.saturating_add(step).max(0);
    }

    /// Modeled winding temperature at this thermistor reading.
    #[must_use]
    pub fn winding(&self, thermistor: DeciCelsius) -> DeciCelsius {
        let rise = i16::try_from(self.rise >> 16).unwrap_or(i16::MAX);
        DeciCelsius(thermistor.0.saturating_add(rise))
    }
}

impl Start {
    /// The rise at this reading of the thermistor, 0.1 K; with a winding at its limit there is no torque, so no more than that.
    fn rise(self, of: &Winding, thermistor: DeciCelsius) -> i16 {
        let up_to = |winding: i32| saturating_i16(winding.saturating_sub(thermistor.0.into()).max(0));
        let kept = |rise: u16| i16::try_from(rise).unwrap_or(i16::MAX);
        match self {
            Self::Reset(rise) => kept(rise),
            Self::Interrupted(rise) => {
                kept(rise.saturating_add(of.uncounted)).min(kept(rise).max(up_to(of.max.into())))
            }
            Self::Marked => up_to(of.max.into()),
            Self::Unmarked => up_to(i32::from(of.max) - UNMARKED_BELOW),
        }
    }
}

fn derate(temp: i32, max: i32, band: i32) -> i16 {
    let left = max - temp;
    // 0..=990.
    if left >= band { FULL } else { saturating_i16(left.max(0) * i32::from(FULL) / band) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hand() -> Winding {
        Winding::new(&Motor::HAND)
    }

    const WARM: DeciCelsius = DeciCelsius(400);

    fn at(temp: i16, otemp: i16) -> Thermal {
        let mut thermal = Thermal::default();
        assert_eq!(thermal.step(&hand(), Torque::ZERO, DeciCelsius(temp), otemp), thermal.over());
        thermal
    }

    #[test]
    fn torque_decreases_over_eight_degrees_below_otemp() {
        let rows = [(610, 990), (620, 990), (660, 495), (690, 123), (700, 0), (900, 0)];
        for (temp, most) in rows {
            assert_eq!(at(temp, 700).most(), Torque(most), "at {temp}");
        }
        assert_eq!(at(900, DISABLED).most(), Torque(990));
        assert!(at(700, 700).over() && !at(699, 700).over() && at(-400, 700).over());
        assert!(
            !at(1250, DISABLED).over() && !at(-500, DISABLED).over(),
            "the check of the wire ends as well"
        );
    }

    #[test]
    fn over_temperature_is_found_within_sixteen_ticks() {
        let mut thermal = at(400, 700);
        let seen = (1..100).find(|_| thermal.step(&hand(), Torque::ZERO, DeciCelsius(700), 700));
        assert_eq!(seen, Some(usize::from(TICKS)));
    }

    #[test]
    fn frequent_readings_do_not_cool_the_winding_model() {
        let rise = |often: bool| {
            let mut thermal = Thermal::default();
            for _ in 0..120_000 {
                thermal.step(&hand(), Torque(750), WARM, DISABLED);
                if often {
                    thermal.look_next();
                }
            }
            thermal.winding(WARM).0 - WARM.0
        };
        // 750² / 292 is 192.6 °C at last; eight time constants leave less than 0.1 °C of it.
        assert!((1915..=1927).contains(&rise(false)), "{}", rise(false));
        assert_eq!(rise(true), rise(false));
    }

    #[test]
    fn new_limit_applies_in_the_next_step() {
        let mut thermal = at(600, 700);
        thermal.look_next();
        assert!(thermal.step(&hand(), Torque::ZERO, DeciCelsius(600), 600));
        thermal.look_next();
        assert!(!thermal.step(&hand(), Torque::ZERO, DeciCelsius(600), 700));
    }

    #[test]
    fn extreme_torque_does_not_overflow() {
        for torque in [i16::MIN, i16::MAX] {
            let mut thermal = Thermal::default();
            for _ in 0..20_000 {
                thermal.step(&hand(), Torque(torque), WARM, DISABLED);
            }
            assert_eq!(thermal.most(), Torque::ZERO);
        }
    }

    #[test]
    fn stall_at_peak_torque_warms_the_winding_by_its_copper_loss() {
        let mut thermal = Thermal::default();
        for _ in 0..300 {
            thermal.step(&hand(), Torque(1024), WARM, 700);
        }
        // 239.5 W for 0.3 s into 10 J/K is 7.2 °C, less what flows off.
        let rise = thermal.winding(WARM).0 - WARM.0;
        assert!((68..=72).contains(&rise), "{rise}");
    }

    #[test]
    fn unmarked_winding_stays_below_what_a_start_without_mark_assumes() {
        let mut thermal = Thermal::default();
        thermal.set_marked(false);
        let (mut torque, mut wanted_at) = (Torque(990), None);
        for _ in 0..120_000 {
            thermal.step(&hand(), torque, WARM, DISABLED);
            torque = thermal.most();
            let winding = thermal.winding(WARM).0;
            assert!(winding <= 1000, "{winding}");
            if thermal.hot_mark(&hand(), true) == HotMark::Wanted && wanted_at.is_none() {
                wanted_at = Some((winding, torque));
            }
        }
        let (winding, torque) = wanted_at.expect("the mark is wanted");
        assert!(
            winding < 960 && torque == Torque(FULL),
            "wanted before the torque is reduced: {winding}, {torque:?}"
        );
        assert_eq!(thermal.hot_mark(&hand(), false), HotMark::Right, "a motor that does not move cools down");
        thermal.set_marked(true);
        thermal.step(&hand(), Torque::ZERO, WARM, DISABLED);
        assert_eq!((thermal.most(), thermal.hot_mark(&hand(), true)), (Torque(FULL), HotMark::Right));
        for _ in 0..8_000 {
            thermal.step(&hand(), Torque::ZERO, WARM, DISABLED);
        }
        assert_eq!(thermal.hot_mark(&hand(), true), HotMark::Obsolete);
    }

    #[test]
    fn cold_start_delays_full_torque_as_decision_0051_says() {
        let full_after_ms = |start, marked, thermistor| {
            let mut thermal = Thermal::default();
            thermal.start(start);
            thermal.set_marked(marked);
            (0..20_000).find(|_| {
                thermal.step(&hand(), Torque::ZERO, DeciCelsius(thermistor), DISABLED);
                thermal.most() == Torque(FULL)
            })
        };
        // 15 s · ln(105/85), and ln(60/40); a mark that is written at once, and one that is never written.
        let marked = full_after_ms(Start::Marked, true, 250);
        assert!(marked.is_some_and(|ms| (3_100..3_250).contains(&ms)), "{marked:?}");
        let warm = full_after_ms(Start::Marked, true, 700);
        assert!(warm.is_some_and(|ms| (6_000..6_200).contains(&ms)), "{warm:?}");
        assert_eq!(full_after_ms(Start::Unmarked, true, 250), Some(0));
        let waiting = full_after_ms(Start::Unmarked, false, 250);
        assert!(waiting.is_some_and(|ms| (380..450).contains(&ms)), "{waiting:?}");
    }

    #[test]
    fn start_assumes_the_hottest_winding_that_is_possible() {
        let rows = [
            (Start::Reset(300), 700),
            (Start::Interrupted(300), 860),
            (Start::Interrupted(850), 1300),
            (Start::Interrupted(1000), 1400),
            (Start::Marked, 1300),
            (Start::Unmarked, 1000),
        ];
        for (start, winding) in rows {
            let mut thermal = Thermal::default();
            thermal.start(start);
            assert_eq!((thermal.rise(), thermal.hot_mark(&hand(), true)), (None, HotMark::Right));
            thermal.step(&hand(), Torque::ZERO, WARM, DISABLED);
            // After a step of cooling, 0.1 K at most.
            let rise = thermal.rise().expect("judged");
            assert!((winding - 397..=winding - 395).contains(&rise), "{start:?}: {rise}");
        }
        let mut thermal = Thermal::default();
        thermal.start(Start::Unmarked);
        thermal.step(&hand(), Torque::ZERO, DeciCelsius(1100), DISABLED);
        assert_eq!(thermal.winding(DeciCelsius(1100)), DeciCelsius(1100), "never below the thermistor");
    }

    #[test]
    fn endless_pressing_settles_below_the_winding_limit() {
        let mut thermal = Thermal::default();
        let mut torque = Torque(990);
        for _ in 0..120_000 {
            thermal.step(&hand(), torque, WARM, DISABLED);
            torque = thermal.most();
        }
        let winding = thermal.winding(WARM).0;
        assert!(torque < Torque(700) && torque > Torque(300), "{torque:?}");
        assert!((1100..1300).contains(&winding), "{winding}");
        for _ in 0..120_000 {
            thermal.step(&hand(), Torque::ZERO, WARM, DISABLED);
        }
        assert!(thermal.winding(WARM).0 - WARM.0 <= 3, "cools down again");
    }

    #[test]
    fn hot_mark_is_wanted_by_a_hot_winding_that_moves_and_obsolete_for_a_cool_one() {
        use HotMark::{Obsolete, Right, Wanted};
        let mut thermal = at(400, DISABLED);
        for (winding, unmarked, marked) in
            [(799, Right, Obsolete), (800, Right, Right), (949, Right, Right), (950, Wanted, Right)]
        {
            thermal.winding = winding;
            for (mark, expected) in [(false, unmarked), (true, marked)] {
                thermal.marked = mark;
                assert_eq!(thermal.hot_mark(&hand(), true), expected, "{winding}, marked: {mark}");
                let rests = if expected == Wanted { Right } else { expected };
                assert_eq!(thermal.hot_mark(&hand(), false), rests, "{winding} at rest, marked: {mark}");
            }
        }
    }

    #[test]
    fn new_hot_mark_is_looked_at_next_and_delays_no_judgment() {
        for (before, marked) in [(false, true), (true, false), (true, true), (false, false)] {
            let mut thermal = at(400, 700);
            thermal.marked = before;
            for _ in 0..5 {
                let _ = thermal.step(&hand(), Torque::ZERO, DeciCelsius(400), 700);
            }
            let due = thermal.due;
            thermal.set_marked(marked);
            assert_eq!(thermal.marked, marked);
            assert_eq!(thermal.due, if before == marked { due } else { due | LOOK });
        }
    }
}
