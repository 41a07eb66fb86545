//! Copies staging to the application, page by page. Progress is not stored: after a power failure the whole
//! copy is repeated, because a page in which the power failed may read correctly today and not tomorrow.

use crate::board::{Flash, FlashError};
use tater_wire::memory::{APPLICATION, PAGE, STAGING};

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
        if self.at >= self.len {
            return Ok(true);
        }
        if !self.erased {
            flash.erase(APPLICATION.start.wrapping_add(self.at))?;
            self.erased = true;
            return Ok(false);
        }
        let value = flash.half_word(STAGING.start.wrapping_add(self.at));
        flash.program(APPLICATION.start.wrapping_add(self.at), value)?;
        self.at = self.at.saturating_add(2);
        self.erased = !self.at.is_multiple_of(PAGE);
        Ok(false)
    }
}
