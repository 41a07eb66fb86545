//! Names and units of the columns of traces. The unit of a column is in its name.

use super::table::{Column, Heading, TableError};
use crate::input::did_you_mean;

/// The column that is first in every trace.
pub const TIME: &str = "time_ms";

/// The node of the row, in traces of several motors.
pub const MOTOR: &str = "motor";

/// The first fact of a recording, which grows row by row.
pub const RECORDED_BY: &str = "recorded_by";

/// How many answers of a recorded row were damaged, missing or out of range; 0: none.
pub const UNTRUSTED: &str = "untrusted";

/// A torque unit of the boards, N·m: 1024 are 65 N·cm.
pub const UNIT_N_M: f64 = 0.65 / 1024.0;

/// Volts of a torque unit: 1024 are 24 V.
pub const UNIT_V: f64 = 24.0 / 1024.0;

/// The unit that a column's name ends in; empty for codes and switches.
#[must_use]
pub fn unit(name: &str) -> &'static str {
    // The longest first: counts_s ends in s as well.
    const UNITS: [(&str, &str); 10] = [
        ("_counts_s", "counts/s"),
        ("_counts", "counts"),
        ("_per_1024", "1/1024 of 65 N·cm"),
        ("_percent", "%"),
        ("_n_m", "N·m"),
        ("_ms", "ms"),
        ("_v", "V"),
        ("_a", "A"),
        ("_c", "°C"),
        ("_s", "s"),
    ];
    UNITS.iter().find(|(end, _)| name.ends_with(end)).map_or("", |(_, unit)| unit)
}

/// Checks that a table is a trace whose columns have names that are `known`.
///
/// # Errors
/// Another first column than the time, a name that no trace has, or no numbers.
pub fn check(heading: &Heading, known: &[&str]) -> Result<(), TableError> {
    let first = heading.columns.first().map_or("nothing", |column| column.name.as_str());
    if first != TIME {
        return Err(TableError::place(1, first, first, format!("{TIME}, the first column of a trace")));
    }
    for (index, Column { name, .. }) in heading.columns.iter().enumerate() {
        if heading.columns.iter().take(index).any(|before| before.name == *name) {
            return Err(TableError::place(1, name, "the column a second time", "each column once"));
        }
        if !known.contains(&name.as_str()) {
            let expected = match did_you_mean(name, known.iter().copied()) {
                Some(question) => format!("a column of a trace; {question}"),
                None => "a column of a trace (docs/traces.md), or a property's name".to_owned(),
            };
            return Err(TableError::place(1, name, "an unknown column", expected));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::Kind;

    const KNOWN: [&str; 5] = [TIME, MOTOR, "bus_v", "winding_c", "IMOTOR"];

    #[test]
    fn other_tables_are_no_traces() {
        let table = |names: &[&str]| Heading {
            columns: names.iter().map(|name| Column::new(*name, "", Kind::Float)).collect(),
            metadata: Vec::new(),
        };
        assert!(check(&table(&["time_ms", "motor", "bus_v", "IMOTOR"]), &KNOWN).is_ok());
        for (names, words) in [
            (&["x", "y"][..], "found x, expected time_ms"),
            (&[], "found nothing"),
            (
                &["time_ms", "windng_c"],
                "column windng_c: found an unknown column, expected a column of a trace; did you mean winding_c?",
            ),
            (&["time_ms", "bus_v", "bus_v"], "a second time"),
        ] {
            let error = check(&table(names), &KNOWN).expect_err("refused").to_string();
            assert!(error.contains(words), "{error}");
        }
    }
}
