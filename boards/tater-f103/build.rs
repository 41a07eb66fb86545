//! Writes the linker scripts of the programs from the memory map.

#[path = "src/map.rs"]
#[allow(dead_code, reason = "the programs use all of it")]
mod map;

use std::path::{Path, PathBuf};
use std::{env, fs};

use map::{APPLICATION, MAP, MONITOR};
use tater_wire::map::Script;

/// Port B's BRR (RM0008 9.2.6): pin 5 low engages the brake.
const SAFE: [u32; 2] = [0x4001_0C14, 1 << 5];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=src/map.rs");
    if env::var("CARGO_CFG_TARGET_OS")? != "none" {
        return Ok(());
    }
    let out = PathBuf::from(env::var("OUT_DIR")?);
    let [register, value] = SAFE;
    let safe = format!("_safe_register = {register:#010x};\n_safe_value = {value:#x};\n");
    for (program, area) in [("tater", APPLICATION), ("monitor", MONITOR), ("conformance", MONITOR)] {
        let folder = out.join(program);
        fs::create_dir_all(&folder)?;
        fs::write(folder.join("memory.x"), format!("{}{safe}", Script { map: MAP, program: area }))?;
        link(program, &folder);
    }
    Ok(())
}

fn link(program: &str, folder: &Path) {
    let argument = |text: &str| println!("cargo::rustc-link-arg-bin={program}={text}");
    argument(&format!("-L{}", folder.display()));
    argument("-Tlink.x");
    // Nothing is aligned to pages of 64 KiB: the linker would load its ELF header into the room before the application,
    // which is the monitor.
    argument("--nmagic");
    if program == "tater" && env::var_os("CARGO_FEATURE_LOG").is_some() {
        argument("-Tdefmt.x");
    }
}
