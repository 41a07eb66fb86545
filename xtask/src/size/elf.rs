//! A linked program for the analyses: loaded sections, symbols by address, code and data.

use std::collections::BTreeMap;
use std::path::Path;

use object::elf::{SHF_ALLOC, SHF_EXECINSTR, SHT_NOBITS};
use object::read::elf::ElfFile32;
use object::{Object, ObjectSection, ObjectSymbol, SectionFlags, SymbolKind};
use tater_f103::map::RAM;

use crate::{Failure, files};

#[derive(Debug)]
pub struct Section {
    pub name: String,
    pub start: u32,
    pub len: u32,
    /// Empty for .bss.
    pub bytes: Vec<u8>,
    pub code: bool,
}

impl Section {
    pub const fn in_ram(&self) -> bool {
        self.start >= RAM.start && self.start < RAM.end()
    }

    /// Whether it is in flash, also if copied to RAM at the start.
    pub const fn in_flash(&self) -> bool {
        !self.bytes.is_empty()
    }

    pub const fn end(&self) -> u32 {
        self.start + self.len
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Symbol {
    pub name: String,
    pub start: u32,
    /// 0 for most assembler symbols.
    pub len: u32,
    /// A function; `start` has no Thumb bit.
    pub function: bool,
}

#[derive(Debug)]
pub struct Program {
    pub sections: Vec<Section>,
    /// Sorted by address.
    pub symbols: Vec<Symbol>,
    /// Start addresses of code (`$t`) and data (`$d`), as marked by the assembler.
    pub code: BTreeMap<u32, bool>,
}

impl Program {
    /// # Errors
    /// Not a readable 32-bit ELF file, or without symbols.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        let data = files::read(path)?;
        Self::parse(&data).map_err(|error| Failure::Unusable(format!("{}: {error}", path.display())))
    }

    /// As [`Self::read`], from bytes.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn parse(data: &[u8]) -> Result<Self, String> {
        let damaged = |error: object::Error| {
            format!(
                "found {error}, expected a linked 32-bit ELF file\n  next: build it again, by cargo xtask image"
            )
        };
        let file: ElfFile32 = ElfFile32::parse(data).map_err(damaged)?;
        let mut sections = Vec::new();
        for section in file.sections() {
            let SectionFlags::Elf { sh_flags, .. } = section.flags() else { continue };
            let number =
                |value: u64| u32::try_from(value).map_err(|_| "found an address of more than 32 bits");
            let (start, len) = (number(section.address())?, number(section.size())?);
            if !sh_flags.contains(SHF_ALLOC) || len == 0 {
                continue;
            }
            let nothing = section.elf_section_header().sh_type.get(object::Endianness::Little) == SHT_NOBITS;
            let bytes = if nothing { Vec::new() } else { section.data().map_err(damaged)?.to_vec() };
            let name = section.name().map_err(damaged)?.to_owned();
            sections.push(Section { name, start, len, bytes, code: sh_flags.contains(SHF_EXECINSTR) });
        }
        let (mut symbols, mut code) = (Vec::new(), BTreeMap::new());
        for symbol in file.symbols() {
            let (Ok(start), Ok(len)) = (u32::try_from(symbol.address()), u32::try_from(symbol.size())) else {
                continue;
            };
            let name = symbol.name().map_err(damaged)?.to_owned();
            if name.starts_with("$t") || name.starts_with("$d") {
                code.insert(start, name.starts_with("$t"));
            } else if !symbol.is_undefined() && !name.is_empty() && symbol.kind() != SymbolKind::File {
                let function = symbol.kind() == SymbolKind::Text;
                symbols.push(Symbol {
                    name,
                    start: if function { start & !1 } else { start },
                    len,
                    function,
                });
            }
        }
        if symbols.is_empty() || code.is_empty() {
            return Err("found no symbols, expected a program that is not stripped\n  next: build it again, by cargo xtask image".into());
        }
        symbols.sort_by(|a, b| (a.start, b.len, &a.name).cmp(&(b.start, a.len, &b.name)));
        Ok(Self { sections, symbols, code })
    }

    pub fn section(&self, address: u32) -> Option<&Section> {
        self.sections.iter().find(|section| (section.start..section.end()).contains(&address))
    }

    /// The bytes from an address to the end of its section.
    pub fn bytes(&self, address: u32) -> &[u8] {
        self.section(address)
            .and_then(|section| section.bytes.get(usize::try_from(address - section.start).ok()?..))
            .unwrap_or_default()
    }

    pub fn word(&self, address: u32) -> Option<u32> {
        Some(u32::from_le_bytes(self.bytes(address).get(..4)?.try_into().ok()?))
    }

    pub fn is_code(&self, address: u32) -> bool {
        self.section(address).is_some_and(|section| section.code)
            && self.code.range(..=address).next_back().is_some_and(|(_, &code)| code)
    }

    /// The end of the data at `address`.
    pub fn next_code(&self, address: u32) -> Option<u32> {
        self.code.range(address..).find(|&(_, &code)| code).map(|(&start, _)| start)
    }

    pub fn names(&self, address: u32) -> impl Iterator<Item = &Symbol> {
        let first = self.symbols.partition_point(|symbol| symbol.start < address);
        self.symbols[first..].iter().take_while(move |symbol| symbol.start == address)
    }
}

/// A symbol's name as in the source, without Rust's hash.
pub fn plain(name: &str) -> String {
    format!("{:#}", rustc_demangle::demangle(name))
}
