//! The motor board's own flash driver keeps the promises of a port (docs/porting.md).

use std::rc::Rc;

use board_emu::image::Programs;

use super::bench::{Bench, NODE, flashed, folder, production};
use tater_wire::Frame;

/// The board's last words: the promise that is broken, or nothing.
fn verdict(programs: &Programs) -> Option<String> {
    let mut bench = Bench::powered(flashed(programs, NODE));
    let deadline = bench.bus.now_us() + 60_000_000;
    let own = |frame: &Frame| frame.id().from.number() == 31;
    let first = std::iter::from_fn(|| bench.bus.wait(deadline)).map(|heard| heard.frame).find(own)?;
    let rest_ends = bench.bus.now_us() + 100_000;
    let rest = std::iter::from_fn(|| bench.bus.wait(rest_ends)).map(|heard| heard.frame).filter(own);
    let bytes: Vec<u8> = std::iter::once(first).chain(rest).flat_map(|frame| frame.data().to_vec()).collect();
    assert_eq!(bench.resets(), 1, "only that of the power: {:?}", bench.board().problem());
    Some(String::from_utf8(bytes).expect("ASCII"))
}

#[test]
fn motor_board_keeps_the_promises_of_its_flash() {
    let Some(mut programs) = production() else { return };
    programs.monitor =
        std::fs::read(folder("production").join("conformance.bin")).expect("made with the image");
    programs.names = Rc::default();
    assert_eq!(verdict(&programs).as_deref(), Some(""));
}
