//! A monitor on simulated flash, its bus with transmission times, and the hosts at the other end.

use boot::monitor::{Monitor, Next};
use boot::{Chip, Flash, FlashError};
use hil_world::rig::flash::SimFlash;
use servo_core::units::Micros;
use std::collections::VecDeque;
use tater_f103::map::{APPLICATION, FLASH, MAP, RAM};
use tater_wire::download::{CHARACTERS, START, START_NUMBERED, pack};
use tater_wire::image::{HEADER_END, Header, seal};
use tater_wire::map::{Area, Map};
use tater_wire::{Body, Destination, FaultCode, Frame, Group, Message, Node, Property};

#[derive(Clone, Copy, Debug)]
pub enum Operation {
    Program(u32, u16),
    Erase(u32),
}

impl Operation {
    pub fn apply(self, flash: &mut SimFlash) -> Result<(), FlashError> {
        match self {
            Self::Program(address, value) => flash.program(address, &[value]),
            Self::Erase(page) => flash.erase(page),
        }
    }
}

pub struct Logged {
    pub sim: SimFlash,
    pub log: Vec<Operation>,
}

impl Flash for Logged {
    const MAP: Map = MAP;

    fn half_word(&self, address: u32) -> u16 {
        self.sim.half_word(address)
    }
    fn program(&mut self, address: u32, unit: &[u16]) -> Result<(), FlashError> {
        let &[value] = unit else { return Err(FlashError::Address) };
        self.log.push(Operation::Program(address, value));
        self.sim.program(address, unit)
    }
    fn erase(&mut self, page: u32) -> Result<(), FlashError> {
        self.log.push(Operation::Erase(page));
        self.sim.erase(page)
    }
}

pub struct Bed {
    pub flash: Logged,
    sent: Vec<Frame>,
}

impl Chip for Bed {
    type Flash = Logged;

    fn transmit(&mut self, frame: &Frame) -> bool {
        self.sent.push(*frame);
        true
    }
    fn set_filters(&mut self, _: Node, _: [Option<Group>; 3]) {}
    fn flash(&mut self) -> &mut Logged {
        &mut self.flash
    }
    fn feed_watchdog(&mut self) {}
    fn reset(&mut self) {}
    fn reset_cause(&self) -> Option<FaultCode> {
        None
    }
    fn straps(&self) -> Node {
        NODE
    }
    fn serial_number(&self) -> u16 {
        4711
    }
}

pub const NODE: Node = match Node::new(3) {
    Some(node) => node,
    None => panic!("3 is a node"),
};

/// Interval of two steps of the monitor: its loop, and the processing of a frame, µs.
const LOOP_US: u64 = 10;

/// Frames that the CAN controller buffers while the flash stalls the processor.
const FIFO: usize = 3;

/// A frame on a bus of 1 Mbit/s, µs: 44 bits and the data, 3 bits until the next; without stuffing.
fn frame_us(frame: &Frame) -> u64 {
    47 + 8 * frame.data().len() as u64
}

#[derive(Debug, Default, PartialEq, Eq)]
pub struct Figures {
    pub requests: usize,
    pub frames: usize,
    pub bus_us: u64,
    /// From SET VERS to the end of the copy, µs.
    pub took_us: u64,
}

pub struct Rig {
    pub monitor: Monitor<Bed>,
    now: u64,
    coming: VecDeque<(u64, Frame)>,
    bus_free: u64,
    figures: Figures,
    /// Frames lost because the controller was full.
    pub lost: usize,
}

impl Rig {
    pub fn boot(flash: SimFlash) -> Self {
        let flash = Logged { sim: flash, log: Vec::new() };
        let monitor = Monitor::new(Bed { flash, sent: Vec::new() });
        Self { monitor, now: 0, coming: VecDeque::new(), bus_free: 0, figures: Figures::default(), lost: 0 }
    }

    pub fn flash(&self) -> &SimFlash {
        &self.monitor.board().flash.sim
    }

    pub fn into_flash(self) -> Logged {
        self.monitor.into_board().flash
    }

    pub fn pass(&mut self, us: u64) {
        self.now += us;
    }

    pub fn say(&mut self, frame: Frame) {
        self.bus_free = self.bus_free.max(self.now) + frame_us(&frame);
        self.figures.bus_us += frame_us(&frame);
        self.coming.push_back((self.bus_free, frame));
    }

    pub fn set(&mut self, property: Property, value: i64) {
        let message = Message::set(Destination::Node(NODE), property, value).expect("a value of 32 bits");
        self.say(message.frame());
    }

    /// Frames that arrive while the flash stalls the processor wait in the controller, which keeps three.
    pub fn step(&mut self) -> (Next, Vec<Frame>) {
        let next = self.monitor.step(Micros(self.now as u32));
        self.now += LOOP_US + self.monitor.board_mut().flash.sim.take_busy_us();
        let mut kept: Vec<Frame> = Vec::new();
        while let Some((_, frame)) = self.coming.pop_front_if(|(at, _)| *at <= self.now) {
            // RFLM = 0: the newest is overwritten.
            if kept.len() >= FIFO {
                self.lost += 1;
                kept.pop();
            }
            kept.push(frame);
        }
        for frame in kept {
            self.monitor.receive(&frame, Micros(self.now as u32));
        }
        let sent = std::mem::take(&mut self.monitor.board_mut().sent);
        for frame in &sent {
            self.bus_free = self.bus_free.max(self.now) + frame_us(frame);
            self.figures.bus_us += frame_us(frame);
        }
        (next, sent)
    }

    /// Returns whether the application is to start.
    pub fn settle(&mut self) -> Next {
        for _ in 0..100_000 {
            let (next, _) = self.step();
            if next == Next::Start || (self.coming.is_empty() && self.monitor.is_idle()) {
                return next;
            }
        }
        panic!("no rest: {:?}", self.monitor.error());
    }

    /// The board's answer to a GET; `None` if nothing arrives within 0.5 ms and a page's erase.
    pub fn get(&mut self, property: Property) -> Option<i64> {
        self.say(Message::get(Destination::Node(NODE), property).frame());
        let end = self.now + 41_000;
        while self.now < end {
            for frame in self.step().1 {
                if let Some(Message { body: Body::Set { property: id, value }, .. }) = Message::parse(&frame)
                    && id == property.id()
                {
                    return Some(property.read(value));
                }
            }
        }
        None
    }

    /// Returns `None` if the power failed in it.
    pub fn download(&mut self, host: &mut Host) -> Option<Figures> {
        self.figures = Figures::default();
        let begun = self.now;
        self.set(Property::VERS, i64::from(if host.numbered { START_NUMBERED } else { START }));
        let mut asked = false;
        while !(asked && self.monitor.is_idle()) {
            for frame in self.step().1 {
                asked = true;
                self.figures.requests += 1;
                for answer in host.hear(&frame) {
                    self.figures.frames += 1;
                    self.say(answer);
                }
            }
            if self.flash().is_dead() {
                return None;
            }
        }
        self.figures.took_us = self.now - begun;
        Some(std::mem::take(&mut self.figures))
    }

    pub fn run_into_cut(&mut self) -> bool {
        for _ in 0..20_000 {
            self.step();
            if self.flash().is_dead() {
                // The processor runs on for a while after the power has failed.
                (0..10).for_each(|_| drop(self.step()));
                return true;
            }
        }
        false
    }

    pub fn error(&self) -> Option<FaultCode> {
        self.monitor.error()
    }
}

pub struct Host {
    numbered: bool,
    characters: Vec<u8>,
    sent: usize,
}

impl Host {
    /// Barrett's downloader (docs/download.md): 98 characters of a line at most, one character for any frame.
    pub fn barrett(file: &[u8]) -> Self {
        let mut characters = Vec::new();
        for line in file.split_inclusive(|&c| c == b'\n').flat_map(|line| line.chunks(98)) {
            characters.extend(line.iter().skip(1).take_while(|&&c| c >= b'0'));
        }
        Self { numbered: false, characters, sent: 0 }
    }

    /// Our downloader: numbered frames, from where the board requests.
    pub fn ours(file: &[u8]) -> Self {
        Self { numbered: true, ..Self::barrett(file) }
    }

    pub fn characters(&self) -> usize {
        self.characters.len()
    }

    fn hear(&mut self, frame: &Frame) -> Vec<Frame> {
        let send = |data: &[u8]| Frame::from_raw(u16::from(NODE.number()), data).expect("up to 8 bytes");
        if !self.numbered {
            let character = self.characters.get(self.sent).copied();
            self.sent += 1;
            return character.map(|character| send(&[character])).into_iter().collect();
        }
        let Some(Message { body: Body::More { frames, received }, .. }) = Message::parse(frame) else {
            return Vec::new();
        };
        let chunks = self.characters.chunks(CHARACTERS).enumerate();
        chunks
            .skip(received as usize / CHARACTERS)
            .take(usize::from(frames))
            .map(|(i, eight)| send(&pack((i % 256) as u8, eight)))
            .collect()
    }
}

pub fn area(flash: &SimFlash, area: Area, len: usize) -> &[u8] {
    &flash.bytes()[(area.start - FLASH.start) as usize..][..len]
}

pub fn application(flash: &SimFlash) -> Option<Header> {
    let all = area(flash, APPLICATION, APPLICATION.len as usize);
    let header = Header::read(all, &MAP).ok()?;
    Header::verify(&all[..header.len as usize], &MAP).ok()
}

pub fn image(len: usize, version: u32) -> Vec<u8> {
    let mut state = version;
    let mut image: Vec<u8> = std::iter::repeat_with(|| {
        // Numerical Recipes' generator: bytes without a pattern.
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    })
    .take(len)
    .collect();
    image[..4].copy_from_slice(&RAM.end().to_le_bytes());
    image[4..8].copy_from_slice(&(APPLICATION.start + HEADER_END + 1).to_le_bytes());
    image[0x1C..0x2C].fill(0xFF);
    seal(&mut image, version, &MAP).expect("an application's image");
    image
}

pub fn flash_with(image: &[u8]) -> SimFlash {
    let mut flash = SimFlash::default();
    flash.load(APPLICATION.start, image);
    flash
}

/// A line of a `.tek` file from all but its length and checksum: type, two characters, and the rest.
pub fn line(body: &str) -> String {
    let mut text = format!("{:02X}{body}", body.len() + 2);
    let sum: u32 = text.bytes().map(|c| u32::from(tater_wire::tek::value(c).expect("hexadecimal"))).sum();
    text.replace_range(3..5, &format!("{:02X}", sum % 256));
    format!("%{text}\r\n")
}

pub fn data(address: u32, bytes: &[u8]) -> String {
    let hex: String = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
    line(&format!("6008{address:08X}{hex}"))
}

pub fn lines(image: &[u8]) -> Vec<String> {
    let data = (APPLICATION.start..).step_by(32).zip(image.chunks(32)).map(|(at, bytes)| data(at, bytes));
    data.chain([line(&format!("8008{:08X}", APPLICATION.start))]).collect()
}
