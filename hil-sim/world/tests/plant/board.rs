//! The board's view of the plant: hall edges, brake, analog readings.

use super::{MODELS, at, close, drive, free, frictionless, rig, run};
use hil_world::plant::{Model, PlantParams};
use hil_world::rig::{HallChange, HallGlitch, Object, Rig, RigParams, Side, StuckLine};
use proptest::prelude::*;
use servo_core::sense::commutation::Bridge;
use tater_wire::MotorKind;

fn no_brake() -> PlantParams {
    PlantParams { brake_n_m: 0.0, ..frictionless() }
}

#[test]
fn hall_edges_come_within_a_microsecond() {
    for speed in [7.0, 613.0, 1000.0] {
        for sign in [1.0, -1.0] {
            let mut rig =
                Rig::new(no_brake(), RigParams::ideal(), &[], Model::Switched, at(0.0, sign * speed), 1)
                    .unwrap();
            for k in 0..20 {
                let change = rig.advance(Bridge::Off, true, u64::MAX).unwrap();
                let boundary = sign * (f64::from(k) + 0.5);
                let late = sign * (rig.truth().counts - boundary) / speed * 1e6;
                assert!((-1e-3..=1.0).contains(&late), "{late} µs at {boundary}");
                assert_eq!(change.at_us, rig.now_us());
            }
        }
    }
}

fn turning(params: RigParams, counts_per_s: f64, ms: u64) -> Vec<HallChange> {
    let mut rig = Rig::new(no_brake(), params, &[], Model::Averaged, at(0.0, counts_per_s), 1).unwrap();
    std::iter::from_fn(|| rig.advance(Bridge::Off, true, ms * 1000)).collect()
}

fn times(changes: &[HallChange]) -> Vec<u64> {
    changes.iter().map(|change| change.at_us).collect()
}

#[test]
fn placement_errors_and_rise_delays_shift_the_edges() {
    // 100 counts/s: a count takes 10 ms, a degree electrical 166.7 µs.
    let exact = turning(RigParams::ideal(), 100.0, 60);
    assert_eq!(times(&exact), [5_000, 15_000, 25_000, 35_000, 45_000, 55_000]);
    assert_eq!(exact.iter().map(|c| c.code).collect::<Vec<_>>(), [6, 4, 5, 1, 3, 2]);

    let hall_error_deg = [6.0, -6.0, 0.0, 12.0, 0.0, 0.0];
    let placed = turning(RigParams { hall_error_deg, ..RigParams::ideal() }, 100.0, 60);
    assert_eq!(times(&placed), [6_000, 14_000, 25_000, 37_000, 45_000, 55_000]);

    // Codes 2 6 4 5 1 3 2: lines rise at the first, third and fifth change.
    let late = turning(RigParams { rise_delay_us: 300, ..RigParams::ideal() }, 100.0, 60);
    assert_eq!(times(&late), [5_300, 15_000, 25_300, 35_000, 45_300, 55_000]);
}

#[test]
fn glitches_and_stuck_lines_appear_as_configured() {
    let glitches = vec![HallGlitch { at_us: 7_000, code: 0, duration_us: 40 }];
    let seen = turning(RigParams { glitches, ..RigParams::ideal() }, 100.0, 20);
    let want = [(6, 5_000), (0, 7_000), (6, 7_040), (4, 15_000)];
    assert_eq!(seen, want.map(|(code, at_us)| HallChange { code, at_us }));

    let stuck = Some(StuckLine { line: 1, high: true, from_us: 0 });
    let seen = turning(RigParams { stuck, ..RigParams::ideal() }, 100.0, 60);
    assert!(seen.iter().all(|change| change.code & 2 != 0) && seen.len() == 4, "{seen:?}");
}

#[test]
fn line_that_falls_within_its_rise_delay_never_rises() {
    // At 1000 counts/s a sensor is on for 3 ms.
    let seen = turning(RigParams { rise_delay_us: 3_100, ..RigParams::ideal() }, 1000.0, 60);
    assert_eq!(seen.last().map(|change| change.code), Some(0));
    assert!(seen.len() < 4, "{seen:?}");
}

#[test]
fn brake_acts_after_its_delay_and_holds() {
    let mut rig = rig(PlantParams::ideal(MotorKind::Spread), Model::Averaged, at(80.0, 0.0));
    rig.set_disturbance(0.6);
    rig.advance(Bridge::Off, false, 50_000);
    assert_eq!(rig.truth().counts, 80.0);
    rig.advance(Bridge::Off, true, 69_999);
    assert_eq!(rig.truth().counts, 80.0);
    rig.advance(Bridge::Off, true, 75_000);
    assert!(rig.truth().counts > 80.0);
    // Engaging takes time too: the rotor turns for 20 ms, then stops for good.
    let released = rig.now_us();
    while rig.now_us() < released + 40_000 {
        rig.advance(Bridge::Off, false, released + 40_000);
    }
    let held = rig.truth();
    assert!(held.brake_engaged && held.counts_per_s == 0.0, "{held:?}");
}

#[test]
fn brake_command_reversed_within_the_delay_has_no_effect() {
    let mut rig = rig(PlantParams::ideal(MotorKind::Spread), Model::Averaged, at(80.0, 0.0));
    rig.set_disturbance(0.6);
    rig.advance(Bridge::Off, true, 15_000);
    rig.advance(Bridge::Off, false, 100_000);
    assert_eq!(rig.truth().counts, 80.0);
}

#[test]
fn hand_on_the_shaft_turns_a_worm_that_a_load_on_the_joint_cannot() {
    let mut rig = rig(PlantParams::ideal(MotorKind::Link), Model::Averaged, at(80.0, 0.0));
    rig.set_disturbance(0.3);
    rig.advance(Bridge::Off, false, 50_000);
    assert_eq!(rig.truth().counts, 80.0);
    rig.set_disturbance(0.0);
    rig.set_shaft_torque(0.3);
    while rig.now_us() < 100_000 {
        rig.advance(Bridge::Off, false, 100_000);
    }
    let ledger = rig.truth().ledger;
    assert!(rig.truth().counts > 86.0, "{:?}", rig.truth());
    assert!(ledger.residual_j().abs() < 1e-3 * ledger.turnover_j(), "{ledger:?}");
    assert!(ledger.motor_j < 0.0, "the bridge is off: {ledger:?}");
}

#[test]
fn thermistor_lags_behind_the_housing() {
    // Locked at 60 W for 20 s: the housing warms by 0.4 K/s in the end, and the thermistor lags by 2 s.
    let params = RigParams { adc_noise_lsb: 0.0, ..RigParams::ideal() };
    let mut rig = Rig::new(free(), params, &[], Model::Averaged, at(0.0, 0.0), 1).unwrap();
    let mut two_seconds_ago = 0.0;
    let mut seen = rig.analog().motor_temp;
    for ms in 1..=20_000 {
        rig.advance(drive(rig.halls(), 0.5), false, ms * 1000);
        seen = rig.analog().motor_temp;
        if ms == 18_000 {
            two_seconds_ago = rig.truth().housing_c;
        }
    }
    assert!(rig.truth().housing_c - two_seconds_ago > 0.5);
    assert!((f64::from(seen.0) / 10.0 - two_seconds_ago).abs() < 0.15, "{seen:?} {two_seconds_ago}");
}

#[test]
fn analog_readings_match_the_plant() {
    let object = Object { from_count: 20.0, stiffness_n_m_rad: 1.0, damping_n_m_s: 0.0, side: Side::Closing };
    let plant = PlantParams::ideal(MotorKind::Link);
    let mut rig = Rig::new(plant, RigParams::ideal(), &[object], Model::Switched, at(15.0, 0.0), 1).unwrap();
    assert_eq!(rig.analog().strain.abs_diff(128), 0);
    run(&mut rig, 0.5, 200);
    rig.analog();
    let truth = run(&mut rig, 0.5, 1);
    let seen = rig.analog();
    // Locked: bus current is phase current times the duty less the dead time, 0.5 of 50 µs; strain is 4 per N·m behind 49:1.
    let phase = truth.phase_a.iter().fold(0.0_f64, |most, i| most.max(i.abs()));
    close("bus mA", f64::from(seen.current.0), 490.0 * phase, 0.01);
    close("bus mV", f64::from(seen.bus.0), 24_000.0, 0.001);
    close("strain", f64::from(seen.strain), 128.0 - truth.load_n_m * 49.0 * 4.0, 0.02);
    assert!(seen.strain > 140 && !seen.bridge_fault);
}

#[test]
fn break_input_latches_until_the_bridge_is_off() {
    let mut rig = rig(PlantParams { trip_a: 5.0, ..free() }, Model::Switched, at(0.0, 0.0));
    rig.advance(drive(rig.halls(), 1.0), false, 5_000);
    assert!(rig.analog().bridge_fault);
    assert_eq!(rig.truth().phase_a, [0.0; 3]);
    rig.advance(Bridge::Off, false, 6_000);
    assert!(!rig.analog().bridge_fault);
}

#[test]
fn peak_current_is_the_largest_between_readings() {
    // Locked from rest at half duty: up to 12 V / 2.405 Ω and half the ripple, 24 V · ½ · 25 µs / 0.8 mH / 2.
    for model in MODELS {
        let plant = PlantParams { dead_time_us: 0.0, r_per_k: 0.0, ..free() };
        let mut rig = rig(plant, model, at(0.0, 0.0));
        rig.advance(drive(rig.halls(), 0.5), false, 20_000);
        rig.analog();
        rig.advance(drive(rig.halls(), 0.5), false, 21_000);
        // Switched off between two readings, the current is gone at the second, and its peak is not.
        rig.advance(Bridge::Off, false, 24_000);
        rig.analog();
        assert_eq!(rig.truth().phase_a, [0.0; 3]);
        close("peak A", rig.truth().peak_phase_a, 12.0 / 2.405 + 0.1875, 0.005);
        rig.advance(Bridge::Off, false, 25_000);
        rig.analog();
        assert_eq!(rig.truth().peak_phase_a, 0.0);
    }
}

#[track_caller]
fn progresses(rig: &mut Rig, duty: Option<f64>) -> u32 {
    let until = rig.now_us() + 50_000;
    let mut calls = 0;
    while rig.now_us() < until {
        let before = rig.now_us();
        let bridge = duty.map_or(Bridge::Off, |duty| drive(rig.halls(), duty));
        let change = rig.advance(bridge, true, until);
        assert!(rig.now_us() > before, "time stands still at {before} µs, {:?}", rig.truth());
        if change.is_none() {
            assert_eq!(rig.now_us(), until);
        }
        calls += 1;
    }
    calls
}

#[test]
fn start_on_a_boundary_advances() {
    // Rounding in radians may put the rotor on either side of the boundary.
    for model in MODELS {
        for error in [-25.0, -6.0, 0.0, 0.1, 6.0, 25.0] {
            let params = RigParams { hall_error_deg: [error; 6], ..RigParams::ideal() };
            for k in [-7, -6, -1, 0, 1, 5, 80, 338] {
                let count = f64::from(k) + 0.5 + error / 60.0;
                for (duty, speed) in [(0.3, 0.0), (-0.3, 0.0), (0.3, 300.0), (-0.3, -300.0), (0.3, -20.0)] {
                    let mut rig = Rig::new(free(), params.clone(), &[], model, at(count, speed), 1).unwrap();
                    assert!(progresses(&mut rig, Some(duty)) > 1);
                    let moved = rig.truth().counts - count;
                    assert!(moved * duty > 1.0, "{model:?} {error}° {k} {duty} {speed}: {moved}");
                }
            }
        }
    }
}

#[test]
fn load_moves_a_resting_rotor_off_a_boundary() {
    // A stop is on a hall boundary.
    let plant = PlantParams { brake_n_m: 0.0, ..PlantParams::ideal(MotorKind::Spread) };
    let stop = plant.max_count + 0.5;
    for model in MODELS {
        let mut rig = rig(plant.clone(), model, at(stop, 0.0));
        rig.set_disturbance(-0.1);
        assert!(progresses(&mut rig, None) > 1);
        assert!(rig.truth().counts < stop - 1.0);
    }
}

fn halves() -> impl Strategy<Value = f64> {
    prop_oneof![(-400_i32..400).prop_map(|k| f64::from(k) + 0.5), -400.0..400.0_f64]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn advance_always_progresses(
        count in halves(),
        still in any::<bool>(),
        speed in -2000.0..2000.0_f64,
        hall_error_deg in prop::array::uniform6(prop_oneof![Just(0.0), -25.0..25.0_f64]),
        rise_delay_us in prop_oneof![Just(0_u64), 0_u64..2000],
        zero_sector in 0_u8..6,
        model in prop_oneof![Just(Model::Averaged), Just(Model::Switched)],
        duties in prop::collection::vec(prop::option::of(-1.0..1.0_f64), 1..4),
    ) {
        let params = RigParams { hall_error_deg, rise_delay_us, ..RigParams::ideal() };
        let start = at(count, if still { 0.0 } else { speed });
        let mut rig = Rig::new(PlantParams { zero_sector, ..free() }, params, &[], model, start, 1).unwrap();
        for duty in duties {
            progresses(&mut rig, duty);
        }
    }
}
