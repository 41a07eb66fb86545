//! Every accepted plant conserves energy and stays finite.

use super::{any_kind, any_model, at, coast, run};
use hil_world::plant::{Model, PlantParams};
use hil_world::rig::{Rig, RigParams};
use proptest::prelude::*;
use tater_wire::MotorKind;

/// Returns the worst residual as a fraction of the energy turned over, and the highest speed, counts/s.
fn worst(plant: &PlantParams, model: Model, duties: &[f64]) -> (f64, f64) {
    let start = at(0.5 * (plant.min_count + plant.max_count), 0.0);
    let mut rig = Rig::new(plant.clone(), RigParams::ideal(), &[], model, start, 1).unwrap();
    let (mut worst, mut fastest) = (0.0_f64, 0.0_f64);
    for &duty in duties {
        for phase in 0..2 {
            for _ in 0..20 {
                let t = if phase == 0 { run(&mut rig, duty, 3) } else { coast(&mut rig, 1) };
                fastest = fastest.max(t.counts_per_s.abs());

                let l = t.ledger;
                // A tenth of a millijoule is negligible, also for a plant with little more energy in total.
                let share = (l.residual_j().abs() - 1e-4).max(0.0) / l.turnover_j();
                // `max` would skip a NaN.
                if !(share.is_finite() && t.counts.is_finite() && t.counts_per_s.is_finite()) {
                    return (f64::INFINITY, f64::INFINITY);
                }
                worst = worst.max(share);
            }
        }
    }
    (worst, fastest)
}

fn decades(low: f64, high: f64) -> impl Strategy<Value = f64> {
    (low.log10()..=high.log10()).prop_map(|exponent| 10_f64.powf(exponent))
}

fn none_or(low: f64, high: f64) -> impl Strategy<Value = f64> {
    prop_oneof![Just(0.0), decades(low, high)]
}

prop_compose! {
    fn any_accepted()(
        kind in any_kind(),
        (r_ohm, l_mh, ke_v_s, j_kg_m2) in (decades(0.1, 100.0), decades(0.05, 20.0), decades(1e-3, 1.0), decades(2e-6, 1e-2)),
        (coulomb_n_m, static_share, viscous_n_m_s) in (decades(1e-4, 1.0), 1.0..2.0_f64, decades(1e-7, 1e-2)),
        (stribeck_counts_s, cogging_n_m) in (none_or(0.1, 1000.0), none_or(1e-4, 0.2)),
        (backlash_counts, gear_rad_n_m) in (none_or(1e-3, 20.0), none_or(1e-4, 10.0)),
        (bus_v, diode_v, dead_time_us) in (5.0..60.0_f64, 0.0..2.0_f64, 0.0..5.0_f64),
        (stop_stiffness_n_m_rad, stop_damping_n_m_s) in (decades(0.1, 1000.0), decades(1e-4, 10.0)),
        (winding_j_k, winding_housing_k_w, housing_j_k) in (decades(0.1, 100.0), decades(0.1, 10.0), decades(0.1, 100.0)),
    ) -> PlantParams {
        PlantParams {
            r_ohm, l_mh, ke_v_s, j_kg_m2, coulomb_n_m, static_n_m: coulomb_n_m * static_share, viscous_n_m_s,
            stribeck_counts_s, cogging_n_m, backlash_counts, gear_rad_n_m,
            bus_v, diode_v, dead_time_us, stop_stiffness_n_m_rad, stop_damping_n_m_s, winding_j_k,
            winding_housing_k_w, housing_j_k,
            // No trip current: the largest currents are the hardest.
            trip_a: 1000.0,
            ..PlantParams::ideal(kind)
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, max_local_rejects: 1_000_000, ..ProptestConfig::default() })]

    #[test]
    fn every_accepted_plant_conserves_energy(
        plant in any_accepted().prop_filter("refused", |plant| plant.validate().is_ok()),
        model in any_model(),
    ) {
        let (leak, fastest) = worst(&plant, model, &[1.0, -0.5, 0.3]);
        prop_assert!(leak <= 0.005, "{leak} leaks from {plant:?}");
        // Weakly damped resonances swing beyond no-load speed. Plants that diverged reached 1e5 and more.
        prop_assert!(fastest <= 12_000.0, "{fastest} counts/s of {plant:?}");
    }
}

#[test]
fn plants_too_fast_for_the_step_are_refused() {
    type Spoil = fn(&mut PlantParams);
    let spoils: [(&str, Spoil); 4] = [
        ("l_mh", |p| p.l_mh = 0.05),
        ("winding_j_k", |p| p.winding_j_k = 0.1),
        ("ke_v_s", |p| p.ke_v_s = 0.005),
        ("j_kg_m2", |p| {
            (p.ke_v_s, p.j_kg_m2, p.r_ohm, p.l_mh, p.winding_j_k) = (1.0, 2e-6, 0.1, 0.05, 100.0)
        }),
    ];
    for (field, spoil) in spoils {
        let mut plant = PlantParams::ideal(MotorKind::Spread);
        spoil(&mut plant);
        let error = plant.validate().unwrap_err();
        println!("{error}");
        assert_eq!(error.field, field, "{error}");
        assert!(error.expected.contains("at least"), "{error}");
    }
}

#[test]
fn start_far_beyond_a_stop_is_refused() {
    let plant = PlantParams::ideal(MotorKind::Spread);
    let start = |count| {
        let params = RigParams::ideal();
        Rig::new(plant.clone(), params, &[], Model::Averaged, at(count, 0.0), 1).map(|_| ())
    };
    for count in [-2.5, -0.5, 166.5, 168.5] {
        assert_eq!(start(count), Ok(()));
    }
    for count in [-2.6, 168.6, 1e6, -1e6, f64::NAN, f64::INFINITY] {
        let error = start(count).unwrap_err();
        assert_eq!(error.field, "start_count", "{error}");
    }
}
