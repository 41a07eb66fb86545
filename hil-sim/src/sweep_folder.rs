//! A folder of results: `sweep.json`, which describes it, and its table, `results.csv` and `results.parquet`.
//!
//! The CSV grows line by line during a sweep, so that a kill at any moment loses at most its last lines. The rest is complete or
//! absent. The bytes depend on the sweep, the commit and the shard only.

use std::fs::{self, File, TryLockError};
use std::io::{self, BufRead, BufReader, BufWriter, ErrorKind, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::output::{COMMIT, SWEEP};
use hil_tuning::sweep::{ResultColumn, Sweep, fields, head, shard_of};
use programs::files::{self, Part};
use traces::input::BadInput;
use traces::parquet::Writer;
use traces::table::{Cell, Column, Heading, Kind, Sink, TableError};

pub const CSV: &str = "results.csv";
const PARQUET: &str = "results.parquet";

/// Longest header read, bytes: a megabyte for each of some scenarios.
const MOST_HEADER: u64 = 64 << 20;

/// A part of a sweep: number 1 to `of`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shard {
    pub number: u64,
    pub of: u64,
}

impl Shard {
    pub const WHOLE: Self = Self { number: 1, of: 1 };
}

impl std::fmt::Display for Shard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

/// What `sweep.json` says: enough to make the results again.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    pub runs: u64,
    pub shard: Shard,
    /// Tells the sweep from others.
    pub sweep: String,
    pub commit: String,
    pub version: String,
    pub file: String,
    pub scenarios: Vec<Text>,
    /// Path and text of the motor's file, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motor: Option<Text>,
    pub columns: Vec<ResultColumn>,
}

/// A scenario or a motor of a sweep.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Text {
    pub name: String,
    pub text: String,
}

impl Header {
    pub fn new(sweep: &Sweep, shard: Shard) -> Self {
        let scenarios = sweep.scenarios();
        Self {
            runs: sweep.rows(),
            shard,
            sweep: sweep.digest(),
            commit: COMMIT.to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            file: sweep.text().to_owned(),
            scenarios: scenarios.map(|(name, text)| Text { name: name.into(), text: text.into() }).collect(),
            motor: sweep.motor().map(|file| Text { name: file.path().into(), text: file.text().into() }),
            columns: sweep.columns(),
        }
    }

    /// The numbers of its runs.
    pub fn range(&self) -> Range<u64> {
        shard_of(self.runs, self.shard.number, self.shard.of)
    }

    pub fn bytes(&self) -> Vec<u8> {
        // Texts and numbers only: serialization cannot fail.
        let mut bytes = serde_json::to_vec_pretty(self).unwrap_or_default();
        bytes.push(b'\n');
        bytes
    }

    /// The header of a folder; `None` if it has none.
    pub fn read(folder: &Path) -> Result<Option<Self>, BadInput> {
        let path = folder.join(SWEEP);
        let mut bytes = Vec::new();
        match File::open(&path).and_then(|file| file.take(MOST_HEADER).read_to_end(&mut bytes)) {
            Err(e) if [ErrorKind::NotFound, ErrorKind::NotADirectory].contains(&e.kind()) => return Ok(None),
            Err(e) => return Err(failed(&path, &e)),
            Ok(_) => {}
        }
        serde_json::from_slice(&bytes).map(Some).map_err(|e| {
            BadInput::new(path.display().to_string(), "is no description of a sweep")
                .found(e.to_string())
                .expected("a file that hil-sim sweep has written")
                .next("choose another folder")
        })
    }

    /// Why the results of `other` do not belong with these; `None` if they do.
    pub fn difference(&self, other: &Self) -> Option<(&'static str, String, String)> {
        let pairs = [
            ("commit", &self.commit, &other.commit),
            ("version", &self.version, &other.version),
            ("sweep", &self.sweep, &other.sweep),
        ];
        let (name, a, b) = pairs.into_iter().find(|(_, a, b)| a != b).or_else(|| {
            (Self { shard: Shard::WHOLE, ..self.clone() } != Self { shard: Shard::WHOLE, ..other.clone() })
                .then_some(("sweep", &self.file, &other.file))
        })?;
        Some((name, a.clone(), b.clone()))
    }

    /// Columns and facts of the Parquet file.
    fn heading(&self) -> Heading {
        let columns =
            self.columns.iter().map(|column| Column::new(&column.name, &column.unit, column.kind).nullable());
        let facts = [
            ("runs", self.runs.to_string()),
            ("sweep", self.sweep.clone()),
            ("commit", self.commit.clone()),
            ("version", self.version.clone()),
            ("file", self.file.clone()),
        ];
        let scenarios = self.scenarios.iter().map(|of| (format!("scenario {}", of.name), of.text.clone()));
        let motor = self.motor.iter().map(|of| (format!("motor {}", of.name), of.text.clone()));
        let metadata =
            facts.into_iter().map(|(key, value)| (key.to_owned(), value)).chain(scenarios).chain(motor);
        Heading { columns: columns.collect(), metadata: metadata.collect() }
    }

    /// An upper estimate of the bytes of its table in both forms.
    pub fn estimate_bytes(&self) -> u128 {
        let cell = |column: &ResultColumn| match column.kind {
            Kind::Int => 18,
            // Up to 17 digits, sign, point and comma; 8 bytes in Parquet.
            Kind::Float => 20 + 8,
            Kind::Text => 16,
        };
        let line: u128 = self.columns.iter().map(cell).sum::<u128>() + self.commit.len() as u128;
        let runs = self.range();
        u128::from(runs.end - runs.start) * line
    }
}

/// How many runs a table has, and how they ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Tally {
    pub runs: u64,
    /// Those that met their scenario's expectations.
    pub passed: u64,
    /// Those that could not be made.
    pub errors: u64,
}

impl Tally {
    /// Adds a line: its second cell is `passed`, its third `error`.
    fn add(&mut self, line: &str) {
        let mut cells = line.split(',').skip(1);
        self.runs += 1;
        self.passed += u64::from(cells.next() == Some("1"));
        self.errors += u64::from(cells.next() != Some(""));
    }
}

/// The table of a folder, open for more lines.
pub struct Table {
    csv: BufWriter<File>,
    folder: PathBuf,
    /// The number of the next run.
    pub next: u64,
    pub tally: Tally,
}

impl Table {
    /// Opens the table of a folder, which is made if it is missing. `resumes`: continues what is there; otherwise nothing may be.
    pub fn open(folder: &Path, header: &Header, resumes: bool) -> Result<Self, BadInput> {
        let error = |problem: &str, found: String, expected: &str, next: &str| {
            BadInput::new(format!("--out {}", folder.display()), problem)
                .found(found)
                .expected(expected)
                .next(next)
        };
        match (Header::read(folder)?, resumes) {
            (Some(found), true) => {
                let different = found.difference(header).or_else(|| {
                    let [a, b] = [&found, header].map(|header| header.shard);
                    (a != b).then(|| ("shard", a.to_string(), b.to_string()))
                });
                if let Some((name, found, expected)) = different {
                    let problem = format!("the folder has results of another {name}");
                    let next =
                        "resume with the arguments and the commit that began it, or choose another folder";
                    return Err(error(&problem, found, &expected, next));
                }
            }
            (None, true) if is_empty(folder)? => {}
            (Some(_), false) => {
                let next = "continue it with --resume, or choose another folder";
                return Err(error("has results of a sweep", SWEEP.to_owned(), "a new folder", next));
            }
            (None, _) if is_empty(folder)? => {}
            (None, _) => {
                let found = "other files".to_owned();
                return Err(error("is not empty", found, "a new folder", "choose another folder"));
            }
        }
        fs::create_dir_all(folder).map_err(|e| failed(folder, &e))?;
        let path = folder.join(CSV);
        let mut options = File::options();
        let file = options.read(true).write(true).create(true).truncate(false).open(&path);
        let file = file.map_err(|e| failed(&path, &e))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let found = "its table is locked".to_owned();
                let next = "wait for it, or stop it";
                return Err(error("another hil-sim is writing there", found, "a folder of its own", next));
            }
            Err(TryLockError::Error(e)) => return Err(failed(&path, &e)),
        }
        let json = folder.join(SWEEP);
        files::replace(&json, &header.bytes()).map_err(|e| failed(&json, &e))?;
        Self::after_last_line(file, folder, header).map_err(|e| failed(&path, &e))
    }

    /// Cuts off what follows the last whole line of the table.
    fn after_last_line(mut file: File, folder: &Path, header: &Header) -> io::Result<Self> {
        let (mut end, mut next, mut tally) = (0, header.range().start, Tally::default());
        let head = head(&header.columns);
        let mut lines = BufReader::new(&mut file);
        let mut line = Vec::new();
        if read_line(&mut lines, &mut line)?.is_some_and(|line| line == head) {
            end = head.len() as u64;
            while next < header.range().end {
                let Some(text) = read_line(&mut lines, &mut line)? else { break };
                if !is_run(text, next, &header.columns) {
                    break;
                }
                tally.add(text);
                end += text.len() as u64;
                next += 1;
            }
        }
        drop(lines);
        file.set_len(end)?;
        file.seek(SeekFrom::Start(end))?;
        let mut csv = BufWriter::with_capacity(1 << 16, file);
        if end == 0 {
            csv.write_all(head.as_bytes())?;
        }
        Ok(Self { csv, folder: folder.to_owned(), next, tally })
    }

    /// Appends the line of the next run.
    pub fn push(&mut self, line: &str) -> io::Result<()> {
        self.tally.add(line);
        self.next += 1;
        self.csv.write_all(line.as_bytes())
    }

    /// Writes what is buffered.
    pub fn flush(&mut self) -> io::Result<()> {
        self.csv.flush()
    }

    /// Makes the Parquet file of a whole sweep.
    pub fn finish(mut self, header: &Header) -> Result<(), BadInput> {
        let path = self.folder.join(CSV);
        self.flush().map_err(|e| failed(&path, &e))?;
        if header.shard == Shard::WHOLE {
            let parquet = parquet(&path, &self.folder.join(PARQUET), header)?;
            let place = self.folder.join(PARQUET);
            parquet.rename().map_err(|e| failed(&place, &e))?;
        }
        Ok(())
    }
}

fn is_empty(folder: &Path) -> Result<bool, BadInput> {
    match fs::read_dir(folder) {
        Ok(mut entries) => Ok(entries.next().is_none()),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(true),
        Err(e) => Err(failed(folder, &e)),
    }
}

pub fn failed(path: &Path, error: &io::Error) -> BadInput {
    BadInput::new(path.display().to_string(), "cannot be read or written")
        .found(error.to_string())
        .expected("a folder that can be written, with free space")
        .next("free space or choose another folder; a sweep that has begun continues with --resume")
}

/// The next line with its line end; `None` at the end of the file, within a line, or at bytes that are no text.
fn read_line<'a>(lines: &mut impl BufRead, line: &'a mut Vec<u8>) -> io::Result<Option<&'a str>> {
    line.clear();
    lines.read_until(b'\n', line)?;
    Ok(std::str::from_utf8(line).ok().filter(|text| text.ends_with('\n')))
}

/// Whether a line is that of a run, with all its cells.
fn is_run(line: &str, index: u64, columns: &[ResultColumn]) -> bool {
    line.split_once(',').is_some_and(|(first, _)| first == index.to_string())
        && cells(line, columns).is_some()
}

/// Merges the shards of one sweep into a folder of their own.
pub fn merge(folders: &[PathBuf], out: &Path) -> Result<Tally, BadInput> {
    let mut shards = Vec::new();
    for folder in folders {
        let header = Header::read(folder)?;
        let header = header.ok_or_else(|| {
            BadInput::new(folder.display().to_string(), "has no results of a sweep")
                .found(format!("no {SWEEP}"))
                .expected("a folder that hil-sim sweep --out has written")
                .next("check the path")
        })?;
        shards.push((folder.as_path(), header));
    }
    shards.sort_by_key(|(_, header)| header.shard.number);
    check_shards(&shards)?;
    let Some(whole) = shards.first().map(|(_, first)| Header { shard: Shard::WHOLE, ..first.clone() }) else {
        return Ok(Tally::default());
    };
    if !is_empty(out)? {
        return Err(BadInput::new(format!("--out {}", out.display()), "is not empty")
            .found("files")
            .expected("a new folder")
            .next("choose another folder"));
    }
    let is_new = !out.exists();
    fs::create_dir_all(out).map_err(|e| failed(out, &e))?;
    let merged = merge_into(out, &shards, &whole);
    if merged.is_err() && is_new {
        // Only an empty folder goes.
        let _ = fs::remove_dir(out);
    }
    merged
}

fn merge_into(out: &Path, shards: &[(&Path, Header)], whole: &Header) -> Result<Tally, BadInput> {
    let [csv, parquet_path, json] = [CSV, PARQUET, SWEEP].map(|name| out.join(name));
    let (part, file) = Part::begin(&csv).map_err(|e| failed(&csv, &e))?;
    let mut to = BufWriter::with_capacity(1 << 16, file);
    let mut tally = Tally::default();
    to.write_all(head(&whole.columns).as_bytes()).map_err(|e| failed(&csv, &e))?;
    for (folder, header) in shards {
        append(folder, header, &mut to, &csv, &mut tally)?;
    }
    to.flush().map_err(|e| failed(&csv, &e))?;
    drop(to);
    let parquet = parquet(part.path(), &parquet_path, whole)?;
    let renamed = part.rename().and_then(|()| parquet.rename());
    renamed.map_err(|e| failed(out, &e))?;
    files::replace(&json, &whole.bytes()).map_err(|e| failed(&json, &e))?;
    Ok(tally)
}

/// Whether these are all shards of one sweep, each once.
fn check_shards(shards: &[(&Path, Header)]) -> Result<(), BadInput> {
    let Some(((first, header), others)) = shards.split_first() else { return Ok(()) };
    let error = |folder: &Path, problem: String, found: String, expected: String, next: &str| {
        BadInput::new(folder.display().to_string(), problem).found(found).expected(expected).next(next)
    };
    for (folder, other) in others {
        if let Some((name, expected, found)) = header.difference(other) {
            let problem = format!("is of another {name} than {}", first.display());
            return Err(error(folder, problem, found, expected, "merge shards of one sweep"));
        }
        if other.shard.of != header.shard.of {
            let problem = format!("is of another division than {}", first.display());
            let [found, expected] = [other, header].map(|header| header.shard.to_string());
            return Err(error(folder, problem, found, expected, "merge shards of one --shard i/n"));
        }
    }
    for (place, number) in (1..=header.shard.of).enumerate() {
        let found = shards.get(place).map(|(folder, header)| (folder, header.shard));
        match found {
            Some((_, shard)) if shard.number == number => {}
            Some((folder, shard)) if shard.number < number => {
                let next = "give each shard once";
                return Err(error(
                    folder,
                    "is given twice".into(),
                    shard.to_string(),
                    "each once".into(),
                    next,
                ));
            }
            _ => {
                let missing = Shard { number, of: header.shard.of };
                let problem = format!("shard {missing} is missing");
                let found = format!("{} of {} shards", shards.len(), header.shard.of);
                let next = format!("run hil-sim sweep with --shard {missing}, and give its folder as well");
                return Err(error(first, problem, found, "all shards".into(), &next));
            }
        }
    }
    match shards.get(header.shard.of as usize) {
        Some((folder, header)) => {
            let found = header.shard.to_string();
            Err(error(folder, "is given twice".into(), found, "each once".into(), "give each shard once"))
        }
        None => Ok(()),
    }
}

/// Appends the lines of a shard.
fn append(
    folder: &Path,
    header: &Header,
    to: &mut impl Write,
    out: &Path,
    tally: &mut Tally,
) -> Result<(), BadInput> {
    let path = folder.join(CSV);
    let mut lines = BufReader::new(File::open(&path).map_err(|e| failed(&path, &e))?);
    let mut line = Vec::new();
    let head_found = read_line(&mut lines, &mut line).map_err(|e| failed(&path, &e))?.map(str::to_owned);
    let mut next = header.range().start;
    while head_found.as_ref().is_some_and(|found| *found == head(&header.columns))
        && next < header.range().end
    {
        let text = read_line(&mut lines, &mut line).map_err(|e| failed(&path, &e))?;
        let Some(text) = text.filter(|text| is_run(text, next, &header.columns)) else { break };
        to.write_all(text.as_bytes()).map_err(|e| failed(out, &e))?;
        tally.add(text);
        next += 1;
    }
    if next < header.range().end {
        return Err(BadInput::new(
            path.display().to_string(),
            format!("shard {} is not complete", header.shard),
        )
        .found(format!(
            "{} of {} runs",
            next - header.range().start,
            header.range().end - header.range().start
        ))
        .expected("all runs")
        .next(format!(
            "continue it: hil-sim sweep SWEEP.toml --out {} --shard {} --resume",
            folder.display(),
            header.shard
        )));
    }
    Ok(())
}

/// Free bytes for a folder that may not exist yet; `None` if the system does not say.
#[cfg(unix)]
pub fn free_bytes(folder: &Path) -> Option<u128> {
    let at = std::path::absolute(folder).ok()?;
    let existing = at.ancestors().find(|path| path.exists())?;
    let stat = rustix::fs::statvfs(existing).ok()?;
    Some(u128::from(stat.f_bavail) * u128::from(stat.f_frsize))
}

/// Free bytes; unknown here.
#[cfg(not(unix))]
pub fn free_bytes(_folder: &Path) -> Option<u128> {
    None
}

/// Writes the table of a CSV as a temporary Parquet file, row group by row group.
fn parquet(csv: &Path, to: &Path, header: &Header) -> Result<Part, BadInput> {
    let (part, file) = Part::begin(to).map_err(|e| failed(to, &e))?;
    let unwritten = |e: TableError| match e {
        TableError::Io(e) => failed(to, &e),
        e => failed(to, &io::Error::other(e.to_string())),
    };
    let mut writer = Writer::new(BufWriter::new(file), &header.heading()).map_err(unwritten)?;
    let mut lines = BufReader::new(File::open(csv).map_err(|e| failed(csv, &e))?);
    let mut line = Vec::new();
    let _ = read_line(&mut lines, &mut line).map_err(|e| failed(csv, &e))?;
    for _ in header.range() {
        let text = read_line(&mut lines, &mut line).map_err(|e| failed(csv, &e))?;
        let row = text.and_then(|text| cells(text, &header.columns));
        let row = row.ok_or_else(|| failed(csv, &io::Error::other("the file was changed meanwhile")))?;
        writer.row(&row).map_err(unwritten)?;
    }
    writer.finish().map_err(unwritten)?;
    Ok(part)
}

/// The cells of a line; `None` where one is not of its column.
fn cells(line: &str, columns: &[ResultColumn]) -> Option<Vec<Cell>> {
    let cell = |(text, column): (String, &ResultColumn)| match column.kind {
        _ if text.is_empty() => Some(Cell::Absent),
        Kind::Int => text.parse().ok().map(Cell::Int),
        Kind::Float => text.parse().ok().map(Cell::Float),
        Kind::Text => Some(Cell::Text(text)),
    };
    let fields = fields(line.trim_end_matches('\n'))?;
    (fields.len() == columns.len()).then(|| fields.into_iter().zip(columns).map(cell).collect())?
}
