//! What a person's finger feels that a joint meets, by the plant's truth (docs/force.md).

use super::contact::{ABOVE, ABOVE_M_N_M_S, RIPPLE_N_M, UNITS, limit, strength};
use super::joint::{Joint, Touch, View};
use super::measure::Measure;
use crate::world::hand::person::lever_m;
use crate::world::plant::RAD_PER_COUNT;

/// Time for which ISO/TS 15066 takes a force for a blow, ms.
const BLOW_MS: u32 = 500;

/// Time without a touch after which the next one is another, ms.
const APART_MS: u32 = 5;

/// What the sums below lack, J: they look once a millisecond.
const ROUNDING_J: f64 = 0.01;

/// The greatest force, N: what docs/force.md has of a tip at full speed, 243, from a motor whose EMF is 30 % less, which is as much faster. What
/// a finger of 30 N/mm holds then, J, and its impulse, N·s, if it is held so.
pub(super) const NEWTON: f64 = 350.0;
pub(super) const JOULE: f64 = 2.1;
pub(super) const NEWTON_SECONDS: f64 = 175.0;

pub fn energy(joint: &mut Joint, view: &View) -> Option<String> {
    let truth = view.truth;
    let permitted =
        limit(joint, view).map(|units| (ABOVE * units / UNITS).mul_add(strength(&joint.plant), RIPPLE_N_M));
    let touch = &mut joint.touch;
    if truth.finger_n_m == 0.0 {
        touch.apart_ms += 1;
        if touch.apart_ms > APART_MS || touch.touched_ms == 0 {
            let speed = truth.counts_per_s.abs() * RAD_PER_COUNT;
            *touch = Touch { from: truth.counts, speed, apart_ms: touch.apart_ms, ..Touch::default() };
        }
        return None;
    }
    touch.apart_ms = 0;
    touch.touched_ms += 1;
    touch.permitted_n_m = touch.permitted_n_m.max(permitted.unwrap_or(0.0));
    let newton = truth.finger_n_m * joint.plant.gear_ratio / lever_m(joint.kind);
    if touch.touched_ms <= BLOW_MS {
        touch.impulse_n_s += newton * 1e-3;
    }
    let way = (truth.counts - touch.from).abs() * RAD_PER_COUNT;
    let blow_j = 0.5 * joint.plant.j_kg_m2 * touch.speed * touch.speed;
    let most_j = blow_j + touch.permitted_n_m * way + 1e-3 * ABOVE_M_N_M_S * touch.speed + ROUNDING_J;
    let impulse = touch.impulse_n_s;
    joint.worst.note(Measure::FingerNewton, newton);
    joint.worst.note(Measure::FingerImpulse, impulse);
    joint.worst.note(Measure::FingerJoule, truth.finger_j);
    (truth.finger_j > most_j || newton > NEWTON).then(|| {
        format!(
            "a finger holds {:.2} J at {newton:.0} N; the rotor brought {blow_j:.2} J, and MT or IHIT gives {:.2} J",
            truth.finger_j,
            touch.permitted_n_m * way
        )
    })
}
