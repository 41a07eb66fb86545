//! Input lines from a script or standard input.

use std::fs::File;
use std::io::{self, BufRead, BufReader, IsTerminal, stdin};
use std::path::Path;

use god::io::ABORT;
use traces::input::BadInput;

/// Longest line read, bytes: more than ten times what the hand takes, so that the hand answers an over-long line.
const MAX_LINE: usize = 4096;

pub struct Lines {
    from: Box<dyn BufRead>,
    name: String,
    /// Whether a person types them at a terminal, which echoes them.
    pub are_typed: bool,
    number: usize,
    /// The last byte read.
    last: Option<u8>,
}

impl Lines {
    pub fn open(script: Option<&Path>) -> Result<Self, BadInput> {
        let Some(path) = script else {
            let are_typed = stdin().is_terminal();
            let from = Box::new(BufReader::new(stdin()));
            return Ok(Self { from, name: "standard input".to_owned(), are_typed, number: 0, last: None });
        };
        let name = format!("--script {}", path.display());
        let from = File::open(path).map_err(|error| {
            BadInput::new(name.clone(), "cannot be read")
                .found(error.to_string())
                .expected("a text file with one command per line")
                .next("check the path, or omit --script and pass the lines on standard input")
        })?;
        Ok(Self { from: Box::new(BufReader::new(from)), name, are_typed: false, number: 0, last: None })
    }

    pub fn place(&self) -> String {
        format!("{}:{}", self.name, self.number)
    }

    /// The next line without its line end, LF, CR or CR LF; `None` at the end of the input. ^C ends a line as well, and stays in it: what
    /// follows is another command. Skips lines that start with #.
    pub fn next_line(&mut self) -> Result<Option<String>, BadInput> {
        loop {
            self.number += 1;
            let problem = match self.read_line() {
                Ok(None) => return Ok(None),
                Err(error) => error.to_string(),
                Ok(Some(line)) if line.len() > MAX_LINE => {
                    format!("more than {MAX_LINE} bytes without a line end")
                }
                Ok(Some(line)) => match String::from_utf8(line) {
                    Ok(line) if line.starts_with('#') => continue,
                    Ok(line) => return Ok(Some(line)),
                    Err(_) => "bytes that are not UTF-8".to_owned(),
                },
            };
            return Err(BadInput::new(self.place(), "this line cannot be read")
                .found(problem)
                .expected(format!("lines of text of up to {MAX_LINE} bytes"))
                .next("give a text file with one command per line"));
        }
    }

    fn read_line(&mut self) -> io::Result<Option<Vec<u8>>> {
        let mut line = Vec::new();
        while line.len() <= MAX_LINE {
            let Some(byte) = self.next_byte()? else {
                return Ok(Some(line).filter(|line| !line.is_empty()));
            };
            // The LF of CR LF, and the line end after ^C, end no other line.
            let (before, is_end) = (self.last.replace(byte), matches!(byte, b'\r' | b'\n'));
            let is_second = is_end
                && line.is_empty()
                && matches!((before, byte), (Some(b'\r'), b'\n') | (Some(ABORT), _));
            if is_second {
                continue;
            }
            if is_end {
                return Ok(Some(line));
            }
            line.push(byte);
            if byte == ABORT {
                return Ok(Some(line));
            }
        }
        Ok(Some(line))
    }

    fn next_byte(&mut self) -> io::Result<Option<u8>> {
        loop {
            match self.from.fill_buf() {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
                Ok(bytes) => {
                    let byte = bytes.first().copied();
                    self.from.consume(usize::from(byte.is_some()));
                    return Ok(byte);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &'static [u8]) -> Vec<String> {
        let name = String::new();
        let mut lines = Lines { from: Box::new(text), name, are_typed: false, number: 0, last: None };
        std::iter::from_fn(|| lines.next_line().expect("text")).collect()
    }

    #[test]
    fn each_line_end_and_each_abort_ends_one_line() {
        for (text, expected) in [
            (&b"HI\nVERS\n"[..], &["HI", "VERS"][..]),
            (b"HI\r\nVERS\r\n", &["HI", "VERS"]),
            (b"HI\rVERS\rFGET P", &["HI", "VERS", "FGET P"]),
            (b"HI\r\rVERS\n\n", &["HI", "", "VERS", ""]),
            (b"1M 100\x03FGET P\n", &["1M 100\x03", "FGET P"]),
            (b"1M 100\x03\r\nFGET P\n\x03\n", &["1M 100\x03", "FGET P", "\x03"]),
            (b"# comment \xC3\xA9\rVERS\r", &["VERS"]),
            (b"", &[]),
        ] {
            assert_eq!(lines(text), expected, "{:?}", String::from_utf8_lossy(text));
        }
    }
}
