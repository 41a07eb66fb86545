//! The monitor on a board of RAM. Power cuts and noise are in the system tests.

mod download;
mod properties;

use super::*;
use crate::chip::FlashError;
use crate::tests::{APPLICATION, FLASH, MAP, PAGE, RAM, STAGING};
use std::vec;
use std::vec::Vec;
use tater_wire::Identifier;
use tater_wire::image::{HEADER_END, seal};
use tater_wire::map::{Area, Map};

#[derive(Debug)]
struct Rom {
    bytes: Vec<u8>,
    erased: Vec<u32>,
    /// From now on every half-word except 0 fails.
    worn: bool,
}

impl Rom {
    fn load(&mut self, address: u32, bytes: &[u8]) {
        let at = (address - FLASH.start) as usize;
        self.bytes[at..at + bytes.len()].copy_from_slice(bytes);
    }

    fn image(&self, area: Area, len: usize) -> &[u8] {
        let at = (area.start - FLASH.start) as usize;
        &self.bytes[at..at + len]
    }
}

impl Flash for Rom {
    const MAP: Map = MAP;

    fn half_word(&self, address: u32) -> u16 {
        let at = (address - FLASH.start) as usize;
        u16::from_le_bytes([self.bytes[at], self.bytes[at + 1]])
    }

    fn program(&mut self, address: u32, unit: &[u16]) -> Result<(), FlashError> {
        let &[value] = unit else { return Err(FlashError::Address) };
        assert!(address.is_multiple_of(2) && FLASH.holds(u64::from(address), 2), "{address:#x}");
        if self.half_word(address) != u16::MAX && value != 0 {
            return Err(FlashError::NotErased);
        }
        if self.worn && value != 0 {
            return Err(FlashError::Verify);
        }
        self.load(address, &value.to_le_bytes());
        Ok(())
    }

    fn erase(&mut self, page: u32) -> Result<(), FlashError> {
        assert!(page.is_multiple_of(PAGE) && FLASH.holds(u64::from(page), u64::from(PAGE)), "{page:#x}");
        self.load(page, &[0xFF; PAGE as usize]);
        self.erased.push(page);
        Ok(())
    }
}

#[derive(Debug)]
struct Bed {
    chip: Rom,
    sent: Vec<Frame>,
    room: usize,
    straps: u8,
    listens: Option<(Node, [Option<Group>; 3])>,
    cause: Option<FaultCode>,
    resets: u32,
}

impl Chip for Bed {
    type Flash = Rom;

    fn transmit(&mut self, frame: &Frame) -> bool {
        let taken = self.sent.len() < self.room;
        if taken {
            self.sent.push(*frame);
        }
        taken
    }
    fn set_filters(&mut self, node: Node, groups: [Option<Group>; 3]) {
        self.listens = Some((node, groups));
    }
    fn flash(&mut self) -> &mut Rom {
        &mut self.chip
    }
    fn feed_watchdog(&mut self) {}
    fn reset(&mut self) {
        self.resets += 1;
    }
    fn reset_cause(&self) -> Option<FaultCode> {
        self.cause
    }
    fn straps(&self) -> Node {
        Node::new(self.straps).expect("straps are 0 to 31")
    }
    fn serial_number(&self) -> u16 {
        4711
    }
}

/// Most steps of one test: the longest, where every second frame is lost, needs some 3,000,000.
const MAX_STEPS: u32 = 8_000_000;

struct Bench {
    monitor: Monitor<Bed>,
    now: u32,
    steps: u32,
}

impl Bench {
    fn strapped(straps: u8) -> Self {
        let chip = Rom { bytes: vec![0xFF; FLASH.len as usize], erased: Vec::new(), worn: false };
        Self::boot(Bed {
            chip,
            sent: Vec::new(),
            room: usize::MAX,
            straps,
            listens: None,
            cause: None,
            resets: 0,
        })
    }

    fn boot(board: Bed) -> Self {
        // Near the wrap of the clock, so that every test passes it.
        Self { monitor: Monitor::new(board), now: 0xFFFF_FF00, steps: 0 }
    }

    fn reset(self) -> Self {
        Self::boot(self.monitor.into_board())
    }

    fn board(&mut self) -> &mut Bed {
        self.monitor.board_mut()
    }

    /// One step, this much later. A monitor that never finishes fails the test instead of hanging it.
    fn step(&mut self, us: u32) -> Next {
        self.steps += 1;
        assert!(self.steps < MAX_STEPS, "no end: {:?}", self.monitor.phase);
        self.now = self.now.wrapping_add(us);
        self.monitor.step(Micros(self.now))
    }

    /// Receives a frame with this raw identifier; returns the frames that the monitor sends at once.
    fn say(&mut self, id: u16, data: &[u8]) -> Vec<Frame> {
        let frame = Frame::from_raw(id, data).expect("a frame");
        self.monitor.receive(&frame, Micros(self.now));
        std::mem::take(&mut self.board().sent)
    }

    fn set(&mut self, id: u16, property: u8, value: i32) {
        let [a, b, c, d] = value.to_le_bytes();
        assert_eq!(self.say(id, &[0x80 | property, 0, a, b, c, d]), [], "a SET is not answered");
    }

    fn get(&mut self, node: u16, property: u8) -> Option<u16> {
        match self.say(node, &[property])[..] {
            [] => None,
            [reply] => {
                assert_eq!(reply.raw_id(), 0x406 | node << 5);
                let &[id, 0, low, high] = reply.data() else { panic!("{reply:?}") };
                assert_eq!(id, 0x80 | property);
                Some(u16::from_le_bytes([low, high]))
            }
            ref more => panic!("{more:?}"),
        }
    }

    /// Steps until there is nothing to do; returns whether the application is to start.
    fn settle(&mut self) -> Next {
        loop {
            if self.step(53) == Next::Start {
                return Next::Start;
            }
            if self.monitor.is_idle() {
                return Next::Stay;
            }
        }
    }
}

fn image(len: usize, version: u32) -> Vec<u8> {
    let mut image: Vec<u8> = (0..len).map(|i| (i * 7 + version as usize) as u8).collect();
    image[..4].copy_from_slice(&RAM.end().to_le_bytes());
    image[4..8].copy_from_slice(&(APPLICATION.start + HEADER_END + 1).to_le_bytes());
    image[0x1C..0x2C].fill(0xFF);
    seal(&mut image, version, &MAP).expect("an application's image");
    image
}

fn data(address: u32, bytes: &[u8]) -> Vec<u8> {
    let mut body = std::format!("6008{address:08X}");
    for byte in bytes {
        body += &std::format!("{byte:02X}");
    }
    record(&body)
}

/// A whole record from its type, a placeholder for the checksum, and the rest.
fn record(body: &str) -> Vec<u8> {
    let mut text = std::format!("{:02X}{body}", body.len() + 2).into_bytes();
    let sum = text.iter().map(|&c| u32::from(tater_wire::tek::value(c).expect("hexadecimal"))).sum::<u32>();
    text[3..5].copy_from_slice(std::format!("{:02X}", sum % 256).as_bytes());
    text
}

/// The characters of a file with this image, 32 bytes a record.
fn characters(image: &[u8]) -> Vec<u8> {
    let mut text = Vec::new();
    for (address, bytes) in (APPLICATION.start..).step_by(32).zip(image.chunks(32)) {
        text.extend(data(address, bytes));
    }
    text.extend(termination());
    text
}

fn termination() -> Vec<u8> {
    record(&std::format!("8008{:08X}", APPLICATION.start))
}
