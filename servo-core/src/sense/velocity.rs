//! Position between edges and velocity from edge time-stamps. First version: the last edge interval.

use crate::sense::hall::{Direction, HallEdge};
use crate::units::{Counts, CountsPerSec, Micros};
use fixed::types::{I16F16, I22F10};

/// Estimates position and velocity.
#[derive(Clone, Copy, Debug)]
pub struct Estimator<const N: usize> {
    count: i32,
    boundary: Counts,
    at: Micros,
    direction: Option<Direction>,
    velocity: CountsPerSec,
}

impl<const N: usize> Estimator<N> {
    /// At rest in the middle of the cell `count`.
    #[must_use]
    pub fn new(count: i32) -> Self {
        let boundary = Counts::from_int(count);
        Self { count, boundary, at: Micros(0), direction: None, velocity: CountsPerSec::ZERO }
    }

    /// One accepted step of the count.
    pub fn edge(&mut self, edge: &HallEdge) {
        let half = Counts(I22F10::lit("0.5"));
        let elapsed = edge.at.wrapping_since(self.at).0.max(1);
        let steps = 1_000_000 * u32::from(edge.steps);
        let speed = I16F16::saturating_from_num(i64::from((steps / elapsed).min(5000)));
        self.velocity = match (self.direction == Some(edge.direction), edge.direction) {
            (false, _) => CountsPerSec::ZERO,
            (true, Direction::Closing) => CountsPerSec(speed),
            (true, Direction::Opening) => CountsPerSec(speed).saturating_neg(),
        };
        self.boundary = match edge.direction {
            Direction::Closing => Counts::from_int(edge.count).wrapping_sub(half),
            Direction::Opening => Counts::from_int(edge.count).wrapping_add(half),
        };
        self.count = edge.count;
        self.at = edge.at;
        self.direction = Some(edge.direction);
    }

    /// Position and velocity at `now`.
    #[must_use]
    pub fn at(&self, now: Micros) -> (Counts, CountsPerSec) {
        let elapsed = now.wrapping_since(self.at).0.max(1);
        let most = I16F16::saturating_from_num(i64::from(1_000_000 / elapsed));
        let velocity = self.velocity.0.clamp(-most, most);
        let moved = (i64::from(self.velocity.0.to_bits()) * i64::from(elapsed.min(1_000_000)) / 64_000_000)
            .clamp(-1000, 1000);
        let position =
            self.boundary.wrapping_add(Counts(I22F10::from_bits(i32::try_from(moved).unwrap_or(0))));
        (position, CountsPerSec(velocity))
    }
}
