//! Copies staging to the application, page by page. Progress is not stored: after a power failure the whole
//! copy is repeated, because a page in which the power failed may read correctly today and not tomorrow.

use crate::chip::{Flash, FlashError, MOST_UNIT, unit};
use tater_wire::map::Map;

#[derive(Debug)]
pub(super) struct Copy {
    len: u32,
    at: u32,
    erased: bool,
}

impl Copy {
    /// `len` is a multiple of 4 and at most the application's area.
    pub(super) const fn new(len: u32) -> Self {
        Self { len, at: 0, erased: false }
    }

    /// At most one flash operation; returns whether everything is copied.
    pub(super) fn step<F: Flash>(&mut self, flash: &mut F) -> Result<bool, FlashError> {
        let Map { of, application, staging, .. } = F::MAP;
        if self.at >= self.len {
            return Ok(true);
        }
        if !self.erased {
            flash.erase(application.start.wrapping_add(self.at))?;
            self.erased = true;
            return Ok(false);
        }
        let mut words = [0; MOST_UNIT];
        let from = staging.start.wrapping_add(self.at);
        words
            .iter_mut()
            .zip((from..).step_by(2))
            .for_each(|(word, address)| *word = flash.half_word(address));
        let words = words.get(..unit::<F>()).unwrap_or_default();
        flash.program(application.start.wrapping_add(self.at), words)?;
        self.at = self.at.saturating_add(of.unit);
        self.erased = !self.at.is_multiple_of(of.page);
        Ok(false)
    }
}
