//! From a call of C to a call of a hand: arguments, limits, panics, and what is recorded of answers.

use std::ffi::{CStr, c_char, c_int};
use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

use tater_wire::Property;
use wraptor::{CallError, Deadline, Hand, Progress};

use crate::error::{Problem, keep, wraptor_error};
use crate::property;
use crate::slot::{self, Slot, wraptor_hand};

/// A limit that never ends: the manual's functions wait like this.
pub const WRAPTOR_ENDLESS: u32 = 0xFFFF_FFFF;

pub(crate) fn deadline(limit_ms: u32) -> Deadline {
    Deadline::after(match limit_ms {
        WRAPTOR_ENDLESS => Duration::MAX,
        ms => Duration::from_millis(ms.into()),
    })
}

/// Runs a function of C: keeps its error for the thread and stops a panic.
pub(crate) fn border(call: impl FnOnce() -> Result<(), Problem>) -> wraptor_error {
    let outcome = catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(|_| {
        let text = "a defect of this library\n  next: report it with what was printed to standard error";
        Err(Problem::new(wraptor_error::WRAPTOR_INTERNAL, text))
    });
    keep(outcome)
}

/// What a call has: the hand, the time that is left, and whether it is cancelled.
pub(crate) struct Call<'a> {
    pub hand: &'a mut Hand,
    pub slot: &'a Slot,
    pub deadline: Deadline,
}

impl Call<'_> {
    pub fn left(&self) -> Duration {
        self.deadline.remaining()
    }

    /// Runs a call of the hand that can be cancelled. Its progress shows values of a property.
    pub fn run<T>(
        &mut self,
        values_of: Property,
        run: impl FnOnce(
            &mut Hand,
            Duration,
            &mut dyn FnMut(&Progress) -> ControlFlow<()>,
        ) -> Result<T, CallError>,
    ) -> Result<T, Problem> {
        let (slot, left) = (self.slot, self.left());
        let outcome = run(self.hand, left, &mut |progress| {
            property::record(values_of, &progress.values);
            if slot.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        Ok(outcome?)
    }
}

/// Runs a call of a hand.
pub(crate) fn with_hand(
    number: wraptor_hand,
    limit_ms: u32,
    call: impl FnOnce(&mut Call) -> Result<(), Problem>,
) -> wraptor_error {
    border(|| {
        let deadline = deadline(limit_ms);
        let slot = slot::find(number)?;
        let mut turn = slot.take(&deadline)?;
        let hand = &mut *turn;
        let outcome = call(&mut Call { hand, slot: &slot, deadline });
        property::record_lines(&hand.take_reports());
        outcome
    })
}

/// Receives and records what a hand has sent so far.
pub(crate) fn process(hand: &mut Hand) -> Result<(), Problem> {
    // A frame comes only after `0 S REPLY 1`, as a packet; lines are recorded.
    while hand.receive(Duration::ZERO)?.is_some() {}
    property::record_lines(&hand.take_reports());
    Ok(())
}

/// # Safety
/// `text` is NULL, or ends with a zero and lives as long as the call.
pub(crate) unsafe fn text<'a>(name: &str, text: *const c_char) -> Result<&'a str, Problem> {
    if text.is_null() {
        return Err(Problem::null(name));
    }
    // SAFETY: not NULL, and by the caller's promise a string that outlives the call.
    let text = unsafe { CStr::from_ptr(text) };
    text.to_str().map_err(|_| Problem::invalid(&format!("{name}: expected ASCII")))
}

/// # Safety
/// `place` is NULL, or may be written.
pub(crate) unsafe fn store<T>(name: &str, place: *mut T, value: T) -> Result<(), Problem> {
    if place.is_null() {
        return Err(Problem::null(name));
    }
    // SAFETY: not NULL, and by the caller's promise a place for a value of this type.
    unsafe { place.write(value) };
    Ok(())
}

/// Stores a text with its final zero, cut to the buffer's size.
///
/// # Safety
/// `buffer` is NULL, or has `size` bytes that may be written.
pub(crate) unsafe fn store_text(buffer: *mut c_char, size: usize, text: &str) {
    let Some(room) = size.checked_sub(1).filter(|_| !buffer.is_null()) else { return };
    let kept = text.as_bytes().get(..room).unwrap_or(text.as_bytes());
    // SAFETY: `kept` and the zero have at most `size` bytes, which by the caller's promise may be written; a text of Rust is not among them.
    unsafe {
        std::ptr::copy_nonoverlapping(kept.as_ptr(), buffer.cast(), kept.len());
        buffer.add(kept.len()).write(0);
    }
}

/// The property of a number.
pub(crate) fn property_of(number: c_int) -> Result<Property, Problem> {
    let property = u8::try_from(number).ok().and_then(Property::of);
    property.ok_or_else(|| {
        Problem::invalid(&format!("property {number}: unknown; expected a WRAPTOR_PROPERTY_ constant"))
    })
}
