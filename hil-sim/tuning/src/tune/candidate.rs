//! What is searched: values of properties, and the plants on which they run.

use servo_core::Config;

use super::ensemble::{Ensemble, Judged};
use hil_experiment::properties::Property;
use hil_experiment::scenario::Scenario;

/// One dimension of the search.
#[derive(Clone, Copy, Debug)]
pub struct Axis {
    /// The property.
    pub property: &'static Property,
    /// Where the search begins.
    pub start: i64,
    /// Below it steps are differences, above it factors, in the property's unit.
    pub knee: f64,
}

impl Axis {
    /// The property's value at a place of the search, where 0 is the start and 1 about a factor of e.
    #[must_use]
    pub fn value(&self, place: f64) -> i64 {
        let (min, max) = self.property.range();
        let from = (self.start as f64 / self.knee).asinh();
        let value = self.knee * (from + place).sinh();
        (value.clamp(min as f64, max as f64)).round() as i64
    }
}

/// What to tune.
#[derive(Debug)]
pub struct Settings {
    /// The properties.
    pub axes: Vec<Axis>,
    /// The plants, with the goals.
    pub ensemble: Ensemble,
    /// Shipped scenarios of the motor that the start passes, and the result must.
    pub shipped: Vec<Scenario>,
    /// Seed of the search.
    pub seed: u64,
    /// Most candidates.
    pub candidates: usize,
}

/// A candidate that ran on the whole ensemble.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// Its values, in the order of the axes.
    pub values: Vec<i64>,
    /// What it costs.
    pub judged: Judged,
}

/// Applies values to a board's properties.
pub fn put(axes: &[Axis], values: &[i64], config: &mut Config) {
    for (axis, value) in axes.iter().zip(values) {
        // Clamped to its range by [`Axis::value`].
        let _ = axis.property.set(config, *value);
    }
}
