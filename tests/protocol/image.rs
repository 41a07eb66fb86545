//! The image made by `cargo xtask image`, downloaded to a simulated board.

use std::fs;

use tater_f103::map::{APPLICATION, MAP, MONITOR};
use tater_wire::Property;
use tater_wire::image::Header;
use tater_wire::map::Area;

use super::download::Bench;
use crate::emulated::bench::folder;

/// Does not show that the image's bytes run: the simulated board starts the firmware that this test is linked with.
/// The emulated board runs the image itself.
#[test]
fn production_image_downloads_by_barretts_downloader_and_by_ours() {
    // Continuous integration has built the image, so the note is not acceptable there.
    let Ok(file) = fs::read(folder("production").join("tater.tek")) else {
        println!("skipped: no image; cargo xtask image makes it");
        return;
    };
    let image = fs::read(folder("production").join("tater.bin")).expect("written together with tater.tek");
    let header = Header::verify(&image, &MAP).expect("sealed");
    for by in ["Barrett's", "our"] {
        let mut bench = Bench::new();
        assert!(bench.application(image.len()) != image, "another application runs first");
        if by == "our" {
            bench.ours(&file).expect("the board takes it and starts");
        } else {
            bench.barrett(&file).expect("the board asks for every character");
            bench.wait(1_000_000);
            assert_eq!(bench.get(Property::STAT), Some(0), "the monitor answers");
            assert_eq!(bench.get(Property::MODE), None, "but has no modes");
            bench.wake();
        }
        assert_eq!(bench.get(Property::STAT), Some(2), "{by}");
        assert_eq!(bench.get(Property::MODE), Some(0), "{by}: the application answers, idle");
        assert_eq!(bench.get(Property::VERS), Some(i64::from(header.version)), "{by}");
        assert!(bench.application(image.len()) == image, "{by}: byte for byte");
        println!("figure: {} bytes of production image onto a board by {by} downloader", image.len());
    }
}

/// A HardFault's first stores: instruction, address, value. TIM1_BDTR 0 (RM0008 14.4.18: MOE off), then port B's BRR, bit 5
/// (RM0008 9.2.6: the brake's pin low).
const STORES: [(u32, u32, u32); 2] = [(3, 0x4001_2C00 + 0x44, 0), (6, 0x4001_0C00 + 0x14, 1 << 5)];

fn half_word(image: &[u8], area: Area, address: u32) -> Option<u16> {
    let at = usize::try_from(address.checked_sub(area.start)?).ok()?;
    Some(u16::from_le_bytes([*image.get(at)?, *image.get(at + 1)?]))
}

fn word(image: &[u8], area: Area, address: u32) -> Option<u32> {
    let [low, high] = [half_word(image, area, address)?, half_word(image, area, address.checked_add(2)?)?];
    Some(u32::from(high) << 16 | u32::from(low))
}

/// Executes the first six instructions of an image's HardFault: address from the literal pool, value, store; twice.
fn hard_fault(image: &[u8], area: Area) -> Result<Vec<(u32, u32, u32)>, String> {
    let vector = word(image, area, area.start + 0xC).ok_or("no vector")?;
    let entry = vector.checked_sub(1).filter(|entry| entry % 2 == 0).ok_or("not Thumb code")?;
    let mut registers = [None; 8];
    let mut stores = Vec::new();
    for (nth, at) in (1..=6).zip((entry..).step_by(2)) {
        let code = half_word(image, area, at).ok_or_else(|| format!("{at:08x}: outside"))?;
        let [first, second, middle] = [code & 7, code >> 3 & 7, code >> 8 & 7].map(usize::from);
        let immediate = u32::from(code & 0xFF);
        let wrong = || format!("{at:08x}: {code:04x}");
        // ARM DDI 0403, A7.7: LDR (literal) T1, MOV (immediate) T1, STR (immediate) T1 with offset 0.
        match (code >> 11, code >> 6) {
            (0b01001, _) => {
                registers[middle] =
                    Some(word(image, area, (at + 4) / 4 * 4 + 4 * immediate).ok_or_else(wrong)?);
            }
            (0b00100, _) => registers[middle] = Some(immediate),
            (_, 0b01_1000_0000) => {
                let (address, value) =
                    (registers[second].ok_or_else(wrong)?, registers[first].ok_or_else(wrong)?);
                stores.push((nth, address, value));
            }
            _ => return Err(wrong()),
        }
    }
    Ok(stores)
}

#[test]
fn hard_fault_of_the_images_switches_the_bridge_off_first() {
    for (name, area) in [("tater.bin", APPLICATION), ("monitor.bin", MONITOR)] {
        let Ok(mut image) = fs::read(folder("production").join(name)) else {
            println!("skipped: no image ({name}); cargo xtask image makes it");
            return;
        };
        assert_eq!(hard_fault(&image, area), Ok(STORES.to_vec()), "{name}");
        let vector = word(&image, area, area.start + 0xC).expect("judged above");
        let entry = (vector - 1 - area.start) as usize;
        for (at, bit) in (0xC..0x10).chain(entry..entry + 12).flat_map(|at| (0..8).map(move |bit| (at, bit)))
        {
            image[at] ^= 1 << bit;
            assert_ne!(hard_fault(&image, area), Ok(STORES.to_vec()), "{name}: bit {bit} of byte {at:x}");
            image[at] ^= 1 << bit;
        }
        println!("figure: {name}: a hard fault switches the bridge off by its third instruction");
    }
}
