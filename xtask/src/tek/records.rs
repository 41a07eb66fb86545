//! Reading the records of a `.tek` file, with errors that name record, line and column.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::ops::Range;
use std::path::Path;

use tater_wire::tek::{Dialect, Reader, Record, TekError, TekErrorKind};

use super::memory::Memory;
use crate::{Failure, files};
use programs::output::warn;

pub fn open(path: &Path) -> Result<BufReader<File>, Failure> {
    File::open(path).map(BufReader::new).map_err(|error| files::unreadable(path, &error))
}

/// Passes each record of the file `path`, with the section that it defines, to `each`, which returns column
/// and message of an error. Returns whether the file has a termination record: srec_cat writes none, which [`Dialect::Gnu`] accepts after
/// whole lines, with a warning on standard error.
///
/// # Errors
/// The first error in the file.
pub fn records(
    path: &Path,
    mut file: impl BufRead,
    dialect: Dialect,
    mut each: impl FnMut(Record<'_>, Option<Range<u64>>) -> Result<(), (u32, String)>,
) -> Result<bool, Failure> {
    let place = path.display();
    let damaged = |TekError { record, line, column, kind }: TekError| {
        let next = kind.next_step();
        Failure::Judged(format!("{place}:{line}:{column}: record {record}: {kind}\n  {next}"))
    };
    let (mut reader, mut number, mut total, mut last_byte) = (Reader::new(dialect), 0, 0_u64, 0);
    let mut judge = |record: Record<'_>, section, line| {
        number += 1;
        each(record, section).map_err(|(column, what)| {
            Failure::Judged(format!("{place}:{line}:{column}: record {number}: {what}"))
        })
    };
    loop {
        let bytes = file.fill_buf().map_err(|error| files::unreadable(path, &error))?;
        let len = bytes.len();
        total += len as u64;
        if total > files::MAX_BYTES {
            return Err(files::too_long(path));
        }
        last_byte = bytes.last().copied().unwrap_or(last_byte);
        for &byte in bytes {
            let line = reader.line();
            match reader.push(byte).map_err(damaged)? {
                None => {}
                Some(Record::Symbols) => judge(Record::Symbols, reader.section(), line)?,
                Some(record) => judge(record, None, line)?,
            }
        }
        if len == 0 {
            let line = reader.line();
            return match reader.finish() {
                Ok(last) => last.map_or(Ok(()), |record| judge(record, None, line)).map(|()| true),
                Err(TekError { kind: TekErrorKind::NoEnd, .. })
                    if dialect == Dialect::Gnu && number > 0 && matches!(last_byte, b'\n' | b'\r' | 0x1A) =>
                {
                    warn(&format!(
                        "warning: {place}: found no termination record, expected one after {number} records: srec_cat writes none, and \
                         a file that is cut between two records has none; compare its length with the original"
                    ));
                    Ok(false)
                }
                Err(error) => Err(damaged(error)),
            };
        }
        file.consume(len);
    }
}

/// Number of bytes of a memory, and their range.
pub fn extent(memory: &Memory) -> String {
    match memory.range() {
        Some(range) => format!("{} bytes in {:#010x} to {:#010x}", memory.len(), range.start(), range.end()),
        None => "no bytes".into(),
    }
}
