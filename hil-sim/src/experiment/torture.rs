//! The torture chamber: seeded runs of the whole hand under random programs, in random worlds, with faults, judged by invariants
//! at each millisecond (docs/torture.md).
//!
//! A run has two phases. In the first, hosts do what the seed draws while faults come and go; every invariant must hold. Then
//! all faults heal, and the hand must home and move within [`recovery::RECOVERY_MS`]. The same seed gives the same run; a
//! failing one is shrunk to the steps and faults that it needs.

pub mod case;
pub mod deadline;
mod download;
pub mod fault;
pub mod invariant;
pub mod kinds;
pub mod lines;
pub mod play;
pub mod program;
pub mod recovery;

pub use case::{Case, Selection};
pub use invariant::INVARIANTS;
pub use kinds::FaultKind;
pub use play::{Outcome, Violation, native, play};

/// Plays a case on native boards.
#[must_use]
pub fn run(case: &Case) -> Outcome {
    match native(case) {
        Ok(hand) => play(case, hand).0,
        Err(error) => Outcome {
            violation: Some(Violation { invariant: "case", ms: 0, node: 0, found: error.to_string() }),
            ..Outcome::default()
        },
    }
}
