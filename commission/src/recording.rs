//! Records a live board by GETs in a cycle. Only GETs, and one SET: a board in its monitor is woken (STAT 2), as by any host.
//!
//! Where rows go, and when the recording ends, is the caller's.

use std::path::Path;

use tater_wire::property::Access;
use tater_wire::{Destination, Message, Node, Property};

use super::excite::{Failure, Link};
use traces::input::BadInput;
use traces::names::{RECORDED_BY, TIME, UNTRUSTED, unit};
use traces::numbers::bad;
use traces::table::{Cell, Column, Heading, Kind, Sink, TableError};

/// Time limit of an answer, µs: a board that erases a page (40 ms) answers after it.
const ANSWER_US: u64 = 100_000;

/// Time limit of a board that wakes, µs: its monitor reads the whole application first.
const WAKE_US: u64 = 5_000_000;

/// A board that answers nothing for this long is silent, µs: more than a reset and its monitor take.
const SILENCE_US: u64 = 2_000_000;

/// Time between two writes into the file, µs: what a kill loses at most.
const FLUSH_US: u64 = 1_000_000;

/// A column that the bus can give, its property, the property's units in one of the column, and its digits.
const COLUMNS: [(&str, Property, f64, u8); 12] = [
    ("mode", Property::MODE, 1.0, 0),
    ("position_estimated_counts", Property::P, 1.0, 0),
    ("velocity_estimated_counts_s", Property::VEL, 1.0, 0),
    ("velocity_setpoint_counts_s", Property::VSET, 1.0, 0),
    ("torque_per_1024", Property::T, 1.0, 0),
    ("bus_v", Property::VBUS, 10.0, 1),
    ("bus_a", Property::IMOTOR, 1000.0, 3),
    ("halls_code", Property::HALLS, 1.0, 0),
    ("thermistor_c", Property::THERM, 10.0, 1),
    ("strain", Property::SG, 1.0, 0),
    ("brake_released", Property::B, 1.0, 0),
    ("ERROR", Property::ERROR, 1.0, 0),
];

/// A recording of a board.
pub struct Recording<'a> {
    link: &'a mut dyn Link,
    /// How the user has named the link.
    place: &'a str,
    node: Node,
    /// Answers that were missing, or no value of their property.
    doubts: u64,
    /// Rows so far.
    pub rows: u64,
    /// Rows that had a missing or damaged answer.
    pub untrusted: u64,
}

impl<'a> Recording<'a> {
    /// With no row yet.
    pub fn new(link: &'a mut dyn Link, place: &'a str, node: Node) -> Self {
        Self { link, place, node, doubts: 0, rows: 0, untrusted: 0 }
    }

    /// What the link has not carried at the first attempt.
    pub fn remark(&self) -> Option<String> {
        self.link.remark()
    }

    /// Wakes the board, and reads all of its properties that can be read: gains, limits and versions. `program` is recorded as their reader.
    ///
    /// # Errors
    /// The board is silent, or speaks another hand's units; the link is lost.
    pub fn heading(&mut self, program: &str, progress: &mut dyn FnMut(&str)) -> Result<Heading, Failure> {
        self.wake(progress)?;
        Ok(Heading { columns: columns(), metadata: self.facts(program, progress)? })
    }

    /// Records for `us`, or until the user ends it. `flush` is called between rows once a second; `out` names the file in errors.
    ///
    /// # Errors
    /// The board has fallen silent, the link is lost, or the file cannot be written.
    pub fn record(
        &mut self,
        sink: &mut dyn Sink,
        flush: &mut dyn FnMut() -> Result<(), TableError>,
        out: &Path,
        us: Option<u64>,
    ) -> Result<(), Failure> {
        let begun_us = self.link.now_us();
        let (mut answered_us, mut flushed_us) = (begun_us, begun_us);
        let wrong = |error: TableError| bad(&out.display().to_string(), error);
        loop {
            let now_us = self.link.now_us();
            if self.link.is_interrupted() || us.is_some_and(|us| now_us - begun_us >= us) {
                return Ok(());
            }
            if now_us - flushed_us >= FLUSH_US {
                flush().map_err(wrong)?;
                flushed_us = now_us;
            }
            let (doubts, damaged) = (self.doubts, self.link.damaged());
            let mut row = vec![Cell::Float((now_us - begun_us) as f64 / 1000.0)];
            for (_, property, scale, decimals) in COLUMNS {
                let value = self.get(property)?;
                if value.is_some() {
                    answered_us = self.link.now_us();
                } else if self.link.now_us() - answered_us >= SILENCE_US {
                    let (rows, out) = (self.rows, out.display());
                    return Err(self
                        .silent(&format!("no answer for 2 s after {rows} rows, which {out} keeps"))
                        .into());
                }
                row.push(match decimals {
                    0 => value.into(),
                    // Integers of a property have 32 bits.
                    _ => value.map(|value| value as f64 / scale).into(),
                });
            }
            // A damaged line is mostly that of the answer that is missing.
            let untrusted = (self.doubts - doubts).max(self.link.damaged() - damaged);
            row.push(Cell::Int(i64::try_from(untrusted).unwrap_or(i64::MAX)));
            sink.row(&row).map_err(wrong)?;
            self.rows += 1;
            self.untrusted += u64::from(untrusted > 0);
        }
    }

    /// GETs a property; `None` without an answer in [`ANSWER_US`].
    fn get(&mut self, property: Property) -> Result<Option<i64>, Failure> {
        self.link.send(&Message::get(Destination::Node(self.node), property).frame())?;
        let until_us = self.link.now_us() + ANSWER_US;
        while let Some((_, frame)) = self.link.receive(until_us)? {
            match Message::parse(&frame).and_then(|message| message.answered()) {
                Some((from, of, Some(value))) if (from, of) == (self.node, property) => {
                    return Ok(Some(value));
                }
                Some((from, of, None)) if (from, of) == (self.node, property) => break,
                _ => {}
            }
        }
        self.doubts += 1;
        Ok(None)
    }

    /// Waits until the board's application runs.
    fn wake(&mut self, progress: &mut dyn FnMut(&str)) -> Result<(), Failure> {
        let until_us = self.link.now_us() + WAKE_US;
        let (mut stat, mut has_woken) = (None, false);
        while self.link.now_us() < until_us && !self.link.is_interrupted() {
            stat = self.get(Property::STAT)?.or(stat);
            match stat {
                Some(2) => return Ok(()),
                Some(0) if !has_woken => {
                    progress(&format!("node {} is in its monitor; it is woken", self.node.number()));
                    has_woken = true;
                    if let Some(set) = Message::set(Destination::Node(self.node), Property::STAT, 2) {
                        self.link.send(&set.frame())?;
                    }
                }
                _ => {}
            }
        }
        let found = match stat {
            _ if self.link.is_interrupted() => "^C before it answered".to_owned(),
            Some(stat) => format!("STAT {stat}, expected 2"),
            None => "no answer".to_owned(),
        };
        Err(self.silent(&found).into())
    }

    fn facts(
        &mut self,
        program: &str,
        progress: &mut dyn FnMut(&str),
    ) -> Result<Vec<(String, String)>, Failure> {
        let mut facts = vec![
            (RECORDED_BY.to_owned(), program.to_owned()),
            ("node".to_owned(), self.node.number().to_string()),
        ];
        let given = facts.len();
        for property in Property::ALL.iter().filter(|property| property.rules().access != Access::WriteOnly) {
            // The application starts after the monitor has acknowledged.
            let patience_us = if facts.len() == given { SILENCE_US } else { 2 * ANSWER_US };
            let until_us = self.link.now_us() + patience_us;
            let value = loop {
                let value = self.get(*property)?;
                if value.is_some() || self.link.now_us() >= until_us {
                    break value;
                }
            };
            match value {
                Some(units) if *property == Property::HOSTUNITS && units != 0 => {
                    return Err(self.foreign(units).into());
                }
                Some(value) => facts.push((property.row().name.to_owned(), value.to_string())),
                None if facts.len() == given => return Err(self.silent("no answer for 2 s").into()),
                None => {
                    progress(&format!(
                        "warning: no answer about {}: the metadata lacks it",
                        property.row().name
                    ));
                }
            }
        }
        Ok(facts)
    }

    fn silent(&self, found: &str) -> BadInput {
        BadInput::new(self.place, format!("node {} is silent", self.node.number()))
            .found(found)
            .expected("a board with its application running")
            .next("check --node, the board's power, and the cable and termination of the bus")
    }

    fn foreign(&self, units: i64) -> BadInput {
        BadInput::new(self.place, format!("node {} speaks another hand's units", self.node.number()))
            .found(format!("HOSTUNITS {units}"))
            .expected("HOSTUNITS 0")
            .next("SET HOSTUNITS (127) to 0, and set it again after the recording")
    }
}

fn columns() -> Vec<Column> {
    let time = Column::new(TIME, unit(TIME), Kind::Float).decimals(3);
    let others = COLUMNS.iter().map(|(name, _, _, decimals)| match decimals {
        0 => Column::new(*name, unit(name), Kind::Int).nullable(),
        decimals => Column::new(*name, unit(name), Kind::Float).nullable().decimals(*decimals),
    });
    let untrusted = Column::new(UNTRUSTED, unit(UNTRUSTED), Kind::Int);
    std::iter::once(time).chain(others).chain([untrusted]).collect()
}
