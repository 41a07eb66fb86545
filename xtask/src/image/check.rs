//! CI step: the forms of an image agree, and another checkout builds the same bytes.

use std::fs;
use std::path::Path;

use tater_f103::map::APPLICATION;

use super::{Profile, build, folder, is_checkout, make};
use crate::program::{output, program, root, run, target};
use crate::{Failure, Outcome, files, tek};

/// Builds and checks an image.
///
/// # Errors
/// A difference, or a failed build.
pub fn check(profile: Profile) -> Outcome {
    let agreed = build(profile).and_then(|_| agree(&folder(profile)));
    agreed.map_err(|error| repeatable(String::from(error), profile))
}

/// Adds the command that repeats an error, if it has none.
fn repeatable(error: String, profile: Profile) -> String {
    if error.contains("repeat with: ") {
        return error;
    }
    format!("{error}\n  repeat with: cargo xtask image --profile {}", profile.name())
}

/// Checks that the three forms of the application hold the same bytes, and that a board accepts them.
fn agree(folder: &Path) -> Result<(), Failure> {
    let (file, decoded) = (folder.join("tater.tek"), folder.join("decoded.bin"));
    // Also checks line lengths and characters.
    tek::tek(&tek::Chore::Verify { file: file.clone() })?;
    wraptor::Firmware::new(files::read(&file)?).map_err(|error| tek::defect(&file, &error))?;
    tek::tek(&tek::Chore::Decode { file: file.clone(), output: decoded.clone(), bytes_per_address: 1 })?;
    let flat = files::read(&folder.join("tater.bin"))?;
    same(&file, &files::read(&decoded)?, &flat)?;
    // A temporary file; harmless if it stays.
    let _ = fs::remove_file(&decoded);
    // A debug probe leaves erased flash behind the last byte.
    let elf = folder.join("tater.elf");
    let (start, mut loaded) = tek::flat(&files::read(&elf)?)?;
    loaded.resize(loaded.len().next_multiple_of(4), tek::ERASED);
    if start != u64::from(APPLICATION.start) {
        let found = format!("{}: found a first address of {start:#010x}", elf.display());
        return Err(Failure::Judged(format!("{found}, expected {:#010x}", APPLICATION.start)));
    }
    same(&elf, &loaded, &flat)
}

/// Builds the production image, and that of HEAD in another folder, and compares.
///
/// # Errors
/// A difference, or a failed build.
pub fn reproducible() -> Outcome {
    build(Profile::Production)
        .map_err(String::from)
        .and_then(|_| second_build())
        .map_err(|error| repeatable(error, Profile::Production))
}

fn second_build() -> Outcome {
    if !is_checkout() {
        println!("  skipped: no git checkout, so no second one to compare with");
        return Ok(());
    }
    // Untracked files are in no image.
    let Ok(changes) = output(program("git status --porcelain --untracked-files=no")) else {
        println!("  skipped: git refuses to read this checkout, for the reason above");
        return Ok(());
    };
    if let Some(first) = changes.lines().next() {
        let first = first.get(3..).unwrap_or(first);
        println!(
            "  skipped: uncommitted changes ({first}), and a second checkout would be of HEAD, without them"
        );
        return Ok(());
    }
    let second = target().join("second checkout");
    clear(&second)?;
    let mut clone = program("git clone --quiet --shared");
    clone.arg(root()).arg(&second);
    run(clone)?;
    let first = folder(Profile::Production);
    let made = make(&second, &second.join("build"), Profile::Production)?;
    for (name, bytes) in made.files() {
        same(&first.join(name), &files::read(&first.join(name))?, bytes).map_err(|error| {
            format!("{}\n  the second is of another checkout, {}", String::from(error), second.display())
        })?;
    }
    println!("  another checkout gave the same .tek, .bin and .elf");
    clear(&second)
}

fn clear(folder: &Path) -> Outcome {
    if !folder.exists() {
        return Ok(());
    }
    fs::remove_dir_all(folder).map_err(|error| format!("{}: cannot be removed: {error}", folder.display()))
}

fn same(file: &Path, found: &[u8], expected: &[u8]) -> Result<(), Failure> {
    if found == expected {
        return Ok(());
    }
    let at = found.iter().zip(expected).position(|(a, b)| a != b).unwrap_or(found.len().min(expected.len()));
    let (place, lens) = (file.display(), format!("{} and {} bytes", found.len(), expected.len()));
    Err(Failure::Judged(format!(
        "{place}: found two that differ from byte {at} on ({lens}), expected the same"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_has_one_repeat_command() {
        let bare = repeatable("a differs".into(), Profile::Release);
        assert_eq!(bare, "a differs\n  repeat with: cargo xtask image --profile release");
        assert_eq!(repeatable(bare.clone(), Profile::Production), bare);
    }

    #[test]
    fn first_different_byte_is_named() {
        let said = |found: &[u8], expected: &[u8]| {
            same(Path::new("a"), found, expected).err().map(String::from).unwrap_or_default()
        };
        assert_eq!(said(b"abc", b"abc"), "");
        assert!(said(b"abc", b"abd").contains("from byte 2 on (3 and 3 bytes)"));
        assert!(said(b"ab", b"abd").contains("from byte 2 on (2 and 3 bytes)"));
        assert!(said(b"abc", b"ab").contains("from byte 2 on (3 and 2 bytes)"));
    }
}
