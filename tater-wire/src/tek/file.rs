//! Whole files: lines, line ends, and dialects.
//!
//! What editors, mail and transfers do to a text file is accepted, because each record has its checksum: lines that end with LF, CR or
//! CR LF, blanks at their end, empty lines, a last line without an end, a UTF-8 byte order mark, ^Z or NUL after the last line, and a
//! repeated termination record, which published firmware has.

use core::ops::Range;

use heapless::Vec;

use super::character::digit;
use super::decode::{Decoder, Record};
use super::encode::DATA_BYTES;
use super::error::{Foreign, TekError, TekErrorKind};

/// Most characters of a line in a download, without its end: hosts read no more.
pub const MAX_LINE: u16 = 98;

/// `%` and the largest length field.
const LONGEST: u16 = 256;

const SHORTEST: u8 = 5;

/// `%`, LL, T, CC, the number of digits and 16 digits.
const LONGEST_END: usize = 23;

/// The end of a text file for CP/M, DOS and XMODEM.
const CONTROL_Z: u8 = 0x1A;

/// The accepted files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dialect {
    /// Files that can be downloaded: types 6 and 8, 8 address digits, 1 to 32 bytes a record.
    Ti,
    /// Also files of GNU objcopy and srecord: symbols, 1 to 16 address digits, up to 124 bytes a record.
    Gnu,
}

/// Reads a file byte by byte and returns its records, one per line.
#[derive(Clone, Debug)]
pub struct Reader {
    dialect: Dialect,
    decoder: Decoder,
    records: u32,
    /// Number of the line, from 1.
    number: u32,
    line: Vec<u8, { LONGEST as usize }>,
    /// Blanks after the line's characters.
    blanks: u32,
    /// First bytes of the file while they may be a byte order mark; `None` after them.
    mark: Option<Vec<u8, 3>>,
    /// The last byte was a CR, whose LF may follow.
    cr: bool,
    /// The line's record has been returned.
    closed: bool,
    /// ^Z has come.
    finished: bool,
    /// The termination record, once it has come.
    termination: Option<Vec<u8, LONGEST_END>>,
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
            number: 1,
            line: Vec::new(),
            blanks: 0,
            mark: Some(Vec::new()),
            cr: false,
            closed: false,
            finished: false,
            termination: None,
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
            self.next_line();
        }
        if core::mem::replace(&mut self.cr, byte == b'\r') && byte == b'\n' {
            return Ok(None);
        }
        let ends = matches!(byte, b'\n' | b'\r' | CONTROL_Z);
        if ends && !self.in_mark() {
            let open = !self.line.is_empty();
            self.finished |= byte == CONTROL_Z;
            if open {
                return self.close();
            }
            if byte != CONTROL_Z {
                self.next_line();
            }
            return Ok(None);
        }
        self.gather(byte).map_err(|(column, kind)| self.fail(column, kind))?;
        Ok(None)
    }

    /// Ends the file. Returns the last line's record if that line has no end.
    ///
    /// # Errors
    /// The defect of that line, or a missing termination record.
    pub fn finish(&mut self) -> Result<Option<Record<'_>>, TekError> {
        if let Some(error) = self.failed {
            return Err(error);
        }
        if let Some(&[found, ..]) = self.mark.as_deref() {
            return Err(self.fail(1, TekErrorKind::Start { found }));
        }
        let open = !self.closed && !self.line.is_empty();
        let repeated = self.termination.is_some();
        if open {
            self.close()?;
        }
        if self.termination.is_none() {
            self.number = self.number.saturating_add(self.closed.into());
            return Err(self.fail(1, TekErrorKind::NoEnd));
        }
        Ok(if open && !repeated { self.decoder.last() } else { None })
    }

    /// Number of the line whose record has just been returned, from 1.
    #[must_use]
    pub const fn line(&self) -> u32 {
        self.number
    }

    /// Characters of the record that has just been returned, from `%` on, without blanks and the line's end.
    #[must_use]
    pub fn characters(&self) -> &[u8] {
        &self.line
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

    fn next_line(&mut self) {
        self.line.clear();
        (self.blanks, self.closed) = (0, false);
        self.number = self.number.saturating_add(1);
    }

    /// Whether the file's first bytes may still become a byte order mark.
    fn in_mark(&self) -> bool {
        self.mark.as_ref().is_some_and(|mark| !mark.is_empty())
    }

    /// Adds a byte to the line, or returns the column and the defect.
    fn gather(&mut self, found: u8) -> Result<(), (u32, TekErrorKind)> {
        let here = self.after_line();
        if self.records == 0 && self.line.is_empty() && self.recognize(found)? {
            return Ok(());
        }
        if self.finished || self.termination.is_some() {
            return self.gather_after_end(found, here);
        }
        if found == b' ' || found == b'\t' {
            self.blanks = self.blanks.saturating_add(1);
            return Ok(());
        }
        if self.line.is_empty() && (found != b'%' || self.blanks > 0) {
            let found = if self.blanks > 0 { b' ' } else { found };
            return Err((here, TekErrorKind::Start { found }));
        }
        if self.records == 0 && self.line.len() == 1 && found == 0 {
            return Err((1, TekErrorKind::Foreign { found: Foreign::Utf16 }));
        }
        if self.blanks > 0 {
            return Err((here, TekErrorKind::Character { found: b' ' }));
        }
        // Other invalid characters are left to the decoder, once the line is as long as its length field.
        if !found.is_ascii_graphic() {
            return Err((here, TekErrorKind::Character { found }));
        }
        let expected = if self.dialect == Dialect::Ti { MAX_LINE } else { LONGEST };
        if self.line.len() >= usize::from(expected) || self.line.push(found).is_err() {
            return Err((here, TekErrorKind::Long { expected }));
        }
        Ok(())
    }

    /// After the termination record, which may be repeated: blanks, line ends and padding.
    fn gather_after_end(&mut self, found: u8, here: u32) -> Result<(), (u32, TekErrorKind)> {
        let termination = self.termination.as_deref().unwrap_or_default();
        let repeats = termination.get(self.line.len()) == Some(&found) && self.blanks == 0 && !self.finished;
        match found {
            b' ' | b'\t' => self.blanks = self.blanks.saturating_add(1),
            0 if self.line.is_empty() => {}
            _ if repeats => {
                // No longer than the termination record.
                let _ = self.line.push(found);
            }
            _ => return Err((here, TekErrorKind::AfterEnd { found })),
        }
        Ok(())
    }

    /// Whether a byte before the first record belongs to a UTF-8 byte order mark, which is skipped.
    fn recognize(&mut self, found: u8) -> Result<bool, (u32, TekErrorKind)> {
        let foreign = |found| Err((1, TekErrorKind::Foreign { found }));
        let Some(mark) = self.mark.as_mut().filter(|_| self.number == 1) else { return Ok(false) };
        // The patterns below have at most 3 bytes.
        let _ = mark.push(found);
        match *mark.as_slice() {
            [0xEF] | [0xEF, 0xBB] | [0xFE] | [0xFF] | [0] | [b':'] | [b'S'] => Ok(true),
            [0xEF, 0xBB, 0xBF] => {
                self.mark = None;
                Ok(true)
            }
            [0xFE, 0xFF] | [0xFF, 0xFE] | [0, b'%'] => foreign(Foreign::Utf16),
            [b':', digit] if digit.is_ascii_hexdigit() => foreign(Foreign::IntelHex),
            [b'S', b'0'..=b'9'] => foreign(Foreign::SRecord),
            [found @ (b':' | b'S'), _] => Err((1, TekErrorKind::Start { found })),
            [b' ' | b'\t' | b'!'..=b'~'] => {
                self.mark = None;
                Ok(false)
            }
            _ => foreign(Foreign::Binary),
        }
    }

    /// Ends a line that is not empty, and returns its record.
    fn close(&mut self) -> Result<Option<Record<'_>>, TekError> {
        self.closed = true;
        if let Some(termination) = &self.termination {
            // The characters are those of the termination record; some may be missing.
            return match self.line.len() == termination.len() {
                true => Ok(None),
                false => Err(self.fail(1, TekErrorKind::AfterEnd { found: b'%' })),
            };
        }
        if let Err((column, kind)) = self.fits() {
            return Err(self.fail(column, kind));
        }
        for &character in self.line.iter().skip(1) {
            if let Err(error) = self.decoder.push(character) {
                let error = TekError { line: self.number, ..error };
                self.failed = Some(error);
                return Err(error);
            }
        }
        if let (Dialect::Ti, Some((column, kind))) = (self.dialect, self.deviates()) {
            return Err(self.fail(column, kind));
        }
        self.records = self.records.saturating_add(1);
        if matches!(self.decoder.last(), Some(Record::End { .. })) {
            // Its length has been checked.
            self.termination = Vec::from_slice(&self.line).ok();
        }
        Ok(self.decoder.last())
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
        let error = TekError { record, line: self.number, column, kind };
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
