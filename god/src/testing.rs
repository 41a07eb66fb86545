//! GOD with boards that a test scripts, for unit tests: single lines here, transcripts of a whole hand in [`transcript`].

mod board;
mod transcript;

use core::pin::pin;
use std::string::String;

use tater_wire::{Body, Destination, Message, Property};

use crate::memory::Memory;
use crate::motors::Motor;
use crate::{Io, io};

const MAX_US: u64 = 10_000_000;

/// Types a line to a hand whose boards are awake, ignore orders and answer with `board` (its time is µs since the line's end;
/// `None` is no answer). Returns the text after the echo, and the time of the prompt.
pub(crate) fn type_line(line: &str, board: impl Fn(Motor, Property, u64) -> Option<i64>) -> (String, u64) {
    let (io, memory) = (Io::default(), Memory::default());
    let mut god = pin!(crate::run(&io, &memory));
    let mut text = String::new();
    line.bytes().chain([b'\r']).for_each(|byte| io.push_rx(byte));
    for now_us in (0..MAX_US).step_by(1000) {
        io::poll(god.as_mut(), &io, now_us);
        while let Some(frame) = io.pop_frame() {
            let message = Message::parse(&frame).expect("GOD's frame");
            let (Destination::Node(node), Body::Get(id)) = (message.to, message.body) else { continue };
            let property = Property::of(id).expect("GOD asks for properties of the table");
            let motor = Motor::new(node.number()).expect("GOD asks the seven boards");
            let value = if property == Property::STAT { Some(2) } else { board(motor, property, now_us) };
            if let Some(value) = value {
                io.push_frame(&Message::reply(node, property, value).expect("it fits").frame());
            }
        }
        text.extend(core::iter::from_fn(|| io.pop_tx()).map(char::from));
        if let Some((_, answer)) = text.rsplit_once(line)
            && answer.ends_with("=> ")
        {
            return (answer.into(), now_us);
        }
    }
    panic!("no prompt: {text:?}");
}
