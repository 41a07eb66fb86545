//! Text on standard output, whose reader may close its end, and on standard error.

use std::io::{self, ErrorKind, Write};

/// Prints to standard output; a closed pipe is not an error.
///
/// # Errors
/// Standard output cannot be written.
pub fn print(text: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error),
        _ => Ok(()),
    }
}

/// Prints a line to standard error; a failure there cannot be reported.
pub fn warn(line: &str) {
    let _ = writeln!(io::stderr(), "{line}");
}
