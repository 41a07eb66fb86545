//! The image that `cargo xtask image` has made, onto a simulated board: the file's way to the metal but for the metal.

use std::fs;
use std::path::{Path, PathBuf};

use tater_wire::Property;
use tater_wire::image::Header;

use super::download::Bench;

/// Where the production image lies.
fn folder() -> PathBuf {
    let root =
        Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the package is a folder of the workspace");
    let target = std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into());
    root.join(target).join("image/production")
}

#[test]
fn the_production_image_gets_onto_a_board_by_barretts_downloader_and_by_ours() {
    // Continuous integration has made it, and takes no such line.
    let Ok(file) = fs::read(folder().join("tater.tek")) else {
        println!("skipped: no image; cargo xtask image makes it");
        return;
    };
    let image = fs::read(folder().join("tater.bin")).expect("written together with tater.tek");
    let header = Header::verify(&image).expect("sealed");
    for by in ["Barrett's", "our"] {
        let mut bench = Bench::new();
        assert!(bench.application(image.len()) != image, "another application runs first");
        if by == "our" {
            bench.ours(&file).expect("the board takes it and starts");
        } else {
            bench.barrett(&file).expect("the board asks for every character");
            bench.wake();
        }
        assert_eq!(bench.get(Property::STAT), Some(2), "{by}");
        assert_eq!(bench.get(Property::VERS), Some(i64::from(header.version)), "{by}");
        assert!(bench.application(image.len()) == image, "{by}: byte for byte");
        println!("figure: {} bytes of production image onto a board by {by} downloader", image.len());
    }
}
