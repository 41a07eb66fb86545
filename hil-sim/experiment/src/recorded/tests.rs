use super::*;
use proptest::prelude::*;
use servo_core::way::Way;

/// Edges at the given times, alternately falling and rising; boundaries with an odd number rise when closing.
fn feed<const N: usize>(
    shaft: &mut RecordedShaft<N>,
    count: &mut i32,
    sign: i32,
    times: impl IntoIterator<Item = u32>,
) {
    let way = Way::closing_if(sign > 0);
    for at in times {
        *count += sign;
        let boundary = if sign > 0 { *count } else { *count + 1 };
        let rising = (boundary & 1 == 1) == (sign > 0);
        let (count, at) = (*count, Micros(at));
        shaft.edge(&HallEdge { count, steps: 1, way, at, rising, bounce: false, uncertain: false });
    }
}

fn velocity<const N: usize>(shaft: &mut RecordedShaft<N>, at: u32) -> i32 {
    i32::from(shaft.at(Micros(at)).1.round())
}

/// 2^-32 of a number, as the nearest millionth.
fn millionths(x: Real) -> i64 {
    (x * whole(1_000_000)).0.round().to_num()
}

#[test]
fn model_predicts_and_updates_by_its_equations() {
    let model = Model {
        position: real!("0.25"),
        velocity: real!("10"),
        position_variance: real!("0.01"),
        covariance: real!("0.02"),
        velocity_variance: real!("4"),
        weight: ONE,
    };
    // t = 0.1 s, q = 30, f = 0.5: way 0.05 s.
    let after = model.predict(real!("0.1"), real!("30"), HALF);
    assert_eq!(millionths(after.position), 750_000);
    assert_eq!(after.velocity, model.velocity);
    // 0.01 + 2·0.05·0.02 + 0.05²·4 + 30·0.05²·0.1/3
    assert_eq!(millionths(after.position_variance), 24_500);
    // 0.02 + 0.05·4 + 30·0.05·0.1/2
    assert_eq!(millionths(after.covariance), 295_000);
    assert_eq!(millionths(after.velocity_variance), 7_000_000);
    // S = 0.01 + 0.3² = 0.1, y = 0.5: K = [0.1, 0.2].
    let (after, far, variance) = model.update(real!("0.75"), real!("0.3"));
    assert_eq!((millionths(variance), millionths(far)), (100_000, 1_250_000));
    assert_eq!((millionths(after.position), millionths(after.velocity)), (300_000, 10_100_000));
    assert_eq!(millionths(after.position_variance), 9000);
    assert_eq!(millionths(after.covariance), 18_000);
    assert_eq!(millionths(after.velocity_variance), 3_996_000);
}

#[test]
fn mixing_keeps_mean_and_variance_of_all_models() {
    let mut shaft = RecordedShaft::<18>::new(0);
    for (model, k) in shaft.motion.models.iter_mut().zip(1..) {
        let k = whole(k);
        *model = Model {
            position: k * real!("0.3"),
            velocity: k * k * whole(7),
            position_variance: k * real!("0.01"),
            covariance: k * real!("0.02"),
            velocity_variance: k * whole(9),
            weight: k * real!("0.1"),
        };
    }
    // The first two moments of all models together.
    let moments = |models: &[Model; 4]| {
        models.iter().fold([ZERO; 5], |sums, model| {
            let (x, v) = (model.position, model.velocity);
            let squares =
                [model.position_variance + x * x, model.covariance + x * v, model.velocity_variance + v * v];
            let [first, second, third, fourth, fifth] = sums;
            let w = model.weight;
            [
                first + w * x,
                second + w * v,
                third + w * squares[0],
                fourth + w * squares[1],
                fifth + w * squares[2],
            ]
        })
    };
    let (before, after) = (moments(&shaft.motion.models), moments(&shaft.mixed()));
    for (before, after) in before.into_iter().zip(after) {
        assert!(before.0.abs_diff(after.0) < real!("0.0001").0, "{before} became {after}");
    }
}

#[test]
fn even_speed_is_exact_across_the_wrap_of_the_clock() {
    for (sign, begin) in [(1, 0_u32), (-1, 0), (1, u32::MAX - 50_000), (-1, u32::MAX - 50_000)] {
        let (mut shaft, mut count) = (RecordedShaft::<18>::new(3), 3);
        feed(&mut shaft, &mut count, sign, (0..100).map(|k| begin.wrapping_add(k * 2000)));
        let last = begin.wrapping_add(99 * 2000);
        for later in [0, 500, 1000, 1900] {
            let (p, v) = shaft.at(Micros(last.wrapping_add(later)));
            assert!((i32::from(v.round()) - 500 * sign).abs() <= 2, "{v:?}");
            // 1/1024 count, from the boundary just crossed, at 500 counts/s.
            let want = (count * 1024) - sign * 512 + sign * i32::try_from(later).unwrap() * 512 / 1000;
            assert!((p.0.to_bits() - want).abs() <= 16, "{p:?} after {later}: {want}");
        }
    }
}

/// Displacements of 12 boundaries, thousandths of a count, whose mean is 0.
const PLACE: [i32; 12] = [40, -80, 30, 10, -60, 90, -160, 30, 70, -20, 110, -60];

/// Ten turns at 400, 700 and 250 counts/s in turn, with displaced marks and rising edges 150 µs late; calls `after` after
/// each edge with its time, the cell's time and the turn.
fn turns(shaft: &mut RecordedShaft<180>, mut after: impl FnMut(&mut RecordedShaft<180>, u32, i32, usize)) {
    let (mut count, mut begin) = (0_i32, 0_u32);
    for turn in 0..30 {
        let us_a_count = [2500_i32, 1430, 4000][turn % 3];
        for k in 0..90 {
            let boundary = count + 1;
            let place = PLACE[usize::try_from(boundary.rem_euclid(12)).unwrap()] * us_a_count / 1000;
            let late = if boundary & 1 == 1 { 150 } else { 0 };
            let at = begin.wrapping_add((k * us_a_count + place + late).unsigned_abs());
            feed(shaft, &mut count, 1, [at]);
            after(shaft, at, us_a_count, turn);
        }
        begin = begin.wrapping_add((90 * us_a_count).unsigned_abs());
    }
}

#[test]
fn lap_placement_and_rise_delay_are_learned() {
    let mut shaft = RecordedShaft::<180>::new(0);
    let (mut worst, mut edges) = (0, 0);
    turns(&mut shaft, |shaft, at, us_a_count, turn| {
        edges += 1;
        if turn >= 27 && edges % 90 > 45 {
            let speed = 1_000_000 / us_a_count;
            worst = worst.max((velocity(shaft, at) - speed).abs() * 1000 / speed);
        }
    });
    assert!(worst <= 20, "2 % where the raw intervals are wrong by up to 36 %, but {worst} per mille");
    assert_eq!(shaft.lap(), Some(12));
    let pattern = shaft.pattern().unwrap();
    for (boundary, place) in (0..).zip(PLACE) {
        let wrong = pattern.place(boundary) - whole(place) / whole(1000);
        assert!(wrong.0.abs() < real!("0.03").0, "{boundary}: {}", pattern.place(boundary));
    }
    // Part of it is taken for displaced marks, which the three speeds separate slowly.
    assert!((30..=200).contains(&shaft.delay().0), "150 µs, but {:?}", shaft.delay());
}

#[test]
fn cogging_is_told_from_placement_by_its_speeds() {
    // v² is 900 less in one cell of six and 900 more in the next: 10 ms and 20 ms a count at 100 and 50 counts/s.
    let (mut shaft, mut count, mut now) = (RecordedShaft::<18>::new(0), 0, 0_u32);
    for turn in 0..60_u64 {
        let square: u64 = if turn % 2 == 0 { 10_000 } else { 3600 };
        for cell in 0..36_u64 {
            let square = match cell % 6 {
                2 => square - 900,
                3 => square + 900,
                _ => square,
            };
            now += u32::try_from(1_000_000_000 / (square * 1_000_000).isqrt()).unwrap();
            feed(&mut shaft, &mut count, 1, [now]);
        }
    }
    let pattern = shaft.pattern().unwrap();
    // The first cell is the one above boundary 0, where the first edge comes from; it ends at boundary 1.
    for (cell, want) in [(2, -900), (3, 900), (5, 0)] {
        let found: i32 = pattern.cogging(cell).0.to_num();
        // Two speeds leave part of it in the widths.
        assert!((found - want).abs() < 500, "{cell}: {found}, not {want}");
        assert!(pattern.place(cell).0.abs() < real!("0.06").0, "{cell}: {}", pattern.place(cell));
    }
}

#[test]
fn overdue_edge_takes_velocity_to_zero_and_position_to_the_middle() {
    for sign in [1, -1] {
        let (mut shaft, mut count) = (RecordedShaft::<18>::new(0), 0);
        feed(&mut shaft, &mut count, sign, (0..40).map(|k| k * 2000));
        let last = 39 * 2000;
        let mut before = 501;
        for later in (2000..1_200_000).step_by(1000) {
            let (p, v) = shaft.at(Micros(last + later));
            let v = i32::from(v.round()) * sign;
            assert!(v <= before && v >= -1, "{v} after {before}");
            assert!((p.0.to_bits() - count * 1024).abs() <= 512, "stays in its cell");
            before = v.max(0);
        }
        let (p, v) = shaft.at(Micros(last + 200_000));
        assert!((p.0.to_bits() - count * 1024).abs() < 256 && v.round() == 0, "{p:?} {v:?}");
        let (p, v) = shaft.at(Micros(last + STANDSTILL.0));
        assert_eq!((p, v), (Counts::from_int(count), CountsPerSec::ZERO));
    }
}

#[test]
fn standstill_outlasts_the_wrap_of_the_clock() {
    let (mut shaft, mut count) = (RecordedShaft::<18>::new(0), 0);
    feed(&mut shaft, &mut count, 1, (0..40).map(|k| k * 2000));
    let last = 39 * 2000_u32;
    assert_eq!(shaft.quiet(Micros(last + 5)), Micros(5));
    for later in (0..u64::from(u32::MAX) + 400_000).step_by(10_000_000) {
        let now = last.wrapping_add(STANDSTILL.0).wrapping_add(u32::try_from(later & 0xFFFF_FFFF).unwrap());
        assert_eq!(shaft.at(Micros(now)), (Counts::from_int(count), CountsPerSec::ZERO), "{later}");
        assert_eq!(shaft.quiet(Micros(now)), STANDSTILL);
    }
    let now = last + 2000;
    assert_eq!(shaft.at(Micros(now)), (Counts::from_int(count), CountsPerSec::ZERO));
    feed(&mut shaft, &mut count, 1, [now + 500]);
    assert_eq!(velocity(&mut shaft, now + 500), 28, "half of the first speed");
}

#[test]
fn reversal_keeps_a_signed_state_and_bounce_is_undone() {
    let (mut shaft, mut count) = (RecordedShaft::<18>::new(0), 0);
    feed(&mut shaft, &mut count, 1, (0..40).map(|k| k * 2000));
    let steady = shaft.at(Micros(79_000));
    let mut hit = shaft.clone();
    let edge = |count, way, at, bounce| HallEdge {
        count,
        steps: 1,
        way,
        at: Micros(at),
        rising: true,
        bounce,
        uncertain: false,
    };
    hit.edge(&edge(count + 1, Way::Closing, 78_500, false));
    hit.edge(&edge(count, Way::Opening, 78_540, true));
    assert_eq!(hit.at(Micros(79_000)), steady);
    // Thrown back with the same speed: across the same boundary 4 ms later.
    feed(&mut shaft, &mut count, -1, [82_000]);
    let back = velocity(&mut shaft, 82_000);
    assert!((-700..=10).contains(&back), "{back}");
    assert_eq!(shaft.at(Micros(82_000)).0.round(), count);
    feed(&mut shaft, &mut count, -1, [84_000]);
    let back = velocity(&mut shaft, 84_000);
    assert!((-600..=-250).contains(&back), "{back}");
}

#[test]
fn even_marks_read_what_a_ruler_of_falls_reads() {
    // 500 counts/s; the falling marks 0, 2, 4 of six appear displaced by 0, +0.1 and −0.1 counts: distances of
    // 2.1, 1.8 and 2.1 counts. If the marks are even, the speed is 476, 556 and 476.
    for sign in [1, -1] {
        let (mut shaft, mut count) = (RecordedShaft::<18>::new(0), 0_i32);
        for k in 0..9000_i32 {
            let boundary = if sign > 0 { count + 1 } else { count };
            let falls = (boundary & 1 == 1) != (sign > 0);
            let mark = if sign > 0 { boundary } else { boundary - 1 };
            let place = match mark.rem_euclid(6) {
                2 => 200,
                4 => -200,
                _ => 0,
            };
            let at = (10_000 + k * 2000 + place * sign).unsigned_abs();
            feed(&mut shaft, &mut count, sign, [at]);
            if k < 8900 || !falls {
                continue;
            }
            assert!((velocity(&mut shaft, at) - 500 * sign).abs() <= 8, "the rotor itself");
            let want = match (mark.rem_euclid(6), sign) {
                (2, 1) | (4, -1) => 556,
                _ => 476,
            };
            let (p, v) = shaft.on_even_marks(Micros(at));
            let v = i32::from(v.round());
            assert!((v - want * sign).abs() <= 8, "{v} from boundary {boundary}: {want}");
            assert!((p.0.to_bits() - (boundary * 1024 - 512)).abs() <= 4, "{p:?} at {boundary}");
            // A quarter of the interval later: half a count.
            let (p, _) = shaft.on_even_marks(Micros(at + 1_000_000 / want.unsigned_abs() / 2));
            let half = boundary * 1024 - 512 + sign * 512;
            assert!((p.0.to_bits() - half).abs() <= 20, "{p:?} at {half}");
        }
    }
}

proptest! {
    #[test]
    fn any_edges_keep_state_and_readings_in_bounds(
        edges in prop::collection::vec(
            (prop_oneof![0..200_u32, 0..3000_u32, 0..2_000_000_u32, any::<u32>()], prop_oneof![Just(1), 1..=40_u8], 0..16_u8), 1..200,
        ),
        count in prop_oneof![-100..100_i32, Just(i32::MAX), Just(i32::MIN)],
    ) {
        let (mut shaft, mut count, mut now) = (RecordedShaft::<18>::new(count), count, 0_u32);
        for (wait, steps, flags) in edges {
            now = now.wrapping_add(wait);
            let way = Way::closing_if(flags & 12 != 0);
            count = count.wrapping_add(way.along(i32::from(steps)));
            let (rising, bounce) = (flags & 1 == 1, flags & 15 == 2);
            shaft.edge(&HallEdge { count, steps, way, at: Micros(now), rising, bounce, uncertain: false });
            for model in &shaft.motion.models {
                prop_assert!(model.velocity.0.abs() <= SPEED_MAX.0, "{model:?}");
                prop_assert!(model.position_variance >= ZERO && model.velocity_variance >= ZERO, "{model:?}");
                prop_assert!((ZERO..=ONE).contains(&model.weight), "{model:?}");
            }
            for later in [0, 999, 40_000, 1_000_000] {
                let mut later_on = shaft.clone();
                let now = Micros(now.wrapping_add(later));
                let (position, velocity) = later_on.at(now);
                let from = position.wrapping_sub(Counts::from_int(count)).0.to_bits();
                prop_assert!(bounce || (-512..=512).contains(&from), "{from}");
                prop_assert!(bounce || later < 1_000_000 || velocity == CountsPerSec::ZERO);
                let (position, velocity) = later_on.on_even_marks(now);
                let from = position.wrapping_sub(Counts::from_int(count)).0.to_bits();
                prop_assert!(bounce || (-2560..=2560).contains(&from), "{from}");
                prop_assert!(bounce || later < 1_000_000 || velocity == CountsPerSec::ZERO);
            }
        }
    }
}
