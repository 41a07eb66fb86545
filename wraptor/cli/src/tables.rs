//! Help and completion, from the tables of commands, parameters and properties.

use std::fmt::Write;

use god::command::{self, GclCommand};
use god::grammar::lower::{self, Request};
use god::grammar::{self, Statement};
use god::motors::Prefix;
use god::parameter::{self, HAND, MOTOR};
use tater_wire::property::{Access, MotorKind, ROWS};
use wraptor::Property;

use crate::entry::OWN;

/// Kinds of motors and their boards.
const KINDS: [(MotorKind, &str); 3] =
    [(MotorKind::Link, "1-3"), (MotorKind::Spread, "4"), (MotorKind::Tip, "5-7")];

/// Properties in the order of their table.
fn properties() -> impl Iterator<Item = Property> {
    ROWS.iter().map(|row| row.rules.property)
}

/// Another name of a property, as section 3 of the manual has it.
const ALIASES: [(&str, Property); 3] =
    [("AP", Property::P), ("M", Property::MODE), ("STATUS", Property::STAT)];

fn property_named(upper: &str) -> Option<Property> {
    let alias = ALIASES.iter().find(|(alias, _)| *alias == upper).map(|(_, property)| *property);
    alias.or_else(|| Property::named(upper))
}

/// ` (AP)` behind an answer whose property was asked for by another name than the table's; else nothing.
pub fn typed_name(line: &str) -> String {
    let upper = line.to_ascii_uppercase();
    let Ok(Statement::Lower(Request::Get(_, property))) = grammar::parse(&upper) else {
        return String::new();
    };
    let alias = ALIASES.iter().find(|(alias, of)| *of == property && upper.trim_end().ends_with(alias));
    alias.map_or_else(String::new, |(alias, _)| format!(" ({alias})"))
}

/// The values of a line that the hand has refused with ERR 128, and their ranges; `None` if none is seen to be wrong.
pub fn range(line: &str) -> Option<String> {
    let upper = line.to_ascii_uppercase();
    let words: Vec<&str> = upper.split_whitespace().collect();
    let wrong = |name: &str, value: &str, min: i64, max: i64| {
        let is_right = value.parse().is_ok_and(|value: i64| (min..=max).contains(&value));
        (!is_right).then(|| format!("{name}: found {value:?}, expected {min} to {max}"))
    };
    // The walk-through's grammar, however it is spaced.
    if let Ok(Statement::Lower(Request::Set(_, property, value))) = grammar::parse(&upper) {
        let (rules, name) = (property.rules(), property.row().name);
        let of_joint = property == Property::E && rules.admits(value);
        return match of_joint {
            true => Some(format!("{name}: found {value}, expected a position within the joint's range")),
            false => wrong(name, &value.to_string(), rules.min(), rules.max()),
        };
    }
    if let [_, "S", name, value, ..] = &words[..]
        && let Some(property) = property_named(name)
    {
        return wrong(name, value, property.rules().min(), property.rules().max());
    }
    let Ok(Statement::Command { command, arguments, .. }) = grammar::parse(&upper) else { return None };
    let spec = command.row()?;
    let arguments: Vec<&str> = arguments.collect();
    let of_pair = |pair: &[&str]| {
        let [name, value] = pair else { return Some("expected a value after each name".to_owned()) };
        match command {
            GclCommand::Fset => {
                let row = parameter::motor(name)?;
                wrong(row.name, value, row.min(), row.max())
            }
            _ => {
                let row = parameter::hand(name)?;
                wrong(row.name, value, row.min, row.max)
            }
        }
    };
    match (command, &arguments[..]) {
        (GclCommand::Fset | GclCommand::Pset, pairs) => pairs.chunks(2).find_map(of_pair),
        (_, []) => None,
        (_, [first, ..]) => Some(format!("{}: found {first:?}, expected {}", spec.name, spec.arguments)),
    }
}

/// All there is to explain, a line each.
pub fn overview() -> String {
    let mut text = String::from("This program:\n");
    let mut row = |name: &str, arguments: &str, help: &str| {
        let head = format!("{name} {arguments}");
        let _ = writeln!(text, "  {head:<38} {help}");
    };
    OWN.iter().for_each(|own| row(own.name, own.arguments, own.help));
    row("", "", "");
    row("[motors]COMMAND", "", "a line for the hand: motors as 13, G, S, X15, or none for all");
    for spec in command::ROWS {
        row(spec.name, spec.arguments, spec.help);
    }
    row("", "", "");
    lower::ROWS.iter().for_each(|lower| row(lower.line, "", lower.help));
    let names = |names: Vec<&str>| names.join(" ");
    let _ = writeln!(text, "Motor parameters: {}", names(MOTOR.iter().map(|row| row.name).collect()));
    let _ = writeln!(text, "Hand parameters: {}", names(HAND.iter().map(|row| row.name).collect()));
    let _ =
        writeln!(text, "Properties: {}", names(properties().map(|property| property.row().name).collect()));
    text + "help NAME explains one of them.\n"
}

/// What a name means, in each table that has it; `None` if none has.
pub fn explain(name: &str) -> Option<String> {
    let mut text = String::new();
    let upper = name.to_ascii_uppercase();
    for own in OWN.iter().filter(|own| own.name.eq_ignore_ascii_case(name)) {
        let _ = writeln!(text, "{} {}: {}", own.name, own.arguments, own.help);
    }
    for lower in lower::ROWS.iter().filter(|lower| lower.name == upper) {
        let _ = writeln!(text, "{}: {} (the walk-through's grammar, manual 3)", lower.line, lower.help);
    }
    for spec in command::ROWS.iter().filter(|spec| spec.name == upper) {
        let motors = if spec.prefix { "[motors]" } else { "" };
        let _ =
            writeln!(text, "{motors}{} {}: {} (a command of the hand)", spec.name, spec.arguments, spec.help);
    }
    if let Some(row) = parameter::motor(&upper) {
        let access = if row.writable { "FGET, FSET" } else { "FGET" };
        let _ = write!(text, "{}: {} (a motor parameter, {access}", row.name, row.help);
        if row.writable {
            let defaults = KINDS.map(|(kind, nodes)| format!("{} for {nodes}", row.default_for(kind)));
            let _ = write!(text, ", {} to {}; default {}", row.min(), row.max(), defaults.join(", "));
        }
        text.push_str(")\n");
    }
    if let Some(row) = parameter::hand(&upper) {
        let access = if row.writable { "PGET, PSET" } else { "PGET" };
        let _ = write!(text, "{}: {} (a parameter of the hand, {access}", row.name, row.help);
        if row.writable {
            let _ = write!(text, ", {} to {}; default {}", row.min, row.max, row.default);
        }
        text.push_str(")\n");
    }
    if let Some(property) = property_named(&upper) {
        text.push_str(&of_property(property));
    }
    (!text.is_empty()).then_some(text)
}

fn of_property(property: Property) -> String {
    let row = property.row();
    let access = match row.rules.access {
        Access::ReadOnly => "read only",
        Access::WriteOnly => "write only",
        _ => "read and write",
    };
    let unit = if row.unit.is_empty() { String::new() } else { format!(", {}", row.unit) };
    format!(
        "{}: {} (property {}{unit}, {} to {}, {access})\n",
        row.name,
        row.meaning,
        property.id(),
        row.min,
        row.max
    )
}

/// The names that can follow what stands before the cursor, and the place where the name begins.
pub fn complete(before: &str) -> (usize, Vec<String>) {
    let start = before.rfind(char::is_whitespace).map_or(0, |at| at + 1);
    let (earlier, part) = before.split_at(start);
    let words: Vec<String> = earlier.split_whitespace().map(str::to_ascii_uppercase).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let properties = || properties().map(|property| property.row().name).collect::<Vec<_>>();
    let (skipped, names) = match &words[..] {
        [] => first_word(part),
        ["WATCH", ..] => (0, properties()),
        ["HELP"] => (0, everything()),
        [nodes] if is_nodes(nodes) => (0, vec!["G", "S"]),
        [nodes, "G" | "S"] if is_nodes(nodes) => (0, properties()),
        [command, ..] => match without_prefix(command).1 {
            "FGET" | "FSET" => (0, MOTOR.iter().map(|row| row.name).collect()),
            "PGET" | "PSET" => (0, HAND.iter().map(|row| row.name).collect()),
            _ => (0, Vec::new()),
        },
    };
    let typed = part.get(skipped..).unwrap_or_default().to_ascii_uppercase();
    let fits = |name: &&str| name.to_ascii_uppercase().starts_with(&typed);
    let mut names: Vec<String> = names.into_iter().filter(fits).map(str::to_owned).collect();
    names.sort();
    names.dedup();
    (start + skipped, names)
}

/// Commands after their motors, or all with those of this program.
fn first_word(part: &str) -> (usize, Vec<&'static str>) {
    let upper = part.to_ascii_uppercase();
    let whole = command::ROWS.iter().map(|spec| spec.name).chain(OWN.iter().map(|own| own.name));
    let whole = whole.chain(["WAKE", "SAVE"]);
    if whole.clone().any(|name| name.to_ascii_uppercase().starts_with(&upper)) {
        return (0, whole.collect());
    }
    let (prefix, _) = without_prefix(&upper);
    (prefix.len(), command::ROWS.iter().filter(|spec| spec.prefix).map(|spec| spec.name).collect())
}

/// Motors before a command, and the command.
fn without_prefix(word: &str) -> (&str, &str) {
    let is_prefix =
        |at: &usize| word.get(..*at).is_some_and(|prefix| Prefix::parse(prefix.as_bytes()).is_some());
    // The command's own name may begin as motors do: GTC has both.
    let exact = |at: &usize| command::ROWS.iter().any(|spec| Some(spec.name) == word.get(*at..));
    let ends = || (0..=word.len()).filter(is_prefix);
    let at = ends().find(exact).or_else(|| ends().next_back()).unwrap_or(0);
    word.split_at_checked(at).unwrap_or(("", word))
}

fn is_nodes(word: &str) -> bool {
    !word.is_empty() && word.bytes().all(|byte| byte.is_ascii_digit())
}

fn everything() -> Vec<&'static str> {
    let commands = command::ROWS.iter().map(|spec| spec.name).chain(OWN.iter().map(|own| own.name));
    let commands = commands.chain(["WAKE", "SAVE"]);
    let parameters = MOTOR.iter().map(|row| row.name).chain(HAND.iter().map(|row| row.name));
    commands.chain(parameters).chain(properties().map(|property| property.row().name)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_that_completes_is_explained() {
        for name in everything() {
            let text = explain(name).unwrap_or_else(|| panic!("{name}"));
            assert!(text.contains(name) && overview().contains(name), "{text}");
        }
        assert_eq!(explain("FROB"), None);
        for word in ["WAKE", "SAVE", "G", "S", "AP", "STATUS"] {
            assert!(explain(word).is_some(), "{word}");
        }
    }

    #[test]
    fn refused_value_is_named_with_its_range() {
        for (line, expected) in [
            ("4 S MT 5000", Some("MT: found \"5000\", expected 0 to 990")),
            ("4smt991", Some("MT: found \"991\", expected 0 to 990")),
            ("4 S MT x", Some("MT: found \"X\", expected 0 to 990")),
            ("1fset mcv 5 lcv 2", Some("MCV: found \"5\", expected 16 to 4080")),
            ("FSET LCV", Some("expected a value after each name")),
            ("PSET BAUD 1", Some("BAUD: found \"1\", expected 6 to 384")),
            ("12M 20001", Some("M: found \"20001\", expected [position 0..20000]")),
            ("1 S E 400", Some("E: found 400, expected a position within the joint's range")),
            ("4 S MT 500", None),
            ("FROB", None),
        ] {
            assert_eq!(range(line).as_deref(), expected, "{line}");
        }
    }

    #[test]
    fn name_as_typed_stands_beside_the_tables() {
        for (line, expected) in [
            ("1 g ap", " (AP)"),
            ("4 G M", " (M)"),
            ("4 G STATUS ", " (STATUS)"),
            ("4 G P", ""),
            ("4 G TEMP", ""),
            ("VERS", ""),
        ] {
            assert_eq!(typed_name(line), expected, "{line}");
        }
    }

    #[test]
    fn property_is_explained_with_its_range() {
        let kp = explain("kp").expect("a property");
        assert!(kp.contains("(property ") && kp.contains(" to "), "{kp}");
    }

    #[test]
    fn names_complete_by_what_stands_before_them() {
        let names = |before: &str| complete(before).1;
        assert_eq!(names("dow"), ["download"]);
        assert_eq!(names("FG"), ["FGET"]);
        assert_eq!(complete("123fg"), (3, vec!["FGET".to_owned()]));
        assert_eq!(complete("GFS").0, 1);
        assert!(names("12FGET M").contains(&"MCV".to_owned()));
        assert!(names("PSET ba").contains(&"BAUD".to_owned()));
        assert_eq!(names("123 "), ["G", "S"]);
        assert!(names("123 G TE").contains(&"TEMP".to_owned()));
        assert!(names("watch P TE").contains(&"TEMP".to_owned()));
        assert!(names("help MC").contains(&"MCV".to_owned()));
        assert_eq!(names("VERS x"), [""; 0]);
        // Not ASCII, and in the middle of a character's bytes.
        for before in ["é", "1é", "help é", "😀 G "] {
            let _ = complete(before);
        }
    }
}
