//! What a person or a script enters: lines of the hand's language, and commands of this program.

use std::path::PathBuf;
use std::time::Duration;

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
    Own { name: "connect", arguments: "HOST:PORT", help: "connects to a hand" },
    Own { name: "disconnect", arguments: "", help: "closes the connection; motors that move stop" },
    Own { name: "discover", arguments: "", help: "lists the hands in the network" },
    Own {
        name: "download",
        arguments: "FILE NODES",
        help: "sends a .tek file to boards, one after the other",
    },
    Own { name: "help", arguments: "[NAME]", help: "explains a command, a parameter or a property" },
    Own { name: "quit", arguments: "", help: "ends this program, as the end of the input does" },
    Own {
        name: "watch",
        arguments: "[NODES] PROPERTY ... [for SECONDS]",
        help: "shows properties of boards until ^C; in a script for so many seconds, or once",
    },
    Own {
        name: "M",
        arguments: "",
        help: "asks for fingers and a position in hall counts, and moves there with the tips",
    },
    Own { name: "C", arguments: "", help: "asks for fingers, and closes them with their tips" },
    Own { name: "O", arguments: "", help: "asks for fingers, and opens them with their tips" },
];

/// All motor boards.
pub const NODES: &str = "1234567";

/// Longest watch, s: a day.
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
    Connect(String),
    Disconnect,
    Discover,
    Download {
        file: PathBuf,
        nodes: String,
    },
    Help(Option<String>),
    Quit,
    Watch {
        nodes: String,
        properties: Vec<Property>,
        time: Option<Duration>,
    },
}

/// A motion of the walk-through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    Move,
    Close,
    Open,
}

/// Reads an entry.
///
/// # Errors
/// What was found and expected.
pub fn parse(text: &str) -> Result<Entry, String> {
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
        ("m", []) => Ok(Entry::Ask(Motion::Move)),
        ("c", []) => Ok(Entry::Ask(Motion::Close)),
        ("o", []) => Ok(Entry::Ask(Motion::Open)),
        ("connect", [address]) => Ok(Entry::Connect((*address).to_owned())),
        ("connect", _) => Err("connect: expected an address, such as connect 127.0.0.1:11001".to_owned()),
        ("disconnect", _) => none(Entry::Disconnect),
        ("discover", _) => none(Entry::Discover),
        ("download", _) => download(text, rest),
        ("help", []) => Ok(Entry::Help(None)),
        ("help", [name]) => Ok(Entry::Help(Some((*name).to_owned()))),
        ("help", _) => Err("help: expected one name, such as help FSET".to_owned()),
        ("quit" | "exit", _) => none(Entry::Quit),
        ("watch", _) => watch(rest),
        (name, _) if name.ends_with("loop") => {
            Err("LOOP: RealTime control is for programs; see docs/wraptor.md".to_owned())
        }
        _ => Ok(Entry::Line(text.to_owned())),
    }
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
    let (rest, time) = match rest {
        [before @ .., word, seconds] if word.eq_ignore_ascii_case("for") => {
            let time = seconds.parse().ok().filter(|time| (0.0..=LONGEST).contains(time));
            let time = time
                .ok_or_else(|| format!("watch: found {seconds:?} after for, expected seconds, 0 to 86400"))?;
            (before, Some(Duration::from_secs_f64(time)))
        }
        _ => (rest, None),
    };
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
    digits(text, '7').ok_or_else(|| format!("{of}: found {text:?}, expected boards from 1 to 7, such as 123"))
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
            ("M", Ok(Entry::Ask(Motion::Move))),
            ("c", Ok(Entry::Ask(Motion::Close))),
            (" o ", Ok(Entry::Ask(Motion::Open))),
            ("M 500", line("M 500")),
            ("4 S E 82", line("4 S E 82")),
            (" WAKE ", line("WAKE")),
            ("help FSET", Ok(Entry::Help(Some("FSET".to_owned())))),
            ("exit", Ok(Entry::Quit)),
            ("watch p t", watch(NODES, &[Property::P, Property::T], None)),
            ("watch 35 TEMP for 2", watch("35", &[Property::TEMP], Some(2))),
            ("download a b.tek 13", download("a b.tek", "13")),
        ] {
            assert_eq!(parse(text), expected, "{text:?}");
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
            "12LOOP",
        ] {
            let error = parse(text).expect_err(text);
            assert!(error.contains("expected") || error.contains("docs/"), "{error}");
        }
        for text in ["", "5", "11", "1,2", "all"] {
            assert!(fingers(text).is_err(), "{text:?}");
        }
        assert_eq!(fingers("1 3"), Ok("13".to_owned()));
        for text in ["", "far", "1.5", "32768", "99999999999999999999"] {
            assert!(position(text).is_err(), "{text:?}");
        }
        assert_eq!(position(" -20 "), Ok(-20));
    }
}
