//! Traces as MCAP files: a channel a motor, a JSON message a row, which viewers such as Foxglove plot without further help.
//!
//! A message's `log_time` is `time_ms`; its schema (JSON Schema) has the units. The metadata record `trace` holds the heading's facts;
//! `columns` holds what else brings the table back as it was: columns in order, digits, and the order of the facts. Not compressed:
//! both compressions of MCAP are C code.

use std::collections::BTreeMap;
use std::io::{Cursor, Seek, Write};

use mcap::read::LinearReader;
use mcap::records::{MessageHeader, Metadata, Record};
use mcap::sans_io::{self, LinearReadEvent, LinearReaderOptions};
use mcap::write::NoSeek;
use mcap::{McapError, MessageStream, Summary, WriteOptions};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::names::{MOTOR, TIME};
use super::table::{Cell, Column, Heading, Kind, Sink, Source, TableError, check, text};

const TRACE: &str = "trace";
const COLUMNS: &str = "columns";

/// Key of the record `columns` of a file that is written row by row: without its end it is as long as its last whole row.
const APPENDED: &str = "appended";

impl From<McapError> for TableError {
    fn from(error: McapError) -> Self {
        match error {
            McapError::Io(error) => Self::Io(error),
            McapError::UnsupportedCompression(found) => Self::input(
                None,
                "the file has a compression that is not read",
                found,
                "chunks that are not compressed",
                "unpack it: mcap decompress IN -o OUT",
            ),
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

/// The rows of a trace as messages.
struct Messages<W: Write + Seek> {
    file: mcap::Writer<W>,
    heading: Heading,
    schema: u16,
    rows: u64,
}

impl<W: Write + Seek> Messages<W> {
    fn new(mut file: mcap::Writer<W>, heading: &Heading, is_appended: bool) -> Result<Self, TableError> {
        let schema =
            file.add_schema("hil_sim.Trace", "jsonschema", schema(heading).to_string().as_bytes())?;
        file.write_metadata(&Metadata {
            name: TRACE.to_owned(),
            metadata: heading.metadata.iter().cloned().collect(),
        })?;
        let columns: Vec<Described> = heading.columns.iter().map(describe).collect();
        let facts: Vec<&str> = heading.metadata.iter().map(|(key, _)| key.as_str()).collect();
        let own = [("columns", json!(columns)), ("facts", json!(facts)), (APPENDED, json!(is_appended))];
        // Only a log says so.
        let own = own.into_iter().filter(|(key, _)| is_appended || *key != APPENDED);
        let own = own.map(|(key, value)| (key.to_owned(), value.to_string())).collect();
        file.write_metadata(&Metadata { name: COLUMNS.to_owned(), metadata: own })?;
        Ok(Self { file, heading: heading.clone(), schema, rows: 0 })
    }

    fn row(&mut self, cells: &[Cell]) -> Result<(), TableError> {
        self.rows += 1;
        let row = self.rows;
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
        // A table without time, such as a frequency response: a millisecond a row.
        let has_time = self.heading.columns.iter().any(|column| column.name == TIME);
        let time = if has_time { time } else { row.checked_mul(1_000_000) };
        let time = time.ok_or_else(|| TableError::place(row, TIME, "no time", "0 or more ms"))?;
        let channel = self.file.add_channel(self.schema, &topic, "json", &BTreeMap::new())?;
        // The number wraps after years of a recording.
        let sequence = row as u32;
        let header = MessageHeader { channel_id: channel, sequence, log_time: time, publish_time: time };
        Ok(self.file.write_to_known_channel(&header, message.as_bytes())?)
    }
}

/// Writes a trace as MCAP. Keeps the whole file until it is finished: its index comes last, and its chunks are completed in place.
pub struct Writer<W: Write> {
    out: W,
    messages: Messages<Cursor<Vec<u8>>>,
}

impl<W: Write> Writer<W> {
    /// Begins a file.
    ///
    /// # Errors
    /// No column of the time, or those of the crate.
    pub fn new(out: W, heading: &Heading) -> Result<Self, TableError> {
        let options = WriteOptions::new().compression(None).library("hil-sim");
        let file = options.create(Cursor::new(Vec::new()))?;
        Ok(Self { out, messages: Messages::new(file, heading, false)? })
    }
}

impl<W: Write> Sink for Writer<W> {
    fn row(&mut self, cells: &[Cell]) -> Result<(), TableError> {
        self.messages.row(cells)
    }

    fn finish(&mut self) -> Result<(), TableError> {
        let file = &mut self.messages.file;
        file.finish()?;
        let options = WriteOptions::new().compression(None);
        let done = std::mem::replace(file, options.create(Cursor::new(Vec::new()))?);
        self.out.write_all(done.into_inner().get_ref())?;
        Ok(self.out.flush()?)
    }
}

/// Writes a trace as MCAP without keeping any of it: each row is a record of its own, neither in a chunk nor in an index, so that a file without its
/// end has whole rows, which [`Reader`] and `mcap recover` read.
pub struct Appender<W: Write> {
    messages: Messages<NoSeek<W>>,
}

impl<W: Write> Appender<W> {
    /// Begins a file.
    ///
    /// # Errors
    /// Those of [`Writer::new`].
    pub fn new(out: W, heading: &Heading) -> Result<Self, TableError> {
        let options =
            WriteOptions::new().compression(None).library("hil-sim").use_chunks(false).disable_seeking(true);
        Ok(Self { messages: Messages::new(options.create(NoSeek::new(out))?, heading, true)? })
    }
}

impl<W: Write> Sink for Appender<W> {
    fn row(&mut self, cells: &[Cell]) -> Result<(), TableError> {
        self.messages.row(cells)
    }

    fn finish(&mut self) -> Result<(), TableError> {
        self.messages.file.finish()?;
        Ok(())
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

/// Reads a trace that a [`Writer`] or an [`Appender`] has written.
pub struct Reader {
    bytes: Vec<u8>,
    heading: Heading,
    /// Whether the rows are read one by one up to the last whole one.
    is_appended: bool,
    notes: Vec<String>,
}

/// The records of a file up to the first that is not whole.
fn records(bytes: &[u8]) -> impl Iterator<Item = Record<'_>> {
    LinearReader::sans_magic(bytes.strip_prefix(mcap::MAGIC).unwrap_or_default()).map_while(Result::ok)
}

/// Whether a file has its end; the sums of its parts are compared as far as it goes. A log that was cut off has none.
fn has_end(bytes: &[u8]) -> Result<bool, TableError> {
    let options = LinearReaderOptions::default()
        .with_validate_chunk_crcs(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true)
        .with_record_length_limit(bytes.len());
    let mut reader = sans_io::LinearReader::new_with_options(options);
    let mut rest = bytes;
    while let Some(event) = reader.next_event() {
        match event {
            Ok(LinearReadEvent::ReadRequest(size)) => {
                let (given, left) = rest.split_at(size.min(rest.len()));
                reader.insert(given.len()).copy_from_slice(given);
                reader.notify_read(given.len());
                rest = left;
            }
            Ok(LinearReadEvent::Record { .. }) => {}
            Err(
                error @ (McapError::BadChunkCrc { .. }
                | McapError::BadDataCrc { .. }
                | McapError::BadSummaryCrc { .. }),
            ) => {
                return Err(TableError::input(
                    None,
                    "the file is damaged",
                    error.to_string(),
                    "the bytes that were written",
                    "copy it again from where it was recorded, or record it again",
                ));
            }
            Err(_) => return Ok(false),
        }
    }
    Ok(true)
}

/// A metadata record of a file that is written row by row.
fn appended(bytes: &[u8], name: &str) -> Option<BTreeMap<String, String>> {
    // They come before the first row.
    let before = records(bytes).take_while(|record| !matches!(record, Record::Message { .. }));
    let mut all = before.filter_map(|record| match record {
        Record::Metadata(metadata) => Some(metadata),
        _ => None,
    });
    all.find(|metadata| metadata.name == name).map(|metadata| metadata.metadata)
}

impl Reader {
    /// Reads the metadata.
    ///
    /// # Errors
    /// Bytes that are no whole MCAP file, or a file of another program. A log may lack its end.
    pub fn new(bytes: Vec<u8>) -> Result<Self, TableError> {
        let has_end = has_end(&bytes)?;
        let is_appended = appended(&bytes, COLUMNS).is_some_and(|columns| columns.contains_key(APPENDED));
        let summary = if is_appended { None } else { Summary::read(&bytes)? };
        let indexes = summary.map(|summary| summary.metadata_indexes).unwrap_or_default();
        let record = |name: &str| {
            let none = || {
                TableError::input(
                    None,
                    "the file is no trace of hil-sim",
                    format!("no metadata record {name}"),
                    "the layout of docs/traces.md, as of `hil-sim log` and `convert`",
                    "write its messages as CSV, with the columns of docs/traces.md",
                )
            };
            if is_appended {
                return appended(&bytes, name).ok_or_else(none);
            }
            let index = indexes.iter().find(|index| index.name == name).ok_or_else(none)?;
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
        let note = "the recording breaks off; its rows are read up to there".to_owned();
        let notes = if has_end { Vec::new() } else { vec![note] };
        Ok(Self { heading: Heading { columns, metadata }, bytes, is_appended, notes })
    }
}

impl Source for Reader {
    fn heading(&self) -> &Heading {
        &self.heading
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }

    fn rows(&self, sink: &mut dyn FnMut(&[Cell]) -> Result<(), TableError>) -> Result<(), TableError> {
        if self.is_appended {
            let data = records(&self.bytes).filter_map(|record| match record {
                Record::Message { data, .. } => Some(data),
                _ => None,
            });
            return (1..).zip(data).try_for_each(|(row, data)| self.give(row, &data, sink));
        }
        for (index, message) in MessageStream::new(&self.bytes)?.enumerate() {
            self.give(
                u64::try_from(index + 1).unwrap_or(u64::MAX),
                &message.map_err(|error| TableError::from(error).of_memory())?.data,
                sink,
            )?;
        }
        Ok(())
    }
}

impl Reader {
    fn give(
        &self,
        row: u64,
        data: &[u8],
        sink: &mut dyn FnMut(&[Cell]) -> Result<(), TableError>,
    ) -> Result<(), TableError> {
        let fields: serde_json::Map<String, Value> = serde_json::from_slice(data)
            .map_err(|error| TableError::place(row, "", error.to_string(), "a JSON object"))?;
        let cells = self.heading.columns.iter().map(|column| {
            let value = fields.get(&column.name).unwrap_or(&Value::Null);
            let cell = match (column.kind, value) {
                (_, Value::Null) => Some(Cell::Absent),
                (Kind::Float, value) => value.as_f64().map(Cell::Float),
                (Kind::Int, value) => value.as_i64().map(Cell::Int),
                (Kind::Text, value) => value.as_str().map(Cell::from),
            };
            cell.ok_or_else(|| TableError::place(row, &column.name, value.to_string(), "a value of its kind"))
        });
        sink(&cells.collect::<Result<Vec<_>, TableError>>()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::tests::cells;

    fn heading() -> Heading {
        let columns = vec![Column::new(TIME, "ms", Kind::Float), Column::new("bus_v", "V", Kind::Float)];
        Heading { columns, ..Heading::default() }
    }

    fn rows(sink: &mut dyn Sink) {
        for ms in 0..9 {
            sink.row(&[Cell::Float(ms.into()), Cell::Float(24.5)]).expect("a row");
        }
        sink.finish().expect("memory");
    }

    fn appended() -> Vec<u8> {
        let mut bytes = Vec::new();
        rows(&mut Appender::new(&mut bytes, &heading()).expect("a file"));
        bytes
    }

    fn whole() -> Vec<u8> {
        let mut out = Cursor::new(Vec::new());
        rows(&mut Writer::new(&mut out, &heading()).expect("a file"));
        out.into_inner()
    }

    /// The file with another digit in its last 24.5.
    fn damaged(mut bytes: Vec<u8>) -> Vec<u8> {
        let at = bytes.windows(4).rposition(|part| part == b"24.5").expect("a row");
        bytes[at] = b'9';
        bytes
    }

    #[test]
    fn damaged_row_is_refused() {
        for bytes in [appended(), whole()] {
            let reader = Reader::new(bytes.clone()).expect("as written");
            assert_eq!(reader.notes(), &[] as &[String]);
            let error =
                Reader::new(damaged(bytes)).err().map(|error| format!("{error:?}")).expect("an error");
            assert!(error.contains("the file is damaged"), "{error}");
        }
    }

    /// Writes a table both ways, and reads each.
    fn written(heading: &Heading, rows: &[Vec<Cell>]) -> Result<[Vec<u8>; 2], TableError> {
        let (mut whole, mut grown) = (Vec::new(), Vec::new());
        let mut sinks: [Box<dyn Sink>; 2] =
            [Box::new(Writer::new(&mut whole, heading)?), Box::new(Appender::new(&mut grown, heading)?)];
        for sink in &mut sinks {
            rows.iter().try_for_each(|row| sink.row(row))?;
            sink.finish()?;
        }
        drop(sinks);
        Ok([whole, grown])
    }

    #[test]
    fn table_reads_back_as_written() {
        let columns = vec![
            Column::new(TIME, "ms", Kind::Int),
            Column::new(MOTOR, "", Kind::Int),
            Column::new("bus_v", "V", Kind::Float).decimals(2),
            Column::new("end", "", Kind::Text).nullable(),
        ];
        let metadata = [("seed", "7"), ("commit", "abc"), ("about", "a \"move\", µ")];
        let metadata = metadata.map(|(key, value)| (key.to_owned(), value.to_owned())).into();
        let heading = Heading { columns, metadata };
        let rows = [
            vec![Cell::Int(0), Cell::Int(5), Cell::Float(24.5), Cell::from("arrived, \"in\" time: µ")],
            vec![Cell::Int(12), Cell::Int(1), Cell::Float(-0.25), Cell::Absent],
        ];
        for bytes in written(&heading, &rows).expect("written") {
            let reader = Reader::new(bytes.clone()).expect("a table");
            assert_eq!((reader.heading(), cells(&reader).as_slice()), (&heading, rows.as_slice()));
            // As viewers see it.
            let messages: Vec<_> =
                MessageStream::new(&bytes).expect("MCAP").map(|of| of.expect("whole")).collect();
            let seen: Vec<_> =
                messages.iter().map(|of| (of.channel.topic.as_str(), of.log_time, of.sequence)).collect();
            assert_eq!(seen, [("/motor_5", 0, 1), ("/motor_1", 12_000_000, 2)]);
            assert_eq!(messages[0].channel.message_encoding, "json");
            let schema = messages[0].channel.schema.as_ref().expect("a schema");
            let schema: Value = serde_json::from_slice(&schema.data).expect("JSON");
            assert_eq!(schema["properties"]["bus_v"], json!({ "type": "number", "description": "V" }));
            assert_eq!(schema["properties"]["motor"]["type"], "integer");
            assert_eq!(schema["properties"]["end"]["type"], "string");
        }
    }

    #[test]
    fn time_of_a_message_is_that_of_its_row() {
        let times = |columns: Vec<Column>, rows: &[Vec<Cell>]| {
            let heading = Heading { columns, ..Heading::default() };
            let [whole, _] = written(&heading, rows).map_err(|error| error.to_string())?;
            let messages = MessageStream::new(&whole).expect("MCAP");
            Ok::<_, String>(messages.map(|of| of.expect("whole").log_time).collect::<Vec<_>>())
        };
        let of = |cells: [f64; 2]| cells.map(|cell| vec![Cell::Float(cell)]);
        let float = |name: &str| vec![Column::new(name, "", Kind::Float)];
        assert_eq!(times(float(TIME), &of([0.0, 0.5])), Ok(vec![0, 500_000]));
        assert_eq!(times(float("freq_hz"), &of([7.0, 8.0])), Ok(vec![1_000_000, 2_000_000]), "1 ms a row");
        let none = "row 2, column time_ms: found no time, expected 0 or more ms".to_owned();
        assert_eq!(times(float(TIME), &of([0.0, -0.5])), Err(none.clone()));
        let int = vec![Column::new(TIME, "ms", Kind::Int)];
        assert_eq!(times(int, &[vec![Cell::Int(0)], vec![Cell::Int(-1)]]), Err(none));
    }

    #[test]
    fn cell_of_another_kind_is_named() {
        let described = |kind: &str| Described {
            name: "x".to_owned(),
            unit: String::new(),
            kind: kind.to_owned(),
            nullable: false,
            decimals: None,
        };
        assert!(["float", "int", "text"].iter().all(|kind| column(described(kind)).is_ok()));
        let error = column(described("time")).expect_err("no kind").to_string();
        assert_eq!(error, "column x is of the unknown kind time");
        for (kind, value) in [(Kind::Int, "0.5"), (Kind::Float, "\"a\""), (Kind::Text, "1")] {
            let columns = vec![Column::new("x", "", kind)];
            let heading = Heading { columns, ..Heading::default() };
            let reader = Reader { bytes: Vec::new(), heading, is_appended: true, notes: Vec::new() };
            let mut given = Vec::new();
            let push = &mut |row: &[Cell]| {
                given.push(row.to_vec());
                Ok(())
            };
            let error = reader.give(3, format!("{{\"x\":{value}}}").as_bytes(), push).expect_err(value);
            let words = format!("row 3, column x: found {value}, expected a value of its kind");
            assert_eq!(error.to_string(), words);
            reader.give(4, b"{}", push).expect("absent");
            assert_eq!(given, [[Cell::Absent]]);
        }
    }

    #[test]
    fn log_that_breaks_off_says_so() {
        let mut bytes = appended();
        bytes.truncate(bytes.windows(4).rposition(|part| part == b"24.5").expect("a row"));
        let reader = Reader::new(bytes).expect("its whole rows");
        assert!(reader.notes()[0].contains("breaks off"), "{:?}", reader.notes());
        let mut found = 0;
        reader
            .rows(&mut |_| {
                found += 1;
                Ok(())
            })
            .expect("whole rows");
        assert_eq!(found, 8);
    }
}
