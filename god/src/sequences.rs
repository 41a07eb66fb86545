//! Macros and sequences (manual 5.2.4).

use crate::command::Command;
use crate::god::God;
use crate::motors::Prefix;
use crate::status::Status;
use crate::words::Arguments;

/// Does it.
pub(crate) async fn execute(
    god: &God<'_>,
    command: Command,
    prefix: Prefix,
    arguments: Arguments<'_>,
) -> Status {
    let _ = (god, command, prefix, arguments);
    Status::UNKNOWN_COMMAND
}
