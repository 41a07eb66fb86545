//! Any frame: a message that parses emits the same frame.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tater_wire::{Body, Frame, Message, Property};

fuzz_target!(|input: (u16, &[u8])| {
    let Some(frame) = Frame::from_raw(input.0 & 0x7FF, input.1) else { return };
    let Some(message) = Message::parse(&frame) else { return };
    assert_eq!(Message::parse(&message.frame()), Some(message));
    if let Body::Set { property, value } = message.body
        && let Some(property) = Property::of(property)
    {
        let read = property.read(value);
        let written = property.write(read).expect("what came from 32 bits fits them");
        assert_eq!(property.read(written), read);
    }
});
