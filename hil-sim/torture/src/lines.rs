//! Random words and lines of the language.

use god::command::{self, GclCommand};
use god::parameter::{HAND, MOTOR};
use rand::RngExt;
use rand::seq::IndexedRandom;
use rand_pcg::Pcg64Mcg;
use tater_wire::Property;

/// Properties that random lines and frames name. HOSTUNITS is none of them: GOD is a host of this project's units, and every value would
/// mean something else. Nor are those that describe the motor and its joint: the plant would be another.
pub const PROPERTIES: &[Property] = {
    const ALL: ([Property; 128], usize) = {
        let (mut all, mut len, mut rest) = ([Property::VERS; 128], 0, Property::ALL);
        while let [property, others @ ..] = rest {
            if !is_stated(*property) {
                all[len] = *property;
                len += 1;
            }
            rest = others;
        }
        (all, len)
    };
    ALL.0.split_at(ALL.1).0
};

/// Whether a property states what the motor, its joint or its host is.
const fn is_stated(property: Property) -> bool {
    use Property as P;
    matches!(
        property,
        P::HOSTUNITS
            | P::MR
            | P::MPK
            | P::MKT
            | P::MJ
            | P::ML
            | P::MVN
            | P::MWX
            | P::MWJ
            | P::MWR
            | P::KBW
            | P::FIT
            | P::JLO
            | P::JHI
    )
}

/// The range of a property's values on this hand: its row's, or what its motor may be taken for.
pub const fn range(property: Property) -> (i64, i64) {
    use Property as P;
    match property {
        P::MKA => (400, 5000),
        P::MKE => (1600, 5000),
        P::MFC => (0, 100),
        P::MFS => (0, 130),
        P::MTE => (0, 1000),
        P::POLES => (6, 6),
        P::CTS => (18, 18),
        P::MECH => (0, 17),
        P::IPNM => (1575, 1575),
        _ => (property.row().min, property.row().max),
    }
}

/// One of several.
///
/// # Panics
/// There is none.
pub fn one<'a, T>(rng: &mut Pcg64Mcg, of: &'a [T]) -> &'a T {
    of.choose(rng).expect("there is one")
}

fn number(rng: &mut Pcg64Mcg) -> String {
    match rng.random_range(0..10) {
        0..4 => rng.random_range(-2..=25).to_string(),
        4..7 => rng.random_range(-20_001..=20_001).to_string(),
        7 => {
            one(rng, &[-32_768, -32_767, 255, 256, 4080, 32_767, 65_535, 4_294_967_295, i64::MAX]).to_string()
        }
        8 => rng.random::<i64>().to_string(),
        _ => one(rng, &["x", "+1", "--1", "1e3", "0x10", "99999999999999999999", "?", ""]).to_string(),
    }
}

fn name(rng: &mut Pcg64Mcg) -> &'static str {
    match rng.random_range(0..4) {
        0 | 1 => one(rng, MOTOR).name,
        2 => one(rng, HAND).name,
        _ => one(rng, PROPERTIES).row().name,
    }
}

/// A prefix of motors, mostly a valid one.
pub fn prefix(rng: &mut Pcg64Mcg) -> String {
    let digits = |rng: &mut Pcg64Mcg, max: u8| -> String {
        (1..=max).filter(|_| rng.random()).map(|digit| char::from(b'0' + digit)).collect()
    };
    match rng.random_range(0..10) {
        0..3 => String::new(),
        3..5 => digits(rng, 4),
        5 => one(rng, &["G", "S", "GS", "1S", "XG", "XGS"]).to_string(),
        6..9 => format!("X{}", digits(rng, 7)),
        _ => one(rng, &["X", "5", "8", "0", "1X", "XX", "11"]).to_string(),
    }
}

fn value(rng: &mut Pcg64Mcg, min: i64, max: i64) -> String {
    match rng.random_range(0..10) {
        0..6 => rng.random_range(min..=max).to_string(),
        6 => one(rng, &[min, max]).to_string(),
        7 => one(rng, &[min.saturating_sub(1), max.saturating_add(1)]).to_string(),
        _ => number(rng),
    }
}

fn parameter(rng: &mut Pcg64Mcg) -> String {
    let row = one(rng, MOTOR);
    format!("{} {} ", row.name, value(rng, row.min(), row.max()))
}

fn global(rng: &mut Pcg64Mcg) -> String {
    let row = one(rng, HAND);
    format!("{} {} ", row.name, value(rng, row.min, row.max))
}

fn many(rng: &mut Pcg64Mcg, one: fn(&mut Pcg64Mcg) -> String) -> String {
    (0..rng.random_range(1..=3)).map(|_| one(rng)).collect()
}

fn board_line(rng: &mut Pcg64Mcg) -> String {
    let nodes: String =
        (0..=7).filter(|_| rng.random_ratio(1, 4)).map(|node| char::from(b'0' + node)).collect();
    let property = *one(rng, PROPERTIES);
    let row = property.row();
    match rng.random_range(0..12) {
        0 => one(rng, &["WAKE", "SAVE", "0 S REPLY 1", "0 G REPLY"]).to_string(),
        1..4 => format!("{nodes} G {}", row.name),
        // Properties that move a motor.
        4 => format!("{nodes} S M {}", rng.random_range(0..=5)),
        5 => format!("{nodes} S E {}", rng.random_range(-400..=400)),
        6 => format!("{nodes} S CMD {}", rng.random_range(0..=22)),
        7 => format!("{nodes} S V {}", rng.random_range(-1000..=1000)),
        8 => format!("{nodes} S T {}", rng.random_range(-990..=990)),
        // Properties that shape a motion, on every board.
        9 => format!("1234567 S {} {}", one(rng, &["MT", "MV", "KPV", "KP"]), rng.random_range(0..=1000)),
        _ => {
            let (min, max) = range(property);
            let text = value(rng, min, max);
            // The board would take it, for another motor.
            let is_another = text
                .parse::<i64>()
                .is_ok_and(|value| (min, max) != (row.min, row.max) && !(min..=max).contains(&value));
            format!("{nodes} S {} {}", row.name, if is_another { "-1" } else { &text })
        }
    }
}

/// A command, mostly with valid arguments, or a line of the walk-through grammar.
pub fn command(rng: &mut Pcg64Mcg) -> String {
    if rng.random_ratio(1, 4) {
        return board_line(rng);
    }
    let row = one(rng, command::ROWS);
    let small = |rng: &mut Pcg64Mcg, max: i64| rng.random_range(-1..=max).to_string();
    let arguments = match row.command {
        _ if rng.random_ratio(1, 20) => number(rng),
        GclCommand::Fset => many(rng, parameter),
        GclCommand::Fget => many(rng, |rng| format!("{} ", one(rng, MOTOR).name)),
        GclCommand::Pset => many(rng, global),
        GclCommand::Pget => many(rng, |rng| format!("{} ", one(rng, HAND).name)),
        GclCommand::Mac | GclCommand::Macset => small(rng, 20),
        GclCommand::Rec | GclCommand::Play => small(rng, 6),
        GclCommand::Wait => small(rng, 2_000),
        GclCommand::Help => one(rng, command::ROWS).name.to_owned(),
        GclCommand::Mdeg => small(rng, 150),
        GclCommand::Mper => small(rng, 100),
        GclCommand::M | GclCommand::Wm | GclCommand::Ic | GclCommand::Io if rng.random() => {
            small(rng, 20_000)
        }
        GclCommand::Ptm if rng.random() => small(rng, 3_000),
        _ => String::new(),
    };
    let prefix = if row.prefix || rng.random_ratio(1, 20) { prefix(rng) } else { String::new() };
    let line = format!("{prefix}{} {arguments}", row.name);
    if rng.random() { line } else { line.to_ascii_lowercase() }
}

/// A word of the language, a number, a blank, a line end or any character.
pub fn word(rng: &mut Pcg64Mcg) -> String {
    match rng.random_range(0..20) {
        0..4 => one(rng, command::ROWS).name.to_owned(),
        4..6 => name(rng).to_owned(),
        6..8 => prefix(rng),
        8..11 => number(rng),
        11 => one(rng, &["S", "G", "WAKE", "SAVE", "REPLY", "M", "AP"]).to_string(),
        12..15 => " ".to_owned(),
        15..19 => "\r".to_owned(),
        _ => char::from(rng.random_range(0..=127)).to_string(),
    }
}
