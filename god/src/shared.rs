//! A value that GOD's parts share, without a panic where two of them have it at once.

use core::cell::RefCell;

/// A value that one call at a time has: none keeps it, so none ever finds it taken.
#[derive(Debug, Default)]
pub(crate) struct Shared<T>(RefCell<T>);

impl<T> Shared<T> {
    pub const fn new(value: T) -> Self {
        Self(RefCell::new(value))
    }

    /// What `act` makes of the value. An `act` that asks for the same value again, which is a mistake in the program, gets the default: a board has
    /// nobody who could read a panic.
    pub fn with<R: Default>(&self, act: impl FnOnce(&mut T) -> R) -> R {
        let Ok(mut value) = self.0.try_borrow_mut() else {
            debug_assert!(false, "the value is in use already");
            return R::default();
        };
        act(&mut value)
    }
}
