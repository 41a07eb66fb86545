//! Names and units of the columns of traces. The unit of a column is in its name.

use super::table::{Cell, Column, Source, TableError};
use crate::input::{did_you_mean, shorten};

/// The column that is first in every trace.
pub const TIME: &str = "time_ms";

/// The node of the row, in traces of several motors.
pub const MOTOR: &str = "motor";

/// The first fact of a recording, which grows row by row.
pub const RECORDED_BY: &str = "recorded_by";

/// How many answers of a recorded row were damaged, missing or out of range; 0: none.
pub const UNTRUSTED: &str = "untrusted";

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

/// Largest magnitude of a number in a trace, and of a time, ms: those since 1970 have 13 digits.
pub const LARGEST: f64 = 1e12;
const LATEST: f64 = 1e13;

/// Whether a column is a time: these alone may be larger than [`LARGEST`].
#[must_use]
pub fn is_time(name: &str) -> bool {
    [TIME, "time_s", "t_ms", "t_s"].iter().any(|time| name.eq_ignore_ascii_case(time))
}

/// The unit that times have although their column's name says another, which has `unit_ms`: those since 1970 tell it by their size. `step` is
/// the time from the first row to the second: 1e9 ms are seconds since 1970, or milliseconds of a board that runs for twelve days.
#[must_use]
pub fn clock_unit(unit_ms: f64, first: f64, step: f64) -> Option<&'static str> {
    // No board gives 20 rows in a millisecond.
    const LEAST_STEP: f64 = 0.05;
    let units = [("seconds", 1e3), ("milliseconds", 1.0), ("microseconds", 1e-3), ("nanoseconds", 1e-6)];
    // The years 2001 to 2099.
    let is_date = |ms: f64| (1e12..4.1e12).contains(&ms);
    units
        .into_iter()
        .find(|(_, ms)| {
            is_date(first * ms) && (*ms < unit_ms || *ms > unit_ms && step > 0.0 && step < LEAST_STEP)
        })
        .map(|(name, _)| name)
}

/// Checks that a table is a trace whose columns have names that are `known`: numbers alone, and times that rise, for each motor.
///
/// # Errors
/// Another first column than the time, a name that no trace has, or the first cell that does not belong there, by its line.
pub fn check(source: &dyn Source, known: &[&str]) -> Result<(), TableError> {
    let heading = source.heading();
    let top = source.header_line().unwrap_or(1);
    let first = heading.columns.first().map_or("nothing", |column| column.name.as_str());
    if first != TIME {
        return Err(TableError::place(top, first, first, format!("{TIME}, the first column of a trace")));
    }
    for (index, Column { name, .. }) in heading.columns.iter().enumerate() {
        if heading.columns.iter().take(index).any(|before| before.name == *name) {
            return Err(TableError::place(top, name, "the column a second time", "each column once"));
        }
        if !known.contains(&name.as_str()) {
            let expected = match did_you_mean(name, known.iter().copied()) {
                Some(question) => format!("a column of a trace; {question}"),
                None => "a column of a trace (docs/traces.md), or a property's name".to_owned(),
            };
            return Err(TableError::place(top, name, "an unknown column", expected));
        }
    }
    let motor = heading.columns.iter().position(|column| column.name == MOTOR);
    let mut last: Vec<(Cell, f64)> = Vec::new();
    let (mut row, mut first_ms) = (0, None);
    source.rows(&mut |cells| {
        row += 1;
        let line = source.line(row);
        let ms = cells.first().and_then(Cell::number);
        if let (Some(ms), true) = (ms, row <= 2) {
            let (before, step) = first_ms.map_or((ms, 0.0), |before| (before, ms - before));
            first_ms = Some(before);
            if let Some(unit) = clock_unit(1.0, before, step) {
                let expected = format!("milliseconds: these times are {unit} since 1970");
                return Err(TableError::place(line, TIME, ms.to_string(), expected));
            }
        }
        for (column, cell) in heading.columns.iter().zip(cells) {
            check_cell(line, column, cell)?;
        }
        let of = motor.and_then(|at| cells.get(at)).cloned().unwrap_or(Cell::Absent);
        let time = ms.unwrap_or_default();
        match last.iter_mut().find(|(motor, _)| *motor == of) {
            None => last.push((of, time)),
            Some((_, before)) if time > *before => *before = time,
            Some((_, before)) => {
                let expected = format!("more than {before}: times in rising order, each once");
                return Err(TableError::place(line, TIME, time.to_string(), expected));
            }
        }
        Ok(())
    })
}

fn check_cell(line: u64, column: &Column, cell: &Cell) -> Result<(), TableError> {
    let most = if column.name == TIME { LATEST } else { LARGEST };
    match cell {
        Cell::Absent if column.name == TIME => Err(TableError::place(line, TIME, "nothing", "a time")),
        Cell::Absent => Ok(()),
        _ => match cell.number() {
            Some(value) if value.abs() <= most => Ok(()),
            Some(value) => {
                let expected = format!("a number from -{most:e} to {most:e}");
                Err(TableError::place(line, &column.name, format!("{value:e}"), expected))
            }
            None => {
                let found = match cell {
                    Cell::Text(text) => shorten(text),
                    _ => format!("{cell:?}"),
                };
                Err(TableError::place(line, &column.name, found, "a finite number"))
            }
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    const KNOWN: [&str; 5] = [TIME, MOTOR, "bus_v", "winding_c", "IMOTOR"];

    fn checked(csv: &str) -> Result<(), String> {
        let source = crate::csv::Reader::new(csv.into()).map_err(|error| error.to_string())?;
        check(&source, &KNOWN).map_err(|error| error.to_string())
    }

    #[test]
    fn other_tables_are_no_traces() {
        assert_eq!(checked("time_ms,motor,bus_v,IMOTOR\n0,1,24,\n0,5,24,3\n1,1,,\n"), Ok(()));
        for clock in ["1764000000000,1\n1764000000001,1", "1764000000.5,1\n1764000001.5,1"] {
            assert_eq!(checked(&format!("time_ms,bus_v\n{clock}\n")), Ok(()));
        }
        for (csv, words) in [
            ("x,y\n", "row 1, column x: found x, expected time_ms"),
            (
                "# a=b\n\ntime_ms,windng_c\n",
                "row 3, column windng_c: found an unknown column, expected a column of a trace; did you mean winding_c?",
            ),
            ("time_ms,bus_v,bus_v\n", "a second time"),
            ("time_ms,bus_v\n0,1\n\n1,24 V\n", "row 4, column bus_v: found 24 V, expected a finite number"),
            ("time_ms,bus_v\n0,1\n1,1e300\n", "row 3, column bus_v: found 1e300, expected a number from"),
            ("time_ms,bus_v\n0,1\n0,1\n", "row 3, column time_ms: found 0, expected more than 0"),
            ("time_ms,bus_v\n1,1\n0,1\n", "row 3, column time_ms: found 0, expected more than 1"),
            ("time_ms,bus_v\n0,1\n1,1\nNA,1\n", "row 4, column time_ms: found NA, expected a finite number"),
            (
                "time_ms,bus_v\n2026-11-28T06:00:00Z,1\n",
                "row 2, column time_ms: found 2026-11-28T06:00:00Z, expected a finite number",
            ),
            (
                "time_ms,bus_v\n1764000000000000,1\n",
                "row 2, column time_ms: found 1764000000000000, expected milliseconds: these times are microseconds",
            ),
            ("time_ms,bus_v\n1764000000000000000,1\n", "these times are nanoseconds"),
            (
                "time_ms,bus_v\n1764000000.001,1\n1764000000.002,1\n",
                "row 3, column time_ms: found 1764000000.002, expected milliseconds: these times are seconds",
            ),
            ("time_ms,bus_v\n,1\n", "row 2, column time_ms: found nothing, expected a time"),
        ] {
            let error = checked(csv).expect_err(csv);
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn unit_is_what_a_name_ends_in() {
        for (name, want) in [
            ("velocity_counts_s", "counts/s"),
            ("position_counts", "counts"),
            ("torque_per_1024", "1/1024 of 65 N·cm"),
            ("time_s", "s"),
            ("time_ms", "ms"),
            ("winding_c", "°C"),
            ("mode", ""),
        ] {
            assert_eq!(unit(name), want, "{name}");
        }
        assert!(is_time("time_ms") && is_time("T_s") && !is_time("settling_ms"));
    }

    #[test]
    fn unit_of_a_clock_is_known_by_its_size() {
        for (unit_ms, first, step, want) in [
            (1.0, 0.0, 1.0, None),
            (1.0, 1.764e12, 1.0, None),
            (1.0, 1.764e9, 1.0, None),
            (1.0, 1.764e9, 0.001, Some("seconds")),
            (1.0, 1.764e15, 1000.0, Some("microseconds")),
            (1.0, 1.764e18, 1e6, Some("nanoseconds")),
            (1000.0, 1.764e9, 0.001, None),
            (1000.0, 1.764e12, 1.0, Some("milliseconds")),
            (1000.0, 1.764e15, 1000.0, Some("microseconds")),
        ] {
            assert_eq!(clock_unit(unit_ms, first, step), want, "{first} of {unit_ms} ms");
        }
    }
}
