//! A million random frames.

use super::rig::{NODE, Rig, area, flash_with, image};
use boot::monitor::Next;
use boot::storage::{Progress, Store};
use tater_f103::map::APPLICATION;
use tater_wire::{Frame, Property};

const FRAMES: usize = 1_000_000;

/// Knuth's MMIX generator; the high bits are the random ones.
struct Random(u64);

impl Random {
    fn below(&mut self, end: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % end
    }

    fn bytes(&mut self, end: u64) -> [u8; 8] {
        std::array::from_fn(|_| self.below(end) as u8)
    }

    /// In equal parts: anything, frames that the monitor receives, and frames with a meaning for it.
    fn frame(&mut self) -> Frame {
        let node = u16::from(NODE.number());
        let id = match self.below(8) {
            0 => self.below(0x800) as u16,
            1 => 0x400 | self.below(8) as u16,
            2 => (self.below(32) as u16) << 5 | node,
            _ => node,
        };
        let len = self.below(9) as usize;
        match self.below(4) {
            0 => Frame::from_raw(id, &self.bytes(256)[..len]),
            1 => Frame::from_raw(id, &[self.below(128) as u8]),
            // Characters, one or eight; hexadecimal digits, so that records have existing lengths and types.
            2 => {
                let digits = self.bytes(16).map(|i| b"0123456789ABCDEF"[usize::from(i)]);
                Frame::from_raw(id, &digits[..if self.below(2) == 0 { 1 } else { 8 }])
            }
            _ => {
                // 1024 is missing from the key, or chance would find it.
                let values =
                    [0, 1, 2, 3, 5, -1, 0xAA, 0x1AA, 18384, 23, 3145, 77, i32::MIN, self.below(65536) as i32];
                let [a, b, c, d] = values[self.below(values.len() as u64) as usize].to_le_bytes();
                let set = [0x80 | self.below(12) as u8, 0, a, b, c, d];
                Frame::from_raw(id, &set[..if self.below(2) == 0 { 4 } else { 6 }])
            }
        }
        .expect("at most 8 bytes, 11 bits")
    }
}

fn identity(rig: &Rig) -> [Option<i64>; 3] {
    let store = Store::open(rig.flash());
    [Property::ROLE, Property::SN, Property::ID].map(|property| store.get(property))
}

#[test]
fn million_random_frames_do_no_harm() {
    let old = image(3000, 1);
    let mut flash = flash_with(&old);
    let mut store = Store::open(&flash);
    for (property, value) in [(Property::ROLE, 3), (Property::SN, 99), (Property::ID, 3)] {
        store.set(property, value);
        while store.step(&mut flash, true) == Progress::More {}
    }
    let mut rig = Rig::boot(flash);
    let before = identity(&rig);
    assert_eq!(before, [Some(3), Some(99), Some(3)]);
    let mut random = Random(1);
    let (mut starts, mut downloads) = (0, 0);
    for _ in 0..FRAMES {
        // A pause now and then, so that timeouts expire.
        let pause = if random.below(1000) == 0 { 1_000_000 * random.below(20) } else { random.below(300) };
        rig.pass(pause);
        rig.say(random.frame());
        if rig.step().0 == Next::Start {
            starts += 1;
            rig = Rig::boot(rig.into_flash().sim);
        }
        downloads += usize::from(!rig.monitor.is_idle());
    }
    println!(
        "figure: frames without sense to the monitor: {FRAMES}, {downloads} of them during a check or a download; {starts} starts"
    );
    assert!(starts > 1000 && downloads > 10_000, "the noise says things that are understood");
    assert_eq!(area(rig.flash(), APPLICATION, old.len()), old);
    assert_eq!(identity(&rig), before);
    rig.set(Property::STAT, 2);
    assert_eq!(rig.settle(), Next::Start, "and it still works");
}
