//! The results of a run of the task: the rows of the page, as they come.

use std::io::IsTerminal;
use std::sync::{Mutex, PoisonError};

use super::list::Defect;
use super::page::{self, Row, Rows};
use crate::files;
use crate::program::root;
use programs::output::warn;

/// The results so far.
pub struct Board<'a> {
    all: &'a [Defect],
    write: bool,
    rows: Mutex<Rows>,
    page: String,
}

impl<'a> Board<'a> {
    /// The rows of the page; with `write` each change is written into it.
    pub fn new(all: &'a [Defect], page: String, write: bool) -> Self {
        Self { all, write, rows: Mutex::new(page::parse(&page)), page }
    }

    /// All rows, which the page has as well if that is wanted.
    ///
    /// # Errors
    /// The page cannot be written.
    pub fn finish(self) -> Result<Rows, String> {
        self.write()?;
        Ok(self.rows.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// Changes the row of a defect.
    ///
    /// # Errors
    /// The page cannot be written.
    pub fn record(&self, defect: &Defect, change: impl FnOnce(Row) -> Row) -> Result<(), String> {
        {
            let mut rows = self.rows.lock().unwrap_or_else(PoisonError::into_inner);
            let row = rows.remove(&defect.name).unwrap_or_default();
            rows.insert(defect.name.clone(), change(row));
        }
        self.write()
    }

    /// Writes the page, if that is wanted.
    fn write(&self) -> Result<(), String> {
        if !self.write {
            return Ok(());
        }
        let rows = self.rows.lock().unwrap_or_else(PoisonError::into_inner);
        let all: Vec<&Defect> = self.all.iter().collect();
        let text = page::with(&self.page, &page::made(&all, &rows))?;
        files::replace(&root().join(page::PAGE), text.as_bytes())
    }
}

/// A line for a person who watches.
pub fn progress(text: &str) {
    if std::io::stderr().is_terminal() {
        warn(text);
    }
}
