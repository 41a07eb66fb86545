//! Rigid transforms.

/// A vector or point: x, y, z.
pub type Vector = [f64; 3];

/// Where a frame stands in another: takes coordinates of the first to those of the second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    /// Rotation matrix, by rows; its columns are the frame's axes.
    pub rotation: [Vector; 3],
    /// The frame's origin, m.
    pub origin: Vector,
}

impl Transform {
    /// A frame that coincides with the other.
    pub const IDENTITY: Self =
        Self { rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], origin: [0.0; 3] };

    /// Craig's transform of frame i in frame i-1: Rot_x(α_{i-1}) · Trans_x(a_{i-1}) · Rot_z(θ_i) · Trans_z(d_i).
    #[must_use]
    pub fn dh(a_m: f64, alpha: f64, d_m: f64, theta: f64) -> Self {
        let ((sa, ca), (st, ct)) = (libm::sincos(alpha), libm::sincos(theta));
        Self {
            rotation: [[ct, -st, 0.0], [st * ca, ct * ca, -sa], [st * sa, ct * sa, ca]],
            origin: [a_m, -sa * d_m, ca * d_m],
        }
    }

    /// A frame of this frame, seen from where this one is seen.
    #[must_use]
    pub fn then(&self, inner: &Self) -> Self {
        let column =
            |j: usize| self.rotate([inner.rotation[0][j], inner.rotation[1][j], inner.rotation[2][j]]);
        let [x, y, z] = [column(0), column(1), column(2)];
        Self { rotation: core::array::from_fn(|i| [x[i], y[i], z[i]]), origin: self.apply(inner.origin) }
    }

    /// The other frame seen from this one.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = core::array::from_fn(|i| core::array::from_fn(|j| self.rotation[j][i]));
        let turned = Self { rotation, origin: [0.0; 3] };
        Self { origin: turned.rotate(self.origin).map(|x| -x), ..turned }
    }

    /// A point of this frame.
    #[must_use]
    pub fn apply(&self, point: Vector) -> Vector {
        let turned = self.rotate(point);
        core::array::from_fn(|i| turned[i] + self.origin[i])
    }

    /// A direction of this frame.
    #[must_use]
    pub fn rotate(&self, direction: Vector) -> Vector {
        self.rotation.map(|row| dot(row, direction))
    }

    /// An axis of this frame: 0 x, 1 y, 2 z.
    #[must_use]
    pub fn axis(&self, index: usize) -> Vector {
        self.rotation.map(|row| row[index])
    }

    /// Roll, pitch and yaw of URDF: the rotation is Rot_z(yaw) · Rot_y(pitch) · Rot_x(roll). Pitch is within ±90°; at ±90° roll is 0.
    #[must_use]
    pub fn roll_pitch_yaw(&self) -> Vector {
        let r = &self.rotation;
        let level = libm::hypot(r[0][0], r[1][0]);
        let pitch = libm::atan2(-r[2][0], level);
        // Below this, roll and yaw turn about the same axis.
        if level < 1e-12 {
            return [0.0, pitch, libm::atan2(-r[0][1], r[1][1])];
        }
        [libm::atan2(r[2][1], r[2][2]), pitch, libm::atan2(r[1][0], r[0][0])]
    }
}

pub(crate) fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(crate) fn minus(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[cfg(test)]
mod tests {
    use core::f64::consts::FRAC_PI_2;

    use proptest::prelude::*;

    use super::*;

    fn close(a: &Transform, b: &Transform) -> bool {
        let rows = a.rotation.iter().zip(&b.rotation).flat_map(|(a, b)| a.iter().zip(b));
        // A few roundings of numbers up to 1.
        rows.chain(a.origin.iter().zip(&b.origin)).all(|(a, b)| (a - b).abs() < 1e-12)
    }

    fn about(axis: usize, angle: f64) -> Transform {
        let (s, c) = libm::sincos(angle);
        let (mut rotation, [i, j]) = (Transform::IDENTITY.rotation, [(axis + 1) % 3, (axis + 2) % 3]);
        (rotation[i][i], rotation[i][j], rotation[j][i], rotation[j][j]) = (c, -s, s, c);
        Transform { rotation, origin: [0.0; 3] }
    }

    fn along(axis: usize, by: f64) -> Transform {
        let mut origin = [0.0; 3];
        origin[axis] = by;
        Transform { origin, ..Transform::IDENTITY }
    }

    proptest! {
        #[test]
        fn dh_is_the_product_of_its_four_motions(a in -1.0..1.0, alpha in -4.0..4.0, d in -1.0..1.0, theta in -4.0..4.0) {
            let product = about(0, alpha).then(&along(0, a)).then(&about(2, theta)).then(&along(2, d));
            prop_assert!(close(&Transform::dh(a, alpha, d, theta), &product));
        }

        #[test]
        fn inverse_undoes_the_transform(a in -1.0..1.0, alpha in -4.0..4.0, d in -1.0..1.0, theta in -4.0..4.0) {
            let transform = Transform::dh(a, alpha, d, theta).then(&about(1, theta));
            prop_assert!(close(&transform.then(&transform.inverse()), &Transform::IDENTITY));
        }

        #[test]
        fn roll_pitch_yaw_compose_to_the_rotation(roll in -3.1..3.1, pitch in -3.1..3.1, yaw in -3.1..3.1) {
            let turned = about(2, yaw).then(&about(1, pitch)).then(&about(0, roll));
            let [roll, pitch, yaw] = turned.roll_pitch_yaw();
            prop_assert!(close(&turned, &about(2, yaw).then(&about(1, pitch)).then(&about(0, roll))));
        }
    }

    #[test]
    fn roll_pitch_yaw_at_the_pole_compose_to_the_rotation() {
        for pitch in [FRAC_PI_2, -FRAC_PI_2] {
            let turned = about(2, 0.7).then(&about(1, pitch)).then(&about(0, 0.2));
            let [roll, pitch, yaw] = turned.roll_pitch_yaw();
            assert!(close(&turned, &about(2, yaw).then(&about(1, pitch)).then(&about(0, roll))));
        }
    }
}
