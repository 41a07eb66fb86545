//! GOD with boards that answer arbitrary values at once.

use std::future::Future;
use std::pin::Pin;
use std::rc::Rc;

use god::command::ROWS;
use god::parameter::{HAND, MOTOR};
use god::{Io, Memory};
use tater_wire::{Body, Destination, Message, Node, Property};

/// ^C.
const ABORT: u8 = 3;

pub const LINE_END: &str = "\r\n\r";

pub const PROMPT: &str = "\r\n\r=> ";

/// The largest control block: this many bytes after its header are data, including ^C.
const BLOCK: usize = 14;

/// Longest time from ^C to the prompt, µs: boards answer at once, and after an error in RealTime GOD drains
/// the host's bytes for 20 ms.
const PROMPT_US: u64 = 100_000;

pub struct God {
    io: Rc<Io>,
    future: Pin<Box<dyn Future<Output = std::convert::Infallible>>>,
    now_us: u64,
    /// The boards' values; each answer changes it.
    word: u32,
    /// Whether the boards know their positions; without, hardly any command moves them.
    known: bool,
    /// The last V set, by node.
    velocities: [i64; 7],
    pub said: Vec<u8>,
    was_raw: bool,
}

impl God {
    pub fn new(word: u32, known: bool) -> Self {
        let (io, memory) = (Rc::new(Io::default()), Rc::new(Memory::default()));
        let ports = Rc::clone(&io);
        let future = Box::pin(async move { god::run(&ports, &memory).await });
        let (velocities, said) = ([0; 7], Vec::new());
        let mut god = Self { io, future, now_us: 0, word, known, velocities, said, was_raw: false };
        god.run_for(1_000_000);
        god
    }

    /// Sends a byte, if there is room, and lets a character's time pass.
    pub fn send(&mut self, byte: u8) {
        if self.io.rx_room() > 0 || byte == ABORT {
            self.io.push_rx(byte);
        }
        self.run_for(1_000);
    }

    pub fn types(&mut self, text: &str) {
        text.bytes().for_each(|byte| self.send(byte));
    }

    /// ^C gives a prompt, also from inside a block.
    pub fn must_prompt(&mut self) {
        for _ in 0..=BLOCK {
            self.send(ABORT);
        }
        self.run_for(PROMPT_US);
        assert!(self.said.ends_with(PROMPT.as_bytes()), "{}", self.told());
        assert!(!self.io.is_raw());
    }

    #[must_use]
    pub fn is_raw(&self) -> bool {
        self.io.is_raw()
    }

    #[must_use]
    pub fn stands(&self) -> bool {
        self.velocities == [0; 7]
    }

    #[must_use]
    pub fn told(&self) -> String {
        self.said.escape_ascii().to_string()
    }

    /// Checks that the output is text: CR and LF only as the line end that clients expect (and in the banner), backspace
    /// only as it is echoed, and every error a sum of status codes. RealTime and packets are not text. Bytes beyond
    /// ASCII are an echo.
    pub fn must_be_text(&self) {
        let text = String::from_utf8_lossy(&self.said).to_ascii_uppercase();
        if self.was_raw || text.contains("REPLY") {
            return;
        }
        let rest = text.replace(LINE_END, "").replace("\u{8} \u{8}", "").replace("FIRMWARE\n\r", "");
        assert!(rest.bytes().all(|byte| matches!(byte, b' '..=b'~' | b'\t' | 0x80..)), "{}", self.told());
        let codes = god::status::ROWS.iter().fold(0, |sum, row| sum | row.status.code());
        for (_, error) in text.match_indices("\r\n\rERR ").map(|(at, mark)| text.split_at(at + mark.len())) {
            let code = error.split(LINE_END).next().unwrap_or_default();
            // `? ERR` explains ERR.
            assert!(
                code.starts_with('[') || code.parse().is_ok_and(|code: u16| code > 0 && code & !codes == 0),
                "{code:?}"
            );
        }
    }

    pub fn run_for(&mut self, us: u64) {
        let until_us = self.now_us + us;
        loop {
            let next_us = god::io::poll(self.future.as_mut(), &self.io, self.now_us);
            self.was_raw |= self.io.is_raw();
            let mut answered = false;
            while let Some(frame) = self.io.pop_frame() {
                answered |= self.answer(&frame);
            }
            let before = self.said.len();
            self.said.extend(std::iter::from_fn(|| self.io.pop_tx()));
            if answered || self.said.len() > before {
                // Something may be due at once.
                self.now_us += 100;
            } else if next_us > until_us {
                self.now_us = self.now_us.max(until_us);
                return;
            } else {
                self.now_us = self.now_us.max(next_us) + 1;
            }
        }
    }

    fn answer(&mut self, frame: &tater_wire::Frame) -> bool {
        let Some(Message { to, body, .. }) = Message::parse(frame) else { return false };
        let nodes = match to {
            Destination::Node(node) => node.number()..=node.number(),
            Destination::Group(_) => 1..=7,
        };
        let property = match body {
            Body::Get(property) => Property::of(property),
            Body::Set { property, value } => {
                if Property::of(property) == Some(Property::V) {
                    nodes.for_each(|node| self.velocities[usize::from(node) - 1] = Property::V.read(value));
                }
                return false;
            }
            _ => None,
        };
        let Some(property) = property else { return false };
        for number in nodes {
            self.word = self.word.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let any = i64::from(self.word as i32 >> (self.word >> 27));
            let value = match property {
                // Awake; all other values are arbitrary.
                Property::STAT => 2,
                Property::HALLH if self.known => 1 << 30,
                // RealTime starts where the boards accept it.
                Property::MODE if self.known => 4,
                _ => any,
            };
            let Some(from) = Node::new(number) else { continue };
            if let Some(reply) = Message::reply(from, property, value) {
                self.io.push_frame(&reply.frame());
            }
        }
        true
    }
}

/// The text of an input: its characters, and for each byte from 128 on a word of the language, so that a
/// fuzzer need not spell it.
#[must_use]
pub fn text(input: &[u8]) -> Vec<u8> {
    let commands = ROWS.iter().map(|row| row.name);
    let parameters = MOTOR.iter().map(|row| row.name).chain(HAND.iter().map(|row| row.name));
    let others = ["WAKE", "SAVE", "REPLY", " S ", " G ", "X1234567", "\r"];
    // As many as there are bytes left.
    let properties = Property::ALL.iter().map(|property| property.row().name);
    let words: Vec<&str> = commands.chain(parameters).chain(others).chain(properties).collect();
    let mut text = Vec::new();
    for &byte in input {
        match usize::from(byte).checked_sub(128).and_then(|place| words.get(place)) {
            Some(word) => text.extend(word.bytes()),
            None => text.push(byte),
        }
    }
    text
}
