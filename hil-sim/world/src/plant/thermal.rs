//! Winding and housing as two heat capacities.

use super::params::PlantParams;

/// The two temperatures, °C.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heat {
    /// Winding.
    pub winding_c: f64,
    /// Housing.
    pub housing_c: f64,
}

impl Heat {
    /// Advances by `dt` seconds (well under the winding's time constant of seconds) with this heat input.
    pub fn advance(&mut self, p: &PlantParams, copper_j: f64, friction_j: f64, dt: f64) {
        let across = (self.winding_c - self.housing_c) / p.winding_housing_k_w * dt;
        let out = (self.housing_c - p.ambient_c) / p.housing_ambient_k_w * dt;
        self.winding_c += (copper_j - across) / p.winding_j_k;
        self.housing_c += (friction_j + across - out) / p.housing_j_k;
    }
}
