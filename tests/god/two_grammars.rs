//! Lines that both grammars can read, by the table in docs/hand.md.

use std::collections::BTreeSet;

use god::grammar::{self, Statement};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngSeed, TestRunner};
use tater_wire::Property;

struct Row {
    line: String,
    is_gcl: bool,
    same_as: String,
}

/// The rows `| line | grammar | same as | why |` of docs/hand.md.
fn table() -> Vec<Row> {
    let page = include_str!("../../docs/hand.md");
    let rows = page.lines().filter_map(|line| {
        let [_, line, grammar @ ("GCL" | "lower"), same_as, _, _] =
            line.split('|').map(str::trim).collect::<Vec<_>>()[..]
        else {
            return None;
        };
        let code = |cell: &str| cell.trim_matches('`').to_owned();
        Some(Row { line: code(line), is_gcl: grammar == "GCL", same_as: code(same_as) })
    });
    rows.collect()
}

/// What a line asks for, without where its arguments stand.
fn meaning(line: &str) -> String {
    match grammar::parse(line) {
        Ok(Statement::Command { command, prefix, arguments }) => {
            format!("{prefix:?} {command:?} {:?}", arguments.collect::<Vec<_>>())
        }
        read => format!("{read:?}"),
    }
}

fn is_gcl(line: &str) -> bool {
    matches!(grammar::parse(line), Ok(Statement::Command { .. }))
}

#[test]
fn lines_of_the_table_are_read_as_it_states() {
    let rows = table();
    assert!(rows.len() >= 18, "{} rows", rows.len());
    for Row { line, is_gcl: expected, same_as } in rows {
        assert_eq!(is_gcl(&line), expected, "{line}");
        assert!(grammar::parse(&line).is_ok(), "{line}");
        assert_eq!(meaning(&line), meaning(&same_as), "{line} and {same_as}");
    }
}

/// S or G, and the name after it, of the lines without white space that the table calls GCL.
fn ambiguous() -> BTreeSet<(char, String)> {
    let joined = table().into_iter().filter(|row| row.is_gcl && !row.line.contains("1 S"));
    let parts = joined.map(|row| {
        let rest = row.line.trim_start_matches(|c: char| c.is_ascii_digit());
        let name = rest[1..].trim_end_matches(|c: char| c.is_ascii_digit() || c == ' ');
        (rest.chars().next().expect("S or G"), name.to_owned())
    });
    parts.collect()
}

fn names() -> Vec<String> {
    let words = ["M", "AP", "STATUS"].map(str::to_owned).into_iter();
    words.chain(Property::ALL.iter().map(|property| property.row().name.to_owned())).collect()
}

fn joined(line: &str) -> String {
    line.split_ascii_whitespace().collect()
}

fn assert_same_or_in_table(line: &str, letter: char, name: &str) {
    assert!(matches!(grammar::parse(line), Ok(Statement::Lower(_))), "{line}");
    let joined = joined(line);
    if meaning(&joined) != meaning(line) {
        assert!(is_gcl(&joined) && ambiguous().contains(&(letter, name.to_owned())), "{line} and {joined}");
    }
}

/// Every set of nodes in ascending order, every property.
#[test]
fn lower_line_without_its_spaces_means_the_same_or_is_in_the_table() {
    for nodes in 1_u8..128 {
        let nodes: String =
            (0..7).filter(|bit| nodes >> bit & 1 != 0).map(|bit| char::from(b'1' + bit)).collect();
        for name in names() {
            assert_same_or_in_table(&format!("{nodes} G {name}"), 'G', &name);
            for value in [0, 5, -5, 12, 32_767] {
                assert_same_or_in_table(&format!("{nodes} S {name} {value}"), 'S', &name);
            }
        }
    }
}

/// Nodes in any order and several times, white space in some of its places, which never changes what a line of the table's left means.
#[test]
fn lower_line_with_some_of_its_spaces_means_the_same_or_is_in_the_table() {
    let config = Config {
        cases: 20_000,
        rng_seed: RngSeed::Fixed(0x10E4),
        failure_persistence: None,
        ..Config::default()
    };
    let line = (
        proptest::collection::vec(1_u8..=7, 1..4),
        any::<bool>(),
        prop::sample::select(names()),
        any::<i32>(),
        any::<[bool; 4]>(),
    );
    let property = |(nodes, is_set, name, value, spaces): (Vec<u8>, bool, String, i32, [bool; 4])| {
        let nodes: Vec<String> = nodes.iter().map(u8::to_string).collect();
        let letter = if is_set { 'S' } else { 'G' };
        let value = if is_set { value.to_string() } else { String::new() };
        let spaced = format!("{} {letter} {name} {value}", nodes.join(" "));
        assert_same_or_in_table(&spaced, letter, &name);
        let space = |place: usize| if spaces[place] { " " } else { "" };
        let some =
            format!("{}{}{letter}{}{name}{}{value}", nodes.join(space(0)), space(1), space(2), space(3));
        let decides = spaces[0] && nodes.len() > 1 || spaces[1] || spaces[2];
        let same = if decides { &spaced } else { &joined(&spaced) };
        prop_assert_eq!(meaning(&some), meaning(same), "{}", some);
        Ok(())
    };
    TestRunner::new(config).run(&line, property).unwrap_or_else(|failed| panic!("{failed}"));
}

/// GCL lines of every command and prefix: white space within the prefix, and before the argument, changes nothing.
#[test]
fn gcl_line_means_the_same_without_its_spaces() {
    for row in god::command::ROWS {
        for prefix in ["", "1", "13", "S", "G", "SG", "S1", "X5", "X157", "XG"] {
            let takes_name = matches!(row.name, "?" | "FSET" | "FGET" | "PSET" | "PGET");
            let argument = if takes_name { "DS" } else { "5" };
            let spaced = format!("{prefix}{} {argument}", row.name);
            assert_eq!(meaning(&spaced), meaning(&joined(&spaced)), "{spaced}");
            let apart: Vec<String> = prefix.chars().map(String::from).collect();
            let apart = format!("{} {} {argument}", apart.join(" "), row.name);
            assert_eq!(meaning(&spaced), meaning(&apart), "{spaced} and {apart}");
        }
    }
}
