//! The equations of the module, against a rotor whose edges come exactly when they should.

use super::*;
use crate::motor;
use crate::way::Way;
use proptest::prelude::*;

/// What the tests reckon with are bits: counts in 2^-20, the rest in 2^-16.
const COUNT: i32 = super::COUNT.to_bits();
const ONE: i32 = super::ONE.to_bits();
const BEYOND: i32 = super::BEYOND.to_bits();
const KEEP_LEAST: i32 = super::KEEP_LEAST.to_bits();

const fn place(bits: i32) -> Place {
    Place::from_bits(bits)
}

const fn law(bits: i32) -> Law {
    Law::from_bits(bits)
}

fn keep(interval: i32) -> i32 {
    super::keep(interval).to_bits()
}

/// One count/s.
const SPEED: i32 = 1 << 16;

fn config() -> Motor {
    Motor::HAND
}

fn volts(volts: i32) -> Push {
    Push::Volts { volts, resting: false }
}

fn resting(volts: i32) -> Push {
    Push::Volts { volts, resting: true }
}

fn edge(count: i32, way: Way, at: Micros) -> HallEdge {
    HallEdge { count, steps: 1, way, at, rising: false, bounce: false, uncertain: false }
}

/// An observer and the rotor that it observes.
struct Rig {
    observer: Observer,
    now: Micros,
    /// Position of the rotor, 2^-20 counts · 10^-6.
    rotor: i64,
    /// How much higher than in the middle the boundary above count 0, 1, … 5 is, 2^-20 counts.
    offsets: [i32; 6],
}

impl Rig {
    fn new(config: &Motor, count: i32) -> Self {
        let observer = Observer::new(Model::new(config), count);
        Self {
            observer,
            now: Micros(u32::MAX - 20_000),
            rotor: (i64::from(count) * 1_000_000) << 20,
            offsets: [0; 6],
        }
    }

    /// Ticks without an edge.
    fn still(&mut self, ms: u32, push: Push) {
        for _ in 0..ms {
            self.now = self.now.wrapping_add(Micros(1000));
            self.observer.tick(self.now);
            self.observer.predict(push);
        }
    }

    /// The boundary above `count`, in the rotor's unit.
    fn above(&self, count: i64) -> i64 {
        let offset = i64::from(self.offsets[usize::try_from(count.rem_euclid(6)).unwrap()]);
        ((count << 20) + (1 << 19) + offset) * 1_000_000
    }

    /// Ticks of a rotor with this speed, 2^-16 counts/s.
    fn run(&mut self, ms: u32, speed: i32, push: Push) {
        for _ in 0..ms {
            self.still(1, push);
            let from = self.rotor;
            // 2^-16 counts/s are 2^-16 · 2^20 = 16 units a µs.
            self.rotor += i64::from(speed) * 16_000;
            loop {
                let count = i64::from(self.observer.count());
                let (direction, next, boundary) = if speed > 0 {
                    (Way::Closing, count + 1, self.above(count))
                } else {
                    (Way::Opening, count - 1, self.above(count - 1))
                };
                let ahead = (self.rotor - boundary) * i64::from(speed.signum());
                if ahead < 0 {
                    break;
                }
                let after = (boundary - from) / (i64::from(speed) * 16);
                let at = self.now.wrapping_add(Micros(u32::try_from(after.max(0)).unwrap()));
                self.observer.edge(&edge(i32::try_from(next).unwrap(), direction, at));
            }
        }
    }

    /// In the middle of the cell, at the speed of this voltage.
    fn turning(drive: i32) -> Self {
        let mut rig = Self::new(&config(), 0);
        let speed = steady(drive);
        (rig.observer.volts, rig.observer.driven) = (law(drive << 16), true);
        let m = &mut rig.observer.state;
        (m.velocity, m.stuck, m.quiet_us, m.moving_us, m.interval_us) = (law(speed), false, 0, 0, 0);
        rig
    }

    /// How far the observed position at the last tick is from the rotor's then, 2^-20 counts.
    fn error(&self, speed: i32) -> i64 {
        let rotor = (self.rotor - i64::from(speed) * 16_000) / 1_000_000;
        (i64::from(self.observer.state.count) << 20) + i64::from(self.observer.state.from.to_bits()) - rotor
    }
}

/// (U − F)/K for MFC 47 and MKE 3971, 2^-16 counts/s.
fn steady(volts: i32) -> i32 {
    let net = volts.abs() - 47;
    i32::try_from((i64::from(net) << 28) / 3971).unwrap() * volts.signum()
}

/// e^−y for 2^-50.
fn exp_neg(y: i128) -> i128 {
    let one = 1 << 50;
    // Four terms of y/2^12, squared twelve times.
    let small = y >> 12;
    let square = (small * small) >> 50;
    let cube = (square * small) >> 50;
    (0..12).fold(one - small + square / 2 - cube / 6, |x: i128, _| (x * x) >> 50)
}

/// `x` times 2^(half/2).
fn half_octave(x: i128, half: usize) -> i128 {
    // √2 for 2^-30.
    let x = if half % 2 == 1 { (x * 1_518_500_250) >> 30 } else { x };
    x << (half / 2)
}

#[test]
fn tables_hold_the_equations_of_the_correction() {
    let one: i128 = 1 << 50;
    for (at, keep) in KEEP.iter().enumerate() {
        // t and tₘ in µs · 2^50.
        let t = half_octave(1000 * one, at);
        let memory = (t * 3).min(60_000 * one).max(8000 * one);
        let exact = exp_neg((t / (memory >> 30)) << 20) >> 34;
        assert!((exact - i128::from(*keep)).abs() <= 1, "{at}: {exact} {keep}");
    }
    for (at, (rate, pull, slowness)) in SLOPES.iter().enumerate() {
        let y = half_octave(one * 885 / 10_000, at);
        let e = one - exp_neg(y);
        let w = y - e;
        for (exact, found) in
            [((e << 12) / w, *rate), ((one << 12) / w, *pull), ((y << 16) / (one + y), *slowness)]
        {
            // Half a unit, and 0.5 % for the three digits of 0.0885.
            let error = (exact - i128::from(found)).abs();
            assert!(error <= 1 + exact / 200, "{at}: {exact} {found}");
        }
    }
}

#[test]
fn rotor_at_rest_stays_up_to_its_static_friction() {
    for sign in [1, -1] {
        let mut rig = Rig::new(&config(), 5);
        rig.still(200, volts(sign * 63));
        assert_eq!(
            (rig.observer.velocity(), rig.observer.position()),
            (CountsPerSec::ZERO, Counts::from_int(5))
        );
        // What breaks it loose: MFS − MFC and 2 units.
        assert_eq!(rig.observer.kick(), Law::from_num(18));
        rig.still(2, volts(sign * 64));
        assert_eq!(rig.observer.velocity().0.signum(), sign);
        assert_eq!(rig.observer.kick(), Law::ZERO);
    }
}

/// MFS below MFC counts as MFC.
#[test]
fn static_friction_is_at_least_that_of_motion() {
    let mut rig = Rig::new(&Motor { mfs: 10, ..config() }, 0);
    rig.still(100, volts(47));
    assert_eq!((rig.observer.velocity(), rig.observer.kick()), (CountsPerSec::ZERO, Law::from_num(2)));
}

/// Without EMF and lag, 100 units beyond friction are 100 · 1454/16 = 9087.5 counts/s²: in 10 ms 90.9 counts/s and 0.454 counts.
#[test]
fn voltage_beyond_friction_accelerates_by_the_gain() {
    for sign in [1, -1] {
        let mut rig = Rig::new(&Motor { mke: 1, mte: 0, ..config() }, 0);
        rig.still(10, volts(sign * 147));
        let velocity = (rig.observer.velocity().0 * sign).to_bits();
        assert!((5_955_584 - velocity).abs() < 59_555, "{velocity}");
        let way = rig.observer.state.to.to_bits() * sign;
        assert!((476_447 - way).abs() < 4_764, "{way}");
    }
}

/// In the first tick the current has 1 − 0.333 of the voltage: 300 · 0.667 − 47 = 153.1 units, 13.9 counts/s.
#[test]
fn current_lags_the_voltage_by_mte() {
    let mut rig = Rig::new(&Motor { mke: 1, ..config() }, 0);
    rig.still(1, volts(300));
    let first = rig.observer.velocity().0.to_bits();
    assert!((911_830 - first).abs() < 9_118, "{first}");
    rig.still(1, volts(300));
    // Then all of it: 253 units, 23.0 counts/s.
    let second = rig.observer.velocity().0.to_bits() - first;
    assert!((1_506_735 - second).abs() < 15_067, "{second}");
}

#[test]
fn rotor_coasts_by_its_friction_alone_and_stays_stopped() {
    let mut rig = Rig::new(&config(), 0);
    rig.observer.state.velocity = law(40 * SPEED);
    rig.observer.state.stuck = false;
    rig.still(3, Push::Off);
    // 47 units · 90.875 counts/s² = 4.27 counts/s a tick, less 4 % of what the EMF damps within a tick.
    let slower = 40 * SPEED - rig.observer.velocity().0.to_bits();
    assert!((3 * 279_908 * 95 / 100..=3 * 279_908).contains(&slower), "{slower}");
    rig.still(20, Push::Off);
    assert_eq!(rig.observer.velocity(), CountsPerSec::ZERO);
    let stopped = rig.observer.exact_position();
    rig.still(20, Push::Off);
    assert_eq!(rig.observer.exact_position(), stopped);
    // v²/(2·4271) = 0.187 counts.
    assert!((180..=200).contains(&stopped.0.to_bits()), "{stopped:?}");
}

/// Where the voltage and the EMF balance.
#[test]
fn steady_motion_leaves_nothing_to_correct() {
    for drive in [200, 241, 400, 700, -241, -700] {
        let speed = steady(drive);
        let mut rig = Rig::turning(drive);
        for _ in 0..3000 {
            rig.run(1, speed, volts(drive));
            let wrong = rig.observer.velocity().0.to_bits() - speed;
            assert!(wrong.abs() <= speed.abs() / 1000, "{drive}: {wrong} of {speed}");
            // 0.003 counts: 1 µs of time-stamp is 0.0007 counts at 674 counts/s.
            assert!(rig.error(speed).abs() < 3146, "{drive}: {}", rig.error(speed));
        }
        let state = &rig.observer.state;
        // A unit, and 0.1 %.
        assert!(state.load.abs() < super::ONE, "{drive}: {}", state.load);
        assert!(state.emf_change.abs() < law(65), "{drive}: {}", state.emf_change);
        assert!(state.gain_change.abs() < law(65), "{drive}: {}", state.gain_change);
    }
}

/// An observer that has moved at `velocity` for `quiet_us` since its last edge and is `ahead` of the boundary at the tick of the edge; and
/// what that edge changes: position, velocity and load.
fn corrected(velocity: i32, quiet_us: i32, ahead: i32, push: Push) -> (Observer, [i32; 3]) {
    let mut rig = Rig::new(&config(), 0);
    rig.still(2, push);
    let sign = velocity.signum();
    let m = &mut rig.observer.state;
    (m.velocity, m.quiet_us, m.moving_us, m.interval_us) = (law(velocity), quiet_us, LONGEST_US, LONGEST_US);
    let at = place(sign * COUNT / 2 + ahead);
    (m.from, m.to, m.stuck, m.load) = (at, at, false, Law::ZERO);
    let way = Way::closing_if(sign > 0);
    rig.observer.edge(&edge(sign, way, rig.now));
    let m = &rig.observer.state;
    let moved = m.to.to_bits() - (ahead - sign * COUNT / 2);
    let changes = [moved, m.velocity.to_bits() - velocity, m.load.to_bits()];
    (rig.observer, changes)
}

/// The gains of the module for an interval and θ, from the tables: of position in 2^-16, of velocity in 2^-16 counts/s for a count, of δ
/// in 2^-16 torque units for a count.
fn gains(model: &Model, interval: i32, keep: i32) -> [i128; 3] {
    let scaled = (u64::from(interval.unsigned_abs()) * u64::from(model.relative_rate)) >> 16;
    let (rate, pull, slowness) = SLOPES[half_octaves(u32::try_from(scaled).unwrap())];
    let [keep, rate, pull, slowness] = [keep, rate, pull, slowness].map(i128::from);
    let one: i128 = 1 << 16;
    let gone = one - keep;
    let per_second = i128::from(model.rate.to_bits());
    let position = one - ((keep * keep * keep) >> 32);
    // 1 + θ/(2(1+y)), where 1/(1+y) = 1 − y/(1+y); 2^-12 · 2^-4 of e/w and 1/τ.
    let velocity = (gone * gone * (2 * one + ((keep * (one - slowness)) >> 16)) * rate * per_second) >> 49;
    // h + (1 − h)·y/(1+y) with h = (1 − θ)/2.
    let lean = (gone >> 1) + (((one - (gone >> 1)) * slowness) >> 16);
    let delta = (((gone * gone * lean) >> 32) * pull * per_second * i128::from(model.emf.to_bits())) >> 32;
    [position, velocity, delta]
}

fn assert_close(found: i32, exact: i128, what: impl core::fmt::Display) {
    // The coarsest factor is that of a load after 150 ms, 93 of its unit.
    assert!((i128::from(found) - exact).abs() <= 2 + exact.abs() / 80, "{what}: {found} instead of {exact}");
}

/// At rest otherwise, so that δ is a load: with n = 0 and v small it takes 40²/(40² + (v/4)²) of it.
#[test]
fn edge_corrects_by_the_gains_of_its_interval() {
    for (quiet_us, velocity) in [(20_000, 60), (50_000, 20), (5000, 200), (150_000, 7)] {
        for ahead in [COUNT / 10, -COUNT / 10, COUNT / 3, -COUNT / 3] {
            // The voltage that keeps this velocity.
            let push = volts(47 + velocity * 3971 / 4096);
            let (observer, changes) = corrected(velocity * SPEED, quiet_us, ahead, push);
            let keep = keep(quiet_us).max(KEEP_LEAST);
            let [position, speed, delta] = gains(&Model::new(&config()), quiet_us, keep);
            let residual = -i128::from(ahead);
            assert_close(
                changes[0],
                (residual * position) >> 16,
                format_args!("position after {quiet_us} us by {ahead}"),
            );
            assert_close(
                changes[1],
                (residual * speed) >> 20,
                format_args!("velocity after {quiet_us} us by {ahead}"),
            );
            let by_speed = i128::from(velocity * velocity / 16);
            let delta = ((residual * delta) >> 20).clamp(-(250 << 16), 250 << 16);
            assert_close(
                changes[2],
                delta * 1600 / (1600 + by_speed),
                format_args!("load after {quiet_us} us by {ahead}"),
            );
            // Too late an edge: slower, held back by a load.
            assert!(changes.iter().all(|change| change.signum() == -ahead.signum()), "{changes:?}");
            assert_eq!(observer.count(), 1);
        }
    }
}

/// At speed the EMF explains it: κ changes by −v·q/16.
#[test]
fn late_edges_at_speed_raise_the_emf() {
    let (observer, [_, _, load]) = corrected(600 * SPEED, 1667, COUNT / 10, volts(47 + 582));
    assert!(observer.state.emf_change > 0, "{}", observer.state.emf_change);
    // d is 40²·q: κ/d = −v/16/40² = −0.0234.
    assert_close(observer.state.emf_change.to_bits(), i128::from(-load) * 600 / 25_600, "EMF");
    assert!(observer.emf() > observer.nominal_emf());
}

/// While it accelerates the gain explains it: β changes by 0.36·n·q, here with n = 500 − 47 − 0.97·20.
#[test]
fn early_edges_in_acceleration_raise_the_gain() {
    let (observer, [_, _, load]) = corrected(20 * SPEED, 20_000, -COUNT / 10, volts(500));
    let net = 500 - 47 - 19;
    assert_close(observer.state.gain_change.to_bits(), i128::from(load) * net * 36 / 160_000, "gain");
    assert!(
        observer.state.gain_change > 0
            && observer.sure_gain() == Observer::new(Model::new(&config()), 0).sure_gain()
    );
    let (weaker, _) = corrected(20 * SPEED, 20_000, COUNT / 10, volts(500));
    assert!(weaker.sure_gain() < observer.sure_gain() && weaker.inertia() > observer.inertia());
}

#[test]
fn first_edge_after_a_rest_has_ten_ms_and_half_a_count_at_most() {
    let [_, speed, delta] = gains(&Model::new(&config()), FIRST_US, 0);
    // From the middle of the cell; from its far end, a whole count; and from near the boundary, an eighth.
    for (at, share) in [(0, 2), (-COUNT / 2, 2), (COUNT * 3 / 8, 8)] {
        for sign in [1, -1] {
            let mut rig = Rig::new(&config(), 0);
            rig.observer.state.to = place(sign * at);
            rig.still(400, volts(0));
            let way = Way::closing_if(sign > 0);
            // In the middle of the tick.
            rig.observer.edge(&edge(sign, way, rig.now.wrapping_add(Micros(500))));
            let m = &rig.observer.state;
            assert_close(m.velocity.to_bits() * sign, speed / share, "velocity");
            assert_close(m.load.to_bits() * sign, (delta / share).min(250 << 16), "load");
            // θ is 0: on the boundary exactly.
            assert_eq!(m.to, place(-sign * COUNT / 2));
        }
    }
}

/// While it should rest, it takes the static friction as well to turn it.
#[test]
fn first_edge_of_a_rotor_that_should_rest_shows_static_friction_as_a_load() {
    let moved = |push| {
        let mut rig = Rig::new(&config(), 0);
        rig.still(400, push);
        rig.observer.edge(&edge(1, Way::Closing, rig.now));
        rig.observer.state.load
    };
    assert_eq!(moved(resting(0)) - moved(volts(0)), Law::from_num(63));
}

#[test]
fn missing_edge_sets_the_position_back_and_slows_down() {
    for sign in [1, -1] {
        let mut rig = Rig::new(&config(), 0);
        rig.still(2, volts(sign * 100));
        let m = &mut rig.observer.state;
        (m.velocity, m.quiet_us, m.moving_us) = (law(sign * 50 * SPEED), 20_000, 20_000);
        m.to = place(sign * (COUNT / 2 + BEYOND));
        let before = rig.observer.state;
        rig.observer.tick(rig.now);
        assert_eq!(rig.observer.state.velocity, before.velocity, "not yet");
        rig.observer.state = State { to: before.to + place(sign * COUNT / 20), ..before };
        rig.observer.tick(rig.now);
        let m = &rig.observer.state;
        assert_eq!(m.to, place(sign * (COUNT / 2 + BEYOND)));
        // Half of what an edge at 22 ms would correct, by 0.05 counts.
        let [_, speed, _] = gains(&Model::new(&config()), 22_000, keep(22_000).max(KEEP_LEAST));
        assert_close((before.velocity - m.velocity).to_bits() * sign, speed / 40, "velocity");
        assert!(m.load * sign < 0, "held back: {}", m.load);
    }
}

/// A rotor that should have left its cell, and has not, is in it still.
#[test]
fn position_of_a_missing_edge_stays_within_its_cell() {
    let mut rig = Rig::new(&config(), 7);
    rig.still(100, volts(300));
    assert_eq!(rig.observer.position().round(), 7);
    assert!(rig.observer.exact_position() > Counts::from_int(7).wrapping_add(Counts(I22F10::ONE / 2)));
}

/// By 16 units each tick, besides what a residual of 2^-20 counts says: rounded down it is one of 2^-16, 0.09 units.
#[test]
fn missing_edge_at_rest_turns_the_load_by_16_units_a_tick() {
    for sign in [1, -1] {
        let mut rig = Rig::new(&config(), 0);
        rig.still(2, resting(0));
        for ms in 1..=10 {
            rig.observer.state.to = place(sign * (COUNT / 2 + BEYOND + 1));
            rig.observer.tick(rig.now);
            let load = rig.observer.load() * sign;
            assert!((load + Law::from_num(16 * ms)).abs() < Law::ONE * ms / 8, "{load} after {ms} ms");
        }
        assert_eq!(rig.observer.state.pinned, sign * 10);
        // Not while it is to move.
        let mut rig = Rig::new(&config(), 0);
        rig.still(2, volts(0));
        rig.observer.state.to = place(sign * (COUNT / 2 + BEYOND + 1));
        rig.observer.tick(rig.now);
        assert!(rig.observer.load().abs() < Law::ONE / 8);
    }
}

/// 1.3 counts since the last edge; twice that from 11 to 150 ms, and after a rest.
#[test]
fn velocity_is_bounded_by_the_time_of_its_missing_edge() {
    for (quiet_ms, moving_ms, most) in [
        // The fastest motor of ±50 % has 1950 counts/s.
        (0, 300, 2600),
        (1, 300, 1300),
        (5, 9, 260),
        (10, 300, 130),
        (11, 300, 236),
        (100, 100, 26),
        (149, 200, 16),
        (150, 150, 8),
        (200, 200, 6),
        (300, 5, 520),
    ] {
        for sign in [1, -1] {
            for push in [resting(0), volts(0)] {
                let mut rig = Rig::new(&config(), 0);
                rig.still(2, push);
                let m = &mut rig.observer.state;
                (m.quiet_us, m.moving_us) = ((quiet_ms - 1) * 1000, (moving_ms - 1) * 1000);
                (m.velocity, m.to) = (law(sign * 4000 * SPEED), place(sign * (COUNT / 2 + BEYOND + 1)));
                rig.observer.tick(rig.now);
                let velocity = rig.observer.velocity();
                assert_eq!(velocity, CountsPerSec(Law::from_num(sign * most)), "{quiet_ms} {moving_ms}");
            }
        }
    }
}

/// 1.3 counts since the last edge, and none after 50 ms.
#[test]
fn sure_velocity_is_that_of_the_time_since_the_last_edge() {
    for (quiet_ms, most) in [(0, 2600), (1, 1300), (10, 130), (50, 26), (51, 0), (300, 0)] {
        for (velocity, expected) in [(4000, most), (-4000, -most), (20, 20.min(most)), (-20, -(20.min(most)))]
        {
            let mut rig = Rig::new(&config(), 0);
            rig.observer.state.quiet_us = quiet_ms * 1000;
            rig.observer.state.velocity = law(velocity * SPEED);
            assert_eq!(rig.observer.sure_velocity(), CountsPerSec(Law::from_num(expected)), "{quiet_ms} ms");
        }
    }
}

/// However long its voltage drives a rotor that stands: a stall, HI and a breakaway depend on its velocity.
#[test]
fn blocked_rotor_is_observed_slower_than_its_missing_edge_allows() {
    for drive in [100, 300, 600, -600] {
        let mut rig = Rig::new(&config(), 0);
        rig.still(200, volts(drive));
        // As a servo reads it, at the beginning of a tick. 1.3 counts in 200 ms: the width of a cell and its margins.
        rig.observer.tick(rig.now);
        let velocity = rig.observer.velocity();
        assert!(velocity.0.abs() <= Law::from_num(7), "{drive}: {velocity:?}");
    }
}

#[test]
fn bounce_restores_the_state_before_its_edge() {
    for sign in [1, -1] {
        let mut rig = Rig::new(&config(), 0);
        let speed = steady(241 * sign);
        rig.run(500, speed, volts(241 * sign));
        rig.still(1, volts(241 * sign));
        let before = rig.observer.state;
        let directions = [Way::Closing, Way::Opening];
        let [there, back] = if sign > 0 { directions } else { [Way::Opening, Way::Closing] };
        let at = |us| rig.now.wrapping_add(Micros(us));
        let (first, second) = (at(300), at(350));
        rig.observer.edge(&edge(before.count + sign, there, first));
        assert_ne!(State { from: Place::ZERO, ..rig.observer.state }, State { from: Place::ZERO, ..before });
        rig.observer.edge(&HallEdge { bounce: true, ..edge(before.count, back, second) });
        // The place within the tick is that of the two edges.
        assert_eq!(State { from: Place::ZERO, ..rig.observer.state }, State { from: Place::ZERO, ..before });
        assert_eq!((rig.observer.low, rig.observer.high), {
            rig.observer.bound();
            (rig.observer.low, rig.observer.high)
        });
    }
}

/// What follows from the learned EMF and gain.
const fn derived(observer: &Observer) -> [i32; 4] {
    let Observer { emf, step, inertia, sure_gain, .. } = observer;
    [emf.to_bits(), step.to_bits(), inertia.to_bits(), sure_gain.to_bits()]
}

/// An edge far from where the model has the rotor changes the gains by more than half.
#[test]
fn bounce_restores_the_gains_of_the_state_before_its_edge() {
    for drive in [900, -900] {
        let sign = i32::signum(drive);
        let mut rig = Rig::turning(drive);
        rig.run(200, steady(drive), volts(drive));
        rig.still(1, volts(drive));
        let (before, gains_before) = (rig.observer.state, derived(&rig.observer));
        let directions = [Way::Closing, Way::Opening];
        let [there, back] = if sign > 0 { directions } else { [Way::Opening, Way::Closing] };
        let count = rig.observer.count();
        let [first, second] = [100, 150].map(|us| rig.now.wrapping_add(Micros(us)));
        rig.observer.edge(&edge(count + 2 * sign, there, first));
        let between = derived(&rig.observer);
        assert_ne!(between, gains_before, "{drive}: {before:?}");
        rig.observer.edge(&HallEdge { bounce: true, ..edge(count, back, second) });
        assert_eq!(derived(&rig.observer), gains_before, "{drive}: {between:?} between");
    }
}

#[test]
fn bounce_after_another_motor_was_described_restores_nothing_of_the_old_one() {
    let mut rig = Rig::turning(900);
    rig.run(200, steady(900) / 2, volts(900));
    let other = Model::new(&Motor { mka: 2000, ..config() });
    rig.observer.set_model(other);
    let bounce = edge(rig.observer.count() - 1, Way::Opening, rig.now.wrapping_add(Micros(150)));
    rig.observer.edge(&HallEdge { bounce: true, ..bounce });
    assert_eq!(derived(&rig.observer), derived(&Observer::new(other, 0)));
}

/// The same run in both directions, with changes of voltage and of speed.
#[test]
fn opening_is_the_mirror_image_of_closing() {
    let (mut one, mut other) = (Rig::new(&config(), 0), Rig::new(&config(), 0));
    for drive in [150, 300, 200, 400, 250, 100] {
        for _ in 0..400 {
            one.run(1, steady(drive), volts(drive));
            other.run(1, -steady(drive), volts(-drive));
            let (v, w) = (one.observer.velocity().0, other.observer.velocity().0);
            // A residual is rounded down to 2^-16 counts, at 2 ms 0.03 counts/s an edge, which the model damps within a few.
            assert!((v + w).abs() < Law::ONE / 8 + (v.abs() >> 10), "{v} {w} at {drive}");
            assert_eq!(one.observer.count(), -other.observer.count());
        }
    }
}

#[test]
fn count_wraps_as_the_position_does() {
    let mut here = Rig::new(&config(), 0);
    let mut wrapping = Observer::new(Model::new(&config()), i32::MAX);
    wrapping.tick(here.now);
    here.observer.tick(here.now);
    for observer in [&mut here.observer, &mut wrapping] {
        observer.predict(volts(300));
        let next = observer.count().wrapping_add(1);
        observer.edge(&edge(next, Way::Closing, here.now.wrapping_add(Micros(500))));
    }
    assert_eq!(wrapping.count(), i32::MIN);
    assert_eq!(wrapping.velocity(), here.observer.velocity());
    assert_eq!(wrapping.state.to, here.observer.state.to);
    // 2^31 counts are 0 in the 22 bits of a position.
    let moved = here.observer.position().wrapping_sub(Counts::from_int(1));
    assert_eq!(wrapping.position(), moved);
}

/// The boundary above each third count is 0.12 counts too high: their mean is 0.04, and that is the rotor's.
#[test]
fn offsets_of_the_boundaries_are_learned_in_steady_motion() {
    let twelve = COUNT * 12 / 100;
    for drive in [241, -241] {
        let mut rig = Rig::new(&config(), 0);
        rig.offsets = [0, twelve, 0, 0, twelve, 0];
        let speed = steady(drive);
        for _ in 0..40 {
            rig.run(100, speed, volts(drive));
        }
        for (at, offset) in rig.observer.offsets.iter().enumerate() {
            let exact = if at % 3 == 1 { 5243 } else { -2621 };
            // 0.01 counts.
            assert!((i32::from(*offset) - exact).abs() < 656, "{at}: {offset} instead of {exact}");
        }
        let wrong = rig.observer.velocity().0.to_bits() - speed;
        assert!(wrong.abs() < speed.abs() / 100, "{wrong} of {speed}");
    }
}

/// Otherwise the position would drift with it.
#[test]
fn mean_of_the_offsets_stays_zero() {
    for drive in [200, 700, -241] {
        let mut rig = Rig::turning(drive);
        rig.offsets = [0, COUNT / 10, 0, 0, 0, 0];
        for _ in 0..50 {
            rig.run(100, steady(drive), volts(drive));
            let sum: i32 = rig.observer.offsets.iter().map(|offset| i32::from(*offset)).sum();
            // A unit of rounding each.
            assert!(sum.abs() <= 6, "{:?}", rig.observer.offsets);
        }
    }
}

#[test]
fn forgotten_load_is_zero() {
    let mut rig = Rig::new(&config(), 0);
    rig.observer.state.load = law(10 * ONE);
    rig.observer.forget_load();
    assert_eq!(rig.observer.load(), Law::ZERO);
}

#[test]
fn another_motor_forgets_what_was_learned_of_the_last() {
    let mut rig = Rig::new(&config(), 0);
    // Slower than the voltage says.
    rig.run(500, steady(700) / 5 * 4, volts(700));
    assert!(rig.observer.emf() > rig.observer.nominal_emf());
    rig.observer.set_model(Model::new(&Motor { mke: 3000, ..config() }));
    assert_eq!(rig.observer.emf(), Law::from_bits(3000 << 4));
    assert_eq!((rig.observer.state.emf_change, rig.observer.state.gain_change), (Law::ZERO, Law::ZERO));
    let fresh = Observer::new(Model::new(&Motor { mke: 3000, ..config() }), 0);
    assert_eq!((rig.observer.step, rig.observer.inertia), (fresh.step, fresh.inertia));
}

#[test]
fn open_bridge_clears_the_load_and_a_closed_one_again() {
    let mut rig = Rig::new(&config(), 0);
    for (push, kept) in
        [(volts(0), false), (resting(10), true), (Push::Off, false), (Push::Off, true), (volts(0), false)]
    {
        rig.observer.state.load = law(10 * ONE);
        rig.still(1, push);
        let expected = if kept { Law::from_num(10) } else { Law::ZERO };
        assert_eq!(rig.observer.load(), expected, "{push:?}");
    }
}

/// 1/B in torque units for a count/s in a tick: 1000·16/1454 = 11.0.
#[test]
fn inertia_and_sure_gain_are_those_of_mka() {
    let observer = Observer::new(Model::new(&config()), 0);
    assert_close(observer.inertia().to_bits(), 16_000 * 65_536 / 1454, "inertia");
    // 1454/16 · 10^-6 counts a tick², in 2^-26.
    assert_close(observer.sure_gain(), 1454 * (1 << 26) / 16_000_000, "sure gain");
    assert_eq!((observer.emf(), observer.friction()), (Law::from_bits(3971 << 4), Law::from_num(47)));
}

#[test]
fn quiet_is_the_time_since_the_last_edge_up_to_300_ms() {
    let mut rig = Rig::new(&config(), 0);
    rig.still(1, volts(0));
    assert_eq!(rig.observer.quiet(), Micros(300_000));
    rig.observer.edge(&edge(1, Way::Closing, rig.now.wrapping_add(Micros(400))));
    rig.still(10, volts(0));
    assert_eq!(rig.observer.quiet(), Micros(9600));
    rig.still(300, volts(0));
    assert_eq!(rig.observer.quiet(), Micros(300_000));
}

fn any_push() -> impl Strategy<Value = Push> {
    prop_oneof![
        Just(Push::Off),
        // 65.5 V, the most that a bus voltage can say, are 2703 units.
        (-2703..=2703_i32, any::<bool>()).prop_map(|(volts, resting)| Push::Volts { volts, resting }),
    ]
}

#[derive(Clone, Debug)]
enum Input {
    Ticks(Push, u32),
    Edge(HallEdge),
}

fn any_input() -> impl Strategy<Value = Input> {
    let edges = (
        any::<i32>(),
        -3..=3_i32,
        any::<u8>(),
        any::<bool>(),
        prop_oneof![0..3000_u32, any::<u32>()],
        0..8_u8,
    );
    prop_oneof![
        (any_push(), prop_oneof![1..5_u32, 1..400_u32]).prop_map(|(push, ms)| Input::Ticks(push, ms)),
        edges.prop_map(|(far, near, steps, closing, at, kind)| {
            let way = Way::closing_if(closing);
            let count = if kind & 1 == 0 { near } else { far };
            let steps = if kind & 2 == 0 { 1 } else { steps };
            let edge = edge(count, way, Micros(at));
            Input::Edge(HallEdge { steps, bounce: kind & 4 != 0, ..edge })
        }),
    ]
}

/// What fits the board.
fn any_motor() -> impl Strategy<Value = Motor> {
    motor::tests::any_fitting()
}

fn assert_bounded(observer: &Observer) {
    let m = &observer.state;
    assert!(m.velocity.abs() < law(1 << 30), "{}", m.velocity);
    assert!(m.load.abs() <= law(900 << 16), "{}", m.load);
    // 46 % of K, and −0.5..=0.9 in 2^-16.
    assert!(m.emf_change.abs() <= observer.model.emf * 47 / 100, "{}", m.emf_change);
    assert!((-32_768..=58_982).contains(&m.gain_change.to_bits()), "{}", m.gain_change);
    assert!((0..=300_000).contains(&observer.quiet().0));
    let _ =
        (observer.position(), observer.exact_position(), observer.coming_velocity(), observer.sure_gain());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// Wherever edges come from and whenever: an offset from the last tick, or any time.
    #[test]
    fn any_input_is_taken_within_the_bounds(
        config in any_motor(), count: i32, inputs in prop::collection::vec(any_input(), 1..60), other in any_motor(),
    ) {
        let mut rig = Rig::new(&config, count);
        let half = inputs.len() / 2;
        for (at, input) in inputs.into_iter().enumerate() {
            if at == half {
                rig.observer.set_model(Model::new(&other));
            }
            match input {
                Input::Ticks(push, ms) => (0..ms).for_each(|_| {
                    rig.still(1, push);
                    assert_bounded(&rig.observer);
                }),
                Input::Edge(edge) => {
                    let count = rig.observer.count().wrapping_add(edge.count);
                    rig.observer.edge(&HallEdge { count, at: rig.now.wrapping_add(edge.at), ..edge });
                    assert_bounded(&rig.observer);
                }
            }
        }
    }
}

/// A stop that has pushed back hard is gone at once: the gain alone would take it, up to its bound.
#[test]
fn load_takes_what_gain_and_emf_cannot() {
    let load_after = |gain, emf| {
        let mut observer = Observer::new(Model::new(&config()), 0);
        observer.mean_volts = law(-241 << 16);
        observer.state = State {
            velocity: law(-100 * SPEED),
            load: law(-700 << 16),
            gain_change: gain,
            emf_change: emf,
            ..observer.state
        };
        observer.correct(HALF, 10_000, super::KEEP_LEAST, false);
        (observer.state.load.to_bits() >> 16) + 700
    };
    let (free, bound) = (load_after(Law::ZERO, Law::ZERO), load_after(GAIN_CHANGE.0, Law::ZERO));
    assert!(free < 5 && bound > 30, "{free} {bound}");
}

#[test]
fn load_along_an_ended_motion_is_friction_at_most_as_much_as_the_motor_has() {
    let friction = i32::from(config().mfc);
    for (closing, load, left) in
        [(true, 30, 0), (true, 300, 300 - friction), (true, -300, -300), (false, -20, 0), (false, 20, 20)]
    {
        let mut observer = Observer::new(Model::new(&config()), 0);
        observer.state.load = law(load << 16);
        observer.end_motion(Way::closing_if(closing));
        assert_eq!(observer.load(), Law::from_num(left), "{closing} {load}");
    }
}

#[test]
fn search_for_a_load_narrows_as_it_turns_round_and_widens_as_it_goes_on() {
    let mut search = Search::NONE;
    let narrowing = [1, -1, 1, -1, 1, -1].map(|sign| search.step(sign, law(64)).to_bits());
    assert_eq!(narrowing, [64, -32, 16, -8, 4, -4]);
    for step in [-4, -8, -16, -32, -64] {
        // Its first step was that of the last turn.
        for _ in u32::from(step == -4)..WIDENS_MS {
            assert_eq!(search.step(-1, law(64)), law(step));
        }
    }
    assert_eq!(search.step(-1, law(64)), law(-64));
}

/// A load that friction nearly holds takes the rotor to and fro over a boundary, each time by less.
#[test]
fn edges_to_and_fro_at_rest_change_the_load_less_and_less() {
    let mut rig = Rig::new(&config(), 0);
    let mut last = Law::MAX;
    for count in [1, 0, 1, 0] {
        rig.still(60, resting(0));
        let before = rig.observer.state.load;
        let way = Way::closing_if(count == 1);
        rig.observer.state.velocity = Law::ZERO;
        rig.observer.edge(&edge(count, way, rig.now));
        let change = (rig.observer.state.load - before).abs();
        assert!(change < last && change > Law::ZERO, "{change} after {last}");
        last = change;
        rig.observer.state.velocity = Law::ZERO;
    }
    rig.still(2, volts(0));
    assert_eq!(rig.observer.state.search, Search::NONE, "forgotten in a motion");
}
