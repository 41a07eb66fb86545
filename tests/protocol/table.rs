//! The property table against an independent list, where that lies beside the checkout.

use std::path::Path;

use tater_wire::property::{Access, ROWS, Stored};
use tater_wire::{Node, Property};

const LIST: &str = "../../shared/data/properties.csv";

/// What the list lacks: in mode 4 V is the velocity commanded, and RealTime feeds back the one that there is (manual 5.3.3).
/// The motor's model is decision 0064's, its description 0083's.
const ADDED: [Property; 25] = [
    Property::MR,
    Property::MPK,
    Property::MKT,
    Property::MJ,
    Property::ML,
    Property::MVN,
    Property::MWX,
    Property::MWJ,
    Property::MWR,
    Property::KBW,
    Property::FIT,
    Property::JLO,
    Property::JHI,
    Property::HOSTUNITS,
    Property::FIND,
    Property::VEL,
    Property::WIRING,
    Property::HOSTMS,
    Property::KIND,
    Property::VSET,
    Property::MKA,
    Property::MKE,
    Property::MFC,
    Property::MFS,
    Property::MTE,
];

/// Properties of the motor, which the list fixes to the hand's.
const CHANGED: [Property; 4] = [Property::POLES, Property::IPNM, Property::CTS, Property::MECH];

fn fields(line: &str) -> Vec<String> {
    let (mut fields, mut quoted) = (vec![String::new()], false);
    for character in line.chars() {
        match character {
            '"' => quoted = !quoted,
            ',' if !quoted => fields.push(String::new()),
            _ => fields.last_mut().expect("one at least").push(character),
        }
    }
    fields
}

#[test]
fn property_table_equals_the_independent_list() {
    let Ok(list) = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(LIST)) else {
        println!("skipped: no properties.csv in ../shared beside the checkout");
        return;
    };
    let lines: Vec<Vec<String>> = list.lines().skip(1).map(fields).collect();
    assert_eq!(lines.len() + ADDED.len(), ROWS.len());
    for row in ROWS.iter().filter(|row| !ADDED.contains(&row.property) && !CHANGED.contains(&row.property)) {
        let id = row.property.id().to_string();
        let line =
            lines.iter().find(|line| line[0] == id).unwrap_or_else(|| panic!("{} is missing", row.name));
        let access = match row.access {
            Access::ReadOnly => "ro",
            Access::ReadWrite => "rw",
            Access::WriteOnly => "wo",
            Access::Locked => "locked",
        };
        let stored = match row.stored {
            Stored::No => "no",
            Stored::Yes => "yes",
            Stored::Always => "always",
        };
        let found = [&line[1], &line[2], line[3].trim_end_matches('*'), &line[4]];
        assert_eq!(found, [row.name, &row.bits.to_string(), access, stored]);
        for (listed, ours) in [(&line[6], row.min), (&line[7], row.max)] {
            assert!(listed.is_empty() || *listed == ours.to_string(), "{}: {listed} and {ours}", row.name);
        }
        for (number, listed) in [(2, &line[8]), (4, &line[9]), (6, &line[10])] {
            let ours = row.default_for(Node::new(number).expect("a node"));
            let listed = match listed.as_str() {
                "tuned" => ours,
                "" => None,
                "node" => Some(number.into()),
                "node-4" => Some(i64::from(number) - 4),
                value => value.parse().ok(),
            };
            assert_eq!(ours, listed, "default of {} on node {number}", row.name);
        }
    }
}
