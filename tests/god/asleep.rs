//! Commands to boards that sleep or are not there: each ends with a prompt and a defined status.

use god::command;
use tater_wire::property::{Access, ROWS};
use tater_wire::{Cmd, Property};

use super::Session;

/// Longest time to the prompt, us: three questions of 60 ms to the boards that sleep, before and after.
const PROMPT_US: u64 = 500_000;

/// The properties that a monitor serves: its others are locked, under numbers that are other properties' of the application.
const SERVED: u8 = 5;

/// What the line is answered while board 1 sleeps.
fn expected(property: Property, is_set: bool) -> String {
    let row = property.row();
    match (is_set, row.access) {
        (true, Access::ReadOnly) => "ERR 256".to_owned(),
        (false, Access::WriteOnly) => "ERR 128".to_owned(),
        (true, _) if property == Property::STAT => String::new(),
        (false, _) if property.id() <= SERVED => format!("1 {}=", row.name),
        _ => "ERR 1".to_owned(),
    }
}

#[test]
fn every_property_of_a_sleeping_board_is_err_1_unless_its_monitor_serves_it() {
    let mut session = Session::new();
    // Board 2 is awake: what reaches it is obeyed, and the line is ERR 1 nevertheless.
    session.run("2 S STAT 2");
    session.wait_us(1_100_000);
    for row in ROWS {
        let name = row.name;
        // M is MODE in this grammar.
        if row.property == Property::M {
            continue;
        }
        // STAT 0 leaves it asleep. A place beyond the joint is ERR 128, whoever sleeps.
        let value =
            if matches!(row.property, Property::STAT | Property::P | Property::E) { 0 } else { row.min() };
        for (line, is_set) in [(format!("1 S {name} {value}"), true), (format!("1 G {name}"), false)] {
            let (answer, _) = session.try_run(&line, PROMPT_US).expect("a prompt");
            let expected = expected(row.property, is_set);
            assert!(
                answer == expected || expected.ends_with('=') && answer.starts_with(&expected),
                "{line}: {answer}"
            );
        }
    }
    for (line, answer) in [("12 S MT 333", "ERR 1"), ("2 G MT", "2 MT=333"), ("1 S MT 100", "ERR 1")] {
        assert_eq!(session.run(line), answer, "{line}");
    }
}

#[test]
fn every_cmd_to_a_sleeping_board_is_err_1() {
    let mut session = Session::new();
    for number in 0..=31 {
        let Some(_) = Cmd::of(number) else { continue };
        let (answer, _) = session.try_run(&format!("1 S CMD {number}"), PROMPT_US).expect("a prompt");
        assert_eq!(answer, "ERR 1", "CMD {number}");
    }
}

fn line(name: &str) -> String {
    let argument = match name {
        "FSET" => " DS 100",
        "FGET" => " P",
        "PSET" => " LFT 1",
        "PGET" => " LFT",
        "WAIT" | "MDEG" | "MPER" => " 10",
        "REC" | "PLAY" | "MACSET" | "MAC" => " 1",
        _ => "",
    };
    format!("{name}{argument}")
}

/// GCL wakes the boards that it needs: its answers are those of a hand that is awake.
#[test]
fn every_gcl_command_wakes_sleeping_boards() {
    for row in command::ROWS {
        let line = line(row.name);
        let answer = |wake: bool| {
            let mut session = Session::new();
            if wake {
                assert_eq!(session.run("WAKE"), "");
            }
            let answer = session.run(&line);
            answer.lines().filter(|line| !line.starts_with("UPSECS")).collect::<Vec<_>>().join("\n")
        };
        assert_eq!(answer(false), answer(true), "{line}");
    }
}

/// A finger whose boards are not there: ERR 1 of each command that needs it.
#[test]
fn every_gcl_command_without_a_board_prompts() {
    for row in command::ROWS {
        let line = line(row.name);
        let mut session = Session::new();
        [1, 5].into_iter().for_each(|board| session.hand.bus_mut().cut(board, true));
        let (answer, _) = session.try_run(&line, 30_000_000).expect("a prompt");
        let needs_boards =
            matches!(row.category, command::Category::Movement | command::Category::MotorParameters)
                && row.prefix;
        let code = answer.rsplit_once("ERR ").and_then(|(_, code)| code.trim().parse::<u16>().ok());
        if needs_boards {
            assert!(code.is_some_and(|code| code & 1 == 1), "{line}: {answer}");
        }
    }
}
