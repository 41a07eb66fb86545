//! Shrinks a failing case to the steps and faults that it needs.

use super::case::{Case, Selection};
use super::session::{Outcome, Violation};

/// A failing case, made smaller.
#[derive(Clone, Debug)]
pub struct Shrunk {
    /// What is left of the case.
    pub selection: Selection,
    /// Its failure: of the same invariant.
    pub violation: Violation,
    /// Runs that this took.
    pub runs: u32,
}

/// Numbers of steps or of faults.
type Numbers = Vec<usize>;

struct Shrinker<'a> {
    case: &'a Case,
    run: &'a mut dyn FnMut(&Case) -> Outcome,
    goes_on: &'a mut dyn FnMut() -> bool,
    best: Shrunk,
}

/// Shrinks `case`, which fails by `violation`, as long as `goes_on`.
pub fn shrink(
    case: &Case,
    violation: &Violation,
    run: &mut dyn FnMut(&Case) -> Outcome,
    goes_on: &mut dyn FnMut() -> bool,
) -> Shrunk {
    let selection = Selection {
        steps: Some((0..case.steps.len()).collect()),
        faults: Some((0..case.faults.len()).collect()),
        stop_ms: Some(case.stop_ms),
    };
    let best = Shrunk { selection, violation: violation.clone(), runs: 0 };
    let mut shrinker = Shrinker { case, run, goes_on, best };
    // Less to play makes each following run shorter. The second round finds what the first one has made possible.
    for _ in 0..2 {
        shrinker.end_early();
        shrinker.drop_parts(|selection| &mut selection.faults);
        shrinker.drop_parts(|selection| &mut selection.steps);
    }
    shrinker.best
}

impl Shrinker<'_> {
    /// Takes a smaller selection if it fails in the same way.
    fn accept(&mut self, selection: Selection) -> bool {
        if !(self.goes_on)() {
            return false;
        }
        self.best.runs += 1;
        let outcome = (self.run)(&self.case.select(&selection));
        match outcome.violation {
            Some(violation) if violation.invariant == self.best.violation.invariant => {
                self.best.selection = selection;
                self.best.violation = violation;
                true
            }
            _ => false,
        }
    }

    /// Ends the program right after the failure, or, if it fails in the recovery, as early as it still does.
    fn end_early(&mut self) {
        let stop_ms = self.best.selection.stop_ms.unwrap_or(self.case.stop_ms);
        if self.best.violation.ms < stop_ms {
            let selection =
                Selection { stop_ms: Some(self.best.violation.ms + 1), ..self.best.selection.clone() };
            let _ = self.accept(selection);
            return;
        }
        let mut cut_ms = stop_ms / 2;
        while cut_ms > 20 {
            let stop_ms = self.best.selection.stop_ms.unwrap_or(0);
            let selection =
                Selection { stop_ms: Some(stop_ms.saturating_sub(cut_ms)), ..self.best.selection.clone() };
            if !self.accept(selection) {
                cut_ms /= 2;
            }
        }
    }

    /// Leaves out ever smaller parts of the steps, or of the faults (delta debugging).
    fn drop_parts(&mut self, part: fn(&mut Selection) -> &mut Option<Numbers>) {
        let mut size = part(&mut self.best.selection).as_ref().map_or(0, Vec::len);
        while size > 0 {
            let mut from = 0;
            loop {
                let all = part(&mut self.best.selection).clone().unwrap_or_default();
                if from >= all.len() {
                    break;
                }
                let to = (from + size).min(all.len());
                let left: Numbers = [&all[..from], &all[to..]].concat();
                let mut selection = self.best.selection.clone();
                *part(&mut selection) = Some(left);
                if !self.accept(selection) {
                    from = to;
                }
            }
            size /= 2;
        }
    }
}
