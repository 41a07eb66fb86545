//! GOD with boards that answer anything at once.

use std::future::Future;
use std::pin::Pin;
use std::rc::Rc;

use god::{Io, Memory};
use tater_wire::{Body, Destination, Message, Node, Property};

/// GOD, its boards made of nothing.
pub struct God {
    io: Rc<Io>,
    future: Pin<Box<dyn Future<Output = std::convert::Infallible>>>,
    now_us: u64,
    /// What the boards say; each answer changes it.
    word: u32,
    /// All that was said to the host.
    pub said: Vec<u8>,
}

/// Longest that anything may take of which the boards always answer, us: ten minutes, longer than WAIT's most.
const MOST_US: u64 = 600_000_000;

impl God {
    /// At its first prompt.
    pub fn new(word: u32) -> Self {
        let (io, memory) = (Rc::new(Io::default()), Rc::new(Memory::default()));
        let ports = Rc::clone(&io);
        let future = Box::pin(async move { god::run(&ports, &memory).await });
        let mut god = Self { io, future, now_us: 0, word, said: Vec::new() };
        god.run_for(1_000_000);
        god
    }

    /// Says a byte, and lets a character's time pass.
    pub fn hear(&mut self, byte: u8) {
        self.io.hear(byte);
        self.run_for(1_000);
    }

    /// ^C ends everything within a second of answers.
    pub fn prompts(&mut self) -> bool {
        for _ in 0..2 {
            // The first may be data of a RealTime block that is not whole: those are at most 14 bytes.
            for _ in 0..15 {
                self.hear(3);
            }
            self.run_for(MOST_US);
        }
        self.said.ends_with(b"\r\n\r=> ")
    }

    fn run_for(&mut self, us: u64) {
        let until_us = self.now_us + us;
        loop {
            let next_us = god::io::poll(self.future.as_mut(), &self.io, self.now_us);
            let mut answered = false;
            while let Some(frame) = self.io.frame() {
                answered |= self.answer(&frame);
            }
            let before = self.said.len();
            self.said.extend(std::iter::from_fn(|| self.io.byte()));
            if answered || self.said.len() > before {
                // Something may go on at once.
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
        let Some(Message { to, body: Body::Get(property), .. }) = Message::parse(frame) else { return false };
        let Some(property) = Property::of(property) else { return false };
        let nodes = match to {
            Destination::Node(node) => node.number()..=node.number(),
            Destination::Group(_) => 1..=7,
        };
        for number in nodes {
            self.word = self.word.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let value = match property {
                // Awake; the rest is anything.
                Property::STAT => 2,
                _ => i64::from(self.word as i32 >> (self.word >> 27)),
            };
            let Some(from) = Node::new(number) else { continue };
            if let Some(reply) = Message::reply(from, property, value) {
                self.io.receive(&reply.frame());
            }
        }
        true
    }
}
