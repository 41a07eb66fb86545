//! A host that sends anything to a simulated hand and checks it each millisecond.

use god::Memory;
use god::io::ABORT;
use hil_experiment::grasp;
use hil_world::hand::Hand;
use hil_world::plant::Model;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

use super::watch::{Peaks, Watch};

const BALL: &str = include_str!("../../../hil-sim/grasps/ball.toml");

/// Data bytes of the largest control block, velocity and gain of seven motors. ^C is data among them.
const BLOCK: usize = 14;

/// Longest time from ^C to the prompt, us: restoring MV, BT and KPV, with three questions of 60 ms each to silent boards. A block's worth of
/// ^C, a millisecond each, and the 20 ms drain after a bad header come before.
const PROMPT_US: u64 = 600_000;

pub const UNREAD: usize = 1024;

/// Timeout of a line, ms of simulated time; HI and slow motions take longest.
const LINE_MS: usize = 120_000;

/// Silence that ends a broken packet, and a millisecond.
const SILENCE_MS: u32 = 21;

#[derive(Clone, Debug, Default)]
pub struct Figure {
    pub bytes: u64,
    /// RealTime blocks among them.
    pub blocks: u64,
    pub hang_ups: u64,
    prompts: u64,
    simulated_us: u64,
    peaks: Peaks,
}

impl Figure {
    pub const fn peaks(&self) -> &Peaks {
        &self.peaks
    }

    pub fn merge(mut self, other: Self) -> Self {
        self.bytes += other.bytes;
        self.blocks += other.blocks;
        self.hang_ups += other.hang_ups;
        self.prompts += other.prompts;
        self.simulated_us += other.simulated_us;
        self.peaks = self.peaks.merge(other.peaks);
        self
    }
}

impl std::fmt::Display for Figure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { bytes, blocks, hang_ups, prompts, simulated_us, peaks } = self;
        let seconds = simulated_us / 1_000_000;
        write!(
            f,
            "{bytes} bytes, {prompts} prompts, {blocks} blocks, {hang_ups} hang-ups in {seconds} s of simulated time; {peaks}"
        )
    }
}

pub struct Client {
    pub hand: Hand,
    pub rng: Pcg64Mcg,
    pub figure: Figure,
    watch: Watch,
    tail: Vec<u8>,
}

impl Client {
    /// A hand at its first prompt. With an odd seed there is a ball between its fingers, and they can touch each other.
    pub fn new(seed: u128) -> Self {
        let mut hand = Hand::new(Model::Averaged, 1, Memory::default());
        if seed % 2 == 1 {
            hand.set_scene(grasp::parse("ball.toml", BALL, &hand.pose()).expect("a world"));
        }
        let mut client = Self {
            hand,
            rng: Pcg64Mcg::new(seed),
            figure: Figure::default(),
            watch: Watch::new(),
            tail: Vec::new(),
        };
        client.read_to_prompt(1_000);
        client
    }

    pub fn step_unread(&mut self) {
        let next_us = (self.hand.now_us() / 1000 + 1) * 1000;
        self.hand.run_until(next_us);
        self.watch.check(&self.hand);
    }

    pub fn step(&mut self) -> Vec<u8> {
        self.step_unread();
        let received = self.hand.take_tx();
        assert!(received.len() <= UNREAD, "{} bytes waited", received.len());
        self.figure.prompts += received.windows(2).filter(|pair| pair == b"=>").count() as u64;
        self.tail.extend(&received);
        self.tail.drain(..self.tail.len().saturating_sub(16));
        received
    }

    pub fn read(&mut self, count: usize, max_ms: usize) -> Vec<u8> {
        let mut received = Vec::new();
        for _ in 0..max_ms {
            received.extend(self.step());
            if received.len() >= count {
                break;
            }
        }
        received
    }

    pub fn wait(&mut self, max_ms: u32) {
        for _ in 0..self.rng.random_range(0..=max_ms) {
            self.step();
        }
    }

    pub fn wait_unread(&mut self, max_ms: u32) {
        for _ in 0..self.rng.random_range(0..=max_ms) {
            self.step_unread();
        }
    }

    pub fn type_line(&mut self, line: &str) {
        self.tail.clear();
        self.hand.push_rx(line.as_bytes());
        self.hand.push_rx(b"\r");
        self.figure.bytes += line.len() as u64 + 1;
    }

    /// Whether a prompt was the last that GOD sent since [`Self::type_line`].
    pub fn is_at_prompt(&self) -> bool {
        self.tail.ends_with(b"\n\r=> ")
    }

    pub fn expect_any_fault(&mut self) {
        self.watch.any_fault = true;
    }

    pub fn wait_for_prompt(&mut self, max_ms: usize) {
        for _ in 0..max_ms {
            if self.tail.ends_with(b"\n\r=> ") {
                return;
            }
            self.step();
        }
    }

    /// Sends bytes as fast as GOD takes them. While it waits for room it sends ^C with probability
    /// 1/`patience_ms` each millisecond, which drops the type-ahead.
    pub fn send(&mut self, bytes: &[u8], patience_ms: u32) {
        for &byte in bytes {
            while self.hand.io().rx_room() == 0 && (byte != ABORT || self.hand.io().is_raw()) {
                self.step();
                if self.rng.random_ratio(1, patience_ms) && !self.hand.io().is_raw() {
                    self.hand.push_rx(&[ABORT]);
                }
            }
            self.hand.push_rx(&[byte]);
        }
        self.figure.bytes += bytes.len() as u64;
        // GOD frees room only when it is polled.
        if self.hand.io().rx_room() == 0 {
            self.step();
        }
    }

    /// Hangs up once in `times` calls. Returns whether it did.
    pub fn maybe_hang_up(&mut self, times: u32) -> bool {
        let hangs_up = self.rng.random_ratio(1, times);
        if hangs_up {
            self.hand.hang_up();
            self.figure.hang_ups += 1;
        }
        hangs_up
    }

    pub fn run(&mut self, line: &str) -> String {
        self.hand.push_rx(line.as_bytes());
        self.hand.push_rx(b"\r");
        self.figure.bytes += line.len() as u64 + 1;
        self.read_to_prompt(LINE_MS)
    }

    fn read_to_prompt(&mut self, max_ms: usize) -> String {
        let mut received = Vec::new();
        for _ in 0..max_ms {
            received.extend(self.step());
            if received.ends_with(b"\n\r=> ") {
                return received.into_iter().map(char::from).collect();
            }
        }
        panic!("no prompt within {max_ms} ms, but {:?}", received.escape_ascii().to_string());
    }

    /// Sends ^C, as often as RealTime may take it for data, and waits for the prompt. Before it a silence ends what a packet with a wrong
    /// length has begun: in that a ^C is discarded (docs/wire.md).
    pub fn abort(&mut self) {
        (0..SILENCE_MS).for_each(|_| _ = self.step());
        let start_us = self.hand.now_us();
        self.tail.clear();
        for _ in 0..=BLOCK {
            self.hand.push_rx(&[ABORT]);
            self.step();
        }
        while !self.tail.ends_with(b"\n\r=> ") {
            let tail = self.tail.escape_ascii().to_string();
            assert!(
                self.hand.now_us() < start_us + PROMPT_US,
                "no prompt within {PROMPT_US} us, but {tail:?}"
            );
            self.step();
        }
        self.watch.peaks.prompt_us = self.watch.peaks.prompt_us.max(self.hand.now_us() - start_us);
    }

    pub fn restore_and_home(&mut self) {
        self.abort();
        for line in [
            // It is ended, whether one was active or not.
            "REC 5",
            "REC",
            "PDEF",
            "0 S REPLY 0",
            "WAKE",
            "1234567 S STAT 2",
            "1234567 S DEF -1",
            "X1234567FDEF",
            "HI",
        ] {
            self.run(line);
        }
    }

    /// Checks that ^C brings the prompt back, and that T stops every motor.
    fn stop(&mut self) {
        self.abort();
        self.run("X1234567T");
        (0..1_000).for_each(|_| _ = self.step());
        for (motor, node) in self.hand.bus().stations().enumerate() {
            let speed = node.board().rig().truth().counts_per_s;
            assert!(speed == 0.0 && node.board().driven_since_us().is_none(), "motor {}: {speed}", motor + 1);
        }
    }

    /// As [`Self::stop`]; returns what was found.
    pub fn stop_all(mut self) -> Figure {
        self.stop();
        self.into_figure()
    }

    /// As [`Self::stop`]; then checks that the hand moves normally with its defaults.
    pub fn finish(mut self) -> Figure {
        self.stop();
        self.restore_and_home();
        for line in ["FGET EN", "HI", "C", "O"] {
            let answer = if line == "FGET EN" { "\r\n\r1 1 1 1" } else { "" };
            assert_eq!(self.run(line), format!("{line}{answer}\r\n\r=> "));
        }
        self.into_figure()
    }

    fn into_figure(mut self) -> Figure {
        self.figure.simulated_us = self.hand.now_us();
        self.figure.peaks = self.watch.peaks;
        self.figure
    }
}
