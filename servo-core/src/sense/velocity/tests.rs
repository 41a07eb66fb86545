mod reference;

use super::*;
use crate::sense::hall::Direction;
use proptest::prelude::*;

/// Edges at the given times, alternately falling and rising.
fn feed<const N: usize>(
    e: &mut Estimator<N>,
    count: &mut i32,
    sign: i32,
    times: impl IntoIterator<Item = u32>,
) {
    let direction = if sign > 0 { Direction::Closing } else { Direction::Opening };
    for at in times {
        *count += sign;
        let boundary = if sign > 0 { *count } else { *count + 1 };
        let rising = (boundary & 1 == 1) == (sign > 0);
        e.edge(&HallEdge {
            count: *count,
            steps: 1,
            direction,
            at: Micros(at),
            rising,
            bounce: false,
            uncertain: false,
        });
    }
}

fn velocity<const N: usize>(e: &mut Estimator<N>, at: u32) -> i32 {
    i32::from(e.at(Micros(at)).1.round())
}

#[test]
fn even_speed_is_exact_across_the_wrap_of_the_clock() {
    for (sign, begin) in [(1, 0_u32), (-1, 0), (1, u32::MAX - 50_000), (-1, u32::MAX - 50_000)] {
        let (mut e, mut count) = (Estimator::<18>::new(3), 3);
        let times = (0..100).map(|k| begin.wrapping_add(k * 2000));
        feed(&mut e, &mut count, sign, times);
        let last = begin.wrapping_add(99 * 2000);
        // A time before the last edge is not an hour after it.
        assert!((velocity(&mut e, last.wrapping_sub(100)) - 500 * sign).abs() <= 1);
        for later in [0, 500, 1000, 1900] {
            let (p, v) = e.at(Micros(last.wrapping_add(later)));
            assert!((i32::from(v.round()) - 500 * sign).abs() <= 1, "{v:?}");
            // 1/1024 count, from the boundary just crossed, at 500 counts/s.
            let want = (count * 1024) - sign * 512 + sign * i32::try_from(later).unwrap() * 512 / 1000;
            assert!((p.0.to_bits() - want).abs() <= 8, "{p:?} after {later}: {want}");
        }
    }
}

#[test]
fn placement_and_rise_delay_are_learned() {
    // Boundaries displaced by up to ±0.16 count, rising edges 150 µs late, at 400, 700 and 250 counts/s in turn. Rising and
    // falling ones have the same mean: the filter separates a difference from a delay only slowly.
    const PLACE: [i32; 18] = [40, -80, 30, 10, -60, 90, -160, 30, 70, -20, 110, -90, -50, 60, 0, -30, 20, 30];
    let (mut e, mut count) = (Estimator::<18>::new(0), 0_i32);
    let mut begin = 0_u32;
    let mut worst = 0;
    for turn in 0..60 {
        let us_a_count = [2500_i32, 1430, 4000][turn % 3];
        for k in 0..90 {
            let boundary = count + 1;
            let place = PLACE[usize::try_from(boundary.rem_euclid(18)).unwrap()] * us_a_count / 1000;
            let late = if boundary & 1 == 1 { 150 } else { 0 };
            let at = begin.wrapping_add((k * us_a_count + place + late).unsigned_abs());
            feed(&mut e, &mut count, 1, [at]);
            if turn >= 57 && k > 45 {
                worst = worst.max(
                    (velocity(&mut e, at) - 1_000_000 / us_a_count).abs() * 1000 * us_a_count / 1_000_000,
                );
            }
        }
        begin = begin.wrapping_add((90 * us_a_count).unsigned_abs());
    }
    assert!(worst <= 10, "1 % where the raw intervals are wrong by up to 28 %, but {worst} per mille");
    // 2^-16 count. The mean of all edges is a shift of position, which changes of speed leave behind; a quarter of ±0.16
    // may remain in each edge.
    let wrong = || e.offsets.iter().zip(PLACE).map(|(o, p)| i32::from(*o) - p * ONE / 1000);
    let shared = wrong().sum::<i32>() / 18;
    assert!(shared.abs() < ONE / 10, "{shared}");
    let left = wrong().map(|w| (w - shared).abs()).max();
    assert!(left < Some(ONE / 25), "{left:?} {:?}", e.offsets);
    let learned = e.delay().0;
    assert!((75..=225).contains(&learned), "half to one and a half of 150 µs, but {learned}");
}

#[test]
fn velocity_falls_when_the_next_edge_is_overdue_and_is_zero_at_standstill() {
    let (mut e, mut count) = (Estimator::<18>::new(0), 0);
    let times = (0..40).map(|k| k * 2000);
    feed(&mut e, &mut count, 1, times);
    let last = 39 * 2000;
    let mut before = 500;
    for later in (2000..400_000).step_by(1000) {
        let (p, v) = e.at(Micros(last + later));
        let v = i32::from(v.round());
        assert!(v <= before && v >= 0, "{v} after {before}");
        assert!(v * i32::try_from(later - 400).unwrap() <= 1_150_000, "{v} is too fast for {later} µs");
        assert_eq!(p.round(), count, "stays in its cell");
        before = v.max(1);
    }
    assert_eq!(velocity(&mut e, last + STANDSTILL.0), 0);
}

#[test]
fn standstill_outlasts_the_wrap_of_the_clock() {
    let (mut e, mut count) = (Estimator::<18>::new(0), 0);
    feed(&mut e, &mut count, 1, (0..40).map(|k| k * 2000));
    let last = 39 * 2000_u32;
    let (rest, _) = e.at(Micros(last + STANDSTILL.0));
    assert_eq!(rest.round(), count);
    for later in (0..u64::from(u32::MAX) + 400_000).step_by(10_000_000) {
        let now = last.wrapping_add(STANDSTILL.0).wrapping_add(u32::try_from(later & 0xFFFF_FFFF).unwrap());
        assert_eq!(e.at(Micros(now)), (rest, CountsPerSec::ZERO), "{later}");
    }
    assert_eq!(e.at(Micros(last + 2000)), (rest, CountsPerSec::ZERO));
    feed(&mut e, &mut count, 1, [last + 2500]);
    assert!(velocity(&mut e, last + 2500) <= 4, "one count in 0.3 s or more");
}

#[test]
fn gap_of_more_than_2_pow_31_us_is_a_standstill() {
    for gap in [2_160_000_000, 4_260_000_000] {
        let (mut e, mut count) = (Estimator::<18>::new(0), 0);
        feed(&mut e, &mut count, 1, (0..40).map(|k| k * 2000));
        let later = (39 * 2000_u32).wrapping_add(gap);
        let mut ticked = e.clone();
        assert_eq!(velocity(&mut ticked, later), 0, "tick after {gap} µs");
        feed(&mut e, &mut count, 1, [later]);
        assert!(velocity(&mut e, later) <= 4, "one count in 0.3 s or more, after {gap} µs");
    }
}

#[test]
fn undecided_is_half_way_between_even_speed_and_even_marks() {
    // 500 counts/s; the falling boundaries 0, 2, 4 of six appear displaced by 0, +0.1 and −0.1 counts: distances of
    // 2.1, 1.8 and 2.1 counts. If the marks are even, the speed is 476, 556 and 476.
    for sign in [1, -1] {
        let (mut e, mut count) = (Estimator::<18>::new(0), 0_i32);
        for k in 0..9000_i32 {
            let boundary = if sign > 0 { count + 1 } else { count };
            let falls = (boundary & 1 == 1) != (sign > 0);
            let place = match boundary.rem_euclid(6) {
                2 => 200,
                4 => -200,
                _ => 0,
            };
            let at = (10_000 + k * 2000 + place * sign).unsigned_abs();
            feed(&mut e, &mut count, sign, [at]);
            if k < 8900 {
                continue;
            }
            assert!((velocity(&mut e, at) - 500 * sign).abs() <= 6, "the rotor itself");
            if !falls {
                continue;
            }
            let want = match (boundary.rem_euclid(6), sign) {
                (2, 1) | (4, -1) => 528,
                (2 | 4 | 0, _) => 488,
                _ => continue,
            };
            let (p, v) = e.undecided(Micros(at));
            let v = i32::from(v.round());
            assert!((v - want * sign).abs() <= 6, "{v} from boundary {boundary}: {want}");
            // Halfway between the mark and its apparent position, but not before the mark; 2^-10 count.
            let half = if place * sign > 0 { place * sign * 1024 / 4000 } else { 0 };
            let mark = boundary * 1024 - 512;
            assert!(((p.0.to_bits() - mark) * sign - half).abs() <= 15, "{p:?} at {boundary}");
        }
    }
}

#[test]
fn reversal_passes_through_zero_and_bounce_is_undone() {
    let (mut e, mut count) = (Estimator::<18>::new(0), 0);
    let times = (0..40).map(|k| k * 2000);
    feed(&mut e, &mut count, 1, times);
    let steady = e.at(Micros(79_000));
    let mut hit = e.clone();
    let edge = |count, direction, at, bounce| HallEdge {
        count,
        steps: 1,
        direction,
        at: Micros(at),
        rising: true,
        bounce,
        uncertain: false,
    };
    hit.edge(&edge(count + 1, Direction::Closing, 78_500, false));
    hit.edge(&edge(count, Direction::Opening, 78_540, true));
    assert_eq!(hit.at(Micros(79_000)), steady);
    feed(&mut e, &mut count, -1, [90_000]);
    assert_eq!(velocity(&mut e, 90_000), 0);
    assert_eq!(e.at(Micros(90_000)).0.round(), count);
    feed(&mut e, &mut count, -1, [94_000]);
    assert!((velocity(&mut e, 94_000) + 250).abs() < 30);
}

#[test]
fn stamps_up_to_10_ms_out_of_order_are_simultaneous() {
    for earlier in [0, 5000, u32::MAX] {
        let since = |us: u32| since(Micros(earlier), Micros(earlier.wrapping_add(us)));
        assert_eq!([0, 1, 300_000].map(since), [0, 1, 300_000]);
        assert_eq!([1, 9999, 10_000].map(|us: u32| since(us.wrapping_neg())), [0; 3]);
        assert_eq!(since(10_001_u32.wrapping_neg()), u32::MAX - 10_000);
    }
}

#[test]
fn quiet_is_the_time_since_the_last_step_up_to_standstill() {
    let (mut e, mut count) = (Estimator::<18>::new(7), 7);
    assert_eq!((e.quiet(Micros(5)), e.count()), (STANDSTILL, 7));
    feed(&mut e, &mut count, 1, [1000, 3000]);
    assert_eq!(e.count(), 9);
    for (now, quiet) in
        [(3000, 0), (2900, 0), (3001, 1), (302_999, 299_999), (303_000, 300_000), (1_000_000, 300_000)]
    {
        assert_eq!(e.quiet(Micros(now)), Micros(quiet), "{now}");
    }
}

/// From rest, with exact edges. The velocity error from the fourth edge on, as a lag in time.
#[test]
fn lag_at_constant_acceleration() {
    for (acceleration, most_us) in [(3433_u64, 4000), (20_000, 2000), (70_000, 1000)] {
        let (mut e, mut count) = (Estimator::<18>::new(0), 0);
        let mut worst = 0;
        for k in 1..=200_u64 {
            // Boundary k − ½ at t = √(2 (k − ½) / a); v = a t ≤ 1100 counts/s.
            let at = ((2 * k - 1) * 1_000_000_000_000 / acceleration).isqrt();
            let speed = i64::try_from(acceleration * at / 1_000_000).unwrap();
            if speed > 1100 {
                break;
            }
            feed(&mut e, &mut count, 1, [u32::try_from(at).unwrap()]);
            if k >= 4 {
                let short = speed - i64::from(velocity(&mut e, u32::try_from(at).unwrap()));
                worst = worst.max(short.abs() * 1_000_000 / i64::try_from(acceleration).unwrap());
            }
        }
        assert!(worst <= most_us, "{acceleration} counts/s²: {worst} µs");
    }
}

proptest::proptest! {
    #[test]
    fn any_edges_keep_the_position_in_its_cell(edges in proptest::collection::vec((-4..=4_i32, 0..2_000_000_u32, 0..4_u8), 0..200), start: i32) {
        let (mut e, mut count, mut now) = (Estimator::<18>::new(start), start, 0_u32);
        let mut bounced = false;
        for (step, dt, bits) in edges.into_iter().filter(|(step, ..)| *step != 0) {
            now = now.wrapping_add(dt);
            count = count.wrapping_add(step);
            let direction = if step > 0 { Direction::Closing } else { Direction::Opening };
            let steps = u8::try_from(step.unsigned_abs()).unwrap();
            let (rising, bounce) = (bits & 1 == 1, bits == 2);
            bounced |= bounce;
            e.edge(&HallEdge { count, steps, direction, at: Micros(now), rising, bounce, uncertain: false });
            for later in [0, 1000, 299_999, 300_000] {
                let mut e = e.clone();
                let (p, v) = e.at(Micros(now.wrapping_add(later)));
                proptest::prop_assert!(p.wrapping_sub(Counts::from_int(count)).0.to_bits().abs() <= 512);
                proptest::prop_assert!(later < 300_000 || v == CountsPerSec::ZERO);
                // Two cells lie between falling edges; the count is in one of them unless there was a bounce.
                let (p, v) = e.undecided(Micros(now.wrapping_add(later)));
                proptest::prop_assert!(bounced || p.wrapping_sub(Counts::from_int(count)).0.to_bits().abs() <= 1536);
                proptest::prop_assert!(later < 300_000 || v == CountsPerSec::ZERO);
            }
        }
    }
}

proptest! {
    #[test]
    fn any_edges_keep_state_and_output_in_bounds(
        edges in prop::collection::vec(
            (prop_oneof![0..200_u32, 0..3000_u32, any::<u32>()], prop_oneof![Just(1), 1..=40_u8], 0..16_u8), 1..300,
        ),
        count in prop_oneof![-100..100_i32, Just(i32::MAX), Just(i32::MIN)],
    ) {
        let (mut e, mut count, mut now) = (Estimator::<18>::new(count), count, 0_u32);
        for (wait, steps, flags) in edges {
            now = now.wrapping_add(wait);
            let direction = if flags & 12 == 0 { Direction::Opening } else { Direction::Closing };
            count = count.wrapping_add(i32::from(direction.sign()) * i32::from(steps));
            let (rising, bounce) = (flags & 1 == 1, flags & 15 == 2);
            e.edge(&HallEdge { count, steps, direction, at: Micros(now), rising, bounce, uncertain: false });
            let m = e.state;
            prop_assert!((0..=SPEED_MAX).contains(&m.velocity) && m.acceleration.abs() <= ACCEL_MAX);
            prop_assert!(m.bias.abs() <= RESTART_RESIDUAL && (0..=RESTART_RESIDUAL).contains(&m.noise) && (0..=MAX_DELAY_US << 8).contains(&e.delay));
            prop_assert!(m.place.abs() <= ONE / 2 && m.position.abs() <= 3 * RESTART_RESIDUAL, "{m:?}");
            for later in [0, 999, 40_000, 300_000] {
                let (position, velocity) = e.clone().at(Micros(now.wrapping_add(later)));
                let out = position.wrapping_sub(Counts::from_int(count)).0.to_bits();
                prop_assert!(bounce || (-512..512).contains(&out), "{out} {m:?}");
                // Forward; the acceleration adds at most a quarter to the bound in 30 ms.
                let forward = i64::from(velocity.0.to_bits()) * i64::from(m.sign);
                prop_assert!((0..=i64::from(SPEED_MAX) * 5 / 4).contains(&forward), "{forward} {m:?}");
            }
        }
    }
}
