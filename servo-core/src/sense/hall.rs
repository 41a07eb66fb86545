//! Hall code → sector, direction and count, and every way in which the lines can lie.

use crate::units::Micros;

/// Which way the rotor turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// Counts rise.
    Closing,
    /// Counts fall.
    Opening,
}

/// One accepted step of the count. `count` is the cell entered: cell k spans k−½ … k+½ counts, so that the
/// boundary just crossed is at `count − ½` when closing and at `count + ½` when opening.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HallEdge {
    /// Hall count after the step.
    pub count: i32,
    /// How many counts the step spans: 1, or more where edges were lost and the way was clear.
    pub steps: u8,
    /// Direction of the step.
    pub direction: Direction,
    /// When the line changed.
    pub at: Micros,
    /// Whether the line that changed rose. Open-collector sensors fall sharply and rise late.
    pub rising: bool,
}

/// A sample that cannot be the rotor's doing, named; the count does not follow it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Glitch {
    /// Code 0 or 7: no rotor position gives it.
    Illegal,
    /// A code two or three sectors away: an edge was lost, or the sample is wrong.
    Jump,
}

/// What one sample of the lines meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HallEvent {
    /// The count moved.
    Step(HallEdge),
    /// A glitch was seen.
    Glitch(Glitch),
}
