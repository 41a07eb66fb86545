//! The position law of modes 3 and 5. Each tick of T = 1 ms, with the set-point at xₛ, vₛ with the acceleration aₛ, the position error
//! e = xₛ − x̂ in counts and the velocity error ė = vₛ − v̂ in counts/s,
//!
//! ```text
//! torque = KP·e + I + (KD/256 + K)·ė + aₛ/B + (F + s)·sgn − d        I = I + KI·T·e, limited to the available torque
//! ```
//!
//! in torque units. aₛ/B accelerates the rotor as the profile does, F is the friction in the direction of the set-point (at its end in
//! that of e), s what breaks a resting rotor loose, and d the observed load, which the law carries instead of an integral: KI is 0 by
//! default. K compensates the EMF at the set-point's velocity instead of the observed one. A set-point at rest ([`Stage::Rest`]) has 1.6
//! of KP and 1.2 of KD; in its cell ([`Stage::Cell`]) the halls resolve no more, so only −d and twice KD are left while the rotor is slower
//! than 10 counts/s.

use crate::config::Config;
use crate::num::{Law, TICK_HZ, gain, mul_clamped, mul_shift, product, saturating_signed, sum_of_products};
use crate::units::Torque;

/// The gains of a tick's laws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gains {
    /// KP: torque units per count.
    pub kp: Law,
    /// KD: torque units per count/s.
    pub kd: Law,
    /// KPV: torque units per count/s.
    pub kpv: Law,
}

impl Gains {
    /// Of the properties KP, KD and KPV, or where KBW is not 0 of it: ω = 2π·KBW/10 is the bandwidth of the position loop, and
    ///
    /// ```text
    /// D = max(3.03·ω/B, K)     KP = D·ω/3.03     KD = D − K     KPV = 1.75·ω/B
    /// ```
    ///
    /// The EMF damps by K whatever KD is: of a motor whose EMF damps more than the loop needs, KP is higher, so that it is as fast.
    ///
    /// KBW 166 gives the hand's motor its 120, 640 and 32: a damping of 1.5, which a motor with a third of the inertia, or three times of it,
    /// leaves above 0.8.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let Config { kp, kd, kpv, kbw, motor, .. } = *config;
        if kbw == 0 {
            return Self { kp: gain(kp, 0), kd: gain(kd, 8), kpv: gain(kpv, 4) };
        }
        // MKA is 16·B. 16·3.03·2π/10 · 2^16 = 1,996,284; 16·1.75·2π/10 · 2^16 = 1,152,970; 2π/10/3.03 · 2^16 = 13,590.
        let kbw = u32::from(kbw);
        let over = |n: u32| saturating_signed(n * kbw / u32::from(motor.mka.max(1)));
        let (damping, emf) = (over(1_996_284), i32::from(motor.mke) << 4);
        let kp = mul_shift(damping.max(emf), (13_590 * kbw).cast_signed(), 16);
        let kd = Law::from_bits((damping - emf).max(0)).min(MOST_KD);
        Self { kp: Law::from_bits(kp), kd, kpv: Law::from_bits(over(1_152_970)) }
    }

    /// The coefficients of a tick, with property KI in torque units per count·second. Gains saturate at 32,767.
    #[must_use]
    pub fn build(self, ki: u16) -> Pid {
        // The largest KI of 32767 is 32.767 a tick; the truncation of the smallest (1) is 0.8 %.
        let ki = gain(ki, 0).checked_div_int(TICK_HZ.cast_signed()).unwrap_or(Law::ZERO);
        // KD is below 128, so twice it and an EMF fit.
        let Self { kp, kd, .. } = self;
        let more = |gain: Law, share| gain.saturating_add(product(gain, share));
        Pid { kp, ki, kd, resting: (more(kp, RESTING_KP), more(kd, RESTING_KD)), twice_kd: kd + kd }
    }
}

/// The law's coefficients.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pid {
    kp: Law,
    ki: Law,
    kd: Law,
    /// KP and KD while the set-point rests.
    resting: (Law, Law),
    twice_kd: Law,
}

/// The integral I, in torque units.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PidState {
    integral: Law,
}

/// What the set-point does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// It moves.
    Move,
    /// It rests, and the rotor is in another cell.
    Rest,
    /// It rests in the rotor's cell.
    Cell,
}

/// The inputs of a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Errors {
    /// What the set-point does.
    pub stage: Stage,
    /// e in counts.
    pub position: Law,
    /// ė in counts/s.
    pub velocity: Law,
    /// K in torque units per count/s.
    pub emf: Law,
    /// The other terms, in torque units.
    pub feed: Law,
}

/// Largest KD, torque units per count/s.
const MOST_KD: Law = Law::lit("127");

/// More KP and KD while the set-point rests.
const RESTING_KP: Law = Law::lit("0.6");
const RESTING_KD: Law = Law::lit("0.2");

/// Velocity from which the position error counts in the cell too, counts/s.
const SOFT: Law = Law::lit("10");

impl Pid {
    /// One tick; returns a torque in `low..=high`, which the limits and the bus voltage leave at the present speed. Anti-windup: the
    /// integral stays within that range and pauses while the output is beyond its end in the error's direction.
    #[must_use]
    pub fn step(&self, state: &mut PidState, errors: &Errors, (low, high): (Law, Law)) -> Torque {
        let Errors { stage, position, velocity, emf, feed } = *errors;
        let (kp, kd) = match stage {
            Stage::Move => (self.kp, self.kd),
            Stage::Rest => self.resting,
            Stage::Cell => {
                (if velocity.saturating_abs() <= SOFT { Law::ZERO } else { self.kp }, self.twice_kd)
            }
        };
        // Products and feed are within ±8192: no sum overflows.
        let direct = sum_of_products((kp, position), (kd + emf, velocity)) + feed;
        if self.ki == Law::ZERO {
            return Torque::from_fixed(direct.max(low).min(high));
        }
        let increment = if stage == Stage::Cell { Law::ZERO } else { mul_clamped(self.ki, position) };
        let unbounded = direct + state.integral;
        let winding_up =
            (unbounded > high && increment > Law::ZERO) || (unbounded < low && increment < Law::ZERO);
        if !winding_up {
            state.integral = (state.integral + increment).max(low).min(high);
        }
        Torque::from_fixed((direct + state.integral).max(low).min(high))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMIT: Torque = Torque(750);
    const RANGE: (Law, Law) = (fixed(Torque(-750)), fixed(LIMIT));

    /// As the arithmetic of the law has it.
    const fn fixed(torque: Torque) -> Law {
        Law::from_bits((torque.0 as i32) << 16)
    }

    fn law(kp: u16, ki: u16, kd: u16) -> Pid {
        Gains { kp: gain(kp, 0), kd: gain(kd, 8), kpv: Law::ZERO }.build(ki)
    }

    /// Of a set-point that moves, without EMF and other terms.
    fn errors(position: Law, velocity: Law) -> Errors {
        Errors { stage: Stage::Move, position, velocity, emf: Law::ZERO, feed: Law::ZERO }
    }

    fn whole(position: i32, velocity: i32) -> Errors {
        errors(Law::from_num(position), Law::from_num(velocity))
    }

    fn once(law: Pid, errors: &Errors) -> Torque {
        law.step(&mut PidState::default(), errors, RANGE)
    }

    #[test]
    fn gains_have_their_scale() {
        let mut state = PidState::default();
        assert_eq!(law(60, 0, 0).step(&mut state, &whole(1, 0), RANGE), Torque(60));
        assert_eq!(law(0, 0, 128).step(&mut state, &whole(0, 100), RANGE), Torque(50));
        let integral = law(0, 300, 0);
        let mut torque = Torque::ZERO;
        for _ in 0..1000 {
            torque = integral.step(&mut state, &whole(1, 0), RANGE);
        }
        // One count for one second, less the truncation of KI to a tick.
        assert!((299..=300).contains(&torque.0), "{torque:?}");
    }

    #[test]
    fn emf_and_feed_are_added() {
        let emf = Law::lit("0.9695");
        for (stage, damping) in [(Stage::Move, 250), (Stage::Rest, 300), (Stage::Cell, 500)] {
            let errors = Errors { stage, emf, feed: Law::from_num(-40), ..whole(0, 100) };
            // KD 640 is 2.5 a count/s.
            assert_eq!(once(law(0, 0, 640), &errors), Torque(damping + 97 - 40), "{stage:?}");
        }
        assert_eq!(once(law(0, 0, 0), &Errors { feed: Law::from_num(800), ..whole(0, 0) }), LIMIT);
    }

    #[test]
    fn resting_set_point_has_more_kp_and_kd() {
        let law = law(100, 0, 640);
        for (stage, position, velocity) in [(Stage::Move, 100, 250), (Stage::Rest, 160, 300)] {
            assert_eq!(once(law, &Errors { stage, ..whole(1, 0) }), Torque(position), "{stage:?}");
            assert_eq!(once(law, &Errors { stage, ..whole(0, -100) }), Torque(-velocity), "{stage:?}");
        }
    }

    #[test]
    fn rotor_in_the_cell_of_the_end_gets_no_kp_below_10_counts_per_second() {
        let law = law(100, 0, 640);
        let at = |velocity| once(law, &Errors { stage: Stage::Cell, ..errors(Law::ONE, velocity) });
        let soft = Law::from_num(10);
        assert_eq!([Law::ZERO, soft, -soft].map(at), [Torque(0), Torque(50), Torque(-50)]);
        assert_eq!([soft + Law::DELTA, -soft - Law::DELTA].map(at), [Torque(150), Torque(50)]);
    }

    /// An error of a quarter of a count integrates outside its cell alone.
    #[test]
    fn integral_stays_in_the_cell_of_the_end() {
        let law = law(0, 4000, 0);
        for (stage, integrated) in [(Stage::Move, 1), (Stage::Rest, 1), (Stage::Cell, 0)] {
            // At 20 counts/s the error counts in the cell too.
            let errors = Errors { stage, ..errors(Law::ONE / 4, Law::from_num(20)) };
            let mut state = PidState { integral: Law::from_num(7) };
            assert_eq!(law.step(&mut state, &errors, RANGE), Torque(7 + integrated), "{stage:?}");
            assert_eq!(state.integral, Law::from_num(7) + law.ki / 4 * i32::from(integrated), "{stage:?}");
        }
    }

    #[test]
    fn long_saturation_leaves_no_windup() {
        let law = law(60, 3000, 0);
        let mut state = PidState::default();
        for _ in 0..10_000 {
            assert_eq!(law.step(&mut state, &whole(100, 0), RANGE), LIMIT);
        }
        assert!(law.step(&mut state, &whole(-1, 0), RANGE) < Torque::ZERO);
    }

    #[test]
    fn largest_gains_saturate() {
        let law = law(u16::MAX, u16::MAX, u16::MAX);
        for stage in [Stage::Move, Stage::Rest, Stage::Cell] {
            let errors = Errors { stage, emf: Law::from_num(2), ..errors(Law::MAX, Law::MAX) };
            assert_eq!(once(law, &errors), LIMIT, "{stage:?}");
        }
    }

    fn any_stage() -> impl Strategy<Value = Stage> {
        prop_oneof![Just(Stage::Move), Just(Stage::Rest), Just(Stage::Cell)]
    }

    proptest! {
        #[test]
        fn torque_and_integral_stay_in_range(
            gains: (u16, u16, u16),
            errors in prop::collection::vec(
                (any_stage(), any::<i32>(), any::<i32>(), 0..0x2_0000_i32, -8191_i32..=8191), 1..50,
            ),
            low in -990i16..=990, room in 0i16..=990,
        ) {
            let law = law(gains.0 >> 1, gains.1 >> 1, gains.2 >> 1);
            let mut state = PidState::default();
            let (low, high) = (Torque(low), Torque(low + room));
            let range = (fixed(low), fixed(high));
            for (stage, position, velocity, emf, feed) in errors {
                let [position, velocity, emf] = [position, velocity, emf].map(Law::from_bits);
                let errors = Errors { stage, position, velocity, emf, feed: Law::from_num(feed) };
                let torque = law.step(&mut state, &errors, range);
                prop_assert!(low <= torque && torque <= high);
                // Before its first step it is 0.
                let zero = Law::ZERO;
                prop_assert!((range.0.min(zero)..=range.1.max(zero)).contains(&state.integral));
            }
        }

        #[test]
        fn opposite_errors_give_the_opposite_torque(
            stage in any_stage(), position in -20_000_000..20_000_000_i32, velocity in -20_000_000..20_000_000_i32, feed in -500..500_i32,
        ) {
            let [position, velocity] = [position, velocity].map(Law::from_bits);
            let one = Errors { stage, position, velocity, emf: Law::ONE, feed: Law::from_num(feed) };
            let other = Errors { position: -position, velocity: -velocity, feed: -one.feed, ..one };
            let law = law(120, 0, 640);
            // Products round down.
            prop_assert!((once(law, &one).0 + once(law, &other).0).abs() <= 1);
        }
    }

    /// At the end of its range exactly, the integral still takes a step; beyond it pauses, but for an error of the other sign.
    #[test]
    fn integral_pauses_beyond_the_end_of_the_range() {
        let pid = law(60, 800, 0);
        for (sign, end) in [(1, LIMIT), (-1, LIMIT.saturating_neg())] {
            let error = Law::from_num(sign);
            let (direct, increment) = (Law::from_num(60 * sign), mul_clamped(pid.ki, error));
            let delta = Law::DELTA * sign;
            assert!(direct.abs() > increment.abs() && increment != Law::ZERO);
            for (beyond, moves) in [(-delta, true), (Law::ZERO, true), (delta, false)] {
                let from = fixed(end) - direct + beyond;
                let mut state = PidState { integral: from };
                assert_eq!(pid.step(&mut state, &whole(sign, 0), RANGE), end);
                assert_eq!(state.integral, if moves { from + increment } else { from }, "{sign} {beyond}");
            }
            let mut state = PidState { integral: fixed(end) };
            let _ = pid.step(&mut state, &whole(-sign, sign * 200), RANGE);
            assert_eq!(state.integral, fixed(end) - increment, "back");
        }
    }
}
