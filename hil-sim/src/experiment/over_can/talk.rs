//! Questions and answers, one at a time: before a scenario begins there is no hurry.

use tater_wire::{Body, Destination, Frame, Message, Node as Id, Property};

use super::{OverCan, Watched};

/// How long a host waits for an answer before it asks again, us: a board that erases a page (40 ms) answers after it.
pub(super) const ANSWER_US: u64 = 100_000;

/// How often a host asks in vain.
const TRIES: u32 = 5;

/// Between two looks at what takes a while, us.
const LOOK_US: u64 = 10_000;

impl<S: Watched> OverCan<S> {
    /// GETs a property; `None` if nobody answers in `ANSWER_US`.
    pub fn get(&mut self, node: Id, property: Property) -> Option<i64> {
        while self.bus.receive().is_some() {}
        self.send_get(node, property);
        let deadline = self.bus.now_us() + ANSWER_US;
        std::iter::from_fn(|| self.bus.wait(deadline)).find_map(|stamped| match answer(&stamped.frame)? {
            (from, of, value) if (from, of) == (node, property) => Some(value),
            _ => None,
        })
    }

    /// SETs a property; nobody answers that.
    ///
    /// # Errors
    /// A value of more than 32 bits.
    pub fn set(&mut self, node: Id, property: Property, value: i64) -> Result<(), String> {
        let message = Message::set(Destination::Node(node), property, value)
            .ok_or_else(|| format!("{property:?} = {value}: no value of a property"))?;
        // The host is plugged since the beginning.
        let _ = self.bus.send(message.frame());
        Ok(())
    }

    /// SETs a property and reads it back.
    ///
    /// # Errors
    /// The board has another value, or does not answer.
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

    /// Asks until a property has a value.
    ///
    /// # Errors
    /// It has not, for so long; a board that stands still for good.
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

    /// Lets time pass, `what` being the reason; what comes meanwhile is not read.
    ///
    /// # Errors
    /// A board that stands still for good.
    pub fn rest(&mut self, what: &'static str, us: u64) -> Result<(), String> {
        let begin = self.bus.now_us();
        while self.bus.now_us() < begin + us {
            let until = (self.bus.now_us() + LOOK_US).min(begin + us);
            self.bus.run_until(until);
            while self.bus.receive().is_some() {}
            self.check()?;
            self.tell(what, self.bus.now_us() - begin, us);
        }
        Ok(())
    }
}

/// What a board says of a property, asked or not.
pub(super) fn answer(frame: &Frame) -> Option<(Id, Property, i64)> {
    let message = Message::parse(frame)?;
    match message.body {
        Body::Position(counts) => Some((message.from, Property::P, i64::from(counts))),
        Body::Set { property, value } => {
            let property = Property::of(property)?;
            Some((message.from, property, property.read(value)))
        }
        Body::Get(_) | Body::Torques(_) | Body::More { .. } => None,
    }
}
