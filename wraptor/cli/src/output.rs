//! Standard output, whose reader may close its end.

use crate::trouble::Trouble;

/// Prints text; a closed pipe is not an error.
///
/// # Errors
/// Standard output cannot be written.
pub fn print(text: &str) -> Result<(), Trouble> {
    programs::output::print(text).map_err(|error| {
        Trouble::Input(format!(
            "standard output: cannot be written: {error}\n  next: free space, or send the output elsewhere"
        ))
    })
}
