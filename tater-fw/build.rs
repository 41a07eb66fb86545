//! Writes the linker scripts of the two programs from the memory map in `tater_wire::memory`.

use std::path::{Path, PathBuf};
use std::{env, fs};

use tater_wire::memory::{APPLICATION, Area, KEPT, MONITOR, STACK, STATICS};

/// The stack lies below the variables: one that overflows leaves the RAM, which is a fault, and overwrites nothing.
fn script(flash: Area) -> String {
    let Area { start, len } = flash;
    format!(
        "MEMORY\n{{\n  FLASH : ORIGIN = {start:#010x}, LENGTH = {len:#x}\n  RAM : ORIGIN = {:#010x}, LENGTH = {:#x}\n}}\n\
         _stack_start = {:#010x};\n_stack_end = {:#010x};\n_kept = {:#010x};\n",
        STATICS.start,
        STATICS.len,
        STACK.end(),
        STACK.start,
        KEPT.start,
    )
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo::rerun-if-changed=build.rs");
    if env::var("CARGO_CFG_TARGET_OS")? != "none" {
        return Ok(());
    }
    let out = PathBuf::from(env::var("OUT_DIR")?);
    for (program, flash) in [("tater", APPLICATION), ("monitor", MONITOR)] {
        let folder = out.join(program);
        fs::create_dir_all(&folder)?;
        fs::write(folder.join("memory.x"), script(flash))?;
        link(program, &folder);
    }
    Ok(())
}

fn link(program: &str, folder: &Path) {
    let argument = |text: &str| println!("cargo::rustc-link-arg-bin={program}={text}");
    argument(&format!("-L{}", folder.display()));
    argument("-Tlink.x");
    // Or the file's own headers become a segment at the 64 KiB boundary below: in the monitor.
    argument("--nmagic");
    if program == "tater" && env::var_os("CARGO_FEATURE_LOG").is_some() {
        argument("-Tdefmt.x");
    }
}
