//! Full resolution; `tests/profile.rs` checks a million moves against an oracle.

use super::*;
use proptest::prelude::*;

const fn limits(accel: u16, cruise: i16) -> MoveLimits {
    MoveLimits { accel, closing: CountsPerSec::from_int(cruise), opening: CountsPerSec::from_int(cruise) }
}

fn moving(start: i32, end: i32, limits: MoveLimits, ticks: u32) -> Profile {
    let mut profile = Profile::at_rest(Counts::from_int(start));
    profile.set_end(Counts::from_int(end));
    for _ in 0..ticks {
        profile.step(&limits.build(), Reach::FREE);
    }
    profile
}

/// Ticks to the end, if that comes.
fn land(profile: &mut Profile, limits: MoveLimits, most: u32) -> Option<u32> {
    (1..=most).find(|_| profile.step(&limits.build(), Reach::FREE).done)
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
    any::<i32>().prop_map(|bits| Counts(I22F10::from_bits(bits)))
}

/// Accelerations from far below ACCEL 1 (64) to all.
fn any_reach() -> impl Strategy<Value = Reach> {
    (0..25_u32, 0..25_u32).prop_map(|(up, down)| Reach { up: MOST >> up, down: MOST >> down })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(5000))]

    /// Changes of the velocity, its bounds, and the way, which is exactly the mean of two velocities except where the set-point lands.
    #[test]
    fn limits_hold_to_the_last_bit(
        distance in -2000..2000_i32,
        first in any_limits(),
        ticks in 0..400_u32,
        end in -2000..2000_i32,
        second in any_limits(),
    ) {
        let mut profile = moving(0, distance, first, ticks);
        profile.set_end(Counts::from_int(end));
        let ramps = second.build();
        // The deceleration that ends at the end is rounded up within 1/1024.
        let a = i64::from(ramps.accel) + i64::from(ramps.accel / 1024) + 1;
        for _ in 0..1000 {
            let (left, u) = (profile.left, i64::from(profile.velocity));
            profile.step(&ramps, Reach::FREE);
            let v = i64::from(profile.velocity);
            prop_assert!((v - u).abs() <= a, "{u} {v} {a}");
            let cruise = i64::from(if v > 0 { ramps.closing } else { ramps.opening });
            prop_assert!(v.abs() <= cruise.max(u.abs() - i64::from(ramps.accel)), "{u} {v}");
            if profile.left == 0 && v == 0 {
                prop_assert!(left.abs() <= a + u.abs() + RESOLUTION, "lands from {left} at {u}");
            } else {
                prop_assert_eq!(left - profile.left, u + v);
            }
        }
    }

    #[test]
    fn mirrored_move_is_the_mirror_image(
        distance in -2000..2000_i32, ticks in 0..400_u32, end in -2000..2000_i32, limits in any_limits(), reach in any_reach(),
    ) {
        let limits = MoveLimits { opening: limits.closing, ..limits };
        let mut one = moving(0, distance, limits, ticks);
        let mut other = moving(0, -distance, limits, ticks);
        one.set_end(Counts::from_int(end));
        other.set_end(Counts::from_int(-end));
        for _ in 0..500 {
            one.step(&limits.build(), reach);
            other.step(&limits.build(), reach);
            prop_assert_eq!((one.left, one.velocity), (-other.left, -other.velocity));
        }
    }

    #[test]
    fn any_input_is_taken(
        start in any_counts(),
        plans in prop::collection::vec(
            (any_counts(), any::<u16>(), any::<i32>(), any::<i32>(), any_reach(), 0..300_u32), 1..6,
        ),
        rotor in (any_counts(), -0x3FFF_FFFF..=0x3FFF_FFFF_i32),
    ) {
        let mut profile = Profile::at_rest(start);
        for (end, accel, closing, opening, reach, ticks) in plans {
            let speed = |bits| CountsPerSec(Law::from_bits(bits));
            profile.set_end(end);
            let limits = MoveLimits { accel, closing: speed(closing), opening: speed(opening) };
            for _ in 0..ticks {
                let velocity = profile.step(&limits.build(), reach).velocity;
                prop_assert!(velocity <= FASTEST && velocity >= CountsPerSec(-FASTEST.0));
            }
        }
        // The observer's velocity stays below 2^30.
        profile.follow(&limits(512, 4080).build(), rotor.0, CountsPerSec(Law::from_bits(rotor.1)));
        for _ in 0..300 {
            profile.step(&limits(512, 4080).build(), Reach::FREE);
        }
    }

    /// Each step changes the velocity by no more than the motor can; to slow down, by an eighth more than it could at the outset.
    #[test]
    fn reach_limits_both_accelerations(
        distance in -2000..2000_i32, cruise in 16..=4080_i16, reach in any_reach(), ticks in 0..300_u32,
    ) {
        let limits = limits(512, cruise);
        let mut profile = moving(0, distance, limits, ticks);
        profile.set_end(Counts::from_int(-distance));
        for _ in 0..300 {
            let u = profile.velocity;
            profile.step(&limits.build(), reach);
            let v = profile.velocity;
            let same_side = (u ^ v) >= 0;
            let faster = if same_side { v.abs() - u.abs() } else { v.abs() };
            let slower = if same_side { u.abs() - v.abs() } else { u.abs() };
            // Landing takes off less than a tick's braking more; one unit of the last way is always possible.
            prop_assert!(faster <= reach.up.max(1), "{u} {v} {reach:?}");
            prop_assert!(slower <= reach.down + reach.down / 8 + 1, "{u} {v} {reach:?}");
        }
    }
}

#[test]
fn cruise_velocity_out_of_range_is_clamped() {
    for (asked, used) in [(0, 16), (-100, 16), (15, 16), (16, 16), (4080, 4080), (4081, 4080), (32767, 4080)]
    {
        let velocity = moving(0, 1000, limits(65535, asked), 100).current().velocity;
        // 2^-26 counts a tick are 2^-16 counts/s and less, rounded down twice.
        let low = CountsPerSec::from_int(used).0.to_bits() - velocity.0.to_bits();
        assert!((0..=2).contains(&low), "{asked}: {velocity:?}");
    }
}

#[test]
fn directions_have_separate_cruise_velocities() {
    let limits = MoveLimits { opening: CountsPerSec::from_int(300), ..limits(1000, 200) };
    assert_eq!(moving(0, 1000, limits, 100).current().velocity.round(), 200);
    assert_eq!(moving(0, -1000, limits, 100).current().velocity.round(), -300);
}

/// 4095/1024 squared is 16 counts a tick²; a quarter is the most: 250 counts/s a tick.
#[test]
fn accel_beyond_512_counts_as_512() {
    for accel in [512, 513, 65535] {
        let setpoint = moving(0, 1000, limits(accel, 4080), 1).current();
        assert_eq!((setpoint.velocity.round(), setpoint.position), (250, Counts(I22F10::ONE / 8)), "{accel}");
    }
}

/// ACCEL 32 is 2^-10 counts a tick², 0.977 counts/s a tick.
#[test]
fn set_point_reports_the_change_of_its_velocity() {
    let ramps = limits(32, 1000).build();
    let mut profile = moving(0, 100, limits(32, 1000), 10);
    let before = profile.current();
    assert_eq!(before.change, Law::ZERO);
    let after = profile.step(&ramps, Reach::FREE);
    assert_eq!(after.change, Law::from_num(1000) / 1024);
    assert_eq!(after.change, after.velocity.0 - before.velocity.0);
    let mut braking = moving(0, -100, limits(32, 1000), 500);
    let before = braking.current();
    let after = braking.step(&ramps, Reach::FREE);
    assert!(
        after.change > Law::ZERO
            && (after.change - (after.velocity.0 - before.velocity.0)).abs() <= Law::DELTA
    );
}

#[test]
fn move_to_the_present_position_is_done() {
    let mut profile = moving(5, 5, limits(30, 1000), 0);
    assert!(profile.current().done);
    assert_eq!(profile.step(&limits(30, 1000).build(), Reach::FREE), profile.current());
    assert_eq!((profile.current().position, profile.ticks()), (Counts::from_int(5), 0));
}

#[test]
fn accel_zero_at_rest_stays_and_is_done_only_at_its_end() {
    let mut profile = moving(0, 100, limits(0, 1000), 1000);
    let still = SetPoint { done: false, ..SetPoint::at_rest(Counts::ZERO) };
    assert_eq!((profile.current(), profile.ticks()), (still, 0));
    profile.set_end(Counts::ZERO);
    assert!(profile.current().done, "there already");
    profile.set_end(Counts::from_int(100));
    assert!(land(&mut profile, limits(30, 1000), 1000).is_some());
}

#[test]
fn accel_zero_at_rest_forgets_the_accel_of_the_last_move() {
    let mut profile = moving(0, 10, limits(1000, 1000), 100);
    assert!(profile.current().done);
    profile.set_end(Counts::ZERO);
    let setpoint = profile.step(&limits(0, 1000).build(), Reach::FREE);
    assert_eq!((setpoint.position, setpoint.done), (Counts::from_int(10), false));
}

#[test]
fn accel_zero_in_mid_move_keeps_the_last_accel() {
    let (mut zero, mut old) = (moving(0, 100, limits(30, 1000), 200), moving(0, 100, limits(30, 1000), 200));
    for profile in [&mut zero, &mut old] {
        profile.set_end(Counts::from_int(50));
    }
    for _ in 0..1000 {
        let with_old = old.step(&limits(30, 1000).build(), Reach::FREE);
        assert_eq!(zero.step(&limits(0, 1000).build(), Reach::FREE), with_old);
    }
    assert!(zero.current().done);
}

/// ACCEL 32 is 2^-10 counts a tick²: 1024 ticks and 512 counts to 1 count a tick, 976 ticks of cruise, braking from tick 2000 to 3024,
/// and up to six ticks for choosing each tick (`tests/profile.rs`).
#[test]
fn same_end_while_braking_changes_nothing() {
    for end in [2000, -2000] {
        let limits = limits(32, 1000);
        let mut again = moving(0, end, limits, 2500);
        let mut once = again;
        again.set_end(Counts::from_int(end));
        assert_eq!((again.ticks(), once.ticks()), (0, 2500));
        let landed = land(&mut once, limits, 1000);
        assert!(landed.is_some_and(|ticks| (523..=530).contains(&ticks)), "{landed:?}");
        assert_eq!(land(&mut again, limits, 1000), landed);
    }
}

/// At tick 2500 there are 0.512 counts a tick and 134 counts left; to one further away it speeds up again.
#[test]
fn new_end_while_braking_is_reached_without_a_step() {
    for end in [2400, 2000, 1900, 1000, -1000] {
        let limits = limits(32, 1000);
        let mut profile = moving(0, 2000, limits, 2500);
        let before = profile.current();
        profile.set_end(Counts::from_int(end));
        let after = profile.current();
        assert_eq!((after.position, after.velocity), (before.position, before.velocity), "{end}");
        assert!(land(&mut profile, limits, 10_000).is_some(), "{end}");
        assert_eq!(profile.current(), SetPoint::at_rest(Counts::from_int(end)));
    }
}

/// From 0.512 counts a tick it stops within 134 counts, 124 beyond an end that is 10 away.
#[test]
fn end_that_comes_too_near_is_passed_and_returned_to() {
    for sign in [1, -1] {
        let limits = limits(32, 1000);
        let mut profile = moving(0, sign * 2000, limits, 2500);
        let end = (profile.current().position.round() * sign + 10) * sign;
        profile.set_end(Counts::from_int(end));
        let mut farthest = 0;
        let landed = (1..5000).find(|_| {
            let setpoint = profile.step(&limits.build(), Reach::FREE);
            farthest = farthest.max((setpoint.position.round() - end) * sign);
            setpoint.done
        });
        assert!(landed.is_some(), "{end}");
        assert_eq!(profile.current(), SetPoint::at_rest(Counts::from_int(end)));
        assert!((122..=126).contains(&farthest), "{farthest}");
    }
}

#[test]
fn set_point_on_its_end_at_speed_is_not_done() {
    let mut passing = moving(0, 100, limits(30, 1000), 100);
    let here = passing.current().position;
    passing.set_end(here);
    assert!(!passing.current().done, "it cannot stop there");
    assert!(land(&mut passing, limits(30, 1000), 1000).is_some_and(|ticks| ticks > 100), "it returns");
    assert_eq!(passing.current().position, here);
}

/// ACCEL 512 would take 8 ticks to 2000 counts/s; 2^-8 counts a tick² takes 512, and 512 counts.
#[test]
fn reach_sets_the_time_to_speed_and_the_way_to_stop() {
    let ramps = limits(512, 2000).build();
    let slow = MOST >> 6;
    let mut profile = moving(0, 10_000, limits(512, 2000), 0);
    let up = Reach { up: slow, down: MOST };
    let ticks = (1..1000).find(|_| profile.step(&ramps, up).velocity.round() == 2000);
    assert_eq!((ticks, profile.current().position.round()), (Some(512), 512));
    // It begins to slow down 512 counts before its end, and takes 512 ticks and up to six.
    let down = Reach { up: MOST, down: slow };
    let begins = (1..10_000).find(|_| profile.step(&ramps, down).velocity.round() < 1990);
    assert!(begins.is_some());
    let way = 10_000 - profile.current().position.round();
    assert!((500..=512).contains(&way), "{way}");
    let ticks = (1..1000).find(|_| profile.step(&ramps, down).done);
    assert!(ticks.is_some_and(|ticks| (505..=518).contains(&ticks)), "{ticks:?}");
}

/// A motor without torque to spare neither speeds up nor moves a set-point at rest, but still stops one that moves.
#[test]
fn set_point_without_reach_waits() {
    let none = Reach { up: 0, down: MOST };
    let ramps = limits(512, 1000).build();
    let mut profile = moving(0, 100, limits(512, 1000), 0);
    for _ in 0..100 {
        assert_eq!(profile.step(&ramps, none).position, Counts::ZERO);
    }
    assert!(!profile.current().done);
    profile.step(&ramps, Reach::FREE);
    let velocity = profile.current().velocity;
    assert_eq!(profile.step(&ramps, none).velocity, velocity);
}

#[test]
fn set_point_follows_the_rotor_until_it_is_done() {
    let mut profile = moving(0, 100, limits(30, 1000), 200);
    let (position, velocity) = (Counts::from_int(40), CountsPerSec::from_int(-125));
    let ramps = limits(30, 1000).build();
    let setpoint = profile.follow(&ramps, position, velocity);
    assert_eq!((setpoint.position, setpoint.done), (position, false));
    // −125 counts/s are −2^23 in 2^-26 counts a tick; each conversion rounds down.
    assert!((0..=2).contains(&(velocity.0.to_bits() - setpoint.velocity.0.to_bits())), "{setpoint:?}");
    assert_eq!(profile.current(), setpoint);
    assert!(land(&mut profile, limits(30, 1000), 2000).is_some());
    assert_eq!(profile.current(), SetPoint::at_rest(Counts::from_int(100)));
    assert_eq!(profile.follow(&ramps, position, velocity), SetPoint::at_rest(Counts::from_int(100)));
}

/// A new MV may be slower than its rotor.
#[test]
fn set_point_that_follows_is_no_faster_than_its_limits() {
    let slow =
        MoveLimits { accel: 30, closing: CountsPerSec::from_int(90), opening: CountsPerSec::from_int(60) };
    for (velocity, most) in [(1125, 90), (-1125, -60), (89, 89), (-59, -59)] {
        let mut profile = moving(0, 100, limits(30, 1000), 200);
        let setpoint = profile.follow(&slow.build(), Counts::from_int(40), CountsPerSec::from_int(velocity));
        let error = setpoint.velocity.0 - CountsPerSec::from_int(most).0;
        assert!(error.abs() <= Law::from_bits(1 << 6), "{velocity}: {setpoint:?}");
    }
}

#[test]
fn end_beyond_the_wrap_is_reached_the_short_way() {
    let (start, end) = ((1 << 21) - 5, -(1 << 21) + 5);
    let mut profile = moving(start, end, limits(30, 1000), 1);
    assert!(profile.current().velocity > CountsPerSec::ZERO);
    let ticks = land(&mut profile, limits(30, 1000), 300);
    // 2·√10·1024/30 = 216 ticks.
    assert!(ticks.is_some_and(|ticks| (214..=222).contains(&ticks)), "{ticks:?}");
    assert_eq!(profile.current().position, Counts::from_int(end));
}
