//! Reads the small flat tables outside datasets.

use std::fs::File;
use std::path::Path;

use arrow::cast::AsArray as _;
use arrow::types::{Float32Type, UInt64Type};
use arrow_schema::DataType;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use program::{Context as _, Failure};

use super::table_reader::{guard, undecoded};
use crate::PlainColumn;

/// The columns of a file that [`crate::plain_table`] made, by their names.
///
/// # Errors
/// [`Failure`] if the file cannot be read, is damaged, has more rows than `rows_max` or columns of other types.
pub fn read_plain_table(path: &Path, rows_max: usize) -> Result<Vec<(String, PlainColumn)>, Failure> {
    let file = File::open(path).context(format_args!("failed to read {}", path.display()))?;
    guard(|| columns(file, rows_max)).map_err(|text| undecoded(format!("{text}: {}", path.display())))
}

fn columns(file: File, rows_max: usize) -> Result<Vec<(String, PlainColumn)>, String> {
    let failed = |error: &dyn std::fmt::Display| format!("the table must be a whole Parquet file, got {error}");
    let builder = ParquetRecordBatchReaderBuilder::try_new(file).map_err(|error| failed(&error))?;
    let rows = builder.metadata().file_metadata().num_rows();
    if !usize::try_from(rows).is_ok_and(|rows| rows <= rows_max) {
        return Err(format!("the table must have at most {rows_max} rows, got {rows}"));
    }
    let mut columns = Vec::new();
    for field in builder.schema().fields() {
        let column = match field.data_type() {
            DataType::UInt64 => PlainColumn::Whole(Vec::new()),
            DataType::Float32 => PlainColumn::Real(Vec::new()),
            DataType::Utf8 => PlainColumn::Text(Vec::new()),
            other => return Err(format!("column {} must be integers, floats or text, got {other}", field.name())),
        };
        columns.push((field.name().clone(), column));
    }
    for batch in builder.build().map_err(|error| failed(&error))? {
        let batch = batch.map_err(|error| failed(&error))?;
        for ((_, column), array) in columns.iter_mut().zip(batch.columns()) {
            match column {
                PlainColumn::Whole(all) => all.extend_from_slice(array.as_primitive::<UInt64Type>().values()),
                PlainColumn::Real(all) => all.extend(array.as_primitive::<Float32Type>()),
                PlainColumn::Text(all) => {
                    all.extend(array.as_string::<i32>().iter().map(|text| text.unwrap_or_default().to_owned()));
                }
            }
        }
    }
    Ok(columns)
}

#[cfg(test)]
mod tests {
    use program::ExitCode;

    use super::*;
    use crate::plain_table;

    #[test]
    fn a_table_is_read_as_it_was_written_and_damage_is_an_error() {
        let columns = vec![
            ("round", PlainColumn::Whole(vec![0, 1, 2])),
            ("rho_m", PlainColumn::Real(vec![Some(0.5), None, Some(-1.0)])),
            ("outcome", PlainColumn::Text(["held", "slipped", "held"].map(str::to_owned).to_vec())),
        ];
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("a.parquet");
        let bytes = plain_table(columns.clone()).unwrap();
        std::fs::write(&path, &bytes).unwrap();
        let read = read_plain_table(&path, 3).unwrap();
        assert!(read.iter().map(|(name, column)| (name.as_str(), column.clone())).eq(columns));
        assert_eq!(read_plain_table(&path, 2).unwrap_err().exit_code(), ExitCode::Data);
        for cut in [0, 10, bytes.len() / 2, bytes.len() - 5] {
            std::fs::write(&path, &bytes[..cut]).unwrap();
            assert_eq!(read_plain_table(&path, 3).unwrap_err().exit_code(), ExitCode::Data, "{cut}");
        }
    }
}
