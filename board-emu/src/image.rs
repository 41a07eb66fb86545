//! The programs: bytes for the flash, and names of functions.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use object::read::elf::ElfFile32;
use object::{Object, ObjectSymbol, SymbolKind};

/// Longest file of an image, bytes: a program with debug information has a few MiB.
const MAX_BYTES: u64 = 64 << 20;

/// # Errors
/// The file cannot be read, or has no end (a device).
pub(crate) fn read(path: &Path) -> Result<Vec<u8>, String> {
    let wrong = |what: String| format!("{}: cannot be read: {what}", path.display());
    let mut bytes = Vec::new();
    let read = File::open(path).and_then(|file| file.take(MAX_BYTES + 1).read_to_end(&mut bytes));
    read.map_err(|error| wrong(error.to_string()))?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(wrong(format!("found more than {} MiB, expected a file of an image", MAX_BYTES >> 20)));
    }
    Ok(bytes)
}

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
        let bytes = read(path)?;
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
            self::read(&path).map_err(|error| format!("{error}\n  next: {next}"))
        };
        let mut names = Names::default();
        names.add(&folder.join("monitor.elf"))?;
        names.add(&folder.join("tater.elf"))?;
        let tek = String::from_utf8(read("tater.tek")?).map_err(|error| format!("tater.tek: {error}"))?;
        let names = std::rc::Rc::new(names);
        Ok(Self { monitor: read("monitor.bin")?, application: read("tater.bin")?, tek, names })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Without a limit it would fill the memory.
    #[cfg(unix)]
    #[test]
    fn file_without_an_end_is_refused() {
        let error = Names::default().add(Path::new("/dev/zero")).expect_err("it has no end");
        assert!(error.starts_with("/dev/zero: cannot be read: found more than 64 MiB"), "{error}");
    }
}
