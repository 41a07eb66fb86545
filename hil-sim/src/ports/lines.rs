//! Input lines from a script or standard input.

use std::fs::File;
use std::io::{BufRead, BufReader, IsTerminal, Read, stdin};
use std::path::Path;

use crate::experiment::input::BadInput;

/// Longest line read, bytes: more than ten times what the hand takes, so that the hand answers an over-long line.
const MAX_LINE: usize = 4096;

pub struct Lines {
    from: Box<dyn BufRead>,
    name: String,
    /// Whether a person types them at a terminal, which echoes them.
    pub are_typed: bool,
    number: usize,
}

impl Lines {
    pub fn open(script: Option<&Path>) -> Result<Self, BadInput> {
        let Some(path) = script else {
            let are_typed = stdin().is_terminal();
            let from = Box::new(BufReader::new(stdin()));
            return Ok(Self { from, name: "standard input".to_owned(), are_typed, number: 0 });
        };
        let name = format!("--script {}", path.display());
        let from = File::open(path).map_err(|error| BadInput {
            place: name.clone(),
            problem: "cannot be read".to_owned(),
            found: error.to_string(),
            expected: "a text file with one command per line".to_owned(),
            next: "check the path, or omit --script and pass the lines on standard input".to_owned(),
        })?;
        Ok(Self { from: Box::new(BufReader::new(from)), name, are_typed: false, number: 0 })
    }

    pub fn place(&self) -> String {
        format!("{}:{}", self.name, self.number)
    }

    /// The next line without its line end; `None` at the end of the input. Skips lines that start with #.
    pub fn next_line(&mut self) -> Result<Option<String>, BadInput> {
        loop {
            self.number += 1;
            let mut line = Vec::new();
            let read = (&mut self.from).take(MAX_LINE as u64 + 1).read_until(b'\n', &mut line);
            let problem = match read {
                Ok(0) => return Ok(None),
                Err(error) => error.to_string(),
                Ok(_) if line.len() > MAX_LINE => format!("more than {MAX_LINE} bytes without a line end"),
                Ok(_) => match String::from_utf8(line) {
                    Ok(line) if line.starts_with('#') => continue,
                    Ok(line) => return Ok(Some(line.trim_end_matches(['\r', '\n']).to_owned())),
                    Err(_) => "bytes that are not UTF-8".to_owned(),
                },
            };
            return Err(BadInput {
                place: self.place(),
                problem: "this line cannot be read".to_owned(),
                found: problem,
                expected: format!("lines of text of up to {MAX_LINE} bytes"),
                next: "give a text file with one command per line".to_owned(),
            });
        }
    }
}
