//! Checks an area of the flash for a whole image, in slices, so that the bus is answered meanwhile.

use crate::chip::Flash;
use tater_wire::image::{HEADER_BYTES, Header, Summer};
use tater_wire::map::Area;

/// Bytes per step: 0.15 ms at 72 MHz and some 42 cycles a byte, a third of the time that an answer may take.
const SLICE: u32 = 256;

pub(super) struct Check {
    area: Area,
    header: Header,
    at: u32,
    summer: Summer,
}

impl core::fmt::Debug for Check {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Check").field("area", &self.area).field("at", &self.at).finish_non_exhaustive()
    }
}

impl Check {
    /// `None` if staging has no header with valid vectors.
    pub(super) fn of_staging<F: Flash>(flash: &F) -> Option<Self> {
        Self::new(flash, F::MAP.staging)
    }

    /// `None` if the application has no header with valid vectors.
    pub(super) fn of_application<F: Flash>(flash: &F) -> Option<Self> {
        Self::new(flash, F::MAP.application)
    }

    fn new<F: Flash>(flash: &F, area: Area) -> Option<Self> {
        let mut start = [0; HEADER_BYTES];
        for (address, pair) in (area.start..).step_by(2).zip(start.chunks_exact_mut(2)) {
            pair.copy_from_slice(&flash.half_word(address).to_le_bytes());
        }
        Some(Self { area, header: Header::read(&start, &F::MAP).ok()?, at: 0, summer: Summer::default() })
    }

    pub(super) const fn len(&self) -> u32 {
        self.header.len
    }

    /// At the end, returns whether the CRC-32 matches the header.
    pub(super) fn step<F: Flash>(&mut self, flash: &F) -> Option<bool> {
        let end = self.header.len.min(self.at.saturating_add(SLICE));
        while self.at < end {
            // Both fit: an area is in the flash, and a header's length in its area.
            let address = self.area.start.wrapping_add(self.at);
            self.summer.update(&flash.half_word(address).to_le_bytes());
            self.at = self.at.saturating_add(2);
        }
        (self.at >= self.header.len).then(|| core::mem::take(&mut self.summer).finish() == self.header.crc)
    }
}
