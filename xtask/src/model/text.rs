//! Numbers, shapes and places as both models write them.

use kinematics::bodies::{Body, Cylinder};
use kinematics::{Transform, Vector};

/// A length or angle to 1e-9: a nanometer.
pub fn fixed(number: f64) -> String {
    let text = format!("{number:.9}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".into() } else { text.into() }
}

/// The same, with blanks between them.
pub fn fixed_all(numbers: &[f64]) -> String {
    numbers.iter().map(|number| fixed(*number)).collect::<Vec<_>>().join(" ")
}

/// A mass or inertia to six digits.
pub fn short(number: f64) -> String {
    format!("{number:.5e}")
}

/// The middle of a cylinder in its body's frame, and the turn from z onto its axis.
pub fn middle(shape: &Cylinder) -> (Vector, Vector) {
    let mut at = [0.0; 3];
    at[shape.axis] = 0.5 * shape.length_m;
    // About y, z comes onto x.
    (at, if shape.axis == 0 { [0.0, std::f64::consts::FRAC_PI_2, 0.0] } else { [0.0; 3] })
}

/// Diagonal of the inertia in the body's frame, kg·m².
pub fn diagonal(body: &Body) -> Vector {
    let [along, across] = body.inertia_kg_m2();
    let mut diagonal = [across; 3];
    diagonal[body.shape.axis] = along;
    diagonal
}

/// URDF's attributes of a place.
pub fn xyz_rpy(place: &Transform) -> String {
    format!("xyz=\"{}\" rpy=\"{}\"", fixed_all(&place.origin), fixed_all(&place.roll_pitch_yaw()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_plain() {
        assert_eq!(fixed_all(&[0.05, -0.0, 5e-19, 1.0, -0.25]), "0.05 0 0 1 -0.25");
        assert_eq!(short(1.984e-6), "1.98400e-6");
    }
}
