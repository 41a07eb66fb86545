use super::*;
use crate::format::Format;

fn heading() -> Heading {
    Heading {
        columns: vec![
            Column::new("time_ms", "ms", Kind::Int),
            Column::new("bus_v", "V", Kind::Float).decimals(2),
            Column::new("overshoot_counts", "counts", Kind::Float).nullable(),
            Column::new("motor", "", Kind::Text),
            Column::new("end", "", Kind::Text).nullable(),
        ],
        metadata: vec![("commit".to_owned(), "abc".to_owned()), ("seed".to_owned(), "7".to_owned())],
    }
}

fn row(index: usize) -> Vec<Cell> {
    let number = i64::try_from(index).expect("small");
    let end = (!index.is_multiple_of(4)).then_some("arrived, in time: µ");
    vec![
        number.into(),
        (0.1 * number as f64).into(),
        index.is_multiple_of(3).then_some(-0.0).into(),
        "tip".into(),
        end.into(),
    ]
}

fn file(rows: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = Writer::new(&mut bytes, &heading()).expect("columns");
    for index in 0..rows {
        writer.row(&row(index)).expect("a row");
    }
    writer.finish().expect("memory is large enough");
    drop(writer);
    bytes
}

fn read(bytes: Vec<u8>) -> Result<(Heading, Vec<Vec<Cell>>), TableError> {
    let reader = Reader::new(bytes)?;
    let mut rows = Vec::new();
    reader.rows(&mut |row| {
        rows.push(row.to_vec());
        Ok(())
    })?;
    Ok((reader.heading().clone(), rows))
}

#[test]
fn table_reads_back_as_written_over_row_groups() {
    // None, part of a group, exactly one, and more.
    for rows in [0, 3, GROUP_ROWS, GROUP_ROWS + BATCH_ROWS + 1] {
        let (found, cells) = read(file(rows)).expect("a Parquet file");
        assert_eq!(found, heading());
        assert_eq!(cells.len(), rows);
        let wrong = cells.iter().enumerate().find(|(index, cells)| **cells != row(*index));
        assert_eq!(wrong, None);
        let zero = cells.first().map(|row| matches!(row[2], Cell::Float(v) if v.is_sign_negative()));
        assert_ne!(zero, Some(false), "-0 keeps its sign");
    }
}

#[test]
fn same_rows_give_the_same_bytes() {
    assert!(file(1000) == file(1000));
    let text = String::from_utf8_lossy(&file(1)).into_owned();
    assert!(!text.contains("parquet-rs"), "the version of a crate is no part of the result");
}

#[test]
fn row_that_does_not_fit_is_named() {
    let mut writer = Writer::new(Vec::new(), &heading()).expect("columns");
    writer.row(&row(0)).expect("a row");
    let with = |index: usize, cell: Cell| {
        let mut row = row(1);
        row[index] = cell;
        row
    };
    for (cells, words) in [
        (row(1)[1..].to_vec(), "found 4 cells, expected 5 cells"),
        (with(1, f64::NAN.into()), "column bus_v: found NaN, expected a finite number"),
        (with(0, Cell::Absent), "column time_ms: found no value, expected an integer"),
        (with(3, 1.into()), "column motor: found 1, expected text"),
    ] {
        let error = writer.row(&cells).expect_err("refused").to_string();
        assert!(error.contains(words), "{error}");
    }
    assert!(writer.row(&row(1)[..0]).expect_err("refused").to_string().starts_with("row 6, "));
    let twice = Heading { columns: vec![heading().columns[0].clone(); 2], ..Heading::default() };
    let error = Writer::new(Vec::new(), &twice).map(|_| ()).expect_err("refused").to_string();
    assert_eq!(error, "two columns are named time_ms");
}

#[test]
fn truncated_file_is_an_error() {
    let whole = file(300);
    for end in 0..whole.len() {
        assert!(read(whole[..end].to_vec()).is_err(), "{end} of {} bytes", whole.len());
    }
}

/// A page that does not unpack is damage, not a disk that fails.
#[test]
fn damage_is_no_error_of_the_system() {
    let whole = file(300);
    let mut refused = 0;
    for at in (4..whole.len() - 8).step_by(3) {
        let mut bytes = whole.clone();
        bytes[at] ^= 0x40;
        let read = Format::Parquet.source(bytes).and_then(|source| source.rows(&mut |_| Ok(())));
        if let Err(error) = read {
            assert!(!matches!(error, TableError::Io(_)), "byte {at}: {error}");
            refused += 1;
        }
    }
    assert!(refused > 100, "{refused} of {} changes are refused", whole.len());
}

#[test]
fn types_of_a_file_become_kinds_and_values() {
    let of = |name: &str, physical, logical: Option<LogicalType>, converted| {
        let field = Type::primitive_type_builder(name, physical).with_repetition(Repetition::REQUIRED);
        let field = field.with_logical_type(logical).with_converted_type(converted).build().expect("a type");
        let (column, values) = described(&field, &Frame::default()).map_err(|error| error.to_string())?;
        let values = match values {
            Values::AsTheyAre => 0,
            Values::Unsigned => -1,
            Values::Times(per_unit) => per_unit,
        };
        Ok::<_, String>((column.kind, column.unit, values))
    };
    let none = ConvertedType::NONE;
    let time = |unit| Some(LogicalType::timestamp(true, unit));
    let int = |is_signed| Some(LogicalType::integer(64, is_signed));
    for (found, want) in [
        (of("end", Physical::BYTE_ARRAY, None, ConvertedType::UTF8), (Kind::Text, "", 0)),
        (of("end", Physical::BYTE_ARRAY, Some(LogicalType::String), none), (Kind::Text, "", 0)),
        (of("n", Physical::INT64, int(true), none), (Kind::Int, "", 0)),
        (of("n", Physical::INT64, int(false), none), (Kind::Int, "", -1)),
        (of("time_ms", Physical::INT64, time(TimeUnit::MILLIS), none), (Kind::Float, "", 1)),
        (of("time_ms", Physical::INT64, time(TimeUnit::MICROS), none), (Kind::Float, "", 1000)),
        (of("time_s", Physical::INT64, time(TimeUnit::MICROS), none), (Kind::Float, "", 1_000_000)),
        (of("at", Physical::INT64, time(TimeUnit::NANOS), none), (Kind::Float, "ms", 1_000_000)),
    ] {
        let (kind, unit, values) = want;
        assert_eq!(found, Ok((kind, unit.to_owned(), values)));
    }
    let error = of("x", Physical::BYTE_ARRAY, None, none).expect_err("no text");
    assert!(error.contains("column x has a type that is not read: found BYTE_ARRAY"), "{error}");
}
