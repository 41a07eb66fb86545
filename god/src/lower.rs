//! The walk-through's grammar (manual 3): `<nodes> S <property> <value>`, `<nodes> G <property>`, WAKE, SAVE.

use crate::god::God;
use crate::status::Status;

/// Does it.
pub(crate) async fn execute(god: &God<'_>, line: &str) -> Status {
    let _ = (god, line);
    Status::UNKNOWN_COMMAND
}
