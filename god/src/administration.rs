//! Help, errors, version (manual 5.2.5, 5.2.6).

use crate::command::Command;
use crate::god::God;
use crate::status::Status;
use crate::words::Arguments;

/// Does it.
pub(crate) async fn execute(god: &God<'_>, command: Command, arguments: Arguments<'_>) -> Status {
    let _ = (god, command, arguments);
    Status::UNKNOWN_COMMAND
}
