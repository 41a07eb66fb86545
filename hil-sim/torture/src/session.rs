//! A hand under torture and its host: what hosts can do, each millisecond with its faults and checks.

use std::hash::{DefaultHasher, Hasher};

use god::io::ABORT;
use servo_core::mode::Mode;

use super::case::{Case, MOTORS};
use super::fault::{Faults, Subject};
use super::invariant::measure::Worst;
use super::invariant::{self, ABORT as ABORTS, ENERGY, GIVES_BACK, IMAGE, Joint, QUEUES, View};
use super::kinds::{FaultKind, Kinds};
use super::observe;
use super::shadow::{self, Settings, Shadow};
use hil_world::hand::Hand;
use hil_world::node::Node;

/// Longest time from ^C to the prompt, ms: up to three properties, each with three questions of 60 ms to a silent board.
const ABORT_MS: u64 = 600;

/// Silence that ends a broken packet, ms: in that a ^C is discarded (docs/wire.md).
const SILENCE_MS: u64 = 21;

/// Data bytes of the largest control block: ^C is data among them.
const BLOCK: usize = 14;

/// Transmit mailboxes of GOD's CAN controller.
const MAILBOXES: usize = 3;

/// An energy residual of this share of the turnover is the integration's error (docs/simulator.md).
const ENERGY_SHARE: f64 = 0.02;

/// A prompt; reports of boards may follow it.
const PROMPTED: &[u8] = b"\n\r=> ";

/// Time in which the prompts of further ^C come, ms.
const LATE_MS: u64 = 30;

/// Time in which what a line has ordered reaches the boards: its prompt may be there before.
const ORDERING_MS: u64 = 10;

/// Silence after which no prompt of a line before is on its way, ms.
const QUIET_MS: u64 = 15;

/// Faults with which orders come from another host or may not arrive: a motor then ends its motion by itself, which may take seconds.
const UNHEARD: [FaultKind; 11] = [
    FaultKind::FrameLost,
    FaultKind::FrameCorrupted,
    FaultKind::FrameDelayed,
    FaultKind::BusOff,
    FaultKind::Babble,
    FaultKind::NoAck,
    FaultKind::CableCut,
    FaultKind::HandPowerCut,
    FaultKind::BoardHang,
    FaultKind::SecondHost,
    // Its answers hide those of a motor that moves.
    FaultKind::SameNumber,
];

/// Faults after which the host does not know to which line a prompt belongs, or another host sets what it likes.
const UNSTEADY: Kinds = Kinds::of(&[
    FaultKind::HostSilent,
    FaultKind::PartialLine,
    FaultKind::HangUp,
    FaultKind::SecondHost,
    FaultKind::HandPowerCut,
]);

/// A failure.
#[derive(Clone, Debug, PartialEq)]
pub struct Violation {
    /// The invariant's name.
    pub invariant: &'static str,
    /// Simulated time, ms.
    pub ms: u64,
    /// The motor's node; 0 for the hand.
    pub node: usize,
    /// What was found.
    pub found: String,
}

/// The result of a run.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// The first failure.
    pub violation: Option<Violation>,
    /// Simulated time, ms.
    pub ms: u64,
    /// From the end of the faults until the hand had homed and moved, ms; `None` if the run ended before.
    pub recovered_ms: Option<u64>,
    /// Joints that the recovery had to turn by hand.
    pub turned_by_hand: u32,
    /// Digest of everything that the host and the bus saw, and of the rotors.
    pub digest: u64,
    /// Commands that ended in a prompt.
    pub prompts: u64,
    /// What the checks have measured at most.
    pub worst: Worst,
    /// Extremes: winding, °C; phase current, A; bus, V.
    pub peaks: [f64; 3],
    /// ERROR values that boards reported, a bit each.
    pub errors: u64,
    /// Status codes (ERR) that the host read while the program ran, added up as GOD adds them.
    pub statuses: u64,
}

/// A hand under torture, and its host.
pub struct Session<'a, S> {
    /// The hand.
    pub hand: Hand<S>,
    pub(super) faults: Faults,
    /// All orders are the host's commands, and boards receive them.
    is_heard: bool,
    joints: Vec<Joint>,
    pub(super) has_faults: bool,
    pub(super) outcome: Outcome,
    digest: DefaultHasher,
    /// The last characters received.
    pub(super) tail: Vec<u8>,
    /// The line that is being received.
    line: Vec<u8>,
    stop_ms: u64,
    seen: Vec<invariant::Seen>,
    answers: observe::Answers,
    /// Bytes and frames that GOD has lost.
    lost: (u32, u32),
    /// Time since the host has read, ms.
    unread_ms: u64,
    /// Time since GOD has last sent something, ms.
    silent_ms: u64,
    /// When a line has last ordered settings, ms.
    ordered_ms: u64,
    pub(super) shadow: Shadow,
    look: &'a mut dyn FnMut(&Hand<S>),
}

impl<'a, S: Subject> Session<'a, S> {
    /// A session with a hand that is new.
    pub fn new(case: &Case, mut hand: Hand<S>, look: &'a mut dyn FnMut(&Hand<S>)) -> Self {
        let faults = Faults::new(case, &mut hand);
        let joints = (0..MOTORS).map(|motor| Joint::new(&case.world, motor)).collect();
        Self {
            hand,
            faults,
            joints,
            is_heard: case.is_plain && !case.faults.iter().any(|fault| UNHEARD.contains(&fault.kind)),
            has_faults: !case.faults.is_empty(),
            outcome: Outcome::default(),
            digest: DefaultHasher::new(),
            tail: Vec::new(),
            line: Vec::new(),
            stop_ms: case.stop_ms,
            seen: Vec::new(),
            answers: observe::Answers::default(),
            lost: (0, 0),
            unread_ms: 0,
            silent_ms: 0,
            ordered_ms: 0,
            shadow: Shadow::default(),
            look,
        }
    }

    /// Lets steps begin and go on after the program's end: for the recovery.
    pub(crate) fn end_program(&mut self) {
        self.stop_ms = u64::MAX;
    }

    /// The outcome, and the hand as the run left it.
    pub fn finish(mut self) -> (Outcome, Hand<S>) {
        self.outcome.ms = self.ms();
        self.outcome.digest = self.digest.finish();
        self.joints.iter().for_each(|joint| self.outcome.worst.merge(&joint.worst));
        (self.outcome, self.hand)
    }

    /// Simulated time, ms.
    pub fn ms(&self) -> u64 {
        self.hand.now_us() / 1_000
    }

    /// Whether nothing has failed.
    pub fn is_whole(&self) -> bool {
        self.outcome.violation.is_none()
    }

    /// An object, or another finger, may stop a finger before its goal.
    pub(super) fn is_blocked(&self) -> bool {
        self.hand.scene().is_some()
    }

    /// Whether the program goes on.
    pub(super) fn goes_on(&self) -> bool {
        self.is_whole() && self.ms() < self.stop_ms
    }

    /// Records a failure, if it is the first.
    pub fn fail(&mut self, invariant: &'static str, node: usize, found: String) {
        let ms = self.ms();
        self.outcome.violation.get_or_insert(Violation { invariant, ms, node, found });
    }

    /// One millisecond, in which the host reads.
    pub fn step(&mut self) {
        self.step_unread();
        if !self.faults.host_silent {
            self.unread_ms = 0;
            let received = self.hand.take_tx();
            self.silent_ms = if received.is_empty() { self.silent_ms + 1 } else { 0 };
            self.digest.write(&received);
            self.outcome.prompts += received.windows(2).filter(|pair| pair == b"=>").count() as u64;
            self.note_statuses(&received);
            self.tail.extend(&received);
            let extra = self.tail.len().saturating_sub(512);
            self.tail.drain(..extra);
        }
    }

    fn note_statuses(&mut self, received: &[u8]) {
        if !self.goes_on() {
            return;
        }
        for &byte in received {
            if !matches!(byte, b'\r' | b'\n') {
                self.line.push(byte);
                continue;
            }
            let line = std::mem::take(&mut self.line);
            let number = line.strip_prefix(b"ERR ").and_then(|digits| std::str::from_utf8(digits).ok());
            self.outcome.statuses |= number.and_then(|number| number.parse().ok()).unwrap_or(0);
        }
    }

    pub(super) fn step_unread(&mut self) {
        let ms = self.ms();
        self.faults.step(&mut self.hand, ms);
        if std::mem::take(&mut self.faults.hangs_up) {
            self.hand.hang_up();
        }
        self.hand.run_until(1_000 * (ms + 1));
        self.unread_ms += 1;
        let recent = self.faults.recent();
        if recent.meets(UNSTEADY) {
            self.shadow.lose_step();
        }
        if recent.meets(Kinds::of(&UNHEARD)) {
            self.shadow.doubt();
        }
        (self.look)(&self.hand);
        self.check();
    }

    /// The hand's settings, as a host may read them; of emulated boards none.
    fn settings(&self) -> Settings {
        let mut boards = self.hand.bus().stations();
        let boards = std::array::from_fn(|_| {
            let node = boards.next()?.native()?;
            let tater = node.application()?;
            let values =
                shadow::settings().filter_map(|property| Some((property, tater.property(property)?)));
            Some((node.starts(), values.collect()))
        });
        (boards, self.hand.memory().parameters())
    }

    /// Settings may have been ordered, and the last orders are on their way.
    pub(super) fn forget_settings(&mut self) {
        self.shadow.forget();
        self.ordered_ms = self.ms();
    }

    fn is_ordering(&self) -> bool {
        self.ms() < self.ordered_ms + ORDERING_MS
    }

    /// Looks at the settings before a command.
    pub(super) fn look_at_settings(&mut self) {
        if self.is_ordering() {
            return;
        }
        let now = self.settings();
        self.shadow.look(now);
    }

    /// Compares the settings at the prompt after a command that leaves them alone; `restored`: it moved without an error.
    pub(super) fn compare_settings(&mut self, restored: bool) {
        if self.is_ordering() {
            return;
        }
        let restored = restored && !self.faults.recent().meets(Kinds::of(&UNHEARD));
        let now = self.settings();
        if let Some((motor, found)) = self.shadow.compare(now, restored) {
            self.fail(GIVES_BACK, motor, found);
        }
    }

    fn check(&mut self) {
        let ms = self.ms();
        for motor in 0..MOTORS {
            self.seen.clear();
            if let Some(node) = self.hand.bus_mut().station_mut(motor).and_then(Subject::native_mut) {
                self.seen.extend(std::iter::from_fn(|| node.board_event()).map(observe::seen));
            }
            let Some(board) = self.hand.bus().stations().nth(motor) else { continue };
            let native = board.native();
            let application = native.and_then(Node::application);
            let (at, answers) = ((ms << 3) + motor as u64, &self.answers);
            let answer = application.map(|tater| move |property| answers.get(at, tater, property));
            let truth = board.rig().truth();
            let view = View {
                ms,
                truth,
                cell: board.rig().hall_cell(),
                volts: board.rig().plant().bus_v,
                bridge: board.bridge(),
                brake_released: board.is_brake_released(),
                ground: native.map(observe::ground),
                answer: answer.as_ref().map(|answer| answer as _),
                seen: &self.seen,
                faults: self.faults.recent_at(motor),
                active: self.faults.active_at(motor),
                anywhere: self.faults.recent(),
            };
            self.digest.write_u64(truth.counts.to_bits());
            self.digest.write_u8(truth.brake_engaged.into());
            let peaks = &mut self.outcome.peaks;
            *peaks =
                [peaks[0].max(truth.winding_c), peaks[1].max(truth.peak_phase_a), peaks[2].max(view.volts)];
            if let Some(fault) = application.and_then(|tater| tater.status().fault) {
                self.outcome.errors |= 1 << (tater_fw::codes::fault_code(fault).code() & 63);
            }
            let broken = self.joints[motor].check(&view);
            let problem = board.problem();
            if let Some((invariant, found)) = broken {
                self.fail(invariant.name, motor + 1, found);
            } else if let Some(problem) = problem {
                self.fail(IMAGE, motor + 1, problem);
            }
        }
        self.check_queues();
        self.digest.write_u64(self.hand.bus().stats().frames);
    }

    fn check_queues(&mut self) {
        let waiting = self.hand.bus().waiting();
        if waiting > MAILBOXES {
            self.fail(QUEUES, 0, format!("{waiting} frames in GOD's mailboxes"));
        }
        let io = self.hand.io();
        let lost = (io.lost_bytes(), io.lost_frames());
        let (bytes, frames) = (lost.0.saturating_sub(self.lost.0), lost.1.saturating_sub(self.lost.1));
        self.lost = lost;
        // In the middle of a line, or for a host that does not read, nobody waits for these frames; one that babbles sends too many.
        let excused = io.waits_for_line()
            || self.unread_ms > 1
            || self.faults.recent_at(0).meets(Kinds::of(&[FaultKind::Babble]));
        if bytes > 0 || frames > 0 && !excused {
            self.fail(QUEUES, 0, format!("GOD lost {bytes} bytes and {frames} frames"));
        }
    }

    pub(super) fn check_energy(&mut self) {
        for motor in 0..MOTORS {
            let Some(ledger) = self.hand.bus().stations().nth(motor).map(|board| board.rig().truth().ledger)
            else {
                continue;
            };
            let (residual, turnover) = (ledger.residual_j(), ledger.turnover_j());
            if residual.abs() > ENERGY_SHARE * turnover.max(1.0) {
                self.fail(ENERGY, motor + 1, format!("{residual:.3} J of {turnover:.3} J"));
            }
        }
    }

    /// Sends bytes as fast as GOD takes them, while the program goes on. Returns whether all were sent.
    pub(super) fn send(&mut self, bytes: &[u8]) -> bool {
        for (at, &byte) in bytes.iter().enumerate() {
            while (self.faults.host_silent || self.faults.holds_line && at > bytes.len() / 2)
                && self.goes_on()
            {
                self.step();
            }
            let mut patience = 50;
            while self.hand.io().rx_room() == 0
                && (byte != ABORT || self.hand.io().is_raw())
                && self.goes_on()
            {
                self.step();
                patience -= 1;
                if patience == 0 && !self.hand.io().is_raw() {
                    self.hand.push_rx(&[ABORT]);
                    patience = 50;
                }
            }
            if !self.goes_on() {
                return false;
            }
            if self.hand.is_on() {
                self.hand.push_rx(&[byte]);
            }
        }
        true
    }

    /// Reads until GOD has nothing more to say.
    pub(super) fn wait_for_silence(&mut self) {
        self.silent_ms = 0;
        while self.silent_ms < QUIET_MS && self.is_whole() {
            self.step();
        }
    }

    pub(super) fn is_at_prompt(&self) -> bool {
        self.tail.windows(PROMPTED.len()).any(|part| part == PROMPTED)
    }

    /// Reads until the prompt, at most so long. Returns whether it came.
    pub(super) fn read_to_prompt(&mut self, most_ms: u64) -> bool {
        let end_ms = self.ms() + most_ms;
        while !self.is_at_prompt() && self.ms() < end_ms && self.is_whole() {
            self.step();
        }
        self.is_at_prompt()
    }

    /// Types a line, and returns what comes up to the prompt, if that comes in time.
    pub(super) fn run_line(&mut self, line: &str, most_ms: u64) -> Option<String> {
        self.tail.clear();
        self.send(format!("{line}\r").as_bytes());
        self.read_to_prompt(most_ms).then(|| String::from_utf8_lossy(&self.tail).into_owned())
    }

    /// Sends ^C, as often as RealTime may take it for data, and waits for the prompt.
    pub(super) fn abort(&mut self) {
        let end_ms = self.ms() + SILENCE_MS;
        while self.ms() < end_ms || self.faults.host_silent && self.goes_on() {
            self.step();
        }
        let began_ms = self.ms();
        self.tail.clear();
        // A key that repeats: the second byte meets the stop orders of the first in GOD.
        let typed: &[u8] = if began_ms.is_multiple_of(2) { &[ABORT] } else { &[ABORT, ABORT] };
        for _ in 0..=BLOCK {
            if self.hand.is_on() {
                self.hand.push_rx(typed);
            }
            self.step();
        }
        while !self.is_at_prompt() && self.is_whole() {
            if !self.hand.is_on() || self.faults.host_silent || self.power_was_cut() {
                return;
            }
            if self.ms() > began_ms + ABORT_MS {
                let tail = self.tail.escape_ascii().to_string();
                self.fail(ABORTS, 0, format!("no prompt within {ABORT_MS} ms of ^C, but {tail:?}"));
            }
            self.step();
        }
        for _ in 0..LATE_MS {
            self.step();
        }
        if self.is_heard && self.is_whole() {
            self.check_stopped();
        }
        // Prompts of lines before may still come.
        if self.silent_ms >= QUIET_MS {
            self.compare_settings(false);
            self.shadow.fall_in_step();
        } else {
            self.shadow.lose_step();
        }
    }

    /// Whether a motor moves on after ^C. One that holds or presses goes on (manual 5.5).
    fn check_stopped(&mut self) {
        for motor in 0..self.joints.len() {
            let board = self.hand.bus().stations().nth(motor);
            let Some(sample) = board.and_then(|board| board.native()).and_then(Node::sample) else {
                continue;
            };
            let (mode, end) = (sample.status.mode, sample.status.end);
            if mode == Mode::Trapezoidal || mode == Mode::Velocity && end.is_none() {
                self.fail(ABORTS, motor + 1, format!("mode {mode:?} goes on {LATE_MS} ms after ^C"));
            }
        }
    }

    /// Whether GOD has lost its power lately, and with it a ^C.
    fn power_was_cut(&self) -> bool {
        self.faults.recent_at(0).meets(Kinds::of(&[FaultKind::HandPowerCut]))
    }
}
