//! What a person or a script enters: lines of the hand's language, and commands of this program.

use std::path::PathBuf;
use std::time::Duration;

use god::motors::Prefix;
use wraptor::Property;

/// A command of this program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Own {
    pub name: &'static str,
    pub arguments: &'static str,
    pub help: &'static str,
}

/// The commands of this program, for help and completion.
pub const OWN: &[Own] = &[
    Own {
        name: "connect",
        arguments: "HOST:PORT, serial PORT [BAUD], can PLACE",
        help: "connects to a hand, by CAN without its GOD; if that fails the connection before stays",
    },
    Own { name: "disconnect", arguments: "", help: "closes the connection; motors that move stop" },
    Own { name: "discover", arguments: "", help: "lists the hands in the network" },
    Own {
        name: "download",
        arguments: "FILE NODES",
        help: "sends a .tek file to boards, one after the other",
    },
    Own { name: "help", arguments: "[NAME]", help: "explains a command, a parameter or a property" },
    Own {
        name: "loop",
        arguments: "MOTORS [VELOCITY ...] [for SECONDS]",
        help: "RealTime by hand, such as loop 124: keys set velocities, the feedback is shown; in a script velocities (hall counts/s) and a time",
    },
    Own { name: "quit", arguments: "", help: "ends this program, as the end of the input does" },
    Own {
        name: "watch",
        arguments: "[NODES] PROPERTY ... [for SECONDS]",
        help: "shows properties of boards until ^C; in a script for so many seconds, or once",
    },
    Own {
        name: "walk",
        arguments: "[off]",
        help: "the walk-through of the manual (3), until walk off: M, C and O alone ask for fingers and move them with their tips, M to a position in hall counts",
    },
];

/// All motor boards.
pub const NODES: &str = "1234567";

/// Greatest velocity of a loop by hand, hall counts/s: 127 units of 8, a signed byte of RealTime's blocks.
pub const FASTEST: i32 = 1016;

/// Longest watch or loop, s: a day.
const LONGEST: f64 = 86_400.0;

/// An entry.
#[derive(Clone, Debug, PartialEq)]
pub enum Entry {
    /// Empty, or a comment.
    Nothing,
    /// A line for the hand.
    Line(String),
    /// The walk-through's commands, which ask for their arguments (manual 3).
    Ask(Motion),
    /// The walk-through begins, or ends.
    Walk(bool),
    Connect(Way),
    Disconnect,
    Discover,
    Download {
        file: PathBuf,
        nodes: String,
    },
    Help(Option<String>),
    /// RealTime by hand.
    Loop {
        motors: String,
        /// Hall counts/s of each motor, or of all; none: keys set them.
        velocities: Vec<i32>,
        time: Option<Duration>,
    },
    Quit,
    Watch {
        nodes: String,
        properties: Vec<Property>,
        time: Option<Duration>,
    },
}

/// A way to a hand.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Way {
    /// `HOST:PORT`.
    Tcp(String),
    /// A serial port and its baud rate.
    #[cfg(unix)]
    Serial(String, u32),
    /// A CAN interface or an SLCAN adapter.
    Can(String),
}

impl Way {
    /// The place as it was given.
    pub fn place(&self) -> &str {
        match self {
            Self::Tcp(place) | Self::Can(place) => place,
            #[cfg(unix)]
            Self::Serial(place, _) => place,
        }
    }
}

/// A motion of the walk-through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    Move,
    Close,
    Open,
}

/// Baud rate of a hand's serial port (parameter BAUD), unless the user gives another.
#[cfg(unix)]
pub const BAUD: u32 = 9600;

/// Reads an entry. `walks`: within the walk-through.
///
/// # Errors
/// What was found and expected.
pub fn parse(text: &str, walks: bool) -> Result<Entry, String> {
    // A tab is white space, and none of the hand's characters.
    let text = &*text.replace('\t', " ");
    let text = text.trim();
    let words: Vec<&str> = text.split_whitespace().collect();
    let Some((&first, rest)) = words.split_first() else { return Ok(Entry::Nothing) };
    if first.starts_with('#') {
        return Ok(Entry::Nothing);
    }
    let none = |entry| match rest {
        [] => Ok(entry),
        [found, ..] => Err(format!("{first}: found {found:?}, expected nothing after it")),
    };
    match (&*first.to_ascii_lowercase(), rest) {
        ("m", []) if walks => Ok(Entry::Ask(Motion::Move)),
        ("c", []) if walks => Ok(Entry::Ask(Motion::Close)),
        ("o", []) if walks => Ok(Entry::Ask(Motion::Open)),
        ("walk", []) => Ok(Entry::Walk(true)),
        ("walk", [off]) if off.eq_ignore_ascii_case("off") => Ok(Entry::Walk(false)),
        ("walk", _) => Err("walk: expected nothing after it, or off".to_owned()),
        (digits, []) if digits.bytes().all(|byte| byte.is_ascii_digit()) => Err(format!(
            "found {digits:?}, expected a command; after walk, M, C and O ask for motors as in the manual's section 3"
        )),
        ("connect", _) => connect(rest).map(Entry::Connect),
        ("disconnect", _) => none(Entry::Disconnect),
        ("discover", _) => none(Entry::Discover),
        ("download", _) => download(text, rest),
        ("help", []) => Ok(Entry::Help(None)),
        ("help", [name]) => Ok(Entry::Help(Some((*name).to_owned()))),
        ("help", _) => Err("help: expected one name, such as help FSET".to_owned()),
        ("quit" | "exit", _) => none(Entry::Quit),
        ("watch", _) => watch(rest),
        ("loop", [motors, rest @ ..]) => by_hand(motors, rest),
        (name, _) if name.ends_with("loop") => by_hand(name.strip_suffix("loop").unwrap_or(name), rest),
        _ => Ok(Entry::Line(text.to_owned())),
    }
}

fn connect(rest: &[&str]) -> Result<Way, String> {
    let expected =
        "connect: expected HOST:PORT, serial PORT [BAUD] or can PLACE, such as connect 127.0.0.1:11001";
    match rest {
        [address] if address.contains(':') => Ok(Way::Tcp((*address).to_owned())),
        #[cfg(unix)]
        [word, port] if word.eq_ignore_ascii_case("serial") => Ok(Way::Serial((*port).to_owned(), BAUD)),
        #[cfg(unix)]
        [word, port, baud] if word.eq_ignore_ascii_case("serial") => match baud.parse() {
            Ok(baud @ 600..=115_200) => Ok(Way::Serial((*port).to_owned(), baud)),
            _ => Err(format!("connect: found {baud:?}, expected a baud rate, 600 to 115200")),
        },
        [word, place] if word.eq_ignore_ascii_case("can") => Ok(Way::Can((*place).to_owned())),
        _ => Err(expected.to_owned()),
    }
}

fn by_hand(motors: &str, rest: &[&str]) -> Result<Entry, String> {
    let motors = motors.to_ascii_uppercase();
    if Prefix::parse(motors.as_bytes()).is_none_or(|prefix| !prefix.given) {
        return Err(format!(
            "loop: found {motors:?}, expected motors, such as loop 1234, loop G or loop X15; keys set their velocities then"
        ));
    }
    let (rest, time) = time("loop", rest)?;
    let velocity = |word: &&str| {
        let found = word.parse().ok().filter(|velocity| (-FASTEST..=FASTEST).contains(velocity));
        found.ok_or_else(|| {
            format!("loop: found {word:?}, expected velocities in hall counts/s, -{FASTEST} to {FASTEST}")
        })
    };
    let velocities = rest.iter().map(velocity).collect::<Result<Vec<i32>, _>>()?;
    Ok(Entry::Loop { motors, velocities, time })
}

/// `for SECONDS` at the end.
fn time<'a, 'b>(of: &str, rest: &'a [&'b str]) -> Result<(&'a [&'b str], Option<Duration>), String> {
    let [before @ .., word, seconds] = rest else { return Ok((rest, None)) };
    if !word.eq_ignore_ascii_case("for") {
        return Ok((rest, None));
    }
    let time = seconds.parse().ok().filter(|time| (0.0..=LONGEST).contains(time));
    let time =
        time.ok_or_else(|| format!("{of}: found {seconds:?} after for, expected seconds, 0 to 86400"))?;
    Ok((before, Some(Duration::from_secs_f64(time))))
}

/// The file's name may have spaces: the last word is the nodes.
fn download(text: &str, rest: &[&str]) -> Result<Entry, String> {
    let expected = "download: expected a file and nodes, such as download tater.tek 123";
    let [_, .., nodes] = rest else { return Err(expected.to_owned()) };
    let file = text.split_once(char::is_whitespace).map_or("", |(_, rest)| rest);
    let file = file.trim().strip_suffix(nodes).map_or("", str::trim);
    Ok(Entry::Download { file: PathBuf::from(file), nodes: boards("download", nodes)? })
}

fn watch(rest: &[&str]) -> Result<Entry, String> {
    let (rest, time) = time("watch", rest)?;
    let (nodes, names) = match rest {
        [nodes, names @ ..] if nodes.bytes().all(|byte| byte.is_ascii_digit()) => {
            (boards("watch", nodes)?, names)
        }
        names => (NODES.to_owned(), names),
    };
    let property = |name: &&str| {
        Property::named(&name.to_ascii_uppercase())
            .ok_or_else(|| format!("watch: found {name:?}, expected a property, such as P; help lists them"))
    };
    let properties = names.iter().map(property).collect::<Result<Vec<_>, _>>()?;
    match properties.is_empty() {
        true => Err("watch: expected properties, such as watch P T TEMP".to_owned()),
        false => Ok(Entry::Watch { nodes, properties, time }),
    }
}

/// Boards as digits, none twice.
///
/// # Errors
/// What was found and expected.
pub fn boards(of: &str, text: &str) -> Result<String, String> {
    let listed = if text.contains(['-', ',']) { list(text) } else { Some(text.to_owned()) };
    listed
        .and_then(|text| digits(&text, '7'))
        .ok_or_else(|| format!("{of}: found {text:?}, expected boards from 1 to 7, such as 123, 1-3 or 1,5"))
}

/// `1-3` and `1,5` as digits.
fn list(text: &str) -> Option<String> {
    let digit = |text: &str| text.trim().parse::<u8>().ok().filter(|node| (1..=7).contains(node));
    let part = |part: &str| {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        Some((digit(first)?..=digit(last)?).map(|node| node.to_string()).collect::<String>())
    };
    text.split(',').map(part).collect()
}

/// Fingers, and 4 for the spread.
///
/// # Errors
/// What was found and expected.
pub fn fingers(text: &str) -> Result<String, String> {
    digits(text, '4')
        .ok_or_else(|| format!("motors: found {text:?}, expected 1, 2, 3, or 4 for the spread, such as 123"))
}

fn digits(text: &str, last: char) -> Option<String> {
    let digits: String = text.chars().filter(|c| !c.is_whitespace()).collect();
    let is_right = |(index, digit): (usize, char)| {
        ('1'..=last).contains(&digit) && !digits.chars().take(index).any(|before| before == digit)
    };
    (!digits.is_empty() && digits.chars().enumerate().all(is_right)).then_some(digits)
}

/// A position, hall counts.
///
/// # Errors
/// What was found and expected.
pub fn position(text: &str) -> Result<i64, String> {
    let rules = Property::E.rules();
    let position = text.trim().parse().ok().filter(|position| rules.admits(*position));
    position.ok_or_else(|| {
        format!("position: found {text:?}, expected hall counts, {} to {}", rules.min(), rules.max())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entry_is_its_command_or_a_line_for_the_hand() {
        let line = |text: &str| Ok(Entry::Line(text.to_owned()));
        let watch = |nodes: &str, properties: &[Property], seconds: Option<u64>| {
            let (nodes, properties) = (nodes.to_owned(), properties.to_vec());
            Ok(Entry::Watch { nodes, properties, time: seconds.map(Duration::from_secs) })
        };
        let download = |file: &str, nodes: &str| {
            Ok(Entry::Download { file: PathBuf::from(file), nodes: nodes.to_owned() })
        };
        for (text, expected) in [
            ("", Ok(Entry::Nothing)),
            ("  # comment", Ok(Entry::Nothing)),
            ("M", line("M")),
            ("c", line("c")),
            (" o ", line("o")),
            ("M 500", line("M 500")),
            ("4\tS\tE\t82", line("4 S E 82")),
            ("walk", Ok(Entry::Walk(true))),
            ("WALK OFF", Ok(Entry::Walk(false))),
            ("connect h:1", Ok(Entry::Connect(Way::Tcp("h:1".to_owned())))),
            ("connect can can0", Ok(Entry::Connect(Way::Can("can0".to_owned())))),
            ("loop g", by_hand("G", &[])),
            ("12LOOP", by_hand("12", &[])),
            (
                "loop x15 40 -8 for 2",
                Ok(Entry::Loop {
                    motors: "X15".to_owned(),
                    velocities: vec![40, -8],
                    time: Some(Duration::from_secs(2)),
                }),
            ),
            ("4 S E 82", line("4 S E 82")),
            (" WAKE ", line("WAKE")),
            ("help FSET", Ok(Entry::Help(Some("FSET".to_owned())))),
            ("exit", Ok(Entry::Quit)),
            ("watch p t", watch(NODES, &[Property::P, Property::T], None)),
            ("watch 35 TEMP for 2", watch("35", &[Property::TEMP], Some(2))),
            ("download a b.tek 13", download("a b.tek", "13")),
        ] {
            assert_eq!(parse(text, false), expected, "{text:?}");
        }
    }

    #[test]
    fn walk_through_asks_after_m_c_and_o_alone() {
        for (text, motion) in [("M", Motion::Move), ("c", Motion::Close), (" o ", Motion::Open)] {
            assert_eq!(parse(text, true), Ok(Entry::Ask(motion)));
        }
        for text in ["GC", "M 500", "4 S M 5", "FGET P"] {
            assert_eq!(parse(text, true), Ok(Entry::Line(text.to_owned())));
        }
    }

    #[test]
    fn entry_that_cannot_be_meant_names_what_is_expected() {
        for text in [
            "connect",
            "connect a b",
            "disconnect now",
            "watch",
            "watch 8 P",
            "watch P for long",
            "watch P for -1",
            "watch NOPE",
            "download x.tek",
            "download x.tek 0",
            "help a b",
            "LOOP",
            "loop 8",
            "loop 12 fast",
            "loop 12 1017",
            "loop 12 for long",
            "walk on",
            "123",
            "connect serial",
            "connect serial a 5",
            "connect can",
        ] {
            let error = parse(text, false).expect_err(text);
            assert!(error.contains("expected"), "{error}");
        }
        for text in ["", "5", "11", "1,2", "all"] {
            assert!(fingers(text).is_err(), "{text:?}");
        }
        assert_eq!(fingers("1 3"), Ok("13".to_owned()));
        assert_eq!(boards("--node", "1-3,5"), Ok("1235".to_owned()));
        for text in ["3-1", "1-8", "1,1", "1-", ",", "-"] {
            assert!(boards("--node", text).is_err(), "{text:?}");
        }
        for text in ["", "far", "1.5", "32768", "99999999999999999999"] {
            assert!(position(text).is_err(), "{text:?}");
        }
        assert_eq!(position(" -20 "), Ok(-20));
    }
}
