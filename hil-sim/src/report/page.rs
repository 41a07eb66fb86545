//! x
use crate::run::Outcome;
use crate::scenario::Scenario;
/// x
#[must_use]
pub fn html(scenario: &Scenario, outcome: &Outcome) -> String { let _ = (scenario, outcome); String::new() }
