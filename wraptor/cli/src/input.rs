//! Entries: from a person with history and completion, or from a script, each with its place for errors.

use std::fs::File;
use std::io::{self, BufRead, BufReader, ErrorKind, IsTerminal, Read};
use std::path::{Path, PathBuf};

use rustyline::completion::{Completer, FilenameCompleter, Pair};
use rustyline::error::ReadlineError;
use rustyline::history::FileHistory;
use rustyline::{Context, Editor, Helper, Highlighter, Hinter, Validator};

use crate::output::print;
use crate::tables;
use crate::trouble::Trouble;

/// Longest line of a script, bytes: more is no script.
const LONGEST: u64 = 4096;

#[derive(Helper, Hinter, Highlighter, Validator)]
pub struct Tables(FilenameCompleter);

impl Completer for Tables {
    type Candidate = Pair;

    fn complete(&self, line: &str, pos: usize, context: &Context) -> rustyline::Result<(usize, Vec<Pair>)> {
        let before = line.get(..pos).unwrap_or_default();
        if before.trim_start().to_ascii_lowercase().starts_with("download ") {
            return self.0.complete(line, pos, context);
        }
        let (start, names) = tables::complete(before);
        let pair = |name: String| Pair { display: name.clone(), replacement: name + " " };
        Ok((start, names.into_iter().map(pair).collect()))
    }
}

/// What comes next.
pub enum Next {
    Entry(String),
    /// ^C: what was typed is dropped.
    Dropped,
    End,
}

/// Where entries come from.
pub enum Input {
    Typed { editor: Box<Editor<Tables, FileHistory>>, history: Option<PathBuf> },
    Script { lines: Box<dyn BufRead>, name: String, number: usize },
}

impl Input {
    /// A script, or standard input, which is typed on a terminal.
    ///
    /// # Errors
    /// The script cannot be opened, or the terminal not be used.
    pub fn open(script: Option<&Path>) -> Result<Self, Trouble> {
        if let Some(path) = script {
            let file = File::open(path).map_err(|error| unreadable(&path.display().to_string(), &error))?;
            let lines = Box::new(BufReader::new(file));
            return Ok(Self::Script { lines, name: path.display().to_string(), number: 0 });
        }
        if !io::stdin().is_terminal() {
            let lines = Box::new(BufReader::new(io::stdin()));
            return Ok(Self::Script { lines, name: "standard input".to_owned(), number: 0 });
        }
        let mut editor = Editor::new().map_err(|error| unreadable("terminal", &error))?;
        editor.set_helper(Some(Tables(FilenameCompleter::new())));
        // A pipe of that name would wait for its other end.
        let history = history().filter(|path| !path.exists() || path.is_file());
        if let Some(path) = &history {
            // The first time there is none.
            let _ = editor.load_history(path);
        }
        Ok(Self::Typed { editor: Box::new(editor), history })
    }

    pub const fn is_typed(&self) -> bool {
        matches!(self, Self::Typed { .. })
    }

    /// Where the last entry stands.
    pub fn place(&self) -> String {
        match self {
            Self::Typed { .. } => String::new(),
            Self::Script { name, number, .. } => format!("{name}:{number}: "),
        }
    }

    /// The next entry. Prints the prompt, and after it a script's entry.
    ///
    /// # Errors
    /// The input cannot be read.
    pub fn next(&mut self, prompt: &str) -> Result<Next, Trouble> {
        match self {
            Self::Typed { editor, .. } => match editor.readline(prompt) {
                Ok(entry) => {
                    // A failure costs the history only.
                    let _ = editor.add_history_entry(&entry);
                    Ok(Next::Entry(entry))
                }
                Err(ReadlineError::Interrupted) => Ok(Next::Dropped),
                Err(ReadlineError::Eof) => Ok(Next::End),
                // Bytes that are no text, which the editor has read.
                Err(ReadlineError::Io(error)) if error.kind() == ErrorKind::InvalidData => Ok(Next::Dropped),
                Err(error) => Err(unreadable("terminal", &error)),
            },
            Self::Script { lines, name, number } => {
                *number += 1;
                let mut bytes = Vec::new();
                let read = lines.by_ref().take(LONGEST).read_until(b'\n', &mut bytes);
                read.map_err(|error| unreadable(name, &error))?;
                if bytes.is_empty() {
                    return Ok(Next::End);
                }
                let entry = String::from_utf8(bytes).ok().filter(|entry| entry.len() < LONGEST as usize);
                let entry = entry.ok_or_else(|| {
                    let expected = "expected lines of text, UTF-8, below 4096 bytes";
                    Trouble::Input(format!("{name}:{number}: {expected}\n  next: check that it is a script"))
                })?;
                let entry = entry.trim_end_matches(['\r', '\n']).trim_start_matches('\u{FEFF}').to_owned();
                print(&format!("{prompt}{}\n", visible(&entry)))?;
                Ok(Next::Entry(entry))
            }
        }
    }
}

impl Drop for Input {
    fn drop(&mut self) {
        if let Self::Typed { editor, history: Some(path) } = self {
            // A history that cannot be kept is no error of the session.
            let _ = path.parent().map(std::fs::create_dir_all);
            let _ = editor.save_history(path);
        }
    }
}

/// Text without what a terminal obeys.
fn visible(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { char::REPLACEMENT_CHARACTER } else { c }).collect()
}

fn unreadable(name: &str, error: &dyn std::error::Error) -> Trouble {
    Trouble::Input(format!(
        "{name}: cannot be read: {error}\n  next: check that it is a file that you may read"
    ))
}

/// The file of the history, where programs keep their state.
fn history() -> Option<PathBuf> {
    let folder = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let state = folder("XDG_STATE_HOME")
        .or_else(|| folder("HOME").map(|home| home.join(".local/state")))
        .or_else(|| folder("LOCALAPPDATA"))?;
    Some(state.join("wraptor/history"))
}
