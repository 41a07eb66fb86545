//! RealTime control: LOOP, its blocks, and what they mean (manual 6).

use crate::god::God;
use crate::motors::Prefix;
use crate::status::Status;
use crate::words::Arguments;

/// Does it.
pub(crate) async fn execute(god: &God<'_>, prefix: Prefix, arguments: Arguments<'_>) -> Status {
    let _ = (god, prefix, arguments);
    Status::UNKNOWN_COMMAND
}
