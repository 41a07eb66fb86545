//! The stub keeps the promises of a port, power cuts included.

use boot::conformance::{Cut, chip, survives_power_cuts};
use boot::{Flash, FlashError};
use stub::map::WORDS;
use stub::{Ram, Stub};
use tater_fw::conformance::board;
use tater_wire::map::Map;

fn blank() -> Ram<Vec<u16>> {
    Ram(vec![u16::MAX; WORDS])
}

#[test]
fn stub_keeps_the_promises_of_chip_and_board() {
    let stub = chip(Stub::new(blank())).expect("a chip");
    board(stub).expect("a board");
}

/// The stub's flash, whose power fails after so many operations.
#[derive(Clone)]
struct Cuttable {
    flash: Ram<Vec<u16>>,
    left: Option<u32>,
    dead: bool,
}

impl Cuttable {
    /// Whether an operation is done: not once the power has failed.
    fn takes(&mut self) -> Result<bool, FlashError> {
        if self.dead {
            return Err(FlashError::Failed);
        }
        self.dead = self.left == Some(0);
        self.left = self.left.map(|left| left.saturating_sub(1));
        Ok(!self.dead)
    }
}

impl Flash for Cuttable {
    const MAP: Map = <Ram<Vec<u16>> as Flash>::MAP;

    fn half_word(&self, address: u32) -> u16 {
        self.flash.half_word(address)
    }

    fn program(&mut self, address: u32, unit: &[u16]) -> Result<(), FlashError> {
        let whole = self.takes()?;
        // An error correction gives up a unit that was cut.
        self.flash.program(address, if whole { unit } else { &[0; 4] })?;
        if whole { Ok(()) } else { Err(FlashError::Failed) }
    }

    fn erase(&mut self, page: u32) -> Result<(), FlashError> {
        let whole = self.takes()?;
        if whole { self.flash.erase(page) } else { Err(FlashError::Failed) }
    }
}

impl Cut for Cuttable {
    fn cut_after(&mut self, operations: u32, _: u32) {
        self.left = Some(operations);
    }

    fn restore(&mut self) -> bool {
        self.left = None;
        std::mem::take(&mut self.dead)
    }
}

#[test]
fn stub_survives_power_cuts() {
    let cuts = survives_power_cuts(&Cuttable { flash: blank(), left: None, dead: false }, 1);
    assert!(cuts.as_ref().is_ok_and(|&cuts| cuts > 400), "{cuts:?}");
}
