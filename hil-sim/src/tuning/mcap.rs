//! Traces as MCAP files: a channel a motor, a JSON message a row, which viewers such as Foxglove plot without further help.
//!
//! A message's `log_time` is `time_ms`; its schema (JSON Schema) has the units. The metadata record `trace` holds the heading's facts;
//! `columns` holds what else brings the table back as it was: columns in order, digits, and the order of the facts. Not compressed:
//! both compressions of MCAP are C code.

use std::collections::BTreeMap;
use std::io::{Cursor, Write};

use mcap::records::{MessageHeader, Metadata};
use mcap::{McapError, MessageStream, Summary, WriteOptions};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::table::{Cell, Column, Heading, Kind, Sink, Source, TableError, check, text};
use super::traces::{MOTOR, TIME};

const TRACE: &str = "trace";
const COLUMNS: &str = "columns";

impl From<McapError> for TableError {
    fn from(error: McapError) -> Self {
        match error {
            McapError::Io(error) => Self::Io(error),
            other => Self::File(other.to_string()),
        }
    }
}

/// What the record `columns` says of one.
#[derive(Serialize, Deserialize)]
struct Described {
    name: String,
    unit: String,
    kind: String,
    nullable: bool,
    decimals: Option<u8>,
}

/// Writes a trace as MCAP. Keeps the whole file until it is finished: its index comes last, and its chunks are completed in place.
pub struct Writer<W: Write> {
    out: W,
    file: mcap::Writer<Cursor<Vec<u8>>>,
    heading: Heading,
    schema: u16,
    rows: u32,
}

impl<W: Write> Writer<W> {
    /// Begins a file.
    ///
    /// # Errors
    /// No column of the time, or those of the crate.
    pub fn new(out: W, heading: &Heading) -> Result<Self, TableError> {
        let options = WriteOptions::new().compression(None).library("hil-sim");
        let mut file = options.create(Cursor::new(Vec::new()))?;
        let schema =
            file.add_schema("hil_sim.Trace", "jsonschema", schema(heading).to_string().as_bytes())?;
        file.write_metadata(&Metadata {
            name: TRACE.to_owned(),
            metadata: heading.metadata.iter().cloned().collect(),
        })?;
        let columns: Vec<Described> = heading.columns.iter().map(describe).collect();
        let facts: Vec<&str> = heading.metadata.iter().map(|(key, _)| key.as_str()).collect();
        let own = [("columns", json!(columns)), ("facts", json!(facts))];
        let own = own.map(|(key, value)| (key.to_owned(), value.to_string()));
        file.write_metadata(&Metadata { name: COLUMNS.to_owned(), metadata: own.into() })?;
        Ok(Self { out, file, heading: heading.clone(), schema, rows: 0 })
    }
}

impl<W: Write> Sink for Writer<W> {
    fn row(&mut self, cells: &[Cell]) -> Result<(), TableError> {
        self.rows += 1;
        let row = u64::from(self.rows);
        check(&self.heading.columns, row, cells)?;
        let (mut time, mut topic, mut message) = (None, "/motor".to_owned(), String::from("{"));
        for (column, cell) in self.heading.columns.iter().zip(cells) {
            let written = match cell {
                Cell::Absent => "null".to_owned(),
                Cell::Text(value) => json!(value).to_string(),
                _ => text(column, cell),
            };
            let comma = if message.len() > 1 { "," } else { "" };
            message.push_str(&format!("{comma}{}:{written}", json!(column.name)));
            match (column.name.as_str(), cell) {
                (TIME, Cell::Int(ms)) => {
                    time = u64::try_from(*ms).ok().and_then(|ms| ms.checked_mul(1_000_000))
                }
                (TIME, Cell::Float(ms)) if *ms >= 0.0 => time = Some((ms * 1e6).round() as u64),
                (MOTOR, _) => topic = format!("/motor_{written}"),
                _ => {}
            }
        }
        message.push('}');
        let time = time.ok_or_else(|| TableError::place(row, TIME, "no time", "0 or more ms"))?;
        let channel = self.file.add_channel(self.schema, &topic, "json", &BTreeMap::new())?;
        let header =
            MessageHeader { channel_id: channel, sequence: self.rows, log_time: time, publish_time: time };
        Ok(self.file.write_to_known_channel(&header, message.as_bytes())?)
    }

    fn finish(&mut self) -> Result<(), TableError> {
        self.file.finish()?;
        let options = WriteOptions::new().compression(None);
        let done = std::mem::replace(&mut self.file, options.create(Cursor::new(Vec::new()))?);
        self.out.write_all(done.into_inner().get_ref())?;
        Ok(self.out.flush()?)
    }
}

fn schema(heading: &Heading) -> Value {
    let properties: serde_json::Map<String, Value> = heading
        .columns
        .iter()
        .map(|column| {
            let kind = match column.kind {
                Kind::Float => "number",
                Kind::Int => "integer",
                Kind::Text => "string",
            };
            (column.name.clone(), json!({ "type": kind, "description": column.unit }))
        })
        .collect();
    json!({ "type": "object", "properties": properties })
}

fn describe(column: &Column) -> Described {
    let kind = match column.kind {
        Kind::Float => "float",
        Kind::Int => "int",
        Kind::Text => "text",
    };
    let Column { name, unit, nullable, decimals, .. } = column.clone();
    Described { name, unit, kind: kind.to_owned(), nullable, decimals }
}

fn column(described: Described) -> Result<Column, TableError> {
    let Described { name, unit, kind, nullable, decimals } = described;
    let kind = match kind.as_str() {
        "float" => Kind::Float,
        "int" => Kind::Int,
        "text" => Kind::Text,
        _ => return Err(TableError::File(format!("column {name} is of the unknown kind {kind}"))),
    };
    Ok(Column { name, unit, kind, nullable, decimals })
}

/// Reads a trace that a [`Writer`] has written.
pub struct Reader {
    bytes: Vec<u8>,
    heading: Heading,
}

impl Reader {
    /// Reads the metadata.
    ///
    /// # Errors
    /// Bytes that are no whole MCAP file, or a file of another program.
    pub fn new(bytes: Vec<u8>) -> Result<Self, TableError> {
        let summary = Summary::read(&bytes)?;
        let indexes = summary.map(|summary| summary.metadata_indexes).unwrap_or_default();
        let record = |name: &str| {
            let index = indexes.iter().find(|index| index.name == name).ok_or_else(|| {
                TableError::File(format!("has no metadata record {name}: it is no trace of hil-sim"))
            })?;
            Ok::<_, TableError>(mcap::read::metadata(&bytes, index)?.metadata)
        };
        let (mut facts, own) = (record(TRACE)?, record(COLUMNS)?);
        let wrong = |error: serde_json::Error| TableError::File(format!("metadata {COLUMNS}: {error}"));
        let part = |key: &str| own.get(key).map_or("[]", String::as_str);
        let columns: Vec<Described> = serde_json::from_str(part("columns")).map_err(wrong)?;
        let order: Vec<String> = serde_json::from_str(part("facts")).map_err(wrong)?;
        let mut metadata: Vec<(String, String)> = Vec::new();
        for key in order {
            metadata.extend(facts.remove_entry(&key));
        }
        metadata.extend(facts);
        let columns = columns.into_iter().map(column).collect::<Result<Vec<_>, TableError>>()?;
        Ok(Self { heading: Heading { columns, metadata }, bytes })
    }
}

impl Source for Reader {
    fn heading(&self) -> &Heading {
        &self.heading
    }

    fn rows(&self, sink: &mut dyn FnMut(&[Cell]) -> Result<(), TableError>) -> Result<(), TableError> {
        for (index, message) in MessageStream::new(&self.bytes)?.enumerate() {
            let row = u64::try_from(index + 1).unwrap_or(u64::MAX);
            let fields: serde_json::Map<String, Value> = serde_json::from_slice(&message?.data)
                .map_err(|error| TableError::place(row, "", error.to_string(), "a JSON object"))?;
            let cells = self.heading.columns.iter().map(|column| {
                let value = fields.get(&column.name).unwrap_or(&Value::Null);
                let cell = match (column.kind, value) {
                    (_, Value::Null) => Some(Cell::Absent),
                    (Kind::Float, value) => value.as_f64().map(Cell::Float),
                    (Kind::Int, value) => value.as_i64().map(Cell::Int),
                    (Kind::Text, value) => value.as_str().map(Cell::from),
                };
                cell.ok_or_else(|| {
                    TableError::place(row, &column.name, value.to_string(), "a value of its kind")
                })
            });
            sink(&cells.collect::<Result<Vec<_>, TableError>>()?)?;
        }
        Ok(())
    }
}
