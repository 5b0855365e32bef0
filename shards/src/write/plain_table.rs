//! Small flat tables outside datasets, such as those of experiments, for DuckDB, polars and pyarrow.

use std::sync::Arc;

use arrow::{ArrayRef, Float32Array, RecordBatch, StringArray, UInt64Array};
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, ZstdLevel};
use parquet::file::properties::{WriterProperties, WriterVersion};
use program::{ExitCode, Failure};
use schema::Pose;

/// A column of a flat table.
#[derive(Debug, Clone, PartialEq)]
pub enum PlainColumn {
    /// Integers.
    Whole(Vec<u64>),
    /// Floats, which may be null.
    Real(Vec<Option<f32>>),
    /// Strings.
    Text(Vec<String>),
}

/// The bytes of a Parquet file with these columns, in this order; a pure function of them.
///
/// # Errors
/// [`Failure`] if the columns differ in length.
pub fn plain_table(columns: Vec<(&str, PlainColumn)>) -> Result<Vec<u8>, Failure> {
    let failed = |e: &dyn std::fmt::Display| Failure::new(ExitCode::Internal, format!("failed to write a table: {e}"));
    let array = |column: PlainColumn| -> ArrayRef {
        match column {
            PlainColumn::Whole(values) => Arc::new(UInt64Array::from(values)),
            PlainColumn::Real(values) => Arc::new(Float32Array::from(values)),
            PlainColumn::Text(values) => Arc::new(StringArray::from(values)),
        }
    };
    let arrays = columns.into_iter().map(|(name, column)| {
        let nullable = matches!(column, PlainColumn::Real(_));
        (name, array(column), nullable)
    });
    let batch = RecordBatch::try_from_iter_with_nullable(arrays).map_err(|e| failed(&e))?;
    let properties = WriterProperties::builder()
        .set_created_by("graspmill".to_owned())
        .set_writer_version(WriterVersion::PARQUET_1_0)
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(1).map_err(|e| failed(&e))?))
        .build();
    let mut bytes = Vec::new();
    let mut writer = ArrowWriter::try_new(&mut bytes, batch.schema(), Some(properties)).map_err(|e| failed(&e))?;
    writer.write(&batch).map_err(|e| failed(&e))?;
    writer.close().map_err(|e| failed(&e))?;
    Ok(bytes)
}

/// The columns of poses.
pub fn pose_columns(poses: &[&Pose]) -> impl Iterator<Item = (&'static str, PlainColumn)> {
    let names = ["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"].into_iter().enumerate();
    let numbers = |pose: &Pose| [&pose.translation.to_array()[..], &pose.rotation.to_array()].concat();
    names.map(move |(at, name)| (name, PlainColumn::Real(poses.iter().map(|pose| Some(numbers(pose)[at])).collect())))
}

#[cfg(test)]
mod tests {
    use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;

    use super::*;

    #[test]
    fn a_table_comes_back_and_its_bytes_are_the_same_each_time() {
        let columns = || {
            vec![
                ("round", PlainColumn::Whole(vec![0, 1, 2])),
                ("rho_m", PlainColumn::Real(vec![Some(0.5), None, Some(-1.0)])),
                ("outcome", PlainColumn::Text(["held", "slipped", "held"].map(str::to_owned).to_vec())),
            ]
        };
        let bytes = plain_table(columns()).unwrap();
        assert_eq!(bytes, plain_table(columns()).unwrap());
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), &bytes).unwrap();
        let reader = ParquetRecordBatchReaderBuilder::try_new(file.reopen().unwrap()).unwrap().build().unwrap();
        let batch = reader.into_iter().next().unwrap().unwrap();
        assert_eq!((batch.num_rows(), batch.num_columns()), (3, 3));
        assert_eq!(batch.column(1).null_count(), 1);
        let words = batch.column(2).as_any().downcast_ref::<StringArray>().unwrap();
        assert_eq!(words.value(1), "slipped");
    }

    #[test]
    fn columns_of_other_lengths_are_refused() {
        let uneven = vec![("a", PlainColumn::Whole(vec![1])), ("b", PlainColumn::Whole(vec![1, 2]))];
        assert!(plain_table(uneven).is_err());
    }
}
