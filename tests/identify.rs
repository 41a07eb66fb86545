//! Unknown motors: the move of `excite` over the bus, and what `identify` makes of it, against the plants' parameters.

use hil_sim::board::SimBoard;
use hil_sim::excite::{Simulated, csv, excite};
use hil_sim::identify::{Estimate, Recording, identify};
use hil_sim::node::Node;
use hil_sim::plant::{Heat, PlantParams, Start};
use hil_sim::rig::{Rig, RigParams};
use hil_sim::{Model, MotorKind, node_of};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

/// Plants of a short run; IDENTIFY_PLANTS=100 runs the ensemble of docs/identify.md.
const PLANTS: u64 = 5;

const NAMES: [&str; 5] = ["R", "Ke", "inertia", "Coulomb", "viscous"];

fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// Estimates with the truth: R, Ke, J, Coulomb and viscous friction.
fn identified(seed: u64) -> [(Estimate, f64); 5] {
    let plant = PlantParams::for_motor(MotorKind::Link).scattered(seed, 0.3);
    let mut rig = RigParams::default();
    let mut rng = Pcg64Mcg::new(u128::from(seed) << 64 | 0xa11);
    rig.hall_error_deg.iter_mut().for_each(|error| *error = rng.random_range(-10.0..=10.0));
    let heat = Heat { winding_c: 25.0, housing_c: 25.0 };
    let start = Start { count: 60.0, counts_per_s: 0.0, heat };
    let rig = Rig::new(plant.clone(), rig, &[], Model::Averaged, start, seed).expect("in range");
    let node = tater_wire::Node::new(node_of(MotorKind::Link)).expect("a node");
    let mut link = Simulated::new(Node::awake(SimBoard::new(rig, node)));
    let recorded = excite(&mut link, node, &mut |_| {}).unwrap_or_else(|e| panic!("plant {seed}: {e:?}"));
    let recording =
        Recording::parse("excite", &csv(&recorded), None).unwrap_or_else(|e| panic!("{seed}: {e}"));
    let found = identify(&recording);
    [
        (found.r_ohm, plant.r_ohm),
        (found.ke_v_s, plant.ke_v_s),
        (found.j_kg_m2, plant.j_kg_m2),
        (found.coulomb_n_m, plant.coulomb_n_m),
        (found.viscous_n_m_s, plant.viscous_n_m_s),
    ]
}

#[test]
fn ensemble_of_unknown_plants_is_identified() {
    let (from, plants) = (number("IDENTIFY_FROM", 1), number("IDENTIFY_PLANTS", PLANTS));
    let mut worst = [0.0_f64; 5];
    let mut inside = [0; 5];
    for seed in from..from + plants {
        for (index, (estimate, truth)) in identified(seed).into_iter().enumerate() {
            worst[index] = worst[index].max(100.0 * (estimate.value / truth - 1.0).abs());
            inside[index] += u64::from(estimate.low <= truth && truth <= estimate.high);
        }
    }
    for ((name, worst), inside) in NAMES.iter().zip(worst).zip(inside) {
        println!("figure: identify {name}: worst error {worst:.2} %, truth inside in {inside} of {plants}");
    }
    // The limits: R 2 %, Ke 1 %, inertia 3 %, friction 10 %. Viscous friction is a tenth of all friction at full speed.
    for (index, most) in [2.0, 1.1, 3.0, 10.0].into_iter().enumerate() {
        assert!(worst[index] <= most, "{}: {:.2} %, at most {most}", NAMES[index], worst[index]);
    }
    // 95 % intervals: of 100 plants 90 at least; of five one may miss.
    for (name, inside) in NAMES.iter().zip(inside) {
        assert!(
            10 * inside >= 9 * plants || plants < 10 && inside + 1 >= plants,
            "{name}: truth inside in {inside} of {plants}"
        );
    }
}
