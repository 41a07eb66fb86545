//! What hosts do: the steps of a program, drawn with each seed's own mixture.

use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use tater_wire::{Destination, Frame, Group, Identifier, Message, Node as Id, Property};

use god::command::{Category, CommandSpec, GclCommand};
use god::grammar::{self, Statement};

use super::lines::{self, one};

/// Something that a host does.
#[derive(Clone, Debug, PartialEq)]
pub enum Act {
    /// Types a line and waits for its prompt, at most this long; then ^C.
    Line {
        /// The line, without its end.
        text: String,
        /// The patience, ms; `None`: the longest time that the command may take, whose excess is a failure.
        patience_ms: Option<u64>,
    },
    /// A RealTime session: LOOP with a prefix, blocks of bytes with pauses, then ^C.
    Loop {
        /// The motors' prefix.
        prefix: String,
        /// Blocks, and the pause after each, ms.
        blocks: Vec<(Vec<u8>, u64)>,
    },
    /// Any bytes.
    Bytes(Vec<u8>),
    /// A frame of its own, as a packet through GOD.
    Packet(Frame),
    /// Frames of other hosts on the bus.
    Raw(Vec<Frame>),
    /// Downloads the application to a board, over the bus.
    Download(Id),
    /// ^C, and waits for the prompt.
    Abort,
    /// Disconnects.
    HangUp,
    /// Waits, reading or not, ms.
    Wait {
        /// Duration, ms.
        ms: u64,
        /// Whether it reads meanwhile.
        reads: bool,
    },
}

impl Act {
    /// Whether it is a plain motion.
    #[must_use]
    pub fn moves(&self) -> bool {
        matches!(self, Self::Line { text, .. } if MOVES.contains(&text.as_str()))
    }

    /// Whether it is a motion that presses.
    #[must_use]
    pub(crate) fn heats(&self) -> bool {
        matches!(self, Self::Line { text, .. } if HEATING.contains(&text.as_str()))
    }
}

/// A step of the host's program.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// It does not begin before this time, ms.
    pub at_ms: u64,
    /// What the host does.
    pub act: Act,
}

/// Weights of the steps of one seed's program.
#[derive(Clone, Copy, Debug)]
pub struct Program {
    is_plain: bool,
    lines: u32,
    moves: u32,
    loops: u32,
    packets: u32,
    raw: u32,
    saves: u32,
    downloads: u32,
    rude: u32,
}

/// Steps of a program at most.
const STEPS: usize = 60;

/// The motions of the host's language, without arguments or with plain ones.
const MOVES: [&str; 18] = [
    "HI", "C", "O", "GC", "GO", "SC", "SO", "M 8000", "M 15000", "GM 3000", "SM 1500", "IC", "IO", "TC",
    "TO", "HOME", "12C", "X57O",
];

/// Motions that press, and what makes them press again: stalls heat a winding by 24 K/s (docs/safety.md).
const HEATING: [&str; 8] = ["TC", "TO", "TC", "TO", "GTC", "STC", "HI", "123TO"];

/// Longest pause between two of them, ms: TSTOP is 300.
const HEATING_PAUSE_MS: u64 = 800;

/// Longest rest of a long program, ms: a housing cools within minutes.
const REST_MS: u64 = 120_000;

/// Longest argument of WAIT, ms: a longer one would be the run.
const WAIT_MS: u64 = 1_000;

impl Program {
    /// Weights of a seed.
    pub fn draw(rng: &mut Pcg64Mcg, is_plain: bool) -> Self {
        let mut weight = |most: u32| if rng.random_ratio(1, 3) { 0 } else { rng.random_range(1..=most) };
        Self {
            is_plain,
            lines: weight(10),
            moves: weight(20),
            loops: if is_plain { 0 } else { weight(3) },
            packets: if is_plain { 0 } else { weight(6) },
            raw: if is_plain { 0 } else { weight(6) },
            saves: weight(4),
            downloads: if is_plain { 0 } else { weight(1) },
            rude: weight(3),
        }
    }

    /// The steps up to `stop_ms`.
    pub fn steps(&self, rng: &mut Pcg64Mcg, stop_ms: u64) -> Vec<Step> {
        let mut steps = Vec::new();
        let mut at_ms = rng.random_range(0..50);
        if rng.random_ratio(3, 4) {
            steps.push(Step { at_ms, act: self.line("HI".to_owned(), rng) });
        }
        while at_ms < stop_ms && steps.len() < STEPS {
            steps.push(Step { at_ms, act: self.act(rng) });
            let pause_ms = if rng.random() { 20 } else { 700 };
            at_ms += rng.random_range(0..=pause_ms);
        }
        steps
    }

    /// The steps of a long program: spells of work, some of which heat windings, and rests in which they cool.
    pub(crate) fn long_steps(&self, rng: &mut Pcg64Mcg, stop_ms: u64) -> Vec<Step> {
        let mut steps = vec![Step { at_ms: 0, act: self.line("HI".to_owned(), rng) }];
        let mut at_ms = 4_000;
        while at_ms < stop_ms {
            if rng.random_ratio(1, 4) {
                at_ms += rng.random_range(1_000..=REST_MS);
                continue;
            }
            if rng.random() {
                at_ms = self.heat(rng, at_ms, &mut steps);
                continue;
            }
            for _ in 0..rng.random_range(1..=STEPS) {
                steps.push(Step { at_ms, act: self.act(rng) });
                at_ms += rng.random_range(0..=3_000);
            }
        }
        steps
    }

    /// A spell that heats windings up to their limit: one motion that presses, again and again, and now and then something else. Returns its end.
    fn heat(&self, rng: &mut Pcg64Mcg, mut at_ms: u64, steps: &mut Vec<Step>) -> u64 {
        let text = *one(rng, &HEATING);
        let presses_on = !self.is_plain && rng.random();
        for _ in 0..rng.random_range(1..=STEPS) {
            let act = match rng.random_range(0..8) {
                0 => self.act(rng),
                // Again and again: a board that has started anew does not have it.
                1 if presses_on => self.line("FSET HOLD 1 TSTOP 0".to_owned(), rng),
                _ => self.line(text.to_owned(), rng),
            };
            steps.push(Step { at_ms, act });
            at_ms += rng.random_range(0..=HEATING_PAUSE_MS);
        }
        at_ms
    }

    fn line(&self, text: String, rng: &mut Pcg64Mcg) -> Act {
        let patience_ms = (!self.is_plain).then(|| rng.random_range(1..=4_000));
        Act::Line { text, patience_ms }
    }

    fn act(&self, rng: &mut Pcg64Mcg) -> Act {
        let Self { lines, moves, loops, packets, raw, saves, downloads, rude, .. } = *self;
        let weights = [lines, moves, loops, packets, raw, saves, downloads, rude, 1];
        let mut at = rng.random_range(0..weights.iter().sum::<u32>());
        let mut chosen = 0;
        while at >= weights[chosen] {
            at -= weights[chosen];
            chosen += 1;
        }
        match chosen {
            0 => {
                let text = if self.is_plain { plain_line(rng, WAIT_MS).0 } else { lines::command(rng) };
                self.line(text, rng)
            }
            1 => {
                let text = (*one(rng, &MOVES)).to_owned();
                self.line(text, rng)
            }
            2 => realtime(rng),
            3 => Act::Packet(frame(rng)),
            4 => Act::Raw((0..rng.random_range(1..=8)).map(|_| frame(rng)).collect()),
            5 => {
                let text = *one(rng, &["FSAVE", "SAVE", "XGSFSAVE", "PSAVE", "X4FSAVE"]);
                self.line(text.to_owned(), rng)
            }
            6 => Act::Download(*one(rng, &NODES)),
            7 => rude_act(rng),
            _ => Act::Wait { ms: rng.random_range(1..=600), reads: true },
        }
    }
}

const NODES: [Id; 7] = {
    const fn id(number: u8) -> Id {
        match Id::new(number) {
            Some(id) => id,
            None => Id::HOST,
        }
    }
    [id(1), id(2), id(3), id(4), id(5), id(6), id(7)]
};

fn rude_act(rng: &mut Pcg64Mcg) -> Act {
    match rng.random_range(0..5) {
        0 => Act::Abort,
        1 => Act::HangUp,
        2 => Act::Wait { ms: rng.random_range(1..=900), reads: false },
        3 => Act::Bytes((0..rng.random_range(1..64)).map(|_| rng.random()).collect()),
        _ => Act::Bytes(lines::word(rng).into_bytes()),
    }
}

fn realtime(rng: &mut Pcg64Mcg) -> Act {
    let blocks = (0..rng.random_range(1..80))
        .map(|_| {
            let header = *one(rng, b"CCCcAa");
            let data: [u8; 14] = rng.random();
            let len = *one(rng, &[2, 4, 6, 8, 14, 14]);
            ([&[header], &data[..len]].concat(), rng.random_range(1..=20))
        })
        .collect();
    Act::Loop { prefix: lines::prefix(rng), blocks }
}

/// Properties that raw frames leave alone: they say what the host states of the motor, which the board must believe, who it is, or in
/// which units the frames are.
const STATED: [Property; 9] = [
    Property::HOSTUNITS,
    Property::WIRING,
    Property::FIND,
    Property::LOCK,
    Property::ID,
    Property::KIND,
    Property::GRPA,
    Property::GRPB,
    Property::GRPC,
];

/// A frame to a board or a group: mostly a SET or GET with a value in range.
pub fn frame(rng: &mut Pcg64Mcg) -> Frame {
    loop {
        let to = match rng.random_range(0..4) {
            0 => Destination::Group(Group::new(*one(rng, &[0, 1, 2, 4])).unwrap_or(Group::ALL)),
            _ => Destination::Node(*one(rng, &NODES)),
        };
        if rng.random_ratio(1, 10) {
            let bytes: [u8; 8] = rng.random();
            let len = rng.random_range(0..=8);
            let property = Property::of(bytes[0] & 0x7F);
            let id = Identifier { from: Id::HOST, to };
            if property.is_none_or(|property| !STATED.contains(&property))
                && let Some(frame) = Frame::new(id, &bytes[..len])
            {
                return frame;
            }
            continue;
        }
        let property = if rng.random() {
            *one(
                rng,
                &[
                    Property::M,
                    Property::E,
                    Property::CMD,
                    Property::MODE,
                    Property::V,
                    Property::T,
                    Property::STAT,
                ],
            )
        } else {
            *one(rng, lines::PROPERTIES)
        };
        if STATED.contains(&property) {
            continue;
        }
        if rng.random_ratio(1, 4) {
            return Message::get(to, property).frame();
        }
        let (min, max) = lines::range(property);
        let value = match property {
            Property::M | Property::E | Property::P => rng.random_range(-60..=360),
            Property::CMD => i64::from(*one(rng, &[13u8, 13, 14, 15, 16, 17, 18, 19, 20, 21, 7, 0, 1, 3])),
            Property::STAT => *one(rng, &[2, 2, 2, 0]),
            Property::V => rng.random_range(-1_000..=1_000),
            _ if rng.random_ratio(1, 8) => *one(rng, &[min, max]),
            _ => rng.random_range(min..=max),
        };
        if let Some(message) = Message::set(to, property, value) {
            return message.frame();
        }
    }
}

/// A frame as the host sends it through GOD.
pub fn packet(frame: &Frame) -> Vec<u8> {
    [&frame.raw_id().to_be_bytes()[..], &[frame.data().len() as u8], frame.data()].concat()
}

/// A line that leaves the parameters alone, and its command. WAIT's argument is at most `wait_ms`.
pub fn plain_line(rng: &mut Pcg64Mcg, wait_ms: u64) -> (String, &'static CommandSpec) {
    loop {
        let line = lines::command(rng).to_ascii_uppercase();
        let Ok(Statement::Command { command, .. }) = grammar::parse(&line) else { continue };
        let Some(row) = command.row() else { continue };
        match (command, row.category) {
            (GclCommand::Loop | GclCommand::Play | GclCommand::Rec, _) => {}
            (GclCommand::Wait, _) => {
                let ms = line.split_whitespace().last().and_then(|word| word.parse().ok());
                if ms.is_none_or(|ms: u64| ms <= wait_ms) {
                    return (line, row);
                }
            }
            (GclCommand::Mac, _) | (_, Category::Movement | Category::Administration) => return (line, row),
            (GclCommand::Fget | GclCommand::Pget | GclCommand::Flistv | GclCommand::Macset, _) => {
                return (line, row);
            }
            _ => {}
        }
    }
}
