//! A host that says anything to a whole hand, and looks at it all the while.

use god::Memory;
use god::io::ABORT;
use hil_sim::grasp;
use hil_sim::hand::Hand;
use hil_sim::plant::Model;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

use super::watch::{Most, Watch};

const BALL: &str = include_str!("../../../hil-sim/grasps/ball.toml");

/// The largest control block, all seven motors with velocity and gain: so many bytes after LOOP's header are data, ^C too.
const BLOCK: usize = 14;

/// How long the prompt may take after ^C, us: GOD ends the motion, and gives MV, BT and KPV back, each with three questions of 60 ms to boards
/// that do not answer any more; and the ^C of a whole block go before it, a millisecond each, and 20 ms in which a host is heard out that has
/// said no header.
const PROMPT_US: u64 = 600_000;

/// What GOD may keep for a host that does not read.
pub const UNREAD: usize = 1024;

/// Longest that a line may take to its end, ms of simulated time: HI or a slow motion.
const LINE_MS: usize = 120_000;

/// What was done, and what came of it.
#[derive(Clone, Debug, Default)]
pub struct Figure {
    /// Bytes said to GOD.
    pub bytes: u64,
    /// RealTime blocks among them.
    pub blocks: u64,
    pub hang_ups: u64,
    /// Prompts that were said.
    prompts: u64,
    simulated_us: u64,
    most: Most,
}

impl Figure {
    pub fn and(mut self, other: Self) -> Self {
        self.bytes += other.bytes;
        self.blocks += other.blocks;
        self.hang_ups += other.hang_ups;
        self.prompts += other.prompts;
        self.simulated_us += other.simulated_us;
        self.most = self.most.and(other.most);
        self
    }
}

impl std::fmt::Display for Figure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { bytes, blocks, hang_ups, prompts, simulated_us, most } = self;
        let seconds = simulated_us / 1_000_000;
        write!(
            f,
            "{bytes} bytes, {prompts} prompts, {blocks} blocks, {hang_ups} hang-ups in {seconds} s of simulated time; {most}"
        )
    }
}

/// The host and its hand.
pub struct Client {
    pub hand: Hand,
    pub rng: Pcg64Mcg,
    pub figure: Figure,
    watch: Watch,
    /// The end of what was said.
    tail: Vec<u8>,
}

impl Client {
    /// Of a hand that has just prompted; with an odd seed there is a ball between its fingers, and they meet each other.
    pub fn new(seed: u128) -> Self {
        let mut hand = Hand::new(Model::Averaged, 1, Memory::default());
        if seed % 2 == 1 {
            hand.set_scene(grasp::parse("ball.toml", BALL).expect("a world"));
        }
        let mut client = Self {
            hand,
            rng: Pcg64Mcg::new(seed),
            figure: Figure::default(),
            watch: Watch::new(),
            tail: Vec::new(),
        };
        client.until_prompt(1_000);
        client
    }

    // --- time -------------------------------------------------------------------------------------------

    /// A millisecond in which the host reads nothing.
    pub fn deaf_ms(&mut self) {
        let next_us = (self.hand.now_us() / 1000 + 1) * 1000;
        self.hand.run_until(next_us);
        self.watch.look(&self.hand);
    }

    /// A millisecond; what was said in it.
    pub fn ms(&mut self) -> Vec<u8> {
        self.deaf_ms();
        let said = self.hand.take_tx();
        assert!(said.len() <= UNREAD, "{} bytes waited", said.len());
        self.figure.prompts += said.windows(2).filter(|pair| pair == b"=>").count() as u64;
        self.tail.extend(&said);
        self.tail.drain(..self.tail.len().saturating_sub(16));
        said
    }

    /// Reads so many bytes, or as many as have come by then.
    pub fn reads(&mut self, count: usize, most_ms: usize) -> Vec<u8> {
        let mut said = Vec::new();
        for _ in 0..most_ms {
            said.extend(self.ms());
            if said.len() >= count {
                break;
            }
        }
        said
    }

    /// Some time, at most so long.
    pub fn waits(&mut self, most_ms: u32) {
        for _ in 0..self.rng.random_range(0..=most_ms) {
            self.ms();
        }
    }

    /// Some time, at most so long, in which it reads nothing.
    pub fn is_deaf(&mut self, most_ms: u32) {
        for _ in 0..self.rng.random_range(0..=most_ms) {
            self.deaf_ms();
        }
    }

    /// Until the prompt is there, or so long.
    pub fn waits_for_prompt(&mut self, most_ms: usize) {
        for _ in 0..most_ms {
            if self.tail.ends_with(b"\n\r=> ") {
                return;
            }
            self.ms();
        }
    }

    // --- what the host does -----------------------------------------------------------------------------

    /// Says bytes as fast as GOD takes them. One that is kept waiting says ^C with a probability of 1 in `patience_ms` a millisecond, which
    /// in text makes what waits void.
    pub fn says(&mut self, bytes: &[u8], patience_ms: u32) {
        for &byte in bytes {
            while self.hand.io().rx_room() == 0 && (byte != ABORT || self.hand.io().is_raw()) {
                self.ms();
                if self.rng.random_ratio(1, patience_ms) && !self.hand.io().is_raw() {
                    self.hand.push_rx(&[ABORT]);
                }
            }
            self.hand.push_rx(&[byte]);
        }
        self.figure.bytes += bytes.len() as u64;
        // GOD has no room for more before it has been polled.
        if self.hand.io().rx_room() == 0 {
            self.ms();
        }
    }

    /// Whether it is to hang up now, once in so many times; what it said before is in mid-line, or a block.
    pub fn may_hang_up(&mut self, times: u32) -> bool {
        let hangs_up = self.rng.random_ratio(1, times);
        if hangs_up {
            self.hand.hang_up();
            self.figure.hang_ups += 1;
        }
        hangs_up
    }

    /// Types a line and waits for the prompt; what was said.
    pub fn line(&mut self, line: &str) -> String {
        self.hand.push_rx(line.as_bytes());
        self.hand.push_rx(b"\r");
        self.figure.bytes += line.len() as u64 + 1;
        self.until_prompt(LINE_MS)
    }

    fn until_prompt(&mut self, most_ms: usize) -> String {
        let mut said = Vec::new();
        for _ in 0..most_ms {
            said.extend(self.ms());
            if said.ends_with(b"\n\r=> ") {
                return said.into_iter().map(char::from).collect();
            }
        }
        panic!("no prompt within {most_ms} ms, but {:?}", said.escape_ascii().to_string());
    }

    /// ^C, as often as RealTime may take it for data, gives the prompt back.
    pub fn aborts(&mut self) {
        let begun_us = self.hand.now_us();
        self.tail.clear();
        for _ in 0..=BLOCK {
            self.hand.push_rx(&[ABORT]);
            self.ms();
        }
        while !self.tail.ends_with(b"\n\r=> ") {
            let tail = self.tail.escape_ascii().to_string();
            assert!(
                self.hand.now_us() < begun_us + PROMPT_US,
                "no prompt within {PROMPT_US} us, but {tail:?}"
            );
            self.ms();
        }
        self.watch.most.prompt_us = self.watch.most.prompt_us.max(self.hand.now_us() - begun_us);
    }

    /// All parameters, all properties of the boards are what they were at first, and motors know where they are.
    pub fn homes(&mut self) {
        self.aborts();
        for line in [
            "REC",
            "PDEF",
            "0 S REPLY 0",
            "WAKE",
            "1234567 S STAT 2",
            "1234567 S DEF -1",
            "X1234567FDEF",
            "HI",
        ] {
            self.line(line);
        }
    }

    /// The prompt comes back, the hand can be switched off, and with its defaults it does what it always did.
    pub fn ends(mut self) -> Figure {
        self.aborts();
        self.line("X1234567T");
        (0..1_000).for_each(|_| _ = self.ms());
        for (motor, node) in self.hand.bus().stations().enumerate() {
            let speed = node.board().rig().truth().counts_per_s;
            assert!(speed == 0.0 && node.board().driven_since_us().is_none(), "motor {}: {speed}", motor + 1);
        }
        self.homes();
        for line in ["FGET EN", "HI", "C", "O"] {
            let answer = if line == "FGET EN" { "\r\n\r1 1 1 1" } else { "" };
            assert_eq!(self.line(line), format!("{line}{answer}\r\n\r=> "));
        }
        self.figure.simulated_us = self.hand.now_us();
        self.figure.most = self.watch.most;
        self.figure
    }
}
