//! Full resolution; the system tests check seconds and counts.

use super::*;
use proptest::prelude::*;

const fn limits(accel: u16, cruise: i16) -> MoveLimits {
    MoveLimits { accel, closing: CountsPerSec::from_int(cruise), opening: CountsPerSec::from_int(cruise) }
}

fn moving(start: i32, end: i32, limits: MoveLimits, ticks: u32) -> Profile {
    let mut profile = Profile::at_rest(Counts::from_int(start));
    profile.plan(Counts::from_int(end), &limits.build());
    for _ in 0..ticks {
        profile.step();
    }
    profile
}

fn land(profile: &mut Profile, most: u32) -> Option<u32> {
    (1..=most).find(|_| profile.step().done)
}

fn any_limits() -> impl Strategy<Value = MoveLimits> {
    // Uniform over the number of bits.
    (0..16_u32, 1..=u16::MAX, 16..=4080_i16, 16..=4080_i16).prop_map(|(shift, accel, closing, opening)| {
        MoveLimits {
            accel: (accel >> shift).max(1),
            closing: CountsPerSec::from_int(closing),
            opening: CountsPerSec::from_int(opening),
        }
    })
}

fn any_counts() -> impl Strategy<Value = Counts> {
    any::<i32>().prop_map(|bits| Counts(fixed::types::I22F10::from_bits(bits)))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    /// Except for the rounding where a segment begins (see the module), also after a new plan in mid-move.
    #[test]
    fn limits_hold_to_the_last_bits(
        distance in -2000..2000_i32,
        first in any_limits(),
        ticks in 0..400_u32,
        end in -2000..2000_i32,
        second in any_limits(),
    ) {
        let mut profile = moving(0, distance, first, ticks);
        profile.plan(Counts::from_int(end), &second.build());
        let a = i64::from(second.accel).pow(2) << 12;
        for _ in 0..1000 {
            let (p, u) = profile.exact();
            profile.step();
            let (q, v) = profile.exact();
            let change = v.to_bits() - u.to_bits();
            prop_assert!(change.abs() <= a + 8, "{change} > {a}");
            let cruise = |up: bool| if up { second.closing } else { second.opening };
            let fastest = cruise(v > 0).to_wide_per_tick().get().cast_signed();
            prop_assert!(v.to_bits().abs() <= fastest.max(u.to_bits().abs() - a + 8));
            // Twice the distance less that of a straight line of velocity: at most a/2.
            let bend = 2 * (q.to_bits() - p.to_bits()) - u.to_bits() - v.to_bits();
            let braking_ticks = u.to_bits().abs() / a + 1;
            prop_assert!(bend.abs() <= a / 2 + 2 * (64 + braking_ticks), "{bend} {a}");
        }
    }

    #[test]
    fn mirrored_move_is_the_mirror_image(
        distance in -2000..2000_i32, ticks in 0..400_u32, end in -2000..2000_i32, limits in any_limits(),
    ) {
        let limits = MoveLimits { opening: limits.closing, ..limits };
        let mut one = moving(0, distance, limits, ticks);
        let mut other = moving(0, -distance, limits, ticks);
        one.plan(Counts::from_int(end), &limits.build());
        other.plan(Counts::from_int(-end), &limits.build());
        for _ in 0..500 {
            one.step();
            other.step();
            let ((p, v), (q, w)) = (one.exact(), other.exact());
            prop_assert_eq!((p, v), (-q, -w));
        }
    }

    #[test]
    fn any_input_is_taken(
        start in any_counts(),
        plans in prop::collection::vec((any_counts(), any::<u16>(), any::<i32>(), any::<i32>(), 0..300_u32), 1..6),
    ) {
        let mut profile = Profile::at_rest(start);
        for (end, accel, closing, opening, ticks) in plans {
            let speed = |bits| CountsPerSec(fixed::types::I16F16::from_bits(bits));
            profile.plan(end, &MoveLimits { accel, closing: speed(closing), opening: speed(opening) }.build());
            for _ in 0..ticks {
                let velocity = profile.step().velocity;
                prop_assert!(velocity <= FASTEST && velocity >= CountsPerSec(-FASTEST.0));
            }
        }
    }
}

#[test]
fn cruise_velocity_out_of_range_is_clamped() {
    for (asked, used) in [(0, 16), (-100, 16), (15, 16), (16, 16), (4080, 4080), (4081, 4080), (32767, 4080)]
    {
        let profile = moving(0, 1000, limits(65535, asked), 100);
        assert_eq!(profile.current().velocity, CountsPerSec::from_int(used));
    }
}

#[test]
fn directions_have_separate_cruise_velocities() {
    let limits = MoveLimits { opening: CountsPerSec::from_int(300), ..limits(1000, 200) };
    assert_eq!(moving(0, 1000, limits, 100).current().velocity, CountsPerSec::from_int(200));
    assert_eq!(moving(0, -1000, limits, 100).current().velocity, CountsPerSec::from_int(-300));
}

#[test]
fn move_to_the_present_position_is_done() {
    let mut profile = moving(5, 5, limits(30, 1000), 0);
    assert!(profile.current().done);
    assert_eq!(profile.step(), profile.current());
    assert_eq!(profile.current().position, Counts::from_int(5));
}

#[test]
fn accel_zero_at_rest_stays_there_and_never_ends() {
    let mut profile = moving(0, 100, limits(0, 1000), 1000);
    assert_eq!(profile.exact(), (Wide::ZERO, Wide::ZERO));
    assert!(!profile.current().done);
    profile.plan(Counts::from_int(100), &limits(30, 1000).build());
    assert!(land(&mut profile, 1000).is_some());
}

#[test]
fn accel_zero_at_rest_forgets_the_accel_of_the_last_move() {
    let mut profile = moving(0, 10, limits(1000, 1000), 100);
    assert!(profile.current().done);
    profile.plan(Counts::ZERO, &limits(0, 1000).build());
    assert_eq!(profile.step().position, Counts::from_int(10));
    assert!(!profile.current().done);
}

/// ACCEL 32 is 2^-10 counts/ms²: 1024 ticks and 512 counts to 1 count/ms, 976 ticks of cruise, braking from tick 2000 to
/// 3024, all without rounding.
#[test]
fn repeated_plan_while_braking_changes_nothing() {
    for end in [2000, -2000] {
        let mut again = moving(0, end, limits(32, 1000), 2500);
        let mut once = again;
        again.plan(Counts::from_int(end), &limits(32, 1000).build());
        assert_eq!(land(&mut again, 1000), Some(524));
        assert_eq!(land(&mut once, 1000), Some(524));
    }
}

#[test]
fn accel_zero_in_mid_move_keeps_the_old_accel() {
    let (mut zero, mut old) = (moving(0, 100, limits(30, 1000), 200), moving(0, 100, limits(30, 1000), 200));
    zero.plan(Counts::from_int(50), &limits(0, 1000).build());
    old.plan(Counts::from_int(50), &limits(30, 1000).build());
    for _ in 0..1000 {
        assert_eq!(zero.step(), old.step());
    }
    assert!(zero.current().done);
}

/// 8000 ticks at 4.08 counts a tick, then ACCEL 1: 4.08²·2^19 = 8,727,507.8 counts to stop, beyond what `Counts` holds,
/// and back again.
#[test]
fn longest_overshoot_returns_exactly() {
    let mut profile = moving(0, 32767, limits(65535, 4080), 8000);
    profile.plan(Counts::from_int(32767), &limits(1, 4080).build());
    // 4.08·2^20 = 4,278,190 ticks to stop, and a triangle of √2 times that to come back.
    let mut farthest = Wide::ZERO;
    let landed = (0..5 * 4_278_190 / 2).any(|_| {
        let done = profile.step().done;
        farthest = farthest.max(profile.exact().0);
        done
    });
    assert!(landed);
    assert_eq!(profile.current().position, Counts::from_int(32767));
    // 32,640 + 8,727,507.76; the ramp up at ACCEL 65535 took 0.002 of the first.
    assert_eq!(farthest.to_num::<i64>(), 8_760_147);
}

/// ACCEL 65535 is 4096 counts/ms²: full speed within the first tick, and the same at the end.
#[test]
fn highest_accel_is_a_velocity_step() {
    let mut profile = moving(0, 10, limits(65535, 4000), 0);
    let velocities = [0; 3].map(|_| profile.step().velocity);
    assert_eq!(velocities, [4000, 4000, 0].map(CountsPerSec::from_int));
    assert!(profile.current().done, "10 counts at 4 counts/ms: 2.5 ms and 1 µs for each ramp");
}

#[test]
fn set_point_is_done_only_at_its_end() {
    let mut still = moving(5, 5, limits(30, 1000), 0);
    assert!(still.current().done, "it is there already");
    assert!(still.step().done && still.ticks() == 0);
    let stuck = moving(5, 6, limits(0, 1000), 0);
    assert!(!stuck.current().done, "ACCEL 0 never moves");
    // On the way, where it happens to be.
    let mut passing = moving(0, 100, limits(30, 1000), 100);
    let here = passing.current().position;
    passing.plan(here, &limits(30, 1000).build());
    assert!(!passing.current().done, "it cannot stop there");
    assert!(land(&mut passing, 1000).is_some_and(|ticks| ticks > 100), "it overshoots and returns");
    assert_eq!(passing.current().position, here);
}
