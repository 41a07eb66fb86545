//! Downloads over the simulated bus: by a host that works exactly like Barrett's, and by ours.

use hil_world::board::SimBoard;
use hil_world::bus::{Adapter, Bus, Noise, Stats};
use hil_world::node::{Node, placeholder_application};
use hil_world::plant::Model;
use tater_f103::map::{APPLICATION, FLASH, MAP, RAM};
use tater_wire::download::{DownloadError, Downloader, Next, START};
use tater_wire::image::seal;
use tater_wire::tek::{Encoder, end};
use tater_wire::{Destination, FaultCode, Frame, Identifier, Message, Node as Id, Property};

use super::hosts::answer;
use crate::figures::Figure::Near;
use crate::figures::claim;

/// The spread's board.
const NODE: u8 = 4;

fn id() -> Id {
    Id::new(NODE).expect("a node")
}

/// A sealed image of so many bytes, none of them erased flash.
fn image(len: usize) -> Vec<u8> {
    let mut image: Vec<u8> =
        (0..len as u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8 & 0x7F).collect();
    image[..4].copy_from_slice(&RAM.end().to_le_bytes());
    image[4..8].copy_from_slice(&(APPLICATION.start + 0x101).to_le_bytes());
    image[0x1C..0x2C].fill(0);
    seal(&mut image, 601, &MAP).expect("room for the header");
    image
}

pub(crate) fn file(image: &[u8]) -> Vec<u8> {
    let lines = Encoder::new(APPLICATION.start, image).expect("addresses fit");
    let mut file: Vec<u8> = lines.flat_map(|line| line.as_bytes().to_vec()).collect();
    file.extend_from_slice(end(APPLICATION.start).as_bytes());
    file
}

pub(super) struct Bench {
    bus: Bus<Node>,
}

impl Bench {
    pub(super) fn new() -> Self {
        let node = Node::awake(SimBoard::standard(id(), Model::Averaged, 1));
        let mut bus = Bus::new(vec![node]);
        bus.plug_host("test", Adapter::default()).expect("the first host");
        bus.run_until(500_000);
        Self { bus }
    }

    fn set(&mut self, property: Property, value: i64) {
        let message = Message::set(Destination::Node(id()), property, value).expect("fits");
        self.bus.send(message.frame()).expect("plugged");
    }

    pub(super) fn wait(&mut self, us: u64) {
        let until = self.bus.now_us() + us;
        self.bus.run_until(until);
        while self.bus.receive().is_some() {}
    }

    pub(super) fn get(&mut self, property: Property) -> Option<i64> {
        self.bus.send(Message::get(Destination::Node(id()), property).frame()).expect("plugged");
        let deadline = self.bus.now_us() + 100_000;
        std::iter::from_fn(|| self.bus.wait(deadline)).find_map(|s| answer(&s.frame, NODE, property))
    }

    pub(super) fn application(&self, len: usize) -> &[u8] {
        let flash = self.bus.stations().next().expect("the board").board().sim_flash().bytes();
        let start = (APPLICATION.start - FLASH.start) as usize;
        &flash[start..start + len]
    }

    /// Barrett's downloader (docs/download.md); `None` if the board stops requesting.
    pub(super) fn barrett(&mut self, file: &[u8]) -> Option<()> {
        self.set(Property::STAT, 0);
        let until = self.bus.now_us() + 1_000_000;
        self.bus.run_until(until);
        self.set(Property::VERS, i64::from(START));
        // Reads at most 98 characters a line, skips the first, and stops at one below '0'.
        for line in file.split_inclusive(|&byte| byte == b'\n').flat_map(|line| line.chunks(98)) {
            for &character in line.iter().skip(1).take_while(|&&character| character >= b'0') {
                // Any frame counts as a request. The real host would wait forever.
                let deadline = self.bus.now_us() + 30_000_000;
                self.bus.wait(deadline)?;
                let to = Identifier { from: Id::HOST, to: Destination::Node(id()) };
                self.bus.send(Frame::new(to, &[character]).expect("one byte")).expect("plugged");
            }
        }
        Some(())
    }

    pub(super) fn wake(&mut self) -> u64 {
        let begin = self.bus.now_us();
        self.wait(1_000_000);
        assert_eq!(self.get(Property::ERROR), Some(0));
        self.set(Property::STAT, 2);
        while self.get(Property::STAT) != Some(2) {
            self.wait(10_000);
            assert!(self.bus.now_us() < begin + 20_000_000, "STAT 2 within 20 s");
        }
        self.bus.now_us() - begin
    }

    pub(super) fn ours(&mut self, file: &[u8]) -> Result<(), DownloadError> {
        let mut host = Downloader::new(id(), file, self.bus.now_us());
        loop {
            match host.next(self.bus.now_us()) {
                Next::Done => return Ok(()),
                Next::Failed(error) => return Err(error),
                Next::Send(frame) => self.bus.send(frame).expect("plugged"),
                Next::Wait(until) => {
                    if let Some(stamped) = self.bus.wait(until) {
                        host.receive(&stamped.frame, stamped.at_us);
                    }
                }
            }
        }
    }

    fn stats(&self) -> Stats {
        self.bus.stats().clone()
    }
}

const BYTES: usize = 48 * 1024;

#[test]
fn barretts_downloader_completes_and_ours_needs_a_fifth_of_the_bus() {
    let image = image(BYTES);
    let file = file(&image);

    let mut bench = Bench::new();
    let (before, begin) = (bench.stats(), bench.bus.now_us());
    bench.barrett(&file).expect("the board asks for every character");
    let barrett_us = bench.bus.now_us() - begin;
    let barrett_busy = bench.stats().busy_us - before.busy_us;
    let barrett_wake = bench.wake();
    assert!(bench.application(BYTES) == image, "the new application is in its place");

    let mut bench = Bench::new();
    let (before, begin) = (bench.stats(), bench.bus.now_us());
    bench.ours(&file).expect("the board takes it and starts");
    let ours_us = bench.bus.now_us() - begin;
    let ours_busy = bench.stats().busy_us - before.busy_us;
    assert!(bench.application(BYTES) == image, "the new application is in its place");

    println!(
        "figure: 48 KiB by Barrett's downloader: {:.2} s, and {:.2} s until STAT 2, bus busy {barrett_busy} us; by ours {:.2} s \
         until STAT 2, bus busy {ours_busy} us, {:.1} times fewer; {} characters of file",
        barrett_us as f64 * 1e-6,
        barrett_wake as f64 * 1e-6,
        ours_us as f64 * 1e-6,
        barrett_busy as f64 / ours_busy as f64,
        file.len()
    );
    assert!(5 * ours_busy <= barrett_busy, "{ours_busy} against {barrett_busy}");
    let [ours, barretts] = [ours_us, barrett_us + barrett_wake].map(|us| Near(us as f64 * 1e-6));
    claim(
        "README.md",
        "| new firmware onto a board, {} KiB | {} s; by Barrett's downloader {} s |",
        &[Near(BYTES as f64 / 1024.0), ours, barretts],
    );
    assert_eq!(bench.stats().overruns, 0, "the board never loses a frame to its flash");
}

#[test]
fn noisy_cable_causes_repetitions_but_no_failure() {
    let (image, mut bench) = (image(4096), Bench::new());
    // One frame in 50 is destroyed, one in 200 is lost by its receiver: far worse than any working cable.
    bench.bus.set_medium(Noise::new(3, 0.005, 0.02));
    bench.ours(&file(&image)).expect("it repeats what is lost");
    let stats = bench.stats();
    assert!(stats.errors > 0 && stats.lost > 0, "{stats:?}");
    assert!(bench.application(4096) == image);
}

#[test]
fn host_that_dies_leaves_the_old_application_and_a_usable_monitor() {
    let mut bench = Bench::new();
    let old = placeholder_application();
    let (image, half) = (image(4096), 3_000);
    let file = file(&image);
    bench.barrett(&file[..half]).expect("as far as it goes");
    // The monitor waits 10 s for the next character.
    bench.wait(11_000_000);
    assert_eq!(bench.get(Property::ERROR), Some(i64::from(FaultCode::DownloadTimeout.code())));
    assert!(bench.application(old.len()) == old);
    bench.set(Property::STAT, 2);
    bench.wait(1_000_000);
    assert_eq!(bench.get(Property::STAT), Some(2), "the old application runs");
    bench.ours(&file).expect("the next one succeeds");
    assert!(bench.application(4096) == image);
}

#[test]
fn damaged_file_is_refused_with_its_error() {
    let mut bench = Bench::new();
    let old = placeholder_application();
    let mut file = file(&image(4096));
    // A digit of data in the second record: its checksum no longer matches.
    file[79 + 2 + 40] ^= 1;
    let error = bench.ours(&file).expect_err("damaged");
    assert_eq!(error, DownloadError::Refused { error: i64::from(FaultCode::BadChecksum.code()) });
    assert!(bench.application(old.len()) == old);
    bench.set(Property::STAT, 2);
    bench.wait(1_000_000);
    assert_eq!(bench.get(Property::STAT), Some(2), "the old application runs");
}

#[test]
fn missing_board_is_named() {
    let mut bench = Bench::new();
    bench.bus.cut(0, true);
    assert_eq!(bench.ours(&file(&image(1024))), Err(DownloadError::NoBoard { node: id() }));
}
