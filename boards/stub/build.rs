//! Writes the linker scripts of the programs from the memory map.

#[path = "src/map.rs"]
#[allow(dead_code, reason = "the programs use all of it")]
mod map;

use std::path::PathBuf;
use std::{env, fs};

use map::MAP;
use tater_wire::map::Script;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=src/map.rs");
    if env::var("CARGO_CFG_TARGET_OS")? != "none" {
        return Ok(());
    }
    for (program, area) in
        [("stub", MAP.application), ("stub-monitor", MAP.monitor), ("stub-god", MAP.application)]
    {
        let folder = PathBuf::from(env::var("OUT_DIR")?).join(program);
        fs::create_dir_all(&folder)?;
        fs::write(folder.join("memory.x"), Script { map: MAP, program: area }.to_string())?;
        for argument in [format!("-L{}", folder.display()), "-Tlink.x".into(), "--nmagic".into()] {
            println!("cargo::rustc-link-arg-bin={program}={argument}");
        }
    }
    Ok(())
}
