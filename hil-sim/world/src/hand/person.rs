//! A person's finger in the way of a joint.

use kinematics::Hand;
use tater_wire::MotorKind;

use crate::plant::{Contact, PlantParams, RAD_PER_COUNT};

/// Stiffness of a finger that is squeezed between two pads, N/mm (issue 33; docs/force.md compares it with ISO/TS 15066).
pub const N_PER_MM: f64 = 30.0;

/// Damping of a finger and of other objects, s: its force is this part of the stiffness a unit of speed. Chosen: a fifth of critical for a link
/// against a finger.
pub const DAMPING_S: f64 = 4e-4;

/// Distance of what is met from the joint's axis, m: the finger of the hand stretched, so that a link has its least force and its greatest speed.
#[must_use]
pub fn lever_m(kind: MotorKind) -> f64 {
    let Hand { base_m, link_m, tip_m, .. } = Hand::default();
    match kind {
        MotorKind::Link => link_m + tip_m,
        MotorKind::Spread => base_m + link_m + tip_m,
        MotorKind::Tip => tip_m,
    }
}

/// Stiffness at the motor of something at the lever's end, N·m/rad.
#[must_use]
pub fn stiffness_n_m_rad(kind: MotorKind, n_per_mm: f64) -> f64 {
    let gear = PlantParams::for_motor(kind).gear_ratio;
    let lever_m = lever_m(kind) / gear;
    1e3 * n_per_mm * (lever_m * lever_m)
}

/// What gives way by a millimeter for so many N, at a count: a person's finger has [`N_PER_MM`]. `side` as in [`Contact`].
#[must_use]
pub fn gives_way(kind: MotorKind, n_per_mm: f64, at_count: f64, side: f64) -> Contact {
    let stiffness = stiffness_n_m_rad(kind, n_per_mm);
    Contact { from: at_count * RAD_PER_COUNT, side, stiffness, damping: DAMPING_S * stiffness }
}
