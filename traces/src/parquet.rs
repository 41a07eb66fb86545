//! Tables in Apache Parquet files. A [`Writer`] writes columns of 64-bit floats, 64-bit integers and text, gzipped. The [`Reader`] takes those
//! of data tools as well: other integers and floats, booleans and times, snappy, and the index of a data frame. The other compressions are C code.
//!
//! The file's key-value metadata is the heading's, then `units` and `decimals`, each a JSON object by column. The same rows give the
//! same bytes: the file names no time and no version. A writer keeps one row group. A truncated or
//! damaged file is an error, also where the crate beneath panics over it.

use std::collections::BTreeMap;
use std::io::Write;
use std::panic::{self, AssertUnwindSafe};
use std::sync::{Arc, Once};

use bytes::Bytes;
use parquet::basic::{
    Compression, ConvertedType, GzipLevel, LogicalType, Repetition, TimeUnit, Type as Physical,
};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::column::writer::ColumnWriterImpl;
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::{KeyValue, ParquetMetaData};
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, RowGroupReader, SerializedFileReader};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::{Type, TypePtr};

use super::names::unit as unit_of;
use super::table::{Cell, Column, Heading, Kind, Sink, Source, TableError, check, check_size};

/// Rows of a row group: 13 MB of a table with 100 columns of numbers.
pub const GROUP_ROWS: usize = 16_384;

/// Rows read at a time.
const BATCH_ROWS: usize = 1024;

const UNITS: &str = "units";
const DECIMALS: &str = "decimals";

impl From<ParquetError> for TableError {
    fn from(error: ParquetError) -> Self {
        match error {
            ParquetError::External(source) => match source.downcast::<std::io::Error>() {
                Ok(error) => Self::Io(*error),
                Err(other) => Self::File(other.to_string()),
            },
            other => Self::File(other.to_string()),
        }
    }
}

/// The cells of a column of the row group that is being written.
enum Kept {
    Float(Vec<f64>),
    Int(Vec<i64>),
    Text(Vec<ByteArray>),
}

struct Block {
    values: Kept,
    /// 1 with a value, 0 without; empty for a column without absent cells.
    present: Vec<i16>,
}

impl Block {
    fn new(kind: Kind) -> Self {
        let values = match kind {
            Kind::Float => Kept::Float(Vec::new()),
            Kind::Int => Kept::Int(Vec::new()),
            Kind::Text => Kept::Text(Vec::new()),
        };
        Self { values, present: Vec::new() }
    }

    fn push(&mut self, nullable: bool, cell: &Cell) {
        if nullable {
            self.present.push(i16::from(*cell != Cell::Absent));
        }
        match (&mut self.values, cell) {
            (Kept::Float(values), Cell::Float(value)) => values.push(*value),
            (Kept::Int(values), Cell::Int(value)) => values.push(*value),
            (Kept::Text(values), Cell::Text(value)) => values.push(value.as_bytes().to_vec().into()),
            // `check` has left nothing else but Absent.
            _ => {}
        }
    }

    fn write<W: Write + Send>(
        &mut self,
        group: &mut SerializedRowGroupWriter<'_, W>,
    ) -> Result<(), TableError> {
        let Some(mut column) = group.next_column()? else { return Ok(()) };
        match &mut self.values {
            Kept::Float(values) => write_batch(column.typed::<DoubleType>(), values, &self.present)?,
            Kept::Int(values) => write_batch(column.typed::<Int64Type>(), values, &self.present)?,
            Kept::Text(values) => write_batch(column.typed::<ByteArrayType>(), values, &self.present)?,
        }
        self.present.clear();
        Ok(column.close()?)
    }
}

fn write_batch<T: DataType>(
    column: &mut ColumnWriterImpl<'_, T>,
    values: &mut Vec<T::T>,
    present: &[i16],
) -> Result<(), TableError> {
    column.write_batch(values, (!present.is_empty()).then_some(present), None)?;
    values.clear();
    Ok(())
}

/// Writes a table as a Parquet file.
pub struct Writer<W: Write + Send> {
    file: SerializedFileWriter<W>,
    columns: Vec<Column>,
    blocks: Vec<Block>,
    kept: usize,
    rows: u64,
}

impl<W: Write + Send> Writer<W> {
    /// Begins a file.
    ///
    /// # Errors
    /// No columns, two of one name, or those of the output.
    pub fn new(out: W, heading: &Heading) -> Result<Self, TableError> {
        let mut names: Vec<&str> = heading.columns.iter().map(|column| column.name.as_str()).collect();
        names.sort_unstable();
        if let Some(twice) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(TableError::File(format!("two columns are named {}", twice[0])));
        }
        if names.is_empty() {
            return Err(TableError::File("a table has at least one column".to_owned()));
        }
        let properties = WriterProperties::builder()
            .set_created_by("hil-sim".to_owned())
            .set_compression(Compression::GZIP(GzipLevel::default()))
            .set_key_value_metadata(Some(facts(heading)))
            .build();
        let file = SerializedFileWriter::new(out, schema(&heading.columns)?, Arc::new(properties))?;
        let columns = heading.columns.clone();
        let blocks = columns.iter().map(|column| Block::new(column.kind)).collect();
        Ok(Self { file, columns, blocks, kept: 0, rows: 0 })
    }

    fn flush(&mut self) -> Result<(), TableError> {
        if self.kept > 0 {
            let mut group = self.file.next_row_group()?;
            for block in &mut self.blocks {
                block.write(&mut group)?;
            }
            group.close()?;
            self.kept = 0;
        }
        Ok(())
    }
}

impl<W: Write + Send> Sink for Writer<W> {
    fn row(&mut self, cells: &[Cell]) -> Result<(), TableError> {
        self.rows += 1;
        check(&self.columns, self.rows, cells)?;
        for ((column, block), cell) in self.columns.iter().zip(&mut self.blocks).zip(cells) {
            block.push(column.nullable, cell);
        }
        self.kept += 1;
        if self.kept == GROUP_ROWS { self.flush() } else { Ok(()) }
    }

    fn finish(&mut self) -> Result<(), TableError> {
        self.flush()?;
        self.file.finish()?;
        Ok(self.file.inner_mut().flush()?)
    }
}

fn facts(heading: &Heading) -> Vec<KeyValue> {
    let units: serde_json::Map<String, serde_json::Value> = heading
        .columns
        .iter()
        .filter(|column| !column.unit.is_empty())
        .map(|column| (column.name.clone(), column.unit.clone().into()))
        .collect();
    let decimals: serde_json::Map<String, serde_json::Value> = heading
        .columns
        .iter()
        .filter_map(|column| Some((column.name.clone(), column.decimals?.into())))
        .collect();
    let tables = [(UNITS, units), (DECIMALS, decimals)];
    let own =
        tables.map(|(key, map)| KeyValue::new(key.to_owned(), serde_json::Value::from(map).to_string()));
    let given = heading.metadata.iter().map(|(key, value)| KeyValue::new(key.clone(), value.clone()));
    given.chain(own).collect()
}

fn schema(columns: &[Column]) -> Result<TypePtr, ParquetError> {
    let fields = columns.iter().map(|column| {
        let physical = match column.kind {
            Kind::Float => Physical::DOUBLE,
            Kind::Int => Physical::INT64,
            Kind::Text => Physical::BYTE_ARRAY,
        };
        let logical = (column.kind == Kind::Text).then_some(LogicalType::String);
        let repetition = if column.nullable { Repetition::OPTIONAL } else { Repetition::REQUIRED };
        let field = Type::primitive_type_builder(&column.name, physical)
            .with_repetition(repetition)
            .with_logical_type(logical)
            .build()?;
        Ok(Arc::new(field))
    });
    let fields = fields.collect::<Result<Vec<_>, ParquetError>>()?;
    Ok(Arc::new(Type::group_type_builder("table").with_fields(fields).build()?))
}

/// What the index of a data frame without a name is called.
const UNNAMED_INDEX: &str = "__index_level_";

/// Facts of data frames about themselves, which say nothing of the table.
const PANDAS: &str = "pandas";
const ARROW: &str = "ARROW:schema";

/// Reads a table from a Parquet file, of this writer or of another program.
pub struct Reader {
    file: SerializedFileReader<Bytes>,
    heading: Heading,
    /// Place in the file and values of each column.
    fields: Vec<(usize, Values)>,
    notes: Vec<String>,
}

impl Reader {
    /// Reads the end of a file, which describes it.
    ///
    /// # Errors
    /// Bytes that are no Parquet file, one with other columns than numbers, times and text, or with a compression other than snappy and gzip.
    pub fn new(bytes: Vec<u8>) -> Result<Self, TableError> {
        let file = unpack(|| Ok(SerializedFileReader::new(Bytes::from(bytes))?))?;
        check_groups(file.metadata())?;
        let footer = file.metadata().file_metadata();
        let mut facts: Vec<(String, String)> = Vec::new();
        for fact in footer.key_value_metadata().into_iter().flatten() {
            facts.push((fact.key.clone(), fact.value.clone().unwrap_or_default()));
        }
        let units: BTreeMap<String, String> = taken(&mut facts, UNITS)?;
        let decimals: BTreeMap<String, u8> = taken(&mut facts, DECIMALS)?;
        let frame = Frame::new(&facts);
        facts.retain(|(key, _)| ![PANDAS, ARROW].contains(&key.as_str()));
        let mut columns = Vec::new();
        let mut notes = Vec::new();
        for (place, field) in footer.schema().get_fields().iter().enumerate() {
            if field.name().starts_with(UNNAMED_INDEX) {
                notes.push("an index without a name is left out".to_owned());
                continue;
            }
            let (mut column, values) = described(field, &frame)?;
            if let Some(unit) = units.get(&column.name) {
                column.unit.clone_from(unit);
            }
            column.decimals = decimals.get(&column.name).copied();
            columns.push((column, (place, values)));
        }
        // A data frame's index is first, but Parquet has it last.
        columns.sort_by_key(|(column, _)| !frame.index.contains(&column.name));
        let (columns, fields) = columns.into_iter().unzip();
        Ok(Self { file, heading: Heading { columns, metadata: facts }, fields, notes })
    }

    fn batches<'a>(&'a self, group: &dyn RowGroupReader) -> Result<Vec<Batches<'a>>, TableError> {
        let columns = self.heading.columns.iter().zip(&self.fields);
        columns
            .map(|(column, (place, values))| {
                Ok(Batches { column, values: *values, reader: group.get_column_reader(*place)? })
            })
            .collect()
    }
}

impl Source for Reader {
    fn heading(&self) -> &Heading {
        &self.heading
    }

    fn rows(&self, sink: &mut dyn FnMut(&[Cell]) -> Result<(), TableError>) -> Result<(), TableError> {
        let mut row = 0;
        for index in 0..self.file.num_row_groups() {
            let group = unpack(|| Ok(self.file.get_row_group(index)?))?;
            let mut left = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
            let mut columns = unpack(|| self.batches(group.as_ref()))?;
            while left > 0 {
                let count = left.min(BATCH_ROWS);
                let batches = columns.iter_mut().map(|column| column.read(count, row));
                let batches: Vec<_> = unpack(|| batches.collect())?;
                let mut batches: Vec<_> = batches.into_iter().map(Vec::into_iter).collect();
                for _ in 0..count {
                    let row: Vec<Cell> = batches.iter_mut().filter_map(Iterator::next).collect();
                    sink(&row)?;
                }
                left -= count;
                row += count as u64;
            }
        }
        Ok(())
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }
}

thread_local! {
    static UNPACKING: std::cell::Cell<bool> = const { std::cell::Cell::new(false) };
}

/// What the crate beneath says of bytes in memory. It panics over some damaged bytes, and reports others as an error of the system: both
/// are damage, and the panic is not printed.
fn unpack<T>(call: impl FnOnce() -> Result<T, TableError>) -> Result<T, TableError> {
    static QUIET: Once = Once::new();
    QUIET.call_once(|| {
        let print = panic::take_hook();
        panic::set_hook(Box::new(move |panic| {
            if !UNPACKING.get() {
                print(panic);
            }
        }));
    });
    UNPACKING.set(true);
    let outcome = panic::catch_unwind(AssertUnwindSafe(call));
    UNPACKING.set(false);
    let damaged = |_| Err(TableError::File("a page that does not unpack".to_owned()));
    outcome.unwrap_or_else(damaged).map_err(TableError::of_memory)
}

/// Checks sizes and compressions before anything is unpacked: a few bytes can claim a million rows.
fn check_groups(file: &ParquetMetaData) -> Result<(), TableError> {
    let columns = file.file_metadata().schema().get_fields().len();
    let rows = file.row_groups().iter().map(|group| u64::try_from(group.num_rows()).unwrap_or(0));
    check_size(columns, rows.fold(0, u64::saturating_add))?;
    for chunk in file.row_groups().iter().flat_map(|group| group.columns()) {
        let name = match chunk.compression() {
            Compression::UNCOMPRESSED | Compression::SNAPPY | Compression::GZIP(_) => continue,
            // The level, which a file does not have.
            other => format!("{other:?}").split('(').next().unwrap_or_default().to_lowercase(),
        };
        return Err(TableError::input(
            None,
            "the file has a compression that is not read",
            name,
            "snappy, gzip or none",
            "write it again, such as with pandas: pandas.read_parquet(\"IN\").to_parquet(\"OUT\", compression=\"snappy\")",
        ));
    }
    Ok(())
}

/// Takes one of this module's own facts out of the file's.
fn taken<T: serde::de::DeserializeOwned>(
    facts: &mut Vec<(String, String)>,
    key: &str,
) -> Result<BTreeMap<String, T>, TableError> {
    let Some(index) = facts.iter().position(|(name, _)| name == key) else { return Ok(BTreeMap::new()) };
    let (_, json) = facts.remove(index);
    serde_json::from_str(&json).map_err(|error| TableError::File(format!("metadata {key}: {error}")))
}

/// What a data frame says of itself.
#[derive(Default)]
struct Frame {
    index: Vec<String>,
    /// Columns of time spans. Their type in the file is that of integers.
    spans: Vec<String>,
}

impl Frame {
    fn new(facts: &[(String, String)]) -> Self {
        let json = facts.iter().find(|(key, _)| key == PANDAS).map(|(_, json)| json.as_str());
        let own: serde_json::Value =
            json.and_then(|json| serde_json::from_str(json).ok()).unwrap_or_default();
        let list = |key: &str| own.get(key).and_then(|list| list.as_array()).into_iter().flatten();
        let text = |value: &serde_json::Value| value.as_str().map(str::to_owned);
        let is_span = |column: &&serde_json::Value| {
            let kind = column.get("numpy_type").and_then(|kind| kind.as_str());
            kind.is_some_and(|kind| kind.starts_with("timedelta"))
        };
        Self {
            index: list("index_columns").filter_map(text).collect(),
            spans: list("columns").filter(is_span).filter_map(|column| text(column.get("name")?)).collect(),
        }
    }
}

/// How the values of a column become cells.
#[derive(Clone, Copy)]
enum Values {
    AsTheyAre,
    /// Integers without a sign, which the file has in the bits of those with one.
    Unsigned,
    /// Times since 1970: so many make one of the column's unit.
    Times(i64),
}

fn described(field: &Type, frame: &Frame) -> Result<(Column, Values), TableError> {
    let name = field.name();
    let wrong = |found: String| {
        let next = format!("leave column {name} out, or write it as floating point");
        let expected = "integers, floating point of 32 or 64 bits, booleans, times or text";
        TableError::input(None, &format!("column {name} has a type that is not read"), found, expected, next)
    };
    if !field.is_primitive() || field.get_basic_info().repetition() == Repetition::REPEATED {
        return Err(wrong("a list or a group".to_owned()));
    }
    if frame.spans.iter().any(|span| span == name) {
        return Err(wrong("spans of time, in a unit that the file does not say".to_owned()));
    }
    let info = field.get_basic_info();
    let logical = info.logical_type_ref();
    let is_text = logical == Some(&LogicalType::String) || info.converted_type() == ConvertedType::UTF8;
    let values = match logical {
        Some(LogicalType::Integer(of)) if !of.is_signed => Values::Unsigned,
        Some(LogicalType::Timestamp(of)) => {
            let per_ms = match of.unit {
                TimeUnit::MILLIS => 1,
                TimeUnit::MICROS => 1_000,
                TimeUnit::NANOS => 1_000_000,
            };
            Values::Times(if unit_of(name) == "s" { 1000 * per_ms } else { per_ms })
        }
        _ => Values::AsTheyAre,
    };
    let kind = match (field.get_physical_type(), logical) {
        (Physical::DOUBLE | Physical::FLOAT, None) => Kind::Float,
        (Physical::INT64, Some(LogicalType::Timestamp(_))) => Kind::Float,
        (Physical::INT64 | Physical::INT32, None | Some(LogicalType::Integer(_))) => Kind::Int,
        // A column of nothing but absent cells.
        (Physical::INT32, Some(LogicalType::Unknown)) => Kind::Int,
        (Physical::BOOLEAN, None) => Kind::Int,
        (Physical::BYTE_ARRAY, _) if is_text => Kind::Text,
        (other, None) => return Err(wrong(format!("{other}"))),
        (other, Some(logical)) => return Err(wrong(format!("{logical:?} in {other}"))),
    };
    let is_ms = matches!(values, Values::Times(_)) && unit_of(name).is_empty();
    let column = Column::new(name, if is_ms { "ms" } else { "" }, kind);
    Ok((if info.repetition() == Repetition::OPTIONAL { column.nullable() } else { column }, values))
}

/// A column of a row group.
struct Batches<'a> {
    column: &'a Column,
    values: Values,
    reader: ColumnReader,
}

impl Batches<'_> {
    /// The next `count` cells, after so many rows.
    fn read(&mut self, count: usize, before: u64) -> Result<Vec<Cell>, TableError> {
        let Self { column, values, reader } = self;
        let values = *values;
        let unsigned = |value: i64| {
            let expected = "an integer up to 2^63";
            let row = before + 1;
            u64::try_from(value).map(|_| Cell::Int(value)).map_err(|_| {
                TableError::place(row, &column.name, "a larger one in this row or soon after", expected)
            })
        };
        match reader {
            ColumnReader::DoubleColumnReader(reader) => cells(column, reader, count, |v| Ok(Cell::Float(v))),
            // The shortest number that is this one in 32 bits: 24.1, not 24.100000381.
            ColumnReader::FloatColumnReader(reader) => cells(column, reader, count, |v: f32| {
                Ok(Cell::Float(v.to_string().parse().unwrap_or_else(|_| f64::from(v))))
            }),
            ColumnReader::Int64ColumnReader(reader) => cells(column, reader, count, |v| match values {
                Values::AsTheyAre => Ok(Cell::Int(v)),
                Values::Unsigned => unsigned(v),
                // In two parts: nanoseconds since 1970 are more than a double counts.
                Values::Times(per_unit) => {
                    let rest = v.rem_euclid(per_unit) as f64 / per_unit as f64;
                    Ok(Cell::Float(v.div_euclid(per_unit) as f64 + rest))
                }
            }),
            ColumnReader::Int32ColumnReader(reader) => cells(column, reader, count, |v: i32| match values {
                Values::Unsigned => Ok(Cell::Int(i64::from(v.cast_unsigned()))),
                Values::AsTheyAre | Values::Times(_) => Ok(Cell::Int(i64::from(v))),
            }),
            ColumnReader::BoolColumnReader(reader) => {
                cells(column, reader, count, |v| Ok(Cell::Int(i64::from(v))))
            }
            ColumnReader::ByteArrayColumnReader(reader) => cells(column, reader, count, |v: ByteArray| {
                v.as_utf8().map(Cell::from).map_err(TableError::from)
            }),
            _ => Err(TableError::File(format!("column {} has another type than the file says", column.name))),
        }
    }
}

fn cells<T: DataType>(
    column: &Column,
    reader: &mut ColumnReaderImpl<T>,
    count: usize,
    cell: impl Fn(T::T) -> Result<Cell, TableError>,
) -> Result<Vec<Cell>, TableError> {
    let (mut values, mut present) = (Vec::new(), Vec::new());
    let levels = column.nullable.then_some(&mut present);
    let (rows, _, _) = reader.read_records(count, levels, None, &mut values)?;
    if rows != count {
        return Err(TableError::File(format!("column {} ends early", column.name)));
    }
    let mut values = values.into_iter();
    let mut next = || match values.next() {
        Some(value) => cell(value),
        None => Err(TableError::File(format!("column {} ends early", column.name))),
    };
    if !column.nullable {
        return (0..count).map(|_| next()).collect();
    }
    present.into_iter().map(|level| if level == 0 { Ok(Cell::Absent) } else { next() }).collect()
}

#[cfg(test)]
mod tests;
