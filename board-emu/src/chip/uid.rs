//! Unique device ID (RM0008 30.2).

use super::AccessError;

/// 96 bits.
#[derive(Clone, Copy, Debug)]
pub struct Uid(pub [u32; 3]);

impl Uid {
    /// Reads a word at an offset.
    ///
    /// # Errors
    /// An unaligned offset is a bus error in this model.
    pub fn read(&self, offset: u32) -> Result<u32, AccessError> {
        if offset.is_multiple_of(4) {
            self.0.get(offset as usize / 4).copied().ok_or(AccessError::Bus)
        } else {
            Err(AccessError::Bus)
        }
    }
}
