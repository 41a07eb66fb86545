//! From staging to the application, page by page. Nothing is remembered of how far it came: after a power failure the
//! whole copy is made again, because a page in which the power failed may read well today and not tomorrow.

use crate::board::{Flash, FlashError};
use tater_wire::memory::{APPLICATION, PAGE, STAGING};

/// A copy so far.
#[derive(Debug)]
pub(super) struct Copy {
    len: u32,
    at: u32,
    /// The page that `at` is in has been erased.
    erased: bool,
}

impl Copy {
    /// Of `len` bytes, a multiple of 4 and at most the application's area.
    pub(super) const fn new(len: u32) -> Self {
        Self { len, at: 0, erased: false }
    }

    /// At most one flash operation; whether all is copied.
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
