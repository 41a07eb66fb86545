//! Homing, arrival, stalls and V on the image, as tests/homing.rs, tests/arrival.rs and servo-core's own tests have them on native
//! boards. The scenario `homing-jammed` has the jammed brake.

use tater_wire::{EndCode, FaultCode, Property};

use super::bench::{Bench, production};

#[test]
fn image_proves_that_the_motor_turns_before_it_is_homed() {
    let Some(programs) = production() else { return };
    let mut bench = Bench::awake(&programs);
    bench.set(Property::CMD, 13);
    let (mut touched, mut left, mut again) = (false, 0.0_f64, false);
    while bench.get(Property::END) == Some(0) {
        let counts = bench.board().rig().truth().counts;
        again |= left > 11.0 && counts < 0.0;
        touched |= counts < 0.0;
        if touched {
            left = left.max(counts);
        }
        bench.wait_ms(5);
    }
    assert_eq!(bench.get(Property::END), Some(EndCode::Arrived.into()));
    assert!(touched && again && (11.0..20.0).contains(&left), "{touched}, {left} counts, {again}");
    assert_eq!(bench.get(Property::HALLH).map(|bits| bits >> 30), Some(1));
}

#[test]
fn image_arrives_at_rest_and_within_mpe() {
    let Some(programs) = production() else { return };
    let mut bench = Bench::awake(&programs);
    for (property, value) in [(Property::ACCEL, 260), (Property::MV, 900), (Property::HOLD, 0)] {
        bench.set(property, value);
    }
    for end in [120, 20] {
        bench.set(Property::M, end);
        while bench.is_driven() || bench.get(Property::END) == Some(0) {
            bench.wait_us(500);
        }
        assert_eq!(bench.get(Property::END), Some(EndCode::Arrived.into()));
        let speed = bench.board().rig().truth().counts_per_s.abs();
        bench.wait_ms(300);
        let rest = (bench.board().rig().truth().counts - end as f64).abs();
        assert!(speed <= 35.0 && rest <= 4.5, "{speed} counts/s, {rest} counts away");
    }
}

#[test]
fn image_stalls_whatever_is_written() {
    let Some(programs) = production() else { return };
    for property in [Property::E, Property::ACCEL] {
        let mut bench = Bench::awake(&programs);
        // Behind the stop at 166.
        bench.set(Property::M, 173);
        bench.wait_ms(800);
        let (mut driven, mut ended) = (0, false);
        for write in 0..30 {
            bench.set(property, if property == Property::E { 173 } else { 30 } + write % 2);
            for _ in 0..10 {
                bench.wait_ms(10);
                driven += if bench.board().rig().truth().torque_n_m.abs() > 0.1 { 10 } else { 0 };
            }
            ended |= bench.get(Property::END) == Some(EndCode::Stalled.into());
        }
        assert!(ended && driven <= 450, "{property:?}: driven for {driven} ms");
    }
}

#[test]
fn image_forgets_v_with_its_host() {
    let Some(programs) = production() else { return };
    let mut bench = Bench::awake(&programs);
    bench.set(Property::V, 100);
    assert_eq!(bench.get(Property::VSET), Some(100));
    bench.set(Property::MODE, 4);
    bench.wait_ms(300);
    assert!(bench.board().rig().truth().counts_per_s > 30.0, "SET V, MODE 4 turns");
    bench.wait_ms(2500);
    assert_eq!(bench.get(Property::ERROR), Some(FaultCode::HostLost.into()));
    assert_eq!(bench.get(Property::VSET), Some(0));
    bench.set(Property::STAT, 2);
    let before = bench.board().rig().truth().counts;
    bench.set(Property::MODE, 4);
    bench.wait_ms(300);
    let moved = (bench.board().rig().truth().counts - before).abs();
    assert!(moved < 1.0, "{moved} counts for the next host");
}
