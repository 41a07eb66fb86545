//! Runs and recordings side by side: figures of each trace with their differences, and their curves on the same axes.
//!
//! The first one is what the others are compared with. A figure is taken from the rows of the trace alone, so that recordings of
//! other rates and columns have it as well; the metrics of a run (docs/metrics.md) are those that it has stored.

use serde_json::{Value, json};

use charts::{Chart, Column, Series, Sheet, escape};
use hil_experiment::metrics::METRICS;
use hil_experiment::properties::PROPERTIES;
use traces::names::{MOTOR, TIME};
use traces::table::{Cell, Source, TableError};

/// Most inputs: as many as there are colors.
pub const MOST: usize = 8;

/// One motor's columns.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Track {
    /// Its node; none in a trace without that column.
    pub node: Option<i64>,
    columns: Vec<(String, Vec<f64>)>,
}

impl Track {
    /// A column, absent numbers as NaN; empty if there is none of that name.
    fn column(&self, name: &str) -> &[f64] {
        self.columns.iter().find(|(own, _)| own == name).map_or(&[], |(_, values)| values)
    }

    fn has(&self, name: &str) -> bool {
        self.column(name).iter().any(|value| value.is_finite())
    }

    /// The first of these columns that has numbers.
    fn first_of(&self, names: &[&'static str]) -> Option<&'static str> {
        names.iter().copied().find(|name| self.has(name))
    }

    /// A column in the plant's counts, so that HI causes no jump.
    fn in_plant(&self, name: &str) -> Vec<f64> {
        let zero = self.column("zero_counts");
        let zeros = zero.iter().copied().chain(std::iter::repeat(0.0));
        self.column(name).iter().zip(zeros).map(|(counts, zero)| counts + zero).collect()
    }

    fn position(&self) -> Option<Vec<f64>> {
        match self.first_of(&["position_counts", "position_estimated_counts"])? {
            "position_counts" => Some(self.column("position_counts").to_vec()),
            estimated => Some(self.in_plant(estimated)),
        }
    }

    /// The position set-point of modes 3 and 5, which alone have one.
    fn setpoint(&self) -> Option<Vec<f64>> {
        if !self.has("setpoint_counts") || !self.has("mode") {
            return None;
        }
        let goals = self.in_plant("setpoint_counts").into_iter().zip(self.column("mode"));
        Some(goals.map(|(goal, mode)| if [3.0, 5.0].contains(mode) { goal } else { f64::NAN }).collect())
    }

    fn lag(&self) -> Option<Vec<f64>> {
        let (goals, position) = (self.setpoint()?, self.position()?);
        Some(goals.iter().zip(position).map(|(goal, is)| goal - is).collect())
    }
}

/// An input.
#[derive(Clone, Debug)]
pub struct Recording {
    /// In tables and legends.
    pub name: String,
    /// Where it comes from.
    pub place: String,
    /// Its motors.
    pub tracks: Vec<Track>,
    /// What a run has stored of itself (`run.json`); null for others.
    pub run: Value,
    /// Facts of the trace's head, such as a recorded board's properties.
    pub facts: Vec<(String, String)>,
}

/// Reads all rows of a trace that was checked, by motor.
///
/// # Errors
/// A damaged file, or no row.
pub fn tracks(source: &dyn Source) -> Result<Vec<Track>, TableError> {
    let names: Vec<String> = source.heading().columns.iter().map(|column| column.name.clone()).collect();
    let motor = names.iter().position(|name| name == MOTOR);
    let mut tracks: Vec<Track> = Vec::new();
    let mut index = 0;
    source.rows(&mut |row| {
        index += 1;
        // Programs with one type for all numbers write 4.0.
        let node = match motor.and_then(|at| row.get(at)) {
            None | Some(Cell::Absent) => None,
            Some(cell) => match cell.number().filter(|node| node.fract() == 0.0) {
                Some(node) => Some(node as i64),
                None => {
                    let found = format!("{cell:?}");
                    return Err(TableError::place(source.line(index), MOTOR, found, "the number of a node"));
                }
            },
        };
        let at = tracks.iter().position(|track| track.node == node).unwrap_or_else(|| {
            let columns = names.iter().map(|name| (name.clone(), Vec::new())).collect();
            tracks.push(Track { node, columns });
            tracks.len() - 1
        });
        let Some(track) = tracks.get_mut(at) else { return Ok(()) };
        for ((_, values), cell) in track.columns.iter_mut().zip(row) {
            values.push(cell.number().unwrap_or(f64::NAN));
        }
        Ok(())
    })?;
    if tracks.is_empty() {
        return Err(TableError::File("has no rows".to_owned()));
    }
    Ok(tracks)
}

/// A figure of a trace.
struct Figure {
    name: &'static str,
    unit: &'static str,
    of: fn(&Track) -> Option<f64>,
}

fn finite(values: &[f64]) -> impl Iterator<Item = f64> {
    values.iter().copied().filter(|value| value.is_finite())
}

fn largest(values: impl Iterator<Item = f64>) -> Option<f64> {
    values.reduce(f64::max)
}

fn rms(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, number) = values.fold((0.0, 0.0), |(sum, number), value| (sum + value * value, number + 1.0));
    (number > 0.0).then(|| f64::sqrt(sum / number))
}

fn peak(track: &Track, name: &str) -> Option<f64> {
    largest(finite(track.column(name)).map(f64::abs))
}

/// The lag while a trapezoid is followed, as `tracking_rms_counts` has it.
fn tracking(track: &Track) -> Option<Vec<f64>> {
    let lag = track.lag()?;
    Some(
        lag.iter().zip(track.column("mode")).filter(|(_, mode)| **mode == 5.0).map(|(lag, _)| *lag).collect(),
    )
}

const SPEEDS: [&str; 2] = ["velocity_counts_s", "velocity_estimated_counts_s"];

const FIGURES: [Figure; 13] = [
    Figure {
        name: "duration",
        unit: "ms",
        of: |track| Some(track.column(TIME).last()? - track.column(TIME).first()?),
    },
    Figure {
        name: "travel",
        unit: "counts",
        of: |track| {
            let position = track.position()?;
            Some(largest(finite(&position))? - finite(&position).reduce(f64::min)?)
        },
    },
    Figure { name: "final position", unit: "counts", of: |track| finite(&track.position()?).last() },
    Figure { name: "lag, RMS in mode 5", unit: "counts", of: |track| rms(finite(&tracking(track)?)) },
    Figure {
        name: "lag, peak in mode 5",
        unit: "counts",
        of: |track| largest(finite(&tracking(track)?).map(f64::abs)),
    },
    Figure { name: "peak speed", unit: "counts/s", of: |track| peak(track, track.first_of(&SPEEDS)?) },
    Figure { name: "peak torque", unit: "1/1024", of: |track| peak(track, "torque_per_1024") },
    Figure { name: "torque, RMS", unit: "1/1024", of: |track| rms(finite(track.column("torque_per_1024"))) },
    Figure {
        name: "torque change a row, RMS",
        unit: "1/1024",
        of: |track| {
            let steps = track.column("torque_per_1024").windows(2).map(|pair| pair[1] - pair[0]);
            rms(steps.filter(|step| step.is_finite()))
        },
    },
    Figure {
        name: "peak phase current",
        unit: "A",
        of: |track| {
            largest(["phase_a_a", "phase_b_a", "phase_c_a"].iter().filter_map(|name| peak(track, name)))
        },
    },
    Figure { name: "peak bus current", unit: "A", of: |track| peak(track, "bus_a") },
    Figure {
        name: "least bus voltage",
        unit: "V",
        of: |track| finite(track.column("bus_v")).reduce(f64::min),
    },
    Figure { name: "peak winding", unit: "°C", of: |track| largest(finite(track.column("winding_c"))) },
];

/// A row of a table: what, its unit, and the value of each input.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// What.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// One for each input.
    pub values: Vec<Option<f64>>,
}

impl Row {
    /// The differences to the first value.
    #[must_use]
    pub fn differences(&self) -> Vec<Option<f64>> {
        let first = self.values.first().copied().flatten();
        self.values.iter().map(|value| Some((*value)? - first?)).collect()
    }

    fn json(&self) -> Value {
        json!({ "name": self.name, "unit": self.unit, "values": self.values, "differences": self.differences() })
    }

    /// Cells: the first value, then each value with its difference.
    #[must_use]
    pub fn cells(&self) -> Vec<String> {
        let number = |value: &Option<f64>| value.map_or_else(|| "–".to_owned(), short);
        let differences = self.differences();
        let cells =
            self.values.iter().zip(differences).enumerate().map(
                |(at, (value, difference))| match difference {
                    Some(difference) if at > 0 => {
                        let sign = if difference < 0.0 { "−" } else { "+" };
                        let own = format!("{} ({sign}{})", number(value), short(difference.abs()));
                        if difference == 0.0 { format!("{} (=)", number(value)) } else { own }
                    }
                    _ => number(value),
                },
            );
        cells.collect()
    }
}

/// Three digits after the point, none of a whole number, four significant ones of a small one.
fn short(value: f64) -> String {
    match value.abs() {
        _ if value == value.trunc() => format!("{value:.0}"),
        size if size < 0.01 => format!("{value:.5}"),
        size if size < 1000.0 => format!("{value:.3}"),
        _ => format!("{value:.1}"),
    }
}

/// One motor of all inputs.
#[derive(Clone, Debug)]
pub struct Group {
    /// Its name; empty if there is only one.
    pub motor: String,
    /// Its track in each input.
    tracks: Vec<Option<Track>>,
    /// Figures of the traces.
    pub figures: Vec<Row>,
    /// Metrics that the runs have stored; those that none has are left out.
    pub metrics: Vec<Row>,
    /// Metrics that are words, of each input.
    pub words: Vec<(String, Vec<String>)>,
    /// Properties that differ.
    pub properties: Vec<Row>,
}

/// What inputs have in common and where they differ.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// The inputs, the first is compared with.
    pub inputs: Vec<Recording>,
    /// By motor.
    pub groups: Vec<Group>,
    /// What is missing or doubtful, one line each.
    pub notes: Vec<String>,
}

/// Compares recordings.
#[must_use]
pub fn compare(inputs: Vec<Recording>) -> Comparison {
    let mut notes = Vec::new();
    let mut nodes: Vec<Option<i64>> = Vec::new();
    let is_single = inputs.iter().all(|input| input.tracks.len() == 1);
    if is_single {
        nodes.push(None);
        let mut found: Vec<i64> = inputs.iter().filter_map(|input| node(input, &input.tracks[0])).collect();
        found.dedup();
        if found.len() > 1 {
            notes.push("the inputs are of different motors".to_owned());
        }
    } else {
        for input in &inputs {
            nodes.extend(input.tracks.iter().map(|track| node(input, track)));
        }
        nodes.sort_unstable();
        nodes.dedup();
    }
    let groups: Vec<Group> = nodes
        .into_iter()
        .map(|wanted| {
            let of = |input: &Recording| {
                let track = input.tracks.iter().find(|track| is_single || node(input, track) == wanted);
                track.cloned()
            };
            let motor = match (wanted, is_single) {
                (_, true) => String::new(),
                (Some(node), false) => format!("motor {node}"),
                (None, false) => "motor without a number".to_owned(),
            };
            group(motor, &inputs, inputs.iter().map(of).collect())
        })
        .collect();
    for input in &inputs {
        missing(input, &mut notes);
    }
    for group in &groups {
        for (input, track) in inputs.iter().zip(&group.tracks) {
            if track.is_none() {
                notes.push(format!("{} has no {}", input.name, group.motor));
            }
        }
    }
    Comparison { inputs, groups, notes }
}

/// The node of a track: its own, or that of the only motor of a run.
fn node(input: &Recording, track: &Track) -> Option<i64> {
    let stored = input.run["motors"].as_array().filter(|motors| motors.len() == 1);
    track.node.or_else(|| stored?.first()?["node"].as_i64())
}

/// Says what an input lacks.
fn missing(input: &Recording, notes: &mut Vec<String>) {
    let lacks: Vec<&str> = CURVES
        .iter()
        .filter(|curve| input.tracks.iter().all(|track| (curve.of)(track).is_none()))
        .map(|curve| curve.title)
        .collect();
    if !lacks.is_empty() {
        notes.push(format!("{} has no columns for: {}", input.name, lacks.join(", ")));
    }
    let estimated = |track: &Track| !track.has("position_counts") && track.has("position_estimated_counts");
    if input.tracks.iter().any(estimated) {
        notes.push(format!("{}: position and velocity are the board's estimates", input.name));
    }
    if input.run.is_null() {
        notes.push(format!(
            "{} has no run.json: its metrics are unknown, its figures are of the trace",
            input.name
        ));
    }
}

fn group(motor: String, inputs: &[Recording], tracks: Vec<Option<Track>>) -> Group {
    let figures = FIGURES.iter().map(|figure| Row {
        name: figure.name.to_owned(),
        unit: figure.unit.to_owned(),
        values: tracks.iter().map(|track| (figure.of)(track.as_ref()?)).collect(),
    });
    let stored: Vec<&Value> = inputs
        .iter()
        .zip(&tracks)
        .map(|(input, track)| {
            let node = track.as_ref().and_then(|track| node(input, track));
            let motors = input.run["motors"].as_array();
            let own = motors.and_then(|motors| motors.iter().find(|motor| motor["node"].as_i64() == node));
            own.unwrap_or(&Value::Null)
        })
        .collect();
    let row = |name: &str, unit: &str, of: &dyn Fn(&Value) -> Option<f64>| Row {
        name: name.to_owned(),
        unit: unit.to_owned(),
        values: stored.iter().map(|motor| of(motor)).collect(),
    };
    let metrics = METRICS
        .iter()
        .filter(|metric| !metric.is_word())
        .map(|metric| row(metric.name, metric.unit(), &|motor| motor["metrics"][metric.name].as_f64()));
    let words = METRICS.iter().filter(|metric| metric.is_word()).map(|metric| {
        let word = |motor: &&Value| motor["metrics"][metric.name].as_str().unwrap_or("–").to_owned();
        (metric.name.to_owned(), stored.iter().map(word).collect::<Vec<String>>())
    });
    let is_any = |row: &Row| row.values.iter().any(Option::is_some);
    let properties = PROPERTIES.iter().map(|property| {
        let name = property.name;
        let mut own = row(name, property.property.row().unit, &|motor| motor["properties"][name].as_f64());
        for (value, input) in own.values.iter_mut().zip(inputs) {
            let fact = input.facts.iter().find(|(key, _)| key == name);
            *value = value.or_else(|| fact?.1.parse().ok());
        }
        own
    });
    let differs = |row: &Row| row.differences().iter().flatten().any(|difference| *difference != 0.0);
    Group {
        motor,
        figures: figures.filter(is_any).collect(),
        metrics: metrics.filter(is_any).collect(),
        words: words.filter(|(_, words)| words.iter().any(|word| word != "–")).collect(),
        properties: properties.filter(differs).collect(),
        tracks,
    }
}

struct Curve {
    title: &'static str,
    unit: &'static str,
    height: f64,
    least_span: f64,
    of: fn(&Track) -> Option<Vec<f64>>,
}

fn plain(track: &Track, names: &[&'static str]) -> Option<Vec<f64>> {
    track.first_of(names).map(|name| track.column(name).to_vec())
}

const CURVES: [Curve; 8] = [
    Curve { title: "Position", unit: "hall counts", height: 300.0, least_span: 4.0, of: Track::position },
    Curve {
        title: "Lag",
        unit: "hall counts, set-point − rotor",
        height: 180.0,
        least_span: 2.0,
        of: Track::lag,
    },
    Curve {
        title: "Velocity",
        unit: "hall counts / s",
        height: 240.0,
        least_span: 20.0,
        of: |track| plain(track, &SPEEDS),
    },
    Curve {
        title: "Torque",
        unit: "1/1024 of peak",
        height: 200.0,
        least_span: 100.0,
        of: |track| plain(track, &["torque_per_1024"]),
    },
    Curve {
        title: "Duty",
        unit: "% of bus voltage",
        height: 180.0,
        least_span: 20.0,
        of: |track| plain(track, &["duty_percent"]),
    },
    Curve {
        title: "Bus current",
        unit: "A",
        height: 180.0,
        least_span: 1.0,
        of: |track| plain(track, &["bus_a"]),
    },
    Curve {
        title: "Bus voltage",
        unit: "V",
        height: 150.0,
        least_span: 2.0,
        of: |track| plain(track, &["bus_v"]),
    },
    Curve {
        title: "Temperature",
        unit: "°C, winding or thermistor",
        height: 150.0,
        least_span: 5.0,
        of: |track| plain(track, &["winding_c", "thermistor_c"]),
    },
];

impl Comparison {
    /// As one JSON object.
    #[must_use]
    pub fn json(&self) -> Value {
        let inputs = self.inputs.iter().map(|input| {
            let rows: usize = input.tracks.iter().map(|track| track.column(TIME).len()).sum();
            json!({
                "name": input.name, "place": input.place, "rows": rows, "motors": input.tracks.len(),
                "reproduce": input.run["reproduce"], "commit": input.run["commit"],
            })
        });
        let groups = self.groups.iter().map(|group| {
            let rows = |rows: &[Row]| rows.iter().map(Row::json).collect::<Vec<_>>();
            let words = group.words.iter().map(|(name, words)| json!({ "name": name, "values": words }));
            json!({
                "motor": group.motor, "figures": rows(&group.figures), "metrics": rows(&group.metrics),
                "words": words.collect::<Vec<_>>(), "properties": rows(&group.properties),
            })
        });
        json!({
            "inputs": inputs.collect::<Vec<_>>(), "groups": groups.collect::<Vec<_>>(), "notes": self.notes,
        })
    }

    /// The page: tables of differences, and curves on the same axes.
    #[must_use]
    pub fn html(&self) -> String {
        let names: Vec<&str> = self.inputs.iter().map(|input| input.name.as_str()).collect();
        let title = names.join(" · ");
        let mut sheet = Sheet::new(&title);
        sheet.push(&format!("<header><h1>{}</h1>\n", escape(&title)));
        for (number, input) in (1..).zip(&self.inputs) {
            let how = input.run["reproduce"].as_str().unwrap_or(&input.place);
            let commit = input.run["commit"]
                .as_str()
                .map_or_else(String::new, |commit| format!(" at commit {commit}"));
            sheet.push(&format!(
                "<p><span class=\"key c{number}\"></span>{}: <code>{}</code>{}</p>\n",
                escape(&input.name),
                escape(how),
                escape(&commit)
            ));
        }
        sheet.push("</header>\n");
        for note in &self.notes {
            sheet.push(&format!("<p class=\"note\">{}</p>\n", escape(note)));
        }
        sheet.help();
        for group in &self.groups {
            if !group.motor.is_empty() {
                sheet.push(&format!("<h2>{}</h2>\n", escape(&group.motor)));
            }
            self.curves(&mut sheet, group);
            self.tables(&mut sheet, group);
        }
        sheet.finish()
    }

    fn curves(&self, sheet: &mut Sheet, group: &Group) {
        let times: Vec<Option<Column>> = group
            .tracks
            .iter()
            .map(|track| Some(sheet.column(track.as_ref()?.column(TIME).to_vec(), None)))
            .collect();
        for curve in &CURVES {
            let mut chart = Chart::new(curve.title, curve.unit, "ms");
            (chart.height, chart.least_span) = (curve.height, curve.least_span);
            chart.x.group = Some("time".to_owned());
            let all = self.inputs.iter().zip(&group.tracks).zip(&times).zip(1..);
            for (((input, track), time), number) in all {
                let (Some(track), Some(time)) = (track, *time) else { continue };
                if let Some(goals) = track.setpoint().filter(|_| curve.title == "Position") {
                    let goals = sheet.column(goals, Some(3));
                    let name = format!("{} set-point", input.name);
                    let series = Series::line(&name, &format!("c{number} thin dashed"), time, goals);
                    chart.series.push(series);
                }
                if let Some(values) = (curve.of)(track) {
                    let values = sheet.column(values, Some(3));
                    let series = Series::line(&input.name, &format!("c{number}"), time, values);
                    chart.series.push(Series { key: Some(input.name.clone()), ..series });
                }
            }
            if !chart.series.is_empty() {
                sheet.chart(&chart);
            }
        }
    }

    fn tables(&self, sheet: &mut Sheet, group: &Group) {
        let mut head = vec!["", "unit"];
        head.extend(self.inputs.iter().map(|input| input.name.as_str()));
        let base = self.inputs.first().map_or("", |input| input.name.as_str());
        let parts = [
            ("Properties that differ", &group.properties),
            ("Figures of the traces", &group.figures),
            ("Metrics of the runs", &group.metrics),
        ];
        for (title, rows) in parts {
            if rows.is_empty() {
                continue;
            }
            let mut cells: Vec<Vec<String>> = rows
                .iter()
                .map(|row| [vec![row.name.clone(), row.unit.clone()], row.cells()].concat())
                .collect();
            if std::ptr::eq(rows, &raw const group.metrics) {
                cells.extend(
                    group
                        .words
                        .iter()
                        .map(|(name, words)| [vec![name.clone(), String::new()], words.clone()].concat()),
                );
            }
            sheet.push(&format!(
                "<h3>{title}</h3>\n<p class=\"note\">In brackets: the difference to {}.</p>\n",
                escape(base)
            ));
            sheet.table(&head, &cells, 2);
        }
    }
}
