//! Tables in Apache Parquet files: columns of 64-bit floats, 64-bit integers and text, gzipped.
//!
//! The file's key-value metadata is the heading's, then `units` and `decimals`, each a JSON object by column. The same rows give the
//! same bytes: the file names no time and no version. A writer keeps one row group. A truncated file is an error; the crate beneath may
//! panic over bytes that were changed inside a file.

use std::collections::BTreeMap;
use std::io::Write;
use std::sync::Arc;

use bytes::Bytes;
use parquet::basic::{Compression, ConvertedType, GzipLevel, LogicalType, Repetition, Type as Physical};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::column::writer::ColumnWriterImpl;
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, RowGroupReader, SerializedFileReader};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::{Type, TypePtr};

use super::table::{Cell, Column, Heading, Kind, Sink, Source, TableError, check};

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

/// Reads a table from a Parquet file.
pub struct Reader {
    file: SerializedFileReader<Bytes>,
    heading: Heading,
}

impl Reader {
    /// Reads the end of a file, which describes it.
    ///
    /// # Errors
    /// Bytes that are no Parquet file, or one with other columns than floats of 64 bits, integers of 64 bits and text.
    pub fn new(bytes: Vec<u8>) -> Result<Self, TableError> {
        let file = SerializedFileReader::new(Bytes::from(bytes))?;
        let footer = file.metadata().file_metadata();
        let mut facts: Vec<(String, String)> = Vec::new();
        for fact in footer.key_value_metadata().into_iter().flatten() {
            facts.push((fact.key.clone(), fact.value.clone().unwrap_or_default()));
        }
        let units: BTreeMap<String, String> = taken(&mut facts, UNITS)?;
        let decimals: BTreeMap<String, u8> = taken(&mut facts, DECIMALS)?;
        let mut columns = Vec::new();
        for field in footer.schema().get_fields() {
            let mut column = described(field)?;
            column.unit = units.get(&column.name).cloned().unwrap_or_default();
            column.decimals = decimals.get(&column.name).copied();
            columns.push(column);
        }
        Ok(Self { file, heading: Heading { columns, metadata: facts } })
    }

    fn batches<'a>(&'a self, group: &dyn RowGroupReader) -> Result<Vec<Batches<'a>>, TableError> {
        let columns = self.heading.columns.iter().enumerate();
        columns
            .map(|(index, column)| Ok(Batches { column, reader: group.get_column_reader(index)? }))
            .collect()
    }
}

impl Source for Reader {
    fn heading(&self) -> &Heading {
        &self.heading
    }

    fn rows(&self, sink: &mut dyn FnMut(&[Cell]) -> Result<(), TableError>) -> Result<(), TableError> {
        for index in 0..self.file.num_row_groups() {
            let group = self.file.get_row_group(index)?;
            let mut left = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
            let mut columns = self.batches(group.as_ref())?;
            while left > 0 {
                let count = left.min(BATCH_ROWS);
                let batches = columns.iter_mut().map(|column| column.read(count));
                let batches = batches.collect::<Result<Vec<_>, TableError>>()?;
                let mut batches: Vec<_> = batches.into_iter().map(Vec::into_iter).collect();
                for _ in 0..count {
                    let row: Vec<Cell> = batches.iter_mut().filter_map(Iterator::next).collect();
                    sink(&row)?;
                }
                left -= count;
            }
        }
        Ok(())
    }
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

fn described(field: &Type) -> Result<Column, TableError> {
    let name = field.name();
    let wrong = |found: &str| {
        TableError::File(format!("column {name} is {found}; a table has doubles, 64-bit integers and text"))
    };
    if !field.is_primitive() || field.get_basic_info().repetition() == Repetition::REPEATED {
        return Err(wrong("a list or a group"));
    }
    let info = field.get_basic_info();
    let is_text =
        info.logical_type_ref() == Some(&LogicalType::String) || info.converted_type() == ConvertedType::UTF8;
    let kind = match field.get_physical_type() {
        Physical::DOUBLE => Kind::Float,
        Physical::INT64 if info.logical_type_ref().is_none() => Kind::Int,
        Physical::BYTE_ARRAY if is_text => Kind::Text,
        other => return Err(wrong(&format!("{other}"))),
    };
    let column = Column::new(name, "", kind);
    Ok(if info.repetition() == Repetition::OPTIONAL { column.nullable() } else { column })
}

/// A column of a row group.
struct Batches<'a> {
    column: &'a Column,
    reader: ColumnReader,
}

impl Batches<'_> {
    /// The next `count` cells.
    fn read(&mut self, count: usize) -> Result<Vec<Cell>, TableError> {
        let Self { column, reader } = self;
        match reader {
            ColumnReader::DoubleColumnReader(reader) => cells(column, reader, count, |v| Ok(Cell::Float(v))),
            ColumnReader::Int64ColumnReader(reader) => cells(column, reader, count, |v| Ok(Cell::Int(v))),
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
