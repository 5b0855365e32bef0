//! Reading a Parquet file as if it were hostile. parquet-rs checks much but not all, and may panic on bytes that no
//! writer wrote; so bytes reach it only after their checksum was right, its schema is compared before a row is read,
//! and its panics are caught and become errors.

use std::fs::File;
use std::io::{Read, Seek};
use std::panic::{AssertUnwindSafe, catch_unwind};

use arrow::array::RecordBatch;
use arrow::datatypes::Schema;
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::{ArrowReaderOptions, ParquetRecordBatchReader, ParquetRecordBatchReaderBuilder};
use parquet::file::metadata::PageIndexPolicy;
use sha2::{Digest, Sha256};

use crate::Table;

/// Which rows, and which columns, of a file.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Part {
    /// Only this row group.
    pub(crate) row_group: Option<usize>,
    /// Of what is selected, skip so many rows ...
    pub(crate) offset: usize,
    /// ... and end after so many.
    pub(crate) limit: Option<usize>,
    /// Leave out the column of this name.
    pub(crate) without: Option<&'static str>,
    /// Rows of a batch.
    pub(crate) batch_rows: usize,
}

/// Batches of a file, each decoded when asked for.
pub(crate) struct Batches(ParquetRecordBatchReader);

impl Batches {
    /// Opens a file whose checksum was right.
    pub(crate) fn open(file: File, table: Table, resolution: usize, part: Part) -> Result<Self, String> {
        guard(|| {
            let options = ArrowReaderOptions::new().with_page_index_policy(PageIndexPolicy::Optional);
            let mut builder = ParquetRecordBatchReaderBuilder::try_new_with_options(file, options).map_err(text)?;
            compare_schemas(&table.arrow_schema(resolution), builder.schema())?;
            if let Some(left_out) = part.without {
                let kept = table.columns().iter().enumerate().filter(|(_, c)| c.name != left_out).map(|(i, _)| i);
                let mask = ProjectionMask::roots(builder.parquet_schema(), kept);
                builder = builder.with_projection(mask);
            }
            if let Some(row_group) = part.row_group {
                let count = builder.metadata().num_row_groups();
                if row_group >= count {
                    return Err(format!("row group {row_group} must be below {count}"));
                }
                builder = builder.with_row_groups(vec![row_group]);
            }
            builder = builder.with_batch_size(part.batch_rows).with_offset(part.offset);
            if let Some(limit) = part.limit {
                builder = builder.with_limit(limit);
            }
            builder.build().map(Self).map_err(text)
        })
    }
}

impl Iterator for Batches {
    type Item = Result<RecordBatch, String>;

    fn next(&mut self) -> Option<Self::Item> {
        guard(|| self.0.next().transpose().map_err(text)).transpose()
    }
}

/// SHA-256 of a file in hex, read a megabyte at a time; the file stands at its beginning again.
pub(crate) fn hash(file: &mut File) -> std::io::Result<String> {
    let mut hash = Sha256::new();
    let mut buffer = vec![0; 1 << 20];
    loop {
        let count = file.read(&mut buffer)?;
        if count == 0 {
            file.rewind()?;
            return Ok(crate::seal::hex(&hash.finalize()));
        }
        hash.update(&buffer[..count]);
    }
}

fn guard<T>(read: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| Err("the Parquet decoder panicked".to_owned()))
}

fn text(error: impl std::fmt::Display) -> String {
    error.to_string()
}

/// Names, types and nullability must be those of the table; descriptions may differ.
fn compare_schemas(expected: &Schema, found: &Schema) -> Result<(), String> {
    let names = |schema: &Schema| schema.fields().iter().map(|f| f.name().clone()).collect::<Vec<_>>();
    if names(expected) != names(found) {
        return Err(format!("columns must be {:?}, got {:?}", names(expected), names(found)));
    }
    for (a, b) in expected.fields().iter().zip(found.fields()) {
        if a.data_type() != b.data_type() || a.is_nullable() != b.is_nullable() {
            let null = |nullable| if nullable { " or null" } else { "" };
            return Err(format!(
                "column {} must be {}{}, got {}{}",
                a.name(),
                a.data_type(),
                null(a.is_nullable()),
                b.data_type(),
                null(b.is_nullable())
            ));
        }
    }
    Ok(())
}
