//! Commands on parameters (manual 5.2.2, 5.2.3), and their lists.
//!
//! A line may have several names, or pairs of name and value. All of them are checked before any is set.

mod arguments;
pub(crate) mod hand;
mod motors;

use crate::command::GclCommand;
use crate::god::God;
use crate::grammar::Arguments;
use crate::motors::Prefix;
use crate::status::Status;

pub(crate) async fn execute(
    god: &God<'_>,
    command: GclCommand,
    prefix: Prefix,
    arguments: Arguments<'_>,
) -> Status {
    let takes_arguments =
        matches!(command, GclCommand::Fset | GclCommand::Fget | GclCommand::Pset | GclCommand::Pget);
    if let (false, Err(status)) = (takes_arguments, arguments.clone().none()) {
        return status;
    }
    match command {
        GclCommand::Pset => hand::set(god, arguments),
        GclCommand::Pget => hand::get(god, arguments).await,
        GclCommand::Pload => hand::load(god),
        GclCommand::Psave => hand::save(god),
        GclCommand::Pdef => hand::reset_to_defaults(god),
        GclCommand::Plist => hand::list(god, false).await,
        GclCommand::Plista => hand::list(god, true).await,
        GclCommand::Plistv => hand::list_values(god, false).await,
        GclCommand::Plistav => hand::list_values(god, true).await,
        GclCommand::Flist => motors::list(god, false).await,
        GclCommand::Flista => motors::list(god, true).await,
        command => motors::execute(god, command, prefix, arguments).await,
    }
}
