//! A recorded move: the columns of a trace that a board can report over the bus. Columns of the simulator's truth are never read.

use hil_world::rig::halls::CODES;
use tater_wire::MotorKind;
use traces::input::{BadInput, shorten};
use traces::names::UNIT_N_M;

/// Columns that a recording must have.
const NEEDED: [&str; 6] = ["time_ms", "halls_code", "bus_v", "bus_a", "bridge_on", "torque_per_1024"];

/// Longest time between two rows, ms: at 300 counts/s the rotor passes three of six sectors.
const MOST_MS: f64 = 10.0;

/// Fastest motor, counts/ms.
const MOST_COUNTS_MS: f64 = 3.0;

/// Shortest recording, ms: less is no move.
const LEAST_MS: f64 = 100.0;

/// Share of rows with an impossible hall code from which the halls are broken.
const MOST_INVALID: f64 = 0.01;

/// Largest error of P against the halls, counts, while P stands, and what its motion since the row before adds: P is a tick old. A swapped
/// hall line makes 2 counts in two of three sectors. Share of rows from which lines are swapped.
const MOST_ASTRAY: f64 = 1.6;
const MOST_SWAPPED: f64 = 0.05;

/// Fewest counts that tell anything of a motor: two electrical revolutions.
const LEAST_COUNTS: i64 = 12;

/// One row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Time, s.
    pub t_s: f64,
    /// Cell of the halls, unwrapped: its sector is the remainder of six, and cell n reaches from n - 0.5 to n + 0.5.
    pub cell: i64,
    /// Bus voltage, V.
    pub bus_v: f64,
    /// Bus current, mean since the row before, A.
    pub bus_a: f64,
    /// Signed duty from this row on, -1 to 1; `None` if the board did not report it.
    pub duty: Option<f64>,
    /// Torque ordered or applied, N·m by the board's scale.
    pub torque_n_m: f64,
    /// Whether the bridge is on from this row on.
    pub is_driven: bool,
    /// Whether a rotor that is not driven turns freely.
    pub is_free: bool,
    /// Temperature of the motor's housing, °C.
    pub housing_c: f64,
}

/// A recorded move of one motor.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// The rows in order of time.
    pub rows: Vec<Row>,
    /// The smallest step of the bus voltage as recorded, V.
    pub bus_step_v: f64,
    /// Whether temperatures were recorded.
    pub has_temperature: bool,
}

/// The columns of a file.
struct Columns<'a> {
    file: &'a str,
    names: Vec<&'a str>,
}

/// A row of the file.
struct Line<'a> {
    number: usize,
    fields: Vec<&'a str>,
}

const NEXT: &str = "record the move again, with `hil-sim excite` or `hil-sim run --out`";

impl<'a> Columns<'a> {
    fn bad(&self, line: usize, problem: String, found: &str, expected: &str, next: &str) -> BadInput {
        BadInput {
            place: if line == 0 { self.file.to_owned() } else { format!("{}:{line}", self.file) },
            problem,
            found: shorten(found),
            expected: expected.to_owned(),
            next: next.to_owned(),
        }
    }

    fn index(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|of| *of == name)
    }

    fn header(file: &'a str, text: &'a str) -> Result<Self, BadInput> {
        let names: Vec<&str> = text.lines().next().unwrap_or("").split(',').map(str::trim).collect();
        let columns = Self { file, names };
        for name in NEEDED {
            if columns.index(name).is_none() {
                return Err(columns.bad(
                    1,
                    format!("the column {name} is missing"),
                    text.lines().next().unwrap_or(""),
                    &format!("a header with {}", NEEDED.join(", ")),
                    "give a trace.csv of `hil-sim run --out` or of `hil-sim excite`",
                ));
            }
        }
        Ok(columns)
    }

    /// The number in a column; `None` if the column is absent or the field empty.
    fn maybe(&self, line: &Line, name: &str) -> Result<Option<f64>, BadInput> {
        let Some(field) = self.index(name).and_then(|index| line.fields.get(index)) else { return Ok(None) };
        if field.is_empty() {
            return Ok(None);
        }
        match field.parse::<f64>().ok().filter(|value| value.is_finite() && value.abs() < 1e9) {
            Some(value) => Ok(Some(value)),
            None => {
                let problem = format!("{name} is not a number");
                Err(self.bad(line.number, problem, field, "a finite decimal number", NEXT))
            }
        }
    }

    fn number(&self, line: &Line, name: &str) -> Result<f64, BadInput> {
        self.maybe(line, name)?.ok_or_else(|| {
            self.bad(line.number, format!("{name} is empty"), "nothing", "a decimal number", NEXT)
        })
    }
}

const MOTORS: [MotorKind; 3] = [MotorKind::Link, MotorKind::Spread, MotorKind::Tip];

/// Number of a motor's first node, as the column `motor` has it.
const fn node_of(motor: MotorKind) -> f64 {
    match motor {
        MotorKind::Link => 1.0,
        MotorKind::Spread => 4.0,
        MotorKind::Tip => 5.0,
    }
}

impl Recording {
    /// Reads a trace. `motor` selects the rows of a file with several motors, and tells whether its brake stops a motor without
    /// power; without it a coasting rotor is not used.
    ///
    /// # Errors
    /// The place, the problem and the next step: a column missing, a field that is no number, times that do not rise, a gap, an
    /// impossible hall code, too few rows, or no motion.
    pub fn parse(file: &str, text: &str, motor: Option<MotorKind>) -> Result<Self, BadInput> {
        // Spreadsheets write a byte order mark.
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let columns = Columns::header(file, text)?;
        let has_several = columns.index("motor").is_some();
        let mut rows: Vec<Row> = Vec::new();
        let mut unwrap = Unwrap::default();
        let mut invalid = 0;
        let mut last = (0, 0.0);
        let (mut only, mut other) = (None, None);
        for (index, text) in text.lines().enumerate().skip(1).filter(|(_, text)| !text.trim().is_empty()) {
            let line = Line { number: index + 1, fields: text.split(',').map(str::trim).collect() };
            if line.fields.len() != columns.names.len() {
                let found = format!("{} fields", line.fields.len());
                let expected = format!("{} fields, as the header has", columns.names.len());
                let problem = "the row does not fit the header".to_owned();
                return Err(columns.bad(line.number, problem, &found, &expected, NEXT));
            }
            let mut kind = motor;
            if has_several {
                let node = columns.number(&line, "motor")?;
                kind = kind.or(MOTORS.into_iter().find(|kind| node_of(*kind) == node));
                match motor {
                    Some(motor) if node_of(motor) != node => {
                        other = Some((line.number, node));
                        continue;
                    }
                    Some(_) => {}
                    None if *only.get_or_insert(node) != node => {
                        let problem = "the trace has several motors".to_owned();
                        let next = "choose one: --motor link, --motor spread or --motor tip";
                        return Err(columns.bad(line.number, problem, text, "one motor", next));
                    }
                    None => {}
                }
            }
            let ms = columns.number(&line, "time_ms")?;
            if !rows.is_empty() {
                check_time(&columns, line.number, last, ms)?;
            }
            last = (line.number, ms);
            let code = columns.number(&line, "halls_code")?;
            let position = columns.maybe(&line, "position_estimated_counts")?;
            let sector = CODES.iter().position(|of| f64::from(*of) == code);
            invalid += usize::from(sector.is_none());
            rows.push(columns.row(&line, ms, unwrap.cell(sector, position, ms), kind)?);
        }
        if let Some((number, node)) = other.filter(|_| rows.is_empty()) {
            let problem = "the trace has no row of this motor".to_owned();
            let next = "give the --motor that was recorded, or leave --motor out";
            let expected = "motor 1 (link), 4 (spread) or 5 (tip), as --motor has it";
            return Err(columns.bad(number, problem, &format!("motor {node}"), expected, next));
        }
        if unwrap.astray as f64 > MOST_SWAPPED * rows.len() as f64 {
            invalid = invalid.max(unwrap.astray);
        }
        check_length(&columns, &rows, last.0, invalid)?;
        let bus_step_v = bus_step(&rows);
        Ok(Self { rows, bus_step_v, has_temperature: columns.index("thermistor_c").is_some() })
    }
}

impl Columns<'_> {
    fn row(&self, line: &Line, ms: f64, cell: i64, motor: Option<MotorKind>) -> Result<Row, BadInput> {
        let within = |name: &str, value: f64, low: f64, high: f64, expected: &str| {
            if (low..=high).contains(&value) {
                return Ok(value);
            }
            Err(self.bad(line.number, format!("{name} is out of range"), &value.to_string(), expected, NEXT))
        };
        let percent = self.maybe(line, "duty_percent")?;
        let percent = percent.map(|percent| within("duty_percent", percent, -100.0, 100.0, "-100 to 100"));
        let housing_c = self.maybe(line, "thermistor_c")?.unwrap_or(25.0);
        let bridge_on = self.number(line, "bridge_on")?;
        if bridge_on != 0.0 && bridge_on != 1.0 {
            let problem = "bridge_on is neither".to_owned();
            return Err(self.bad(line.number, problem, &bridge_on.to_string(), "0 or 1", NEXT));
        }
        let released = self.maybe(line, "brake_released")?.is_some_and(|released| released > 0.5);
        Ok(Row {
            t_s: ms / 1000.0,
            cell,
            bus_v: within("bus_v", self.number(line, "bus_v")?, 1.0, 60.0, "1 to 60 V")?,
            bus_a: self.number(line, "bus_a")?,
            duty: percent.transpose()?.map(|percent| percent / 100.0),
            torque_n_m: self.number(line, "torque_per_1024")? * UNIT_N_M,
            is_driven: bridge_on == 1.0,
            is_free: released || matches!(motor, Some(MotorKind::Link | MotorKind::Tip)),
            // The range of THERM.
            housing_c: within("thermistor_c", housing_c, -55.0, 125.0, "-55 to 125 C")?,
        })
    }
}

fn check_time(
    columns: &Columns,
    line: usize,
    (before, before_ms): (usize, f64),
    ms: f64,
) -> Result<(), BadInput> {
    if ms <= before_ms {
        let problem = format!("time_ms does not rise: line {before} has {before_ms}");
        let next = "sort the rows by time_ms, each time once, or record the move again";
        return Err(columns.bad(line, problem, &ms.to_string(), &format!("more than {before_ms}"), next));
    }
    if ms - before_ms > MOST_MS {
        let problem = format!("a gap of {:.1} ms after line {before}", ms - before_ms);
        let expected = format!("a row at least every {MOST_MS} ms");
        return Err(columns.bad(line, problem, &format!("time_ms {ms}"), &expected, NEXT));
    }
    Ok(())
}

fn check_length(columns: &Columns, rows: &[Row], line: usize, invalid: usize) -> Result<(), BadInput> {
    let span = rows.first().zip(rows.last()).map_or(0.0, |(first, last)| 1e3 * (last.t_s - first.t_s));
    if span < LEAST_MS {
        let found = format!("{} rows over {span:.0} ms", rows.len());
        let expected = format!("a move of {LEAST_MS} ms or more");
        return Err(columns.bad(line, "the recording is too short".to_owned(), &found, &expected, NEXT));
    }
    if invalid as f64 > MOST_INVALID * rows.len() as f64 {
        let problem = "halls_code is impossible or not of the standard wiring".to_owned();
        let found = format!("{invalid} of {} rows", rows.len());
        let next = "check the hall cable, or let FIND learn the wiring, and record the move again";
        return Err(columns.bad(0, problem, &found, "2, 6, 4, 5, 1 and 3", next));
    }
    let cells = || rows.iter().map(|row| row.cell);
    let moved = cells().max().unwrap_or(0) - cells().min().unwrap_or(0);
    if moved < LEAST_COUNTS {
        let problem = "the motor did not move".to_owned();
        let found = format!("{moved} counts of travel");
        let expected = format!("{LEAST_COUNTS} counts or more");
        let next = "record a move through free travel; `hil-sim excite` makes one";
        return Err(columns.bad(0, problem, &found, &expected, next));
    }
    let amperes = || rows.iter().map(|row| row.bus_a);
    if amperes().all(|bus_a| Some(bus_a) == rows.first().map(|row| row.bus_a)) {
        let problem = "bus_a never changes".to_owned();
        let found = format!("{} A in every row", rows.first().map_or(0.0, |row| row.bus_a));
        let next = "check the current sensor (GET IMOTOR while the motor pushes), and record the move again";
        return Err(columns.bad(0, problem, &found, "the measured current of a motor that was driven", next));
    }
    Ok(())
}

/// 0.1 V as the property VBUS has it, or finer.
fn bus_step(rows: &[Row]) -> f64 {
    let is_coarse = rows.iter().all(|row| (10.0 * row.bus_v - (10.0 * row.bus_v).round()).abs() < 1e-6);
    if is_coarse { 0.1 } else { 0.01 }
}

/// Cells from sectors: of the cells of a sector the one nearest to where the rotor must be.
#[derive(Default)]
struct Unwrap {
    /// Time, ms, and cell of the last row.
    last: Option<(f64, i64)>,
    /// Position, counts, and by how much cells are above it.
    seen: Option<(f64, f64)>,
    counts_per_ms: f64,
    /// Rows whose cell does not fit their position.
    astray: usize,
}

impl Unwrap {
    fn cell(&mut self, sector: Option<usize>, position: Option<f64>, ms: f64) -> i64 {
        let Some(sector) = sector else { return self.last.map_or(0, |(_, cell)| cell) };
        let Some((at, cell)) = self.last else {
            self.last = Some((ms, sector as i64));
            self.seen = position.map(|position| (position, sector as f64 - position));
            return sector as i64;
        };
        let dt = (ms - at).max(1e-3);
        // A position that jumps got another meaning, by HI or a SET.
        let near = |position: f64, before: f64| (position - before).abs() < 3.0 + MOST_COUNTS_MS * dt;
        let offset = position.zip(self.seen).filter(|(position, (before, _))| near(*position, *before));
        let expected = match offset {
            Some((position, (_, above))) => position + above,
            None => cell as f64 + self.counts_per_ms * dt,
        };
        let turns = ((expected - sector as f64) / 6.0).round();
        let next = 6 * turns as i64 + sector as i64;
        self.counts_per_ms += 0.3 * ((next - cell) as f64 / dt - self.counts_per_ms);
        self.last = Some((ms, next));
        let astray = &mut self.astray;
        self.seen = position.map(|position| {
            let above = next as f64 - position;
            let is_astray = offset.is_some_and(|(_, (at, before))| {
                (above - before).abs() > MOST_ASTRAY + (position - at).abs()
            });
            *astray += usize::from(is_astray);
            // A position is a tick old, so its offset changes with the direction.
            (position, offset.map_or(above, |(_, (_, before))| before + 0.1 * (above - before)))
        });
        next
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "time_ms,halls_code,bus_v,bus_a,duty_percent,bridge_on,torque_per_1024";

    /// A rotor at 100 counts/s.
    fn trace(rows: usize) -> Vec<String> {
        let row = |ms: usize| format!("{ms},{},24.0,0.{},20.0,1,200", CODES[ms / 10 % 6], ms % 7);
        std::iter::once(HEADER.to_owned()).chain((0..rows).map(row)).collect()
    }

    fn error(lines: &[String]) -> String {
        Recording::parse("t.csv", &lines.join("\n"), None).expect_err("refused").to_string()
    }

    #[test]
    fn trace_is_unwrapped() {
        let recording = Recording::parse("t.csv", &trace(500).join("\n"), None).expect("valid");
        let cells = |index: usize| recording.rows.get(index).map(|row| row.cell);
        assert_eq!((cells(0), cells(65), cells(499)), (Some(0), Some(6), Some(49)));
        assert!((recording.bus_step_v - 0.1).abs() < 1e-9);
    }

    /// A rotor at 500 counts/s with its position, and codes through a wiring.
    fn positions(wiring: fn(u8) -> u8) -> String {
        let row = |ms: usize| {
            format!("{ms},1,{},24.0,0.{},20.0,1,200,{}\n", wiring(CODES[ms / 2 % 6]), ms % 7, ms / 2)
        };
        let head = "time_ms,motor,halls_code,bus_v,bus_a,duty_percent,bridge_on,torque_per_1024,position_estimated_counts\n";
        std::iter::once(head.to_owned()).chain((0..500).map(row)).collect()
    }

    #[test]
    fn swapped_hall_lines_are_refused() {
        Recording::parse("t.csv", &positions(|code| code), None).expect("valid");
        let swapped = positions(|code| code & 4 | (code & 1) << 1 | code >> 1 & 1);
        let error = Recording::parse("t.csv", &swapped, None).expect_err("refused").to_string();
        assert!(error.contains("not of the standard wiring"), "{error}");
    }

    #[test]
    fn motor_that_was_not_recorded_is_refused() {
        let text = positions(|code| code);
        let error = Recording::parse("t.csv", &text, Some(MotorKind::Tip)).expect_err("refused").to_string();
        assert!(error.contains("no row of this motor") && error.contains("motor 1"), "{error}");
    }

    #[test]
    fn bad_traces_are_refused_with_place_and_next_step() {
        let with = |line: usize, text: &str| {
            let mut lines = trace(500);
            lines[line] = text.to_owned();
            lines
        };
        let mut gap = trace(500);
        gap.drain(50..70);
        let without_current = (0..500).map(|ms| format!("{ms},{},24.0,0.0,20.0,1,200", CODES[ms / 10 % 6]));
        let without_current = std::iter::once(HEADER.to_owned()).chain(without_current).collect();
        let mut too_hot = trace(500);
        too_hot.iter_mut().for_each(|line| line.push_str(",250"));
        too_hot[0] = format!("{HEADER},thermistor_c");
        let row = |ms: usize| format!("{ms},2,24.0,0.1,20.0,1,200");
        let still: Vec<String> = std::iter::once(HEADER.to_owned()).chain((0..300).map(row)).collect();
        for (lines, place, problem) in [
            (with(0, "time_ms,halls_code,bus_v,bus_a,duty_percent"), "t.csv:1", "bridge_on is missing"),
            (with(3, "2,2,NaN,0.1,20.0,1,200"), "t.csv:4", "bus_v is not a number"),
            (with(3, "2,2,,0.1,20.0,1,200"), "t.csv:4", "bus_v is empty"),
            (with(3, "2,2,24.0,0.1,20.0,2,200"), "t.csv:4", "bridge_on is neither"),
            (with(3, "2,2,24.0,0.1,20.0,1,"), "t.csv:4", "torque_per_1024 is empty"),
            (with(0, &HEADER.replace(",torque_per_1024", "")), "t.csv:1", "torque_per_1024 is missing"),
            (without_current, "t.csv", "bus_a never changes"),
            (too_hot, "t.csv:2", "thermistor_c is out of range"),
            (with(3, "2,2,24.0,0.1"), "t.csv:4", "does not fit the header"),
            (with(3, "0,2,24.0,0.1,20.0,1,200"), "t.csv:4", "time_ms does not rise"),
            (gap, "t.csv:51", "a gap of 21.0 ms after line 50"),
            (trace(50), "t.csv:51", "too short"),
            (vec![HEADER.to_owned()], "t.csv", "too short"),
            (still, "t.csv", "the motor did not move"),
        ] {
            let text = error(&lines);
            assert!(text.starts_with(place) && text.contains(problem), "{text}");
            assert!(text.contains("next:"), "{text}");
        }
    }
}
