//! A receive FIFO of three frames, of which the program sees the oldest (RM0008 24.7.3).

use tater_wire::Frame;

const DEPTH: usize = 3;

/// Bits of RFxR (RM0008 24.9.2).
const FULL: u32 = 1 << 3;
const FOVR: u32 = 1 << 4;
const RFOM: u32 = 1 << 5;

/// A received frame: RIxR, RDTxR, RDLxR, RDHxR.
type Place = [u32; 4];

#[derive(Clone, Debug, Default)]
pub(super) struct Fifo {
    places: Vec<Place>,
    /// FULL and FOVR, until cleared.
    flags: u32,
}

impl Fifo {
    /// Stores a frame with the number of the filter that accepted it. A full FIFO loses the new frame if it
    /// is `locked` (MCR.RFLM), otherwise the last one.
    pub(super) fn push(&mut self, frame: &Frame, filter: u32, locked: bool) {
        let mut bytes = [0; 8];
        for (to, from) in bytes.iter_mut().zip(frame.data()) {
            *to = *from;
        }
        let word = |at: usize| (0..4).map(|i| u32::from(bytes[at + i]) << (8 * i)).sum();
        let len = frame.data().len() as u32;
        let place = [u32::from(frame.raw_id()) << 21, filter << 8 | len, word(0), word(4)];
        if self.places.len() < DEPTH {
            self.places.push(place);
        } else {
            self.flags |= FOVR;
            if let Some(last) = self.places.last_mut().filter(|_| !locked) {
                *last = place;
            }
        }
        if self.places.len() == DEPTH {
            self.flags |= FULL;
        }
    }

    /// RFxR.
    pub(super) fn status(&self) -> u32 {
        self.flags | self.places.len() as u32
    }

    /// Writes RFxR: clears flags, releases the oldest frame.
    pub(super) fn write_status(&mut self, value: u32) {
        self.flags &= !value;
        if value & RFOM != 0 && !self.places.is_empty() {
            self.places.remove(0);
        }
    }

    /// One of the four registers of the oldest frame; undefined if the FIFO is empty.
    pub(super) fn read(&self, offset: u32) -> u32 {
        self.places.first().and_then(|place| place.get(offset as usize / 4)).copied().unwrap_or(0)
    }

    /// Whether it requests an interrupt; `enables` are FMPIE, FFIE and FOVIE from bit 0.
    pub(super) fn interrupts(&self, enables: u32) -> bool {
        enables & 1 != 0 && !self.places.is_empty()
            || enables & 2 != 0 && self.flags & FULL != 0
            || enables & 4 != 0 && self.flags & FOVR != 0
    }
}
