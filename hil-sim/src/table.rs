//! Tables of numbers in CSV files: a header, then rows. Lines end in LF or CRLF; blank lines and those that begin with # do not count,
//! nor do spaces around cells. Columns may come in any order, with others among them, which need not be numbers.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use traces::input::{self, BadInput};

/// Largest file: a row of 1 kHz with ten columns for a quarter of an hour.
const MOST_BYTES: u64 = 64 << 20;

/// A file's text.
pub struct TableFile {
    file: String,
    text: String,
}

/// Its header and rows.
pub struct Table<'a> {
    file: &'a str,
    header_line: usize,
    names: Vec<&'a str>,
    rows: Vec<(usize, Vec<&'a str>)>,
}

impl TableFile {
    /// Reads a file.
    ///
    /// # Errors
    /// It cannot be read, is too large, or is no text.
    pub fn read(path: &Path) -> Result<Self, BadInput> {
        let file = path.display().to_string();
        let bad = |problem: &str, found: String| BadInput {
            place: file.clone(),
            problem: problem.to_owned(),
            found,
            expected: format!("a CSV file of at most {} MiB", MOST_BYTES >> 20),
            next: "check the path".to_owned(),
        };
        let mut bytes = Vec::new();
        File::open(path)
            .and_then(|open| open.take(MOST_BYTES + 1).read_to_end(&mut bytes))
            .map_err(|e| bad("cannot be read", e.to_string()))?;
        if bytes.len() as u64 > MOST_BYTES {
            return Err(bad("too large", "more".to_owned()));
        }
        let text = String::from_utf8(bytes)
            .map_err(|e| bad("not text", format!("byte {} is no UTF-8", e.utf8_error().valid_up_to())))?;
        Ok(Self { file, text })
    }

    /// The table in it.
    ///
    /// # Errors
    /// No header, two columns of one name, or a row of another length.
    pub fn table(&self) -> Result<Table<'_>, BadInput> {
        let text = self.text.strip_prefix('\u{feff}').unwrap_or(&self.text);
        let mut lines = (1..).zip(text.lines()).filter(|(_, line)| {
            let line = line.trim();
            !line.is_empty() && !line.starts_with('#')
        });
        let Some((header_line, header)) = lines.next() else {
            return Err(self.bad(1, "no header".to_owned(), "nothing", "names of columns, then rows"));
        };
        let names = split(header);
        for (at, name) in names.iter().enumerate() {
            if names[..at].iter().any(|other| other.eq_ignore_ascii_case(name)) {
                let problem = "two columns have the same name".to_owned();
                return Err(self.bad(header_line, problem, name, "each name once"));
            }
        }
        let mut rows = Vec::new();
        for (number, line) in lines {
            let row = split(line);
            if row.len() != names.len() {
                let problem = format!("the row has {} cells", row.len());
                return Err(self.bad(number, problem, line, &format!("{} as the header", names.len())));
            }
            rows.push((number, row));
        }
        Ok(Table { file: &self.file, header_line, names, rows })
    }

    fn bad(&self, line: usize, problem: String, found: &str, expected: &str) -> BadInput {
        BadInput {
            place: format!("{}:{line}", self.file),
            problem,
            found: input::shorten(found.trim()),
            expected: expected.to_owned(),
            next: "correct this line".to_owned(),
        }
    }
}

fn split(line: &str) -> Vec<&str> {
    line.split(',').map(|cell| cell.trim().trim_matches('"').trim()).collect()
}

impl Table<'_> {
    /// Index of the first of these columns that the table has; letters' case does not count.
    pub fn find(&self, names: &[&str]) -> Option<usize> {
        names.iter().find_map(|name| self.names.iter().position(|own| own.eq_ignore_ascii_case(name)))
    }

    /// The same, of a column that must be there.
    ///
    /// # Errors
    /// None of them is there.
    pub fn need(&self, names: &[&str], expected: &str) -> Result<usize, BadInput> {
        self.find(names).ok_or_else(|| {
            let wanted = names.first().copied().unwrap_or_default();
            BadInput {
                place: format!("{}:{}", self.file, self.header_line),
                problem: format!("no column {wanted}"),
                found: input::shorten(&self.names.join(", ")),
                expected: expected.to_owned(),
                next: input::did_you_mean(wanted, self.names.iter().copied())
                    .unwrap_or_else(|| "name the columns in the first line".to_owned()),
            }
        })
    }

    /// Name of a column.
    pub fn name(&self, column: usize) -> &str {
        self.names.get(column).copied().unwrap_or_default()
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// A cell's number.
    ///
    /// # Errors
    /// It is none, or not finite.
    pub fn number(&self, row: usize, column: usize) -> Result<f64, BadInput> {
        let text = self.rows[row].1[column];
        match text.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            Ok(_) => Err(self.bad(row, column, "not finite", "a finite number")),
            Err(_) if text.is_empty() => Err(self.bad(row, column, "an empty cell", "a number")),
            Err(_) => Err(self.bad(row, column, "no number", "a number")),
        }
    }

    /// An error at a cell.
    pub fn bad(&self, row: usize, column: usize, problem: &str, expected: &str) -> BadInput {
        let (line, cells) = &self.rows[row];
        BadInput {
            place: format!("{}:{line}", self.file),
            problem: format!("{}: {problem}", self.name(column)),
            found: format!("{:?}", input::shorten(cells[column])),
            expected: expected.to_owned(),
            next: "correct this row, or leave it out".to_owned(),
        }
    }

    /// An error of the whole file.
    pub fn bad_file(&self, problem: String, found: String, expected: String, next: &str) -> BadInput {
        BadInput { place: self.file.to_owned(), problem, found, expected, next: next.to_owned() }
    }
}
