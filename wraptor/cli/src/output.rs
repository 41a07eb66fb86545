//! Standard output, whose reader may close its end.

use std::io::{self, ErrorKind, Write};

use crate::trouble::Trouble;

/// Prints text; a closed pipe is not an error.
///
/// # Errors
/// Standard output cannot be written.
pub fn print(text: &str) -> Result<(), Trouble> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Trouble::Input(format!(
            "standard output: cannot be written: {error}\n  next: free space, or send the output elsewhere"
        ))),
        _ => Ok(()),
    }
}
