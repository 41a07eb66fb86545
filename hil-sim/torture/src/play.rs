//! Plays a case on a hand: the host's program, while faults come and go; then the recovery.

use god::Memory;
use god::command::{Category, GclCommand};
use god::grammar::{self, Statement};

use super::case::{Case, MOTORS};
use super::deadline::command_us;
use super::download;
use super::fault::{Subject, node_of};
use super::invariant::PROMPT;
use super::program::{Act, Step, packet};
use super::recovery;
use super::session::{Outcome, Session};
use hil_experiment::grasp;
use hil_world::board::SimBoard;
use hil_world::hand::Hand;
use hil_world::node::Node;
use hil_world::plant::{Heat, Model, ParamError, Start};
use hil_world::rig::Rig;

/// Longest time of a line that moves nothing, ms: SAVE waits for motors that coast and for boards that are silent.
const QUIET_MS: u64 = 6_000;

/// Waking boards that were reset, and what WAIT waits for, ms.
const WAKE_MS: u64 = 2_700;

/// What faults may add to a command, ms: boards that do not answer are asked three times for each of a dozen questions, a sagging supply
/// or a slow clock makes a motion last longer.
const FAULTS_MS: u64 = 15_000;

/// The longest default of TSTOP.
const TSTOP_MS: u64 = 400;

/// The default of IVEL either way, counts/s.
const IVEL: u16 = 200;

/// The hand of a case, its boards native.
///
/// # Errors
/// A drawn parameter is out of range: a mistake of the drawing.
pub fn native(case: &Case) -> Result<Hand<Node>, ParamError> {
    let mut boards = Vec::new();
    for motor in 0..MOTORS {
        boards.push(Node::new(SimBoard::new(rig(case, motor)?, node_of(motor))));
    }
    Ok(with_scene(case, Hand::with(boards, Memory::default())))
}

/// A motor of a case.
///
/// # Errors
/// As [`native`].
pub fn rig(case: &Case, motor: usize) -> Result<Rig, ParamError> {
    let world = &case.world;
    let heat = Heat { winding_c: 25.0, housing_c: 25.0 };
    let start = Start { count: world.starts[motor], counts_per_s: 0.0, heat };
    let seed = case.seed.wrapping_add(motor as u64);
    Rig::new(world.plants[motor].clone(), world.rigs[motor].clone(), &[], Model::Averaged, start, seed)
}

/// Puts the case's object and supply into a hand.
pub fn with_scene<S: Subject>(case: &Case, mut hand: Hand<S>) -> Hand<S> {
    let (volts, amps) = case.world.source;
    hand.set_source(volts, amps);
    if let Some(text) = case.world.object
        && let Ok(scene) = grasp::parse("object", text, &hand.pose())
    {
        hand.set_scene(scene);
    }
    hand
}

/// Plays a case; the hand is new. Returns the hand as the run left it.
pub fn play<S: Subject>(case: &Case, hand: Hand<S>) -> (Outcome, Hand<S>) {
    play_watched(case, hand, &mut |_| {})
}

/// [`play`], with a look at the hand after each millisecond.
pub(crate) fn play_watched<S: Subject>(
    case: &Case,
    hand: Hand<S>,
    look: &mut dyn FnMut(&Hand<S>),
) -> (Outcome, Hand<S>) {
    let mut session = Session::new(case, hand, look);
    session.read_to_prompt(1_000);
    session.shadow.fall_in_step();
    for step in &case.steps {
        session.play_step(step);
    }
    while session.ms() < case.stop_ms && session.is_whole() {
        session.step();
    }
    session.end_program();
    if session.is_whole() {
        let ms = session.ms();
        session.faults.heal_all(&mut session.hand, ms);
        recovery::recover(&mut session, ms);
    }
    if session.is_whole() {
        session.check_energy();
    }
    session.finish()
}

impl<S: Subject> Session<'_, S> {
    fn play_step(&mut self, step: &Step) {
        while self.ms() < step.at_ms && self.goes_on() {
            self.step();
        }
        if !self.goes_on() {
            return;
        }
        match &step.act {
            Act::Line { text, patience_ms } => self.line(text, *patience_ms),
            Act::Loop { prefix, blocks } => self.realtime(prefix, blocks),
            Act::Bytes(bytes) => {
                self.shadow.lose_step();
                self.send(bytes);
            }
            Act::Packet(frame) => {
                self.shadow.lose_step();
                self.send(&packet(frame));
            }
            Act::Raw(frames) => {
                self.forget_settings();
                self.shadow.doubt();
                frames.iter().for_each(|frame| self.hand.bus_mut().intrude(*frame));
            }
            Act::Download(node) => {
                self.shadow.lose_step();
                download::run(self, *node);
            }
            Act::Abort => self.abort(),
            Act::HangUp => {
                self.shadow.lose_step();
                self.hand.hang_up();
            }
            Act::Wait { ms, reads } => {
                if !reads {
                    // What it reads next may be the prompt of any line before.
                    self.shadow.lose_step();
                }
                let end_ms = self.ms() + ms;
                while self.ms() < end_ms && self.goes_on() {
                    if *reads { self.step() } else { self.step_unread() }
                }
            }
        }
    }

    fn line(&mut self, text: &str, patience_ms: Option<u64>) {
        let keeps = Keeps::of(text);
        if keeps == Keeps::Nothing {
            self.forget_settings();
        }
        self.look_at_settings();
        self.play_line(text, patience_ms);
        if keeps == Keeps::Nothing {
            self.forget_settings();
        } else if self.is_at_prompt() {
            self.compare_settings(
                keeps == Keeps::WithMotion && !recovery::is_error(&String::from_utf8_lossy(&self.tail)),
            );
        } else {
            self.shadow.lose_step();
        }
    }

    fn play_line(&mut self, text: &str, patience_ms: Option<u64>) {
        self.tail.clear();
        if !self.send(format!("{text}\r").as_bytes()) {
            return;
        }
        let most_ms = patience_ms.unwrap_or_else(|| self.longest_ms(text));
        let end_ms = self.ms() + most_ms;
        while !self.is_at_prompt() && self.ms() < end_ms + self.stalls_ms() && self.is_whole() {
            // A plain command is waited for beyond the end of the program.
            if patience_ms.is_some() && !self.goes_on() || !self.hand.is_on() {
                return;
            }
            self.step();
        }
        if !self.is_at_prompt() && self.is_whole() {
            let ends = self.stalls_ms() < u64::MAX / 2;
            if patience_ms.is_none() && ends && !self.faults.host_silent && self.hand.is_on() {
                self.fail(PROMPT, 0, format!("no prompt within {most_ms} ms of {text:?}"));
            } else {
                self.abort();
            }
        }
    }

    fn longest_ms(&self, text: &str) -> u64 {
        let moving_ms = command_us(&text.to_ascii_uppercase(), 400).unwrap_or(0) / 1_000;
        let faults_ms = if self.has_faults { moving_ms + FAULTS_MS } else { 0 };
        moving_ms + QUIET_MS + WAKE_MS + faults_ms
    }

    /// By how much another host has lengthened the motions of a plain program, which changes no parameter itself. With a longer TSTOP HI has
    /// three stalls of the links and then three of the tips, and two to spare. TSTOP 0 is for ever, and so is, to this check, a lower IVEL.
    fn stalls_ms(&self) -> u64 {
        let of = |board: &S| {
            let Some(application) = board.native().and_then(Node::application) else { return 0 };
            let config = application.config();
            if config.tstop == 0 || config.ivel.unsigned_abs() < IVEL {
                u64::MAX / 2
            } else {
                8 * u64::from(config.tstop).saturating_sub(TSTOP_MS)
            }
        };
        self.hand.bus().stations().map(of).max().unwrap_or(0)
    }

    fn realtime(&mut self, prefix: &str, blocks: &[(Vec<u8>, u64)]) {
        self.look_at_settings();
        self.tail.clear();
        self.send(format!("{prefix}LOOP\r").as_bytes());
        for (block, pause_ms) in blocks {
            self.send(block);
            for _ in 0..*pause_ms {
                if self.goes_on() {
                    self.step();
                }
            }
        }
        self.abort();
    }
}

/// What a line leaves as it was.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Keeps {
    /// It may set anything.
    Nothing,
    /// It asks, or is none of the language.
    Settings,
    /// It moves, and restores before what an earlier motion has left.
    WithMotion,
}

impl Keeps {
    fn of(text: &str) -> Self {
        let line = text.to_ascii_uppercase();
        let command = match grammar::parse(&line) {
            Ok(Statement::Command { command, .. }) => command,
            Ok(Statement::Lower(_)) => return Self::Nothing,
            Ok(Statement::Empty) | Err(_) => return Self::Settings,
        };
        match (command, command.row().map(|row| row.category)) {
            // GOD takes its stored parameters.
            (GclCommand::Reset, _) => Self::Nothing,
            // T only switches off.
            (GclCommand::T, _) => Self::Settings,
            (_, Some(Category::Movement)) => Self::WithMotion,
            (GclCommand::Fget | GclCommand::Flistv | GclCommand::Pget | GclCommand::Plistv, _)
            | (_, Some(Category::Administration)) => Self::Settings,
            _ => Self::Nothing,
        }
    }
}
