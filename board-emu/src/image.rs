//! The programs: bytes for the flash, and names of functions.

use std::path::Path;

use object::read::elf::ElfFile32;
use object::{Object, ObjectSymbol, SymbolKind};

/// Functions by address.
#[derive(Clone, Debug, Default)]
pub struct Names {
    /// Start, length, name; sorted by start.
    functions: Vec<(u32, u32, String)>,
}

impl Names {
    /// Adds the functions of an ELF file.
    ///
    /// # Errors
    /// The file is not a readable ELF file.
    pub fn add(&mut self, path: &Path) -> Result<(), String> {
        let bytes =
            std::fs::read(path).map_err(|error| format!("{}: cannot be read: {error}", path.display()))?;
        let elf: ElfFile32 = ElfFile32::parse(&*bytes)
            .map_err(|error| format!("{}: is no 32-bit ELF file: {error}", path.display()))?;
        for symbol in elf.symbols().filter(|symbol| symbol.kind() == SymbolKind::Text) {
            let (Ok(name), Ok(start)) = (symbol.name(), u32::try_from(symbol.address())) else { continue };
            let name = format!("{:#}", rustc_demangle::demangle(name));
            self.functions.push((start & !1, symbol.size() as u32, name));
        }
        self.functions.sort();
        Ok(())
    }

    /// The function that contains an address.
    #[must_use]
    pub fn function(&self, address: u32) -> Option<&str> {
        let after = self.functions.partition_point(|&(start, ..)| start <= address);
        let before = self.functions.get(..after)?;
        before
            .iter()
            .rev()
            .take(4)
            .find(|(start, len, _)| address - start < *len)
            .map(|(.., name)| name.as_str())
    }

    /// Start of the function of this name, or whose path ends in `::name`.
    #[must_use]
    pub fn address(&self, name: &str) -> Option<u32> {
        let tail = format!("::{name}");
        let hit = |(.., full): &&(u32, u32, String)| full == name || full.ends_with(&tail);
        self.functions.iter().find(hit).map(|&(start, ..)| start)
    }
}

/// The images that are flashed and downloaded.
#[derive(Clone, Debug)]
pub struct Programs {
    /// `monitor.bin`, from the start of the flash.
    pub monitor: Vec<u8>,
    /// `tater.bin`, sealed.
    pub application: Vec<u8>,
    /// `tater.tek`.
    pub tek: String,
    /// Functions of both programs.
    pub names: std::rc::Rc<Names>,
}

impl Programs {
    /// Reads a folder written by `cargo xtask image`.
    ///
    /// # Errors
    /// The missing file, and the command that makes it.
    pub fn load(folder: &Path) -> Result<Self, String> {
        let read = |name: &str| {
            let path = folder.join(name);
            let next = "make it with: cargo xtask image --profile PROFILE";
            std::fs::read(&path)
                .map_err(|error| format!("{}: cannot be read: {error}\n  next: {next}", path.display()))
        };
        let mut names = Names::default();
        names.add(&folder.join("monitor.elf"))?;
        names.add(&folder.join("tater.elf"))?;
        let tek = String::from_utf8(read("tater.tek")?).map_err(|error| format!("tater.tek: {error}"))?;
        let names = std::rc::Rc::new(names);
        Ok(Self { monitor: read("monitor.bin")?, application: read("tater.bin")?, tek, names })
    }
}
