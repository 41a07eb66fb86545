//! The torture chamber: seeded runs of the whole hand under random programs, in random worlds, with faults, judged by invariants
//! at each millisecond (docs/torture.md).
//!
//! A run has two phases. In the first, hosts do what the seed draws while faults come and go; every invariant must hold. Then
//! all faults heal, and the hand must home and move within `recovery::RECOVERY_MS`. The same seed gives the same run; a
//! failing one is shrunk to the steps and faults that it needs.
#![forbid(unsafe_code)]

pub mod case;
pub mod deadline;
mod download;
pub mod fault;
pub mod identity;
pub mod invariant;
pub mod kinds;
pub mod lines;
mod observe;
pub mod outside;
pub mod play;
pub mod program;
pub mod recovery;
pub mod report;
pub mod session;
mod shadow;
mod shrink;
mod stream;

use std::panic::{AssertUnwindSafe, catch_unwind};

pub use case::{Case, Selection};
use hil_experiment::events::{self, Event};
pub use invariant::INVARIANTS;
pub use kinds::FaultKind;
pub use play::{native, play};
pub use session::{Outcome, Violation};
pub use shrink::{Shrunk, shrink};

/// Plays a case on native boards. A panic of the firmware or of the simulator is a failure like others.
#[must_use]
pub fn run(case: &Case) -> Outcome {
    run_with_events(case).0
}

/// [`run`], and the events that GOD and the boards still have in their rings at the end.
#[must_use]
pub fn run_with_events(case: &Case) -> (Outcome, Vec<Event>) {
    let failed = |invariant, found| {
        let violation = Some(Violation { invariant, ms: 0, node: 0, found });
        (Outcome { violation, ..Outcome::default() }, Vec::new())
    };
    let hand = match native(case) {
        Ok(hand) => hand,
        Err(error) => return failed("case", error.to_string()),
    };
    let played = catch_unwind(AssertUnwindSafe(|| {
        let (outcome, hand) = play(case, hand);
        (outcome, events::of_hand(&hand))
    }));
    played.unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("a panic");
        failed(invariant::NO_PANIC, text.to_owned())
    })
}
