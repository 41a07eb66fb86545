//! HI (manual 5.2.1, findZero in 7): links to their open stops and to 0; then the spread to its open stop and the tips to their closed stops, out
//! of the links' way, and to 0. Each board knows the way from its stop to 0 (IVEL, IHIT, IOFF; CMD 13), and forgets a breakaway.
//!
//! A motor that does not find its stop, or not its way back, ends this for itself only, so that one bad finger does not keep the hand from
//! starting: ERR 4 at the end. So does one that refuses (IVEL 0).

use tater_wire::Cmd;

use super::motion::{self, Plan};
use crate::god::God;
use crate::motors::Motors;
use crate::status::Status;

/// Does it.
pub(super) async fn initialize(god: &God<'_>, motors: Motors) -> Status {
    let mut sum = Status::OK;
    for stage in [motors.intersection(Motors::LINKS), motors.difference(Motors::LINKS)] {
        if !stage.is_empty() {
            sum |= motion::run(god, &Plan::ordered(stage, Cmd::Hi, [Motors::NONE; 3])).await;
        }
    }
    sum
}
