//! HOLD: what the motor does after a motion has ended (manual 5.5, DESIGN 5).

use crate::command::EndReason;

/// What follows an end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum After {
    /// Bridge off, brake engaged.
    Idle,
    /// PID at the position where the motion ended.
    Hold,
    /// A torque-controlled motion (TC, TO) goes on pressing with MT; any other holds.
    Stay,
}

/// HOLD = 0 and every fault: idle. HOLD = 1: hold the terminating position (not the goal).
#[must_use]
pub fn after(reason: EndReason, hold: bool) -> After {
    match (reason, hold) {
        (EndReason::Fault, _) | (_, false) => After::Idle,
        (EndReason::Stalled, true) => After::Stay,
        (EndReason::Arrived | EndReason::Aborted | EndReason::Strain | EndReason::Breakaway, true) => {
            After::Hold
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hold_keeps_and_faults_always_idle() {
        use EndReason::{Aborted, Arrived, Breakaway, Fault, Stalled, Strain};
        for reason in [Arrived, Stalled, Aborted, Strain, Breakaway, Fault] {
            assert_eq!(after(reason, false), After::Idle);
            let held = after(reason, true);
            assert_eq!(held == After::Idle, reason == Fault, "{reason:?}");
            assert_eq!(held == After::Stay, reason == Stalled, "{reason:?}");
        }
    }
}
