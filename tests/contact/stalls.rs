//! TSTOP ends every stall of mode 4 (decision 0077).

use tater_wire::{MotorKind, Property};

use super::{Bench, KINDS, UNITS};
use hil_world::plant::PlantParams;

/// How long a motor that a velocity drives is looked at, ms.
const WATCHED_MS: f64 = 3_000.0;

/// Time in the stop at rest with a torque beyond 0.05 N·m, ms, and the torque at its end, torque units.
fn pressed(kind: MotorKind, settings: &[(Property, i64)]) -> (f64, f64) {
    let plant = PlantParams::for_motor(kind);
    let stop = plant.max_count + 0.5;
    let mut bench = Bench::new(kind, &plant, stop - 40.0, &[]);
    bench.set(Property::HOLD, 0);
    bench.set(Property::MODE, 4);
    for &(property, value) in settings {
        bench.set(property, value);
    }
    let (mut ms, mut last) = (0.0, 0.0);
    bench.watch(&(kind, settings), stop, [20_000.0, WATCHED_MS], |truth, since_ms| {
        if since_ms.is_some() && truth.counts_per_s.abs() < 1.0 && truth.torque_n_m > 0.05 {
            ms += 0.1;
            last = truth.torque_n_m * UNITS;
        }
    });
    (ms, last)
}

/// V 330 pressed with 747 of MT 750 until the heat ended it, and V 400, at the limit, for 337 ms.
#[test]
fn velocity_presses_a_stop_for_tstop_whatever_torque_it_asks_for() {
    for kind in KINDS {
        let tstop = Property::TSTOP.row().default_for_motor(kind).expect("a default");
        for v in [30, 50, 100, 200, 300, 330, 400, 1000] {
            for kpv in [32, 255] {
                let (ms, _) = pressed(kind, &[(Property::KPV, kpv), (Property::V, v)]);
                let tstop = f64::from(tstop);
                // Until the count after the last one is missing.
                let most = tstop + 20.0 + 1_000.0 / v as f64;
                assert!((0.5 * tstop..most).contains(&ms), "{kind:?} V {v} KPV {kpv}: {ms:.0} ms");
            }
        }
    }
}

/// What is so slow that a free joint may stick for TSTOP presses on, with little torque.
#[test]
fn slow_velocity_presses_on_with_little_torque() {
    for kind in KINDS {
        for v in [10, 18] {
            let (ms, torque) = pressed(kind, &[(Property::V, v)]);
            assert!(ms > 0.9 * WATCHED_MS && torque < 175.0, "{kind:?} V {v}: {ms:.0} ms, {torque:.0}");
        }
    }
}

/// A host that controls force by velocity sets TSTOP 0: it presses as long as it speaks, and heat is the bound.
#[test]
fn tstop_0_presses_as_long_as_the_host_speaks() {
    let (ms, torque) = pressed(MotorKind::Link, &[(Property::TSTOP, 0), (Property::V, 100)]);
    assert!(ms > 0.9 * WATCHED_MS && (200.0..350.0).contains(&torque), "{ms:.0} ms, {torque:.0}");
}
