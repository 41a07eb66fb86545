//! Whole files: lines, line ends, and dialects.

use core::ops::Range;

use heapless::Vec;

use super::character::digit;
use super::decode::{Decoder, Record};
use super::encode::DATA_BYTES;
use super::error::{TekError, TekErrorKind};

/// Most characters of a line in a download, without its end: hosts read no more.
pub const MAX_LINE: u16 = 98;

/// `%` and the largest length field.
const LONGEST: u16 = 256;

const SHORTEST: u8 = 5;

/// The accepted files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dialect {
    /// Files that can be downloaded: types 6 and 8, 8 address digits, 1 to 32 bytes a record, CR LF.
    Ti,
    /// Also files of GNU objcopy and srecord: symbols, 1 to 16 address digits, up to 124 bytes a record, LF,
    /// a last line without an end.
    Gnu,
}

/// Reads a file byte by byte and returns its records, one per line.
#[derive(Clone, Debug)]
pub struct Reader {
    dialect: Dialect,
    decoder: Decoder,
    records: u32,
    line: Vec<u8, { LONGEST as usize }>,
    cr: bool,
    /// The line's record has been returned.
    closed: bool,
    ended: bool,
    failed: Option<TekError>,
}

impl Reader {
    /// At the start of a file.
    #[must_use]
    pub fn new(dialect: Dialect) -> Self {
        Self {
            dialect,
            decoder: Decoder::default(),
            records: 0,
            line: Vec::new(),
            cr: false,
            closed: false,
            ended: false,
            failed: None,
        }
    }

    /// Takes the next byte of the file; the end of a line returns its record.
    ///
    /// # Errors
    /// The defect of the file up to this byte. The error persists: it is returned for every further byte.
    pub fn push(&mut self, byte: u8) -> Result<Option<Record<'_>>, TekError> {
        if let Some(error) = self.failed {
            return Err(error);
        }
        if self.closed {
            self.line.clear();
            (self.cr, self.closed) = (false, false);
        }
        if let Err((column, kind)) = self.gather(byte) {
            return Err(self.fail(column, kind));
        }
        if byte != b'\n' {
            return Ok(None);
        }
        let deviation = (!self.cr).then_some(TekErrorKind::LineEnd { found: Some(b'\n') });
        self.close(deviation)?;
        Ok(self.decoder.last())
    }

    /// Ends the file. Returns the last line's record if that line has no end.
    ///
    /// # Errors
    /// The defect of that line, or a missing termination record.
    pub fn finish(&mut self) -> Result<Option<Record<'_>>, TekError> {
        if let Some(error) = self.failed {
            return Err(error);
        }
        let open = !self.closed && !self.line.is_empty();
        if open {
            let found = self.cr.then_some(b'\r');
            self.close(Some(TekErrorKind::LineEnd { found }))?;
        }
        if !self.ended {
            return Err(self.fail(1, TekErrorKind::NoEnd));
        }
        Ok(if open { self.decoder.last() } else { None })
    }

    /// The address range of the section that the record just returned defines, if it is a GNU symbol record. Its bytes are 0
    /// where no data record has a value; data outside of all sections are padding.
    #[must_use]
    pub fn section(&self) -> Option<Range<u64>> {
        if !self.closed || self.line.get(3) != Some(&b'3') {
            return None;
        }
        let (_name, rest) = counted(self.line.get(6..)?)?;
        let (start, rest) = counted(rest.strip_prefix(b"1")?)?;
        let (end, _) = counted(rest)?;
        let range = number(start)?..number(end)?;
        (range.start <= range.end).then_some(range)
    }

    /// Adds a byte to the line, or returns the column and the defect.
    fn gather(&mut self, found: u8) -> Result<(), (u32, TekErrorKind)> {
        let here = self.after_line();
        if self.ended {
            return Err((here, TekErrorKind::AfterEnd { found }));
        }
        if self.line.is_empty() && found != b'%' {
            return Err((here, TekErrorKind::Start { found }));
        }
        match found {
            b'\n' => return Ok(()),
            _ if self.cr => return Err((here, TekErrorKind::Character { found: b'\r' })),
            b'\r' => {
                self.cr = true;
                return Ok(());
            }
            // Other invalid characters are left to the decoder, once the line is as long as its length field.
            _ if !found.is_ascii_graphic() => return Err((here, TekErrorKind::Character { found })),
            _ => {}
        }
        let expected = if self.dialect == Dialect::Ti { MAX_LINE } else { LONGEST };
        if self.line.len() >= usize::from(expected) || self.line.push(found).is_err() {
            return Err((here, TekErrorKind::Long { expected }));
        }
        Ok(())
    }

    /// `deviation` is that of the line's end.
    fn close(&mut self, deviation: Option<TekErrorKind>) -> Result<(), TekError> {
        self.closed = true;
        if let Err((column, kind)) = self.fits() {
            return Err(self.fail(column, kind));
        }
        for &character in self.line.iter().skip(1) {
            if let Err(error) = self.decoder.push(character) {
                self.failed = Some(error);
                return Err(error);
            }
        }
        let deviation = self.deviates().or(deviation.map(|kind| (self.after_line(), kind)));
        if let (Dialect::Ti, Some((column, kind))) = (self.dialect, deviation) {
            return Err(self.fail(column, kind));
        }
        self.records = self.records.saturating_add(1);
        self.ended = matches!(self.decoder.last(), Some(Record::End { .. }));
        Ok(())
    }

    /// Whether the line is as long as its length field. An invalid field is left to the decoder.
    fn fits(&self) -> Result<(), (u32, TekErrorKind)> {
        // At most 255.
        let found = u8::try_from(self.line.len().saturating_sub(1)).unwrap_or(u8::MAX);
        let field = |at: usize| self.line.get(at).map(|&character| digit(character));
        let expected = match (field(1), field(2)) {
            (Some(Some(high)), Some(Some(low))) => high << 4 | low,
            (Some(Some(_)) | None, None) => SHORTEST,
            _ => return Ok(()),
        };
        if expected < SHORTEST || found == expected {
            return Ok(());
        }
        let column = if found < expected { self.after_line() } else { u32::from(expected) + 2 };
        Err((column, TekErrorKind::Line { found, expected }))
    }

    fn deviates(&self) -> Option<(u32, TekErrorKind)> {
        let bytes = match self.decoder.last()? {
            Record::Symbols => return Some((4, TekErrorKind::Symbols)),
            Record::Data { bytes, .. } => Some(bytes.len()),
            Record::End { .. } => None,
        };
        let width = self.line.get(6).and_then(|&count| digit(count))?;
        if width != 8 {
            let found = if width == 0 { 16 } else { width };
            return Some((7, TekErrorKind::AddressWidth { found }));
        }
        let found = bytes.filter(|bytes| !(1..=DATA_BYTES).contains(bytes))?;
        // At most 124.
        Some((16, TekErrorKind::DataBytes { found: u8::try_from(found).unwrap_or(u8::MAX) }))
    }

    fn after_line(&self) -> u32 {
        u32::try_from(self.line.len()).unwrap_or(u32::MAX).saturating_add(1)
    }

    fn fail(&mut self, column: u32, kind: TekErrorKind) -> TekError {
        let record = self.records.saturating_add(1);
        let error = TekError { record, line: record, column, kind };
        self.failed = Some(error);
        error
    }
}

fn counted(text: &[u8]) -> Option<(&[u8], &[u8])> {
    let (&count, rest) = text.split_first()?;
    let count = digit(count)?;
    rest.split_at_checked(if count == 0 { 16 } else { usize::from(count) })
}

fn number(digits: &[u8]) -> Option<u64> {
    digits.iter().try_fold(0, |number, &character| Some(number << 4 | u64::from(digit(character)?)))
}
