//! Whole files: lines, their ends, and which dialect they keep.

use core::ops::Range;

use heapless::Vec;

use super::{DATA_BYTES, Decoder, Record, TekError, TekErrorKind, digit};

/// Most characters of a line that hosts download, without its end: they read no more of one.
pub const MAX_LINE: u16 = 98;

/// `%` and what the length field can say.
const LONGEST: u16 = 256;

/// Characters of the shortest record.
const SHORTEST: u8 = 5;

/// Which files are taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dialect {
    /// What can be downloaded: types 6 and 8, 8 address digits, 1 to 32 bytes a record, CR LF.
    Ti,
    /// What GNU objcopy and srecord write as well: symbols, 1 to 16 address digits, up to 124 bytes a record, LF, a
    /// last line without an end.
    Gnu,
}

/// Takes a file byte by byte and gives its records, one a line.
#[derive(Clone, Debug)]
pub struct Reader {
    dialect: Dialect,
    decoder: Decoder,
    /// Records that have been given.
    records: u32,
    line: Vec<u8, { LONGEST as usize }>,
    /// A CR came after the line.
    cr: bool,
    /// The line's record has been given.
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

    /// The next byte of the file; the end of a line gives its record.
    ///
    /// # Errors
    /// What is wrong with the file up to this byte. That error stays: it answers every further byte.
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

    /// The file ends here. Gives the last line's record if that line has no end.
    ///
    /// # Errors
    /// What is wrong with that line, or that there is no termination record.
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

    /// The addresses of the section that the record just given defines, if it is a symbol record of GNU's kind: its
    /// bytes are 0 where no data record says otherwise, and data outside of all sections are padding.
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

    /// Takes a byte into the line, or says in which column what is wrong.
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
            // What else may not be in a record is the decoder's to say, once the line is as long as its field says.
            _ if !found.is_ascii_graphic() => return Err((here, TekErrorKind::Character { found })),
            _ => {}
        }
        let expected = if self.dialect == Dialect::Ti { MAX_LINE } else { LONGEST };
        if self.line.len() >= usize::from(expected) || self.line.push(found).is_err() {
            return Err((here, TekErrorKind::Long { expected }));
        }
        Ok(())
    }

    /// Decodes a whole line; `deviation` is what is unusual about its end.
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

    /// Whether the line is as long as its length field says. A field that is wrong by itself is left to the decoder.
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

    /// How the record just decoded is not as TI writes it.
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

    /// The column after the last character.
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
