//! What a person's finger feels that a joint meets, by the plant's truth (docs/force.md).

use super::contact::{ABOVE, ABOVE_SOFT_M_N_M_S, RIPPLE_N_M, UNITS, limit, strength};
use super::joint::{Joint, Touch, View};
use super::measure::Measure;
use hil_world::hand::person::lever_m;
use hil_world::plant::RAD_PER_COUNT;

/// Time for which ISO/TS 15066 takes a force for a blow, ms.
const BLOW_MS: u32 = 500;

/// Time without a touch after which the next one is another, ms.
const APART_MS: u32 = 5;

/// What the sums below lack, J: they look once a millisecond.
const ROUNDING_J: f64 = 0.01;

/// What a finger feels at most, and of which motors it is the worst case (tests/contact/force.rs).
pub struct Most {
    /// The force, N.
    pub newton: f64,
    /// The impulse if it is held so for half a second, N·s.
    pub newton_seconds: f64,
}

/// Of a joint that comes as fast as the nominal motor turns at 24 V: a tip's 402 N at MT 990 and 28 V, of a motor with 30 % less resistance and 30 %
/// more Ke.
pub const SLOW: Most = Most { newton: 420.0, newton_seconds: 210.0 };

/// Of a faster one: a spread's 432 N, of a motor whose EMF is 30 % less at 28 V.
pub const FAST: Most = Most { newton: 450.0, newton_seconds: 225.0 };

/// The nominal motor's speed without load at 24 V (decision 0003), counts/s.
const FULL_COUNTS_PER_S: f64 = 1056.0;

pub(crate) fn energy(joint: &mut Joint, view: &View) -> Option<String> {
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
    let most_j = blow_j + touch.permitted_n_m * way + 1e-3 * ABOVE_SOFT_M_N_M_S * touch.speed + ROUNDING_J;
    let impulse = touch.impulse_n_s;
    let (most, measures) = if touch.speed <= FULL_COUNTS_PER_S * RAD_PER_COUNT {
        (SLOW, [Measure::FingerNewton, Measure::FingerImpulse])
    } else {
        (FAST, [Measure::FastFingerNewton, Measure::FastFingerImpulse])
    };
    for (measure, value) in measures.into_iter().zip([newton, impulse]) {
        joint.worst.note(measure, value);
    }
    (truth.finger_j > most_j || newton > most.newton).then(|| {
        format!(
            "a finger holds {:.2} J at {newton:.0} N; the rotor brought {blow_j:.2} J, and MT or IHIT gives {:.2} J",
            truth.finger_j,
            touch.permitted_n_m * way
        )
    })
}
