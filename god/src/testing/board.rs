//! A motor board without a motor: answers GETs, takes SETs, and ends its motions when and as it is told.

use std::collections::VecDeque;
use std::string::{String, ToString};
use std::vec::Vec;

use tater_wire::property::{Access, ROWS};
use tater_wire::{Cmd, Destination, EndCode, Group, ModeCode, MotorKind, Node, Property};

/// HALLH: the position is known.
const POSITION_KNOWN: i64 = 1 << 30;

/// Duration of a motion and of waking up unless a test says otherwise, µs.
const MOTION_US: u64 = 100_000;
const WAKE_US: u64 = 300_000;

/// How a motion ends.
#[derive(Clone, Copy)]
struct End {
    code: EndCode,
    /// µs after the order.
    after_us: u64,
    /// P then; its goal by default.
    position: Option<i64>,
}

struct Motion {
    end: End,
    end_us: u64,
    goal: i64,
    /// TC or TO: with HOLD it presses on in mode 4.
    presses: bool,
    homes: bool,
    /// MODE 5 ordered it: it ends in mode 3 whatever HOLD is.
    holds: bool,
}

pub(super) struct Board {
    pub node: Node,
    values: [i64; 128],
    saved: [i64; 128],
    refused: Vec<Property>,
    muted: Vec<Property>,
    /// Of the next motions.
    ends: VecDeque<End>,
    refuses_motions: bool,
    motion: Option<Motion>,
    wakes_us: Option<u64>,
    pub is_silent: bool,
    /// This many answers will be lost.
    pub loses: u32,
    /// Time to answer, µs.
    pub late_us: u64,
}

pub(super) type Report = (Property, i64);

impl Board {
    /// Awake, at position 0, which it knows.
    pub fn new(node: Node) -> Self {
        let mut values = [0; 128];
        for row in ROWS {
            values[usize::from(row.property.id())] = row.rules.default_for(node).unwrap_or(0);
        }
        let mut board = Self {
            node,
            values,
            saved: values,
            refused: Vec::new(),
            muted: Vec::new(),
            ends: VecDeque::new(),
            refuses_motions: false,
            motion: None,
            wakes_us: None,
            is_silent: false,
            loses: 0,
            late_us: 0,
        };
        board.put(Property::STAT, 2);
        board.put(Property::HALLH, POSITION_KNOWN);
        board.put(Property::TEMP, 350);
        board
    }

    pub fn receives(&self, to: Destination) -> bool {
        let groups = [Property::GRPA, Property::GRPB, Property::GRPC].map(|property| self.value(property));
        match to {
            Destination::Node(node) => node == self.node,
            Destination::Group(Group::ALL) => true,
            Destination::Group(group) => group.is_for_boards() && groups.contains(&group.number().into()),
        }
    }

    pub fn value(&self, property: Property) -> i64 {
        self.values[usize::from(property.id())]
    }

    pub fn put(&mut self, property: Property, value: i64) {
        self.values[usize::from(property.id())] = value;
    }

    /// The answer to a GET, unless it does not answer that or starts, or the answer is lost.
    pub fn answer(&mut self, property: Property) -> Option<i64> {
        let is_muted = self.muted.contains(&property) || property.rules().access == Access::WriteOnly;
        if self.is_silent || self.wakes_us.is_some() || is_muted {
            return None;
        }
        if self.loses > 0 {
            self.loses -= 1;
            return None;
        }
        Some(self.value(property))
    }

    pub fn set(&mut self, property: Property, value: i64, now_us: u64) {
        let is_asleep = self.value(Property::STAT) == 0;
        if self.is_silent || self.refused.contains(&property) || is_asleep && property != Property::STAT {
            return;
        }
        match property {
            Property::STAT if value == 0 => {
                self.motion = None;
                self.put(Property::STAT, 0);
                self.put(Property::MODE, 0);
            }
            Property::STAT if is_asleep => self.wakes_us = Some(now_us + WAKE_US),
            Property::STAT => self.put(Property::ERROR, 0),
            Property::MODE => {
                self.stop();
                self.put(Property::MODE, value);
                if value == 5 {
                    self.start(self.value(Property::E), 5, now_us);
                    if let Some(motion) = &mut self.motion {
                        motion.holds = true;
                    }
                }
            }
            Property::M => self.start(value, 5, now_us),
            Property::CMD => self.command(value, now_us),
            Property::LOAD => {
                let id = usize::try_from(value).expect("GOD loads single properties");
                self.values[id] = self.saved[id];
            }
            Property::SAVE if value == -1 => self.saved = self.values,
            Property::SAVE => {
                let id = usize::try_from(value).expect("0 or more");
                self.saved[id] = self.values[id];
            }
            _ if property.rules().admits(value) && property.rules().access == Access::ReadWrite => {
                let kind = MotorKind::of(self.node);
                let narrow = i32::try_from(value).map(|value| kind.bounded(property, value).into());
                self.put(property, narrow.unwrap_or(value));
            }
            _ => {}
        }
    }

    fn command(&mut self, value: i64, now_us: u64) {
        match Cmd::of(value) {
            Some(Cmd::C) => self.start(self.value(Property::CT), 5, now_us),
            Some(Cmd::O) => {
                self.put(Property::BD, 0);
                self.start(self.value(Property::OT), 5, now_us);
            }
            Some(Cmd::Tc) => self.start(self.value(Property::CT), 4, now_us),
            Some(Cmd::To) => self.start(self.value(Property::OT), 4, now_us),
            Some(Cmd::Hi) => {
                self.start(0, 4, now_us);
                if let Some(motion) = &mut self.motion {
                    (motion.presses, motion.homes) = (false, true);
                }
            }
            Some(Cmd::Home) => self.start(0, 5, now_us),
            Some(Cmd::T) => {
                self.stop();
                self.put(Property::MODE, 0);
            }
            _ => {}
        }
    }

    fn stop(&mut self) {
        if self.motion.take().is_some() {
            self.put(Property::END, EndCode::Aborted.into());
        }
    }

    fn start(&mut self, goal: i64, mode: i64, now_us: u64) {
        self.stop();
        self.put(Property::END, 0);
        self.put(Property::E, goal);
        if self.refuses_motions {
            return;
        }
        self.put(Property::MODE, mode);
        let presses = mode == 4;
        let code = if presses { EndCode::Stalled } else { EndCode::Arrived };
        let end = self.ends.pop_front().unwrap_or(End { code, after_us: MOTION_US, position: None });
        let end_us = now_us + end.after_us;
        self.motion = Some(Motion { end, end_us, goal, presses, homes: false, holds: false });
    }

    /// The time of its next change by itself.
    pub fn next_us(&self) -> Option<u64> {
        self.motion.as_ref().map(|motion| motion.end_us).into_iter().chain(self.wakes_us).min()
    }

    /// What it reports at that time.
    pub fn run_until(&mut self, now_us: u64) -> Vec<Report> {
        if self.wakes_us.is_some_and(|wakes_us| wakes_us <= now_us) {
            self.wakes_us = None;
            self.put(Property::STAT, 2);
            self.put(Property::LFLAGS, 0);
        }
        match self.motion.take() {
            Some(motion) if motion.end_us <= now_us => self.end(&motion),
            motion => {
                self.motion = motion;
                Vec::new()
            }
        }
    }

    fn end(&mut self, motion: &Motion) -> Vec<Report> {
        let End { code, position, .. } = motion.end;
        let holds = motion.holds || self.value(Property::HOLD) != 0;
        let mode = match code {
            EndCode::Fault => ModeCode::Idle,
            EndCode::Stalled if holds && motion.presses => ModeCode::Velocity,
            EndCode::Breakaway => ModeCode::Pid,
            _ if holds => ModeCode::Pid,
            _ => ModeCode::Idle,
        };
        self.put(Property::P, position.unwrap_or(motion.goal));
        self.put(Property::MODE, mode.into());
        self.put(Property::END, code.into());
        if motion.homes && code != EndCode::Fault {
            self.put(Property::HALLH, POSITION_KNOWN);
        }
        let mut reports = Vec::from([(Property::MODE, mode.into()), (Property::END, code.into())]);
        if code == EndCode::Breakaway {
            self.put(Property::BD, 1);
            self.put(Property::BP, self.value(Property::P));
            reports.push((Property::BD, 1));
        }
        let are_wanted = self.value(Property::LFLAGS) == 3 && !self.is_silent;
        if are_wanted { reports } else { Vec::new() }
    }

    /// What a test tells it, such as `silent`, `P 100` or `ends Stalled 300 40`.
    pub fn obey(&mut self, words: &[&str]) {
        let number = |word: &str| word.parse::<i64>().unwrap_or_else(|_| panic!("{word:?} is no number"));
        let property =
            |word: &str| Property::named(word).unwrap_or_else(|| panic!("{word:?} is no property"));
        match words {
            ["silent"] => self.is_silent = true,
            ["answers"] => self.is_silent = false,
            ["asleep"] => self.put(Property::STAT, 0),
            ["lost"] => self.put(Property::HALLH, 0),
            ["refuses", "motions"] => self.refuses_motions = true,
            ["obeys"] => {
                self.refuses_motions = false;
                self.refused.clear();
                self.muted.clear();
            }
            ["refuses", names @ ..] => self.refused.extend(names.iter().map(|name| property(name))),
            ["mutes", names @ ..] => self.muted.extend(names.iter().map(|name| property(name))),
            ["loses", count] => self.loses = number(count).try_into().expect("a count"),
            ["late", us] => self.late_us = number(us).try_into().expect("a time"),
            ["ends", code, ms, position @ ..] => {
                let code = tater_wire::end::ROWS.iter().map(|row| row.code).find(|&of| name_of(of) == *code);
                let after_us = 1000 * u64::try_from(number(ms)).expect("a time");
                let position = position.first().map(|word| number(word));
                self.ends.push_back(End { code: code.expect("an end"), after_us, position });
            }
            [name, value] => self.put(property(name), number(value)),
            _ => panic!("{words:?} means nothing to a board"),
        }
    }
}

fn name_of(code: EndCode) -> String {
    std::format!("{code:?}").to_string()
}
