//! A recorded move: the columns of a trace that a board can report over the bus. Columns of the simulator's truth are never read.

use hil_world::rig::halls::CODES;
use tater_wire::MotorKind;
use tater_wire::mode::ROWS;
use traces::input::BadInput;
use traces::names::{MOTOR, TIME, UNTRUSTED, clock_unit};
use traces::numbers::Numbers;

/// What a recording must have.
const EXPECTED: &str = "time_ms, halls_code, bus_v, bus_a, torque_per_1024, and bridge_on or mode: a trace of `hil-sim run --out`, `excite` or `log`";

/// Longest time between two rows, ms, of a motor that turns at 300 counts/s at most: it passes three of six sectors.
const MOST_MS: f64 = 10.0;

/// The same with positions, which tell the turns: twelve answers of a board on a slow USB adapter take 24 ms, and a busy host adds some.
const MOST_WITH_POSITION_MS: f64 = 100.0;

/// Fastest motor, counts/ms: no board drives a faster one (docs/motor.md).
const MOST_COUNTS_MS: f64 = 6.0;

/// Shortest recording, ms: less is no move.
const LEAST_MS: f64 = 100.0;

/// Share of rows with an impossible hall code from which the halls are broken.
const MOST_INVALID: f64 = 0.01;

/// Largest error of P against the halls, counts, while P stands, and what its motion since the row before adds: P is a tick old. A swapped
/// hall line makes 2 counts in two of three sectors. Share of rows from which lines are swapped.
const MOST_ASTRAY: f64 = 1.6;
const MOST_SWAPPED: f64 = 0.05;

/// Largest bus current, A, and torque, 1/1024 of the motor's peak: several times what a board reports.
const MOST_A: f64 = 100.0;
const MOST_TORQUE: f64 = 4096.0;

/// The largest board address.
const LAST_NODE: f64 = 31.0;

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
    /// Torque ordered or applied, 1/1024 of the board's scale.
    pub torque: f64,
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

const NEXT: &str = "record the move again, with `hil-sim excite` or `hil-sim run --out`";

const MOTORS: [MotorKind; 3] = [MotorKind::Link, MotorKind::Spread, MotorKind::Tip];

/// The columns of a file.
struct Columns<'a> {
    of: &'a Numbers,
    time: usize,
    halls: usize,
    bus_v: usize,
    bus_a: usize,
    torque: usize,
    bridge: Bridge,
    motor: Option<usize>,
    position: Option<usize>,
    duty: Option<usize>,
    thermistor: Option<usize>,
    released: Option<usize>,
    /// Answers that a log could not trust: cells of its rows may be empty.
    untrusted: bool,
}

/// What tells whether the bridge is on.
#[derive(Clone, Copy)]
enum Bridge {
    /// `bridge_on`.
    On(usize),
    /// MODE, which is 0 without power.
    Mode(usize),
}

impl<'a> Columns<'a> {
    fn new(of: &'a Numbers) -> Result<Self, BadInput> {
        let need = |name: &str| of.need(&[name], EXPECTED);
        let bridge = match (of.find(&["bridge_on"]), of.find(&["mode"])) {
            (Some(column), _) => Bridge::On(column),
            (None, Some(column)) => Bridge::Mode(column),
            (None, None) => Bridge::On(need("bridge_on")?),
        };
        Ok(Self {
            of,
            time: need(TIME)?,
            halls: need("halls_code")?,
            bus_v: need("bus_v")?,
            bus_a: need("bus_a")?,
            torque: need("torque_per_1024")?,
            bridge,
            motor: of.find(&[MOTOR]),
            position: of.find(&["position_estimated_counts"]),
            duty: of.find(&["duty_percent"]),
            thermistor: of.find(&["thermistor_c"]),
            released: of.find(&["brake_released"]),
            untrusted: of.find(&[UNTRUSTED]).is_some(),
        })
    }

    /// An error of the whole file.
    fn bad(&self, problem: &str, found: String, expected: String, next: &str) -> BadInput {
        self.of.bad_file(problem.to_owned(), found, expected, next)
    }

    fn maybe(&self, row: usize, column: Option<usize>) -> Result<Option<f64>, BadInput> {
        column.map_or(Ok(None), |column| self.of.maybe(row, column))
    }

    /// A number that must be in its range.
    fn within(&self, row: usize, column: usize, range: [f64; 2], expected: &str) -> Result<f64, BadInput> {
        let value = self.of.number(row, column)?;
        let is_within = (range[0]..=range[1]).contains(&value);
        if is_within { Ok(value) } else { Err(self.of.bad(row, column, "out of range", expected)) }
    }

    /// A whole number that must be in its range.
    fn whole(&self, row: usize, column: usize, range: [f64; 2], expected: &str) -> Result<f64, BadInput> {
        let value = self.within(row, column, range, expected)?;
        if value.fract() == 0.0 { Ok(value) } else { Err(self.of.bad(row, column, "not whole", expected)) }
    }

    /// Whether a log lacks one of the numbers that a row must have: an answer was damaged.
    fn is_lost(&self, row: usize) -> bool {
        let (Bridge::On(bridge) | Bridge::Mode(bridge)) = self.bridge;
        let needed = [self.halls, self.bus_v, self.bus_a, self.torque, bridge];
        self.untrusted && needed.iter().any(|column| matches!(self.of.maybe(row, *column), Ok(None)))
    }

    /// The kind of motor of a row; `None` if the row is another motor's than `motor`. `only` is the node of the rows before.
    fn kind(
        &self,
        row: usize,
        motor: Option<MotorKind>,
        only: &mut Option<f64>,
    ) -> Result<Option<Option<MotorKind>>, BadInput> {
        let Some(column) = self.motor else { return Ok(Some(motor)) };
        let node = self.whole(row, column, [0.0, LAST_NODE], "0 to 31, a board")?;
        let kind = motor.or(MOTORS.into_iter().find(|kind| f64::from(kind.first_node()) == node));
        match motor {
            Some(motor) if f64::from(motor.first_node()) != node => Ok(None),
            None if *only.get_or_insert(node) != node => {
                let expected = "one motor: choose it with --motor link, --motor spread or --motor tip";
                Err(self.of.bad(row, column, "the trace has several motors", expected))
            }
            _ => Ok(Some(kind)),
        }
    }

    fn row(&self, row: usize, ms: f64, cell: i64, motor: Option<MotorKind>) -> Result<Row, BadInput> {
        let duty = match self.duty {
            Some(column) if self.of.maybe(row, column)?.is_some() => {
                Some(self.within(row, column, [-100.0, 100.0], "-100 to 100")? / 100.0)
            }
            _ => None,
        };
        // The range of THERM.
        let housing_c = match self.thermistor {
            Some(column) if self.of.maybe(row, column)?.is_some() => {
                self.within(row, column, [-55.0, 125.0], "-55 to 125 C")?
            }
            _ => 25.0,
        };
        let is_driven = match self.bridge {
            Bridge::On(column) => match self.of.number(row, column)? {
                0.0 => false,
                1.0 => true,
                _ => return Err(self.of.bad(row, column, "neither", "0 or 1")),
            },
            Bridge::Mode(column) => {
                let mode = self.of.number(row, column)?;
                let mut modes = ROWS.iter().map(|spec| f64::from(spec.code.number()));
                if !modes.any(|known| known == mode) {
                    return Err(self.of.bad(row, column, "no mode", "a value of MODE (docs/properties.md)"));
                }
                mode != 0.0
            }
        };
        let released = self.maybe(row, self.released)?.is_some_and(|released| released > 0.5);
        Ok(Row {
            t_s: ms / 1000.0,
            cell,
            bus_v: self.within(row, self.bus_v, [1.0, 60.0], "1 to 60 V")?,
            bus_a: self.within(row, self.bus_a, [-MOST_A, MOST_A], "-100 to 100 A")?,
            duty,
            torque: self.within(row, self.torque, [-MOST_TORQUE, MOST_TORQUE], "-4096 to 4096")?,
            is_driven,
            is_free: released || matches!(motor, Some(MotorKind::Link | MotorKind::Tip)),
            housing_c,
        })
    }

    fn check_time(&self, row: usize, before: Option<(usize, f64)>) -> Result<f64, BadInput> {
        let ms = self.of.number(row, self.time)?;
        let step = before.map_or(0.0, |(_, before_ms)| ms - before_ms);
        if let Some(unit) = clock_unit(1.0, ms, step) {
            let expected = format!("milliseconds: these times are {unit} since 1970");
            return Err(self.of.bad(row, self.time, "times in another unit", &expected));
        }
        let Some((_, before_ms)) = before else { return Ok(ms) };
        if ms <= before_ms {
            let expected = format!("more than {before_ms}: rows sorted by time_ms, each time once");
            return Err(self.of.bad(row, self.time, "does not rise", &expected));
        }
        let most = if self.position.is_some() { MOST_WITH_POSITION_MS } else { MOST_MS };
        if ms - before_ms > most {
            let problem = format!("a gap of {:.1} ms", ms - before_ms);
            let expected = format!("a row at least every {most} ms: record the move again");
            return Err(self.of.bad(row, self.time, &problem, &expected));
        }
        Ok(ms)
    }
}

impl Recording {
    /// Reads a trace of the file `place` from CSV, as [`Recording::read`].
    ///
    /// # Errors
    /// The same, and those of the text.
    pub fn of_csv(place: &str, text: String, motor: Option<MotorKind>) -> Result<Self, BadInput> {
        let source = traces::csv::Reader::new(text.into_bytes())
            .map_err(|error| traces::numbers::bad(place, error))?;
        Self::read(&Numbers::read(place, &source)?, motor)
    }

    /// Reads a trace. `motor` selects the rows of a file with several motors, and tells whether its brake stops a motor without
    /// power; without it a coasting rotor is not used.
    ///
    /// # Errors
    /// The place, the problem and the next step: a column missing, a field that is no number, times that do not rise, a gap, an
    /// impossible hall code, too few rows, or no motion.
    pub fn read(numbers: &Numbers, motor: Option<MotorKind>) -> Result<Self, BadInput> {
        let columns = Columns::new(numbers)?;
        let mut rows: Vec<Row> = Vec::new();
        let mut unwrap = Unwrap::default();
        let (mut invalid, mut start) = (0, None);
        let (mut last, mut only) = (None, None);
        for index in 0..numbers.len() {
            let Some(kind) = columns.kind(index, motor, &mut only)? else { continue };
            if columns.is_lost(index) {
                continue;
            }
            let ms = columns.check_time(index, last)?;
            last = Some((index, ms));
            // A clock's times have too few digits left for milliseconds.
            let ms = ms - *start.get_or_insert(if ms < 1e9 { 0.0 } else { ms });
            let code = columns.whole(index, columns.halls, [0.0, 7.0], "0 to 7, the lines of three halls")?;
            let position = columns.maybe(index, columns.position)?;
            let sector = CODES.iter().position(|of| f64::from(*of) == code);
            invalid += usize::from(sector.is_none());
            rows.push(columns.row(index, ms, unwrap.cell(sector, position, ms), kind)?);
        }
        if let (true, Some(motor), Some(column)) = (rows.is_empty(), motor, columns.motor)
            && !numbers.is_empty()
        {
            let expected = format!("motor {} ({}), as --motor has it", motor.first_node(), motor.name());
            return Err(numbers.bad(0, column, "the trace has no row of this motor", &expected));
        }
        if unwrap.astray as f64 > MOST_SWAPPED * rows.len() as f64 {
            invalid = invalid.max(unwrap.astray);
        }
        check_length(&columns, &rows, invalid)?;
        let bus_step_v = bus_step(&rows);
        Ok(Self { rows, bus_step_v, has_temperature: columns.thermistor.is_some() })
    }
}

fn check_length(columns: &Columns, rows: &[Row], invalid: usize) -> Result<(), BadInput> {
    let span = rows.first().zip(rows.last()).map_or(0.0, |(first, last)| 1e3 * (last.t_s - first.t_s));
    if span < LEAST_MS {
        let found = format!("{} rows over {span:.0} ms", rows.len());
        let expected = format!("a move of {LEAST_MS} ms or more");
        return Err(columns.bad("the recording is too short", found, expected, NEXT));
    }
    if invalid as f64 > MOST_INVALID * rows.len() as f64 {
        let problem = "halls_code is impossible or not of the standard wiring";
        let found = format!("{invalid} of {} rows", rows.len());
        let next = "check the hall cable, or let FIND learn the wiring, and record the move again";
        return Err(columns.bad(problem, found, "2, 6, 4, 5, 1 and 3".to_owned(), next));
    }
    let cells = || rows.iter().map(|row| row.cell);
    let moved = cells().max().unwrap_or(0) - cells().min().unwrap_or(0);
    if moved < LEAST_COUNTS {
        let problem = "the motor did not move";
        let found = format!("{moved} counts of travel");
        let expected = format!("{LEAST_COUNTS} counts or more");
        let next = "record a move through free travel; `hil-sim excite` makes one";
        return Err(columns.bad(problem, found, expected, next));
    }
    let amperes = || rows.iter().map(|row| row.bus_a);
    if amperes().all(|bus_a| Some(bus_a) == rows.first().map(|row| row.bus_a)) {
        let problem = "bus_a never changes";
        let found = format!("{} A in every row", rows.first().map_or(0.0, |row| row.bus_a));
        let next = "check the current sensor (GET IMOTOR while the motor pushes), and record the move again";
        let expected = "the measured current of a motor that was driven".to_owned();
        return Err(columns.bad(problem, found, expected, next));
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

    fn read(text: &str, motor: Option<MotorKind>) -> Result<Recording, BadInput> {
        Recording::of_csv("t.csv", text.to_owned(), motor)
    }

    fn error(lines: &[String]) -> String {
        read(&lines.join("\n"), None).expect_err("refused").to_string()
    }

    #[test]
    fn trace_is_unwrapped() {
        let recording = read(&trace(500).join("\n"), None).expect("valid");
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
        read(&positions(|code| code), None).expect("valid");
        let swapped = positions(|code| code & 4 | (code & 1) << 1 | code >> 1 & 1);
        let error = read(&swapped, None).expect_err("refused").to_string();
        assert!(error.contains("not of the standard wiring"), "{error}");
    }

    /// What `hil-sim log` writes: no bridge_on, rows 20 ms apart, and an answer that was lost.
    #[test]
    fn log_is_a_recording() {
        let head = "# recorded_by=hil-sim\ntime_ms,mode,position_estimated_counts,torque_per_1024,bus_v,bus_a,halls_code,untrusted\n";
        let row = |at: usize| {
            let (ms, count) = (1_764_000_000_000_u64 + 20 * at as u64, 4 * at);
            let current = if at == 40 { String::new() } else { format!("0.{}", at % 7) };
            format!("{ms},4,{count},200,24.0,{current},{},{}\n", CODES[count % 6], u8::from(at == 40))
        };
        let text: String = std::iter::once(head.to_owned()).chain((0..100).map(row)).collect();
        let recording = read(&text, None).expect("valid");
        let last = recording.rows.last().expect("rows");
        assert_eq!((recording.rows.len(), last.cell, last.is_driven), (99, 396, true));
        assert!((last.t_s - 1.98).abs() < 1e-9, "{last:?}");
    }

    #[test]
    fn motor_that_was_not_recorded_is_refused() {
        let text = positions(|code| code);
        let error = read(&text, Some(MotorKind::Tip)).expect_err("refused").to_string();
        assert!(
            error.contains("no row of this motor") && error.contains("expected: motor 5 (tip)"),
            "{error}"
        );
    }

    #[test]
    fn bad_traces_are_refused_with_place_and_next_step() {
        let with = |line: usize, text: &str| {
            let mut lines = trace(500);
            lines[line] = text.to_owned();
            lines
        };
        let mut no_mode = with(3, "2,2,24.0,0.1,20.0,99,200");
        no_mode[0] = HEADER.replace("bridge_on", "mode");
        // MODE has no 1.
        no_mode.iter_mut().for_each(|line| *line = line.replace(",1,200", ",3,200"));
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
            (with(0, &HEADER.replace("bridge_on", "bridge")), "t.csv:1", "no column bridge_on"),
            (with(3, "2,2,NaN,0.1,20.0,1,200"), "t.csv:4", "bus_v: no number"),
            (with(3, "2,2,,0.1,20.0,1,200"), "t.csv:4", "bus_v: an empty cell"),
            (with(3, "2,2,24.0,0.1,20.0,2,200"), "t.csv:4", "bridge_on: neither"),
            (with(3, "2,2.5,24.0,0.1,20.0,1,200"), "t.csv:4", "halls_code: not whole"),
            (with(3, "2,300,24.0,0.1,20.0,1,200"), "t.csv:4", "halls_code: out of range"),
            (with(3, "2,2,24.0,0.1,20.0,1,"), "t.csv:4", "torque_per_1024: an empty cell"),
            (with(0, &HEADER.replace("torque_per_1024", "torque")), "t.csv:1", "no column torque_per_1024"),
            (no_mode, "t.csv:4", "mode: no mode"),
            (without_current, "t.csv", "bus_a never changes"),
            (too_hot, "t.csv:2", "thermistor_c: out of range"),
            (with(3, "2,2,24.0,1e300,20.0,1,200"), "t.csv:4", "bus_a: out of range"),
            (with(3, "2,2,24.0,0.1,20.0,1,9000"), "t.csv:4", "torque_per_1024: out of range"),
            (with(3, "1764000000000000,2,24.0,0.1,20.0,1,200"), "t.csv:4", "time_ms: times in another unit"),
            (with(3, "2,2,24.0,0.1"), "t.csv:4", "4 columns"),
            (with(3, "0,2,24.0,0.1,20.0,1,200"), "t.csv:4", "time_ms: does not rise"),
            (gap, "t.csv:51", "a gap of 21.0 ms"),
            (trace(50), "t.csv", "too short"),
            (vec![HEADER.to_owned()], "t.csv", "too short"),
            (still, "t.csv", "the motor did not move"),
        ] {
            let text = error(&lines);
            assert!(text.starts_with(place) && text.contains(problem), "{text}");
            assert!(text.contains("next:"), "{text}");
        }
    }
}
