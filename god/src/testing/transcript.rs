//! Transcripts of a host with GOD and seven [boards](super::board), in `god/transcripts`: what is typed and what happens, and all that
//! GOD prints and orders. BLESS_GOD=1 rewrites them.
//!
//! | a line that begins with | |
//! |---|---|
//! | `#` | says why |
//! | `!` | something happens: see [`Stage::happen`]; `! after 300 ...` 300 ms after the next input |
//! | `> ` | is typed, with Return; then time passes until GOD waits for another line, or for a block of RealTime |
//! | `^C` | the same for this byte |
//! | `% ` | bytes of the host: one character, then hexadecimal; `x150` repeats the last one |
//! | `~ ` | this many ms pass |
//!
//! What follows each of these is GOD's: lines of text as they are, a prompt with the time since the input, ms, unless it is 0; data of RealTime and packets in
//! hexadecimal, with this time after `@`; and, indented, its time, ms, with the frames to the boards: `15 LFLAGS=3` sets a property of motors 1 and 5, `1 P?` gets one
//! (shown after `! gets on`).
//!
//! Boards answer at once, so time passes only where GOD waits for something.

use core::convert::Infallible;
use core::future::Future;
use core::pin::Pin;
use std::boxed::Box;
use std::string::String;
use std::vec::Vec;
use std::{env, format, fs};

use tater_wire::{Body, Destination, Frame, Message, Node, Property};

use super::board::Board;
use crate::events::EventKind;
use crate::memory::Memory;
use crate::{Io, io};

/// Longest time to a prompt.
const MAX_US: u64 = 100_000_000;

/// Most bytes that are shown in full.
const LONGEST: usize = 64;

/// Most polls at one time.
const MAX_POLLS: usize = 2000;

struct Stage {
    io: &'static Io,
    memory: &'static Memory,
    god: Pin<Box<dyn Future<Output = Infallible>>>,
    boards: Vec<Board>,
    now_us: u64,
    /// GOD's next poll.
    next_us: u64,
    input_us: u64,
    /// Answers under way and their time.
    late: Vec<(u64, Frame)>,
    /// What happens after the next input, and when.
    planned: Vec<(u64, String)>,
    happening: Vec<(u64, String)>,
    is_bus_down: bool,
    is_host_deaf: bool,
    shows_gets: bool,
    /// Whether GOD's owner stores what it is to store, if it reports that.
    owner: Option<bool>,
    record: String,
    /// Text that is not in the record yet.
    text: Vec<u8>,
    /// Time of its last byte.
    text_us: u64,
    /// Orders at the present time that are not in the record yet: motors, property, value.
    orders: Vec<(String, String)>,
    echo: String,
}

fn start(io: &'static Io, memory: &'static Memory) -> Pin<Box<dyn Future<Output = Infallible>>> {
    Box::pin(crate::run(io, memory))
}

/// A time in ms, µs only if there are some.
fn ms(us: u64) -> String {
    if us.is_multiple_of(1000) { format!("{}", us / 1000) } else { format!("{}.{:03}", us / 1000, us % 1000) }
}

impl Stage {
    fn new() -> Self {
        let (io, memory): (&Io, &Memory) = (Box::leak(Box::default()), Box::leak(Box::default()));
        let nodes = (1..=7).map(|number| Node::new(number).expect("a node"));
        let mut stage = Self {
            io,
            memory,
            god: start(io, memory),
            boards: nodes.map(Board::new).collect(),
            now_us: 0,
            next_us: 0,
            input_us: 0,
            late: Vec::new(),
            planned: Vec::new(),
            happening: Vec::new(),
            is_bus_down: false,
            is_host_deaf: false,
            shows_gets: false,
            owner: None,
            record: String::new(),
            text: Vec::new(),
            text_us: 0,
            orders: Vec::new(),
            echo: String::new(),
        };
        stage.settle();
        stage.text.clear();
        stage
    }

    /// Runs everything at the present time until nothing happens any more.
    fn settle(&mut self) {
        for _ in 0..MAX_POLLS {
            self.run_boards();
            self.next_us = io::poll(self.god.as_mut(), self.io, self.now_us);
            let mut is_busy = false;
            if self.io.take_cancel() {
                self.order(String::from("all frames dropped"), String::new());
            }
            while let Some(frame) = (!self.is_bus_down).then(|| self.io.pop_frame()).flatten() {
                self.carry(&frame);
                is_busy = true;
            }
            while let Some(byte) = (!self.is_host_deaf).then(|| self.io.pop_tx()).flatten() {
                self.flush_orders();
                self.text.push(byte);
                self.text_us = self.now_us;
                is_busy = true;
            }
            if let Some(is_stored) = self.owner.filter(|_| self.memory.wants_write()) {
                self.memory.written(is_stored);
                is_busy = true;
            }
            if !is_busy {
                self.flush_orders();
                return;
            }
        }
        panic!("GOD does not come to rest at {} us:\n{}", self.now_us, self.record);
    }

    fn run_boards(&mut self) {
        let now_us = self.now_us;
        let due = self.happening.extract_if(.., |(at_us, _)| *at_us <= now_us).collect::<Vec<_>>();
        due.into_iter().for_each(|(_, what)| self.happen(&what));
        for board in &mut self.boards {
            for (property, value) in board.run_until(now_us) {
                self.io.push_frame(&Message::reply(board.node, property, value).expect("it fits").frame());
            }
        }
        let due = self.late.extract_if(.., |(at_us, _)| *at_us <= now_us);
        due.for_each(|(_, frame)| self.io.push_frame(&frame));
    }

    /// Lets time pass to the next thing that happens, but no further than `end_us`.
    fn advance(&mut self, end_us: u64) {
        let boards = self.boards.iter().filter_map(Board::next_us);
        let others = self.happening.iter().map(|(us, _)| *us).chain(self.late.iter().map(|(us, _)| *us));
        let next_us = boards.chain(others).chain([self.next_us, end_us]).min().unwrap_or(end_us);
        self.now_us = next_us.max(self.now_us + 1);
        self.settle();
    }

    fn run_for(&mut self, us: u64) {
        let end_us = self.now_us + us;
        while self.now_us < end_us {
            self.advance(end_us);
        }
        self.flush();
    }

    fn run_to_prompt(&mut self) {
        self.settle();
        let end_us = self.now_us + MAX_US;
        while !self.io.waits_for_line() && !self.io.is_raw() {
            self.advance(end_us);
            assert!(self.now_us < end_us, "no prompt:\n{}", self.record);
        }
        self.flush();
    }

    /// A frame of GOD reaches the boards.
    fn carry(&mut self, frame: &Frame) {
        let Some(message) = Message::parse(frame).filter(|message| message.from == Node::HOST) else {
            return self.order(format!("{:03x}", frame.raw_id()), format!(" {:02x?}", frame.data()));
        };
        let to = match message.to {
            Destination::Node(node) => format!("{}", node.number()),
            Destination::Group(group) => format!("group {}", group.number()),
        };
        let named = |id| Property::of(id).map_or("unknown", |property| property.row().name);
        match message.body {
            Body::Get(id) if self.shows_gets => self.order(to, format!(" {}?", named(id))),
            Body::Set { property: id, value } => {
                let value = Property::of(id).map_or(0, |property| property.read(value));
                self.order(to, format!(" {}={value}", named(id)));
            }
            Body::Torques(torques) => self.order(to, format!(" {torques:?}")),
            _ => {}
        }
        for board in self.boards.iter_mut().filter(|board| board.receives(message.to)) {
            match message.body {
                Body::Get(id) => {
                    let Some(property) = Property::of(id) else { continue };
                    let Some(value) = board.answer(property) else { continue };
                    let answer = Message::reply(board.node, property, value).expect("it fits").frame();
                    match board.late_us {
                        0 => self.io.push_frame(&answer),
                        late_us => self.late.push((self.now_us + late_us, answer)),
                    }
                }
                Body::Set { property: id, value } => {
                    if let Some(property) = Property::of(id) {
                        board.set(property, property.read(value), self.now_us);
                    }
                }
                _ => {}
            }
        }
    }

    fn happen(&mut self, what: &str) {
        let words: Vec<&str> = what.split_whitespace().collect();
        match words.as_slice() {
            ["^C"] => self.io.push_rx(io::ABORT),
            ["hangup"] => self.io.hang_up(),
            ["break"] => {
                self.io.push_break();
                self.next_us = self.now_us;
            }
            ["restart"] => {
                self.god = start(self.io, self.memory);
                self.run_to_prompt();
            }
            ["heat", tenths] => self.io.set_temperature(tenths.parse().expect("0.1 C")),
            ["bus", state] => self.is_bus_down = *state == "down",
            ["host", state] => self.is_host_deaf = *state == "deaf",
            ["gets", state] => self.shows_gets = *state == "on",
            ["owner", result] => {
                self.memory.report_writes();
                self.owner = Some(*result == "stores").filter(|_| *result != "hangs");
            }
            ["log"] => {
                let mut log = String::new();
                self.io.events().for_each(|event| {
                    if event.at_us >= self.input_us && !matches!(event.kind, EventKind::Started) {
                        log += &format!("  {} {}\n", ms(event.at_us - self.input_us), event.kind);
                    }
                });
                self.record += &log;
            }
            ["counts"] => {
                let due = if self.io.has_reports_due() { ", reports due" } else { "" };
                let (lost, room) = (self.io.lost_bytes(), self.io.rx_room());
                self.record += &format!("  lost {lost}, baud {}, room {room}{due}\n", self.io.baud());
            }
            ["frame", id, data @ ..] => {
                let data: Vec<u8> = data.iter().map(|byte| hexadecimal(byte)).collect();
                let id = u16::from_str_radix(id, 16).expect("an identifier");
                self.io.push_frame(&Frame::from_raw(id, &data).expect("a frame"));
            }
            [motors, "reports", name, value] => {
                let property = Property::named(name).expect("a property");
                let value = value.parse().expect("a number");
                for board in self.boards.iter_mut().filter(|board| is_in(board, motors)) {
                    board.put(property, value);
                    let report = Message::reply(board.node, property, value).expect("it fits");
                    self.io.push_frame(&report.frame());
                }
            }
            [motors, words @ ..] => {
                self.boards
                    .iter_mut()
                    .filter(|board| is_in(board, motors))
                    .for_each(|board| board.obey(words));
            }
            [] => panic!("nothing happens"),
        }
    }

    fn order(&mut self, motors: String, what: String) {
        self.flush_text();
        match self.orders.last_mut() {
            Some((to, last)) if *last == what && motors.len() == 1 => *to += &motors,
            _ => self.orders.push((motors, what)),
        }
    }

    fn flush_orders(&mut self) {
        if self.orders.is_empty() {
            return;
        }
        let orders: Vec<String> = self.orders.drain(..).map(|(to, what)| to + &what).collect();
        self.record += &format!("  {}: {}\n", ms(self.now_us - self.input_us), orders.join(", "));
    }

    /// Puts text into the record, without the echo of what was typed.
    fn flush_text(&mut self) {
        if self.text.is_empty() {
            return;
        }
        let text = core::mem::take(&mut self.text);
        let at = match ms(self.text_us.saturating_sub(self.input_us)).as_str() {
            "0" => String::new(),
            at => format!(" {at}"),
        };
        let is_text = |byte: &u8| matches!(byte, b' '..=b'~' | b'\t' | b'\r' | b'\n' | 8);
        if self.io.is_raw() || !text.first().is_some_and(is_text) {
            let star = if text.first() == Some(&b'*') { "*" } else { "" };
            let shown = |bytes: &[u8]| bytes.iter().map(|byte| format!(" {byte:02x}")).collect::<String>();
            let data = match &text[star.len()..] {
                long @ [first @ .., _, _, _, _] if long.len() > LONGEST => {
                    format!("{} ...{}, {} bytes", shown(&first[..8]), shown(&long[first.len()..]), text.len())
                }
                data => shown(data),
            };
            let at = at.replace(' ', " @");
            self.record += &format!("{}{at}\n", format!("{star}{data}").trim_start());
            return;
        }
        let text: String = text
            .iter()
            .map(|byte| if is_text(byte) { char::from(*byte).into() } else { format!("\\x{byte:02x}") })
            .collect();
        let echo = core::mem::take(&mut self.echo);
        let lines = text.strip_prefix(echo.as_str()).unwrap_or(&text).split("\r\n\r");
        for line in lines.flat_map(|line| line.split("\n\r")) {
            match line {
                "" => {}
                "=> " => self.record += &format!("=>{at}\n"),
                _ => self.record += &format!("{}\n", line.replace('\x08', "\\b")),
            }
        }
    }

    fn flush(&mut self) {
        self.flush_orders();
        self.flush_text();
    }

    fn input(&mut self, bytes: &[u8]) {
        self.input_us = self.now_us;
        let plan = core::mem::take(&mut self.planned);
        self.happening.extend(plan.into_iter().map(|(us, what)| (self.now_us + us, what)));
        bytes.iter().for_each(|&byte| self.io.push_rx(byte));
    }

    /// Plays a line of a transcript. Returns whether it is one: others are what GOD does.
    fn play(&mut self, line: &str) -> bool {
        let (kind, rest) = line.split_once(' ').unwrap_or((line, ""));
        if !matches!(kind, "#" | "!" | ">" | "^C" | "%" | "~" | "") || line.starts_with("  ") {
            return false;
        }
        self.record += &format!("{line}\n");
        match kind {
            "!" => match rest.strip_prefix("after ").and_then(|plan| plan.split_once(' ')) {
                Some((ms, what)) => {
                    self.planned.push((1000 * ms.parse::<u64>().expect("ms"), what.into()));
                }
                None => self.happen(rest),
            },
            ">" => {
                self.echo = if self.io.is_raw() { String::new() } else { rest.into() };
                self.input(format!("{rest}\r").as_bytes());
                self.run_to_prompt();
            }
            "^C" => {
                self.input(b"\x03");
                self.run_to_prompt();
            }
            "%" => {
                let bytes = bytes_of(rest);
                self.input(&bytes);
                self.settle();
                self.flush();
            }
            "~" => {
                self.input(b"");
                self.run_for(1000 * rest.parse::<u64>().expect("ms"));
            }
            _ => {}
        }
        true
    }
}

fn bytes_of(text: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    for (place, word) in text.split_whitespace().enumerate() {
        match (word.as_bytes(), word.strip_prefix('x'), bytes.last()) {
            (&[character], ..) if place == 0 => bytes.push(character),
            (_, Some(count), Some(&last)) => {
                bytes.extend(core::iter::repeat_n(last, count.parse::<usize>().expect("a number")));
            }
            _ => bytes.push(hexadecimal(word)),
        }
    }
    bytes
}

fn hexadecimal(byte: &str) -> u8 {
    u8::from_str_radix(byte, 16).unwrap_or_else(|_| panic!("{byte:?} is no byte"))
}

fn is_in(board: &Board, motors: &str) -> bool {
    motors == "all" || motors.bytes().any(|digit| digit == b'0' + board.node.number())
}

/// Plays a transcript of `god/transcripts`, and compares it with what happens.
fn replay(name: &str, expected: &str) {
    let mut stage = Stage::new();
    expected.lines().for_each(|line| _ = stage.play(line));
    let found = stage.record;
    if env::var_os("BLESS_GOD").is_some() {
        let path = format!("{}/transcripts/{name}.txt", env!("CARGO_MANIFEST_DIR"));
        return fs::write(path, found).expect("it can be written");
    }
    let differs = expected.lines().zip(found.lines()).position(|(expected, found)| expected != found);
    if let Some(at) = differs {
        let around =
            |text: &str| text.lines().skip(at.saturating_sub(4)).take(9).collect::<Vec<_>>().join("\n");
        panic!("{name}.txt:{}: expected\n{}\nfound\n{}", at + 1, around(expected), around(&found));
    }
    assert_eq!(expected, found, "{name}.txt");
}

/// `name;` is a test that replays a transcript.
macro_rules! transcripts {
    ($($name:ident;)*) => {
        $(
            #[test]
            fn $name() {
                let name = stringify!($name);
                replay(name, include_str!(concat!("../../transcripts/", stringify!($name), ".txt")));
            }
        )*
    };
}

transcripts! {
    movement;
    host;
    packets;
    walk_through;
    realtime_errors;
    realtime;
    administration;
    sequences;
    hand_parameters;
    motor_parameters;
    refusals;
    ends;
}
