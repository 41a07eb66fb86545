//! Requests and answers one at a time, outside a scenario's timeline.

use tater_wire::{Destination, Frame, Message, Node as Id, Property};

use super::{ObservedBoard, OverCan};

/// Time limit of an answer, us: a board that erases a page (40 ms) answers after it.
pub(super) const ANSWER_US: u64 = 100_000;

const TRIES: u32 = 5;

/// Poll interval of long operations, us.
const LOOK_US: u64 = 10_000;

impl<S: ObservedBoard> OverCan<S> {
    /// GETs a property; `None` without an answer in `ANSWER_US`.
    pub fn get(&mut self, node: Id, property: Property) -> Option<i64> {
        while self.bus.receive().is_some() {}
        self.send_get(node, property);
        let deadline = self.bus.now_us() + ANSWER_US;
        std::iter::from_fn(|| self.bus.wait(deadline)).find_map(|stamped| match answer(&stamped.frame)? {
            (from, of, value) if (from, of) == (node, property) => Some(value),
            _ => None,
        })
    }

    /// SETs a property, without an acknowledgment.
    ///
    /// # Errors
    /// The value has more than 32 bits.
    pub fn set(&mut self, node: Id, property: Property, value: i64) -> Result<(), String> {
        let message = Message::set(Destination::Node(node), property, value)
            .ok_or_else(|| format!("{property:?} = {value}: no value of a property"))?;
        // The host is connected since `new`.
        let _ = self.bus.send(message.frame());
        Ok(())
    }

    /// SETs a property and reads it back.
    ///
    /// # Errors
    /// The board reads back another value, or does not answer.
    pub fn put(&mut self, node: Id, property: Property, value: i64) -> Result<(), String> {
        self.set(node, property, value)?;
        let read = (0..TRIES).find_map(|_| self.get(node, property));
        self.check()?;
        if read == Some(value) {
            return Ok(());
        }
        let number = node.number();
        Err(match read {
            Some(read) => format!(
                "node {number}: {property:?} is {read}, expected {value} as it was set\n  next: give a value that the board takes"
            ),
            None => format!("node {number}: no answer about {property:?}\n  next: is the board awake?"),
        })
    }

    /// # Errors
    /// Timeout, or a board that has stopped for good.
    pub(super) fn until(
        &mut self,
        node: Id,
        property: Property,
        wanted: i64,
        for_us: u64,
    ) -> Result<(), String> {
        let deadline = self.bus.now_us() + for_us;
        let mut read = None;
        while self.bus.now_us() < deadline {
            read = self.get(node, property).or(read);
            self.check()?;
            if read == Some(wanted) {
                return Ok(());
            }
            self.rest("waiting", LOOK_US)?;
        }
        let error = self.get(node, Property::ERROR);
        let found =
            |value: Option<i64>| value.map_or_else(|| "no answer".to_owned(), |value| value.to_string());
        Err(format!(
            "node {}: {property:?} was not {wanted} within {} ms: {}; ERROR: {}\n  next: look ERROR up in docs/properties.md",
            node.number(),
            for_us / 1000,
            found(read),
            found(error)
        ))
    }

    /// Lets time pass, reporting progress as `what`; discards received frames.
    ///
    /// # Errors
    /// A board has stopped for good.
    pub fn rest(&mut self, what: &'static str, us: u64) -> Result<(), String> {
        let begin = self.bus.now_us();
        while self.bus.now_us() < begin + us {
            let until = (self.bus.now_us() + LOOK_US).min(begin + us);
            self.bus.run_until(until);
            while self.bus.receive().is_some() {}
            self.check()?;
            self.report_progress(what, self.bus.now_us() - begin, us);
        }
        Ok(())
    }
}

/// A board's answer; one that is damaged is none.
pub(super) fn answer(frame: &Frame) -> Option<(Id, Property, i64)> {
    let (from, of, value) = Message::parse(frame)?.answered()?;
    Some((from, of, value?))
}
