//! The shortest time in which a plant's motor can make a move: full torque until it must brake, then full torque against it.

use hil_world::plant::PlantParams;

/// Torque limit MT, of the torque at the peak current.
const MT: f64 = 750.0 / 1024.0;
/// Peak current of the hand's motor: 24 V over 2.405 Ω.
pub const PEAK_A: f64 = 24.0 / 2.405;
/// The greatest share of the bus that the bridge applies.
const MOST_DUTY: f64 = 0.967;
const STEP_S: f64 = 2e-5;

/// In ms, over `counts` from rest to rest.
pub fn optimum_ms(plant: &PlantParams, peak_a: f64, counts: f64) -> f64 {
    optimum_path(plant, peak_a, counts).last().expect("it ends").0
}

/// Time in ms and place in counts, about each ms.
pub fn optimum_path(plant: &PlantParams, peak_a: f64, counts: f64) -> Vec<(f64, f64)> {
    let way = counts.abs() * plant.rad_per_count();
    let most_a = MT * peak_a;
    let braking = (most_a * plant.ke_v_s + plant.coulomb_n_m) / plant.j_kg_m2;
    let (mut theta, mut omega, mut time) = (0.0, 0.0, 0.0);
    let mut path = vec![(0.0, 0.0)];
    let mut next_ms = 1.0;
    while theta + omega * omega / (2.0 * braking) < way {
        let amps = ((plant.bus_v * MOST_DUTY - plant.ke_v_s * omega) / plant.r_ohm).min(most_a);
        let driving = amps * plant.ke_v_s - plant.coulomb_n_m - plant.viscous_n_m_s * omega;
        omega += driving / plant.j_kg_m2 * STEP_S;
        theta += omega * STEP_S;
        time += STEP_S;
        if 1000.0 * time >= next_ms {
            path.push((1000.0 * time, theta / plant.rad_per_count()));
            next_ms += 1.0;
        }
    }
    let end = time + omega / braking;
    for share in [0.25, 0.5, 0.75, 1.0] {
        let left = (1.0 - share) * omega / braking;
        path.push((
            1000.0 * (end - left),
            counts.abs() - braking * left * left / 2.0 / plant.rad_per_count(),
        ));
    }
    path
}
