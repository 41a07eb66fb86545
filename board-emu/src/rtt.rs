//! defmt logs from the RTT buffer in a program's RAM, read as a debug probe reads it.
//!
//! SEGGER's control block is at the symbol `_SEGGER_RTT`: a mark of 16 bytes, the numbers of up and down
//! channels, and for each channel the words name, buffer, length, write index, read index and flags.

use std::path::Path;

use defmt_decoder::{DecodeError, StreamDecoder, Table};
use object::read::elf::ElfFile32;
use object::{Object, ObjectSymbol};

use crate::chip::{Chip, Size};

const MARK: &[u8] = b"SEGGER RTT";

/// Offset of up channel 0, and of its words.
const CHANNEL: u32 = 24;
const BUFFER: u32 = CHANNEL + 4;
const LENGTH: u32 = CHANNEL + 8;
const WRITE: u32 = CHANNEL + 12;
const READ: u32 = CHANNEL + 16;

/// A probe on one board.
pub struct Probe {
    block: u32,
    decoder: Box<dyn StreamDecoder + Send + Sync>,
}

impl Probe {
    /// A probe for the program of this ELF file.
    ///
    /// # Errors
    /// The file cannot be read, or its program has no logs.
    pub fn new(elf: &Path) -> Result<Self, String> {
        let wrong = |what: String| format!("{}: {what}", elf.display());
        let bytes = crate::image::read(elf)?;
        let silent = || wrong("the program does not log\n  next: give --profile release".to_owned());
        let table = Table::parse(&bytes).map_err(|error| wrong(format!("its defmt table: {error}")))?;
        let table = table.filter(|table| !table.is_empty()).ok_or_else(silent)?;
        let file: ElfFile32 = ElfFile32::parse(&*bytes).map_err(|error| wrong(error.to_string()))?;
        let mut symbols = file.symbols().filter(|symbol| symbol.name() == Ok("_SEGGER_RTT"));
        let block =
            symbols.next().and_then(|symbol| u32::try_from(symbol.address()).ok()).ok_or_else(silent)?;
        // Decoder and table live until the program ends.
        let table: &'static Table = Box::leak(Box::new(table));
        Ok(Self { block, decoder: table.new_stream_decoder() })
    }

    /// Takes new log lines.
    pub fn read(&mut self, chip: &mut Chip) -> Vec<String> {
        let bytes = self.take(chip).unwrap_or_default();
        self.decoder.received(&bytes);
        let mut lines = Vec::new();
        loop {
            match self.decoder.decode() {
                Ok(frame) => {
                    let level = frame.level().map_or("", |level| level.as_str());
                    lines.push(format!("{level} {}", frame.display_message()));
                }
                Err(DecodeError::UnexpectedEof) => return lines,
                // An incomplete frame: the buffer was full or the board was reset.
                Err(DecodeError::Malformed) => lines.push("(lost)".to_owned()),
            }
        }
    }

    /// The bytes between read and write index; `None` before the program has initialized the block.
    fn take(&self, chip: &mut Chip) -> Option<Vec<u8>> {
        let byte = |chip: &mut Chip, at: u32| chip.read(at, Size::Byte).ok().map(|byte| byte as u8);
        let mark: Option<Vec<u8>> = (self.block..).take(MARK.len()).map(|at| byte(chip, at)).collect();
        if mark? != MARK {
            return None;
        }
        let mut word = |offset: u32| chip.read(self.block + offset, Size::Word).ok();
        let (buffer, len, write, mut read) = (word(BUFFER)?, word(LENGTH)?, word(WRITE)?, word(READ)?);
        if len == 0 || write >= len || read >= len {
            return None;
        }
        let mut bytes = Vec::new();
        while read != write {
            bytes.push(byte(chip, buffer + read)?);
            read = (read + 1) % len;
        }
        chip.write(self.block + READ, Size::Word, read).ok()?;
        Some(bytes)
    }
}
