//! Compares two runs of one scenario over CAN, native and emulated: the largest distance between their rotors.
//!
//! The boards tick at different phases, so times count from the first driven tick of each run.

use servo_core::Command;

use hil_world::rig::Truth;

/// The rotor's path once a millisecond, and the moves.
#[derive(Clone, Debug)]
pub struct Path {
    /// Time in us and position in counts.
    points: Vec<(u64, f64)>,
    driven_us: Option<u64>,
    moves: Vec<Moved>,
}

#[derive(Clone, Copy, Debug)]
struct Moved {
    told_us: u64,
    driven_us: Option<u64>,
    ended_us: Option<u64>,
}

/// The difference between two runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// Largest distance between the rotors at the same time, counts.
    pub counts: f64,
    /// Largest difference between the durations of a move, from its first driven tick to its reported end, ms.
    pub end_ms: f64,
    /// Whether the runs ended different numbers of moves.
    pub other_ends: bool,
}

impl Path {
    pub(super) fn new(at_us: u64, counts: f64) -> Self {
        Self { points: vec![(at_us, counts)], driven_us: None, moves: Vec::new() }
    }

    pub(super) fn command(&mut self, command: &Command, told_us: u64) {
        let is_move = match command {
            Command::Move(_) => !self.is_moving(),
            Command::TorqueControlled { .. } | Command::Home => true,
            Command::Mode(mode) => *mode == servo_core::mode::Mode::Trapezoidal,
            _ => false,
        };
        if is_move {
            self.moves.push(Moved { told_us, driven_us: None, ended_us: None });
        }
    }

    fn is_moving(&self) -> bool {
        self.moves.last().is_some_and(|last| last.ended_us.is_none())
    }

    pub(super) fn end(&mut self, at_us: u64) {
        if let Some(last) = self.moves.last_mut() {
            last.ended_us.get_or_insert(at_us);
        }
    }

    pub(super) fn follow(&mut self, truth: Truth, driven_since_us: Option<u64>) {
        self.points.push((truth.t_us, truth.counts));
        let Some(since_us) = driven_since_us else { return };
        self.driven_us.get_or_insert(since_us);
        if let Some(last) = self.moves.last_mut().filter(|last| last.ended_us.is_none()) {
            last.driven_us.get_or_insert(since_us.max(last.told_us));
        }
    }

    /// Time zero, us: the first driven tick, or the run's start if it never drove.
    fn zero_us(&self) -> u64 {
        self.driven_us.or_else(|| self.points.first().map(|point| point.0)).unwrap_or(0)
    }

    /// The position at a time, interpolated linearly; `None` outside the path.
    fn at(&self, us: u64) -> Option<f64> {
        let after = self.points.partition_point(|&(t, _)| t <= us);
        let &(t0, from) = self.points.get(after.checked_sub(1)?)?;
        if t0 == us {
            return Some(from);
        }
        let &(t1, to) = self.points.get(after)?;
        Some(from + (to - from) * (us - t0) as f64 / (t1 - t0) as f64)
    }

    fn took_us(&self) -> Vec<u64> {
        self.moves.iter().filter_map(|m| Some(m.ended_us?.saturating_sub(m.driven_us?))).collect()
    }

    /// Compares this run with another one of the same scenario.
    #[must_use]
    pub fn difference(&self, other: &Self) -> Difference {
        let (zero, other_zero) = (self.zero_us(), other.zero_us());
        let apart = self.points.iter().filter_map(|&(us, counts)| {
            let there = other.at((us + other_zero).checked_sub(zero)?)?;
            Some((counts - there).abs())
        });
        let counts = apart.fold(0.0, f64::max);
        let (ours, others) = (self.took_us(), other.took_us());
        let end_us = ours.iter().zip(&others).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0);
        Difference { counts, end_ms: end_us as f64 / 1000.0, other_ends: ours.len() != others.len() }
    }
}
