//! Reads Parquet files as hostile input. Bytes reach the decoder only after their checksum was verified. The file's
//! frame is checked first ([`Frame`]), because parquet-rs trusts most of it. A panic of the decoder becomes an error.

use std::cell::Cell;
use std::fs::File;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::{Arc, Once};

use arrow::RecordBatch;
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::{
    ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReader, ParquetRecordBatchReaderBuilder, RowSelection,
};
use program::{ExitCode, Failure};

use crate::format::frame::{Expected, Frame};

/// Prefix of an error that was a panic.
pub(crate) const PANICKED: &str = "the Parquet decoder panicked: ";

/// What zstd, which has an allocator of its own, says where memory ended.
const MEMORY_ENDED: [&str; 2] = ["null pointer when creating new context", "not enough memory"];

/// The rows and columns to read.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Part<'a> {
    /// Only these rows, ascending.
    pub(crate) rows: Option<&'a [usize]>,
    /// Omit the column of this name.
    pub(crate) without: Option<&'static str>,
    /// Rows per batch.
    pub(crate) batch_rows: usize,
}

/// Batches of a file, decoded on demand.
pub(crate) struct Batches(ParquetRecordBatchReader);

impl Batches {
    /// Opens a file with a verified checksum.
    pub(crate) fn open(file: File, expected: Expected, part: Part<'_>) -> Result<Self, String> {
        guard(|| {
            let frame = Frame::read(&file, expected)?;
            let columns = expected.table.columns(expected.form).into_iter().enumerate();
            let kept: Vec<usize> =
                columns.filter(|(_, c)| Some(c.name) != part.without).map(|(column, _)| column).collect();
            let metadata = frame.check_pages(&kept, part.rows.is_some())?;
            let options = ArrowReaderOptions::new().with_schema(expected.table.arrow_schema(expected.form));
            let metadata = ArrowReaderMetadata::try_new(Arc::new(metadata), options).map_err(text)?;
            let builder = ParquetRecordBatchReaderBuilder::new_with_metadata(file, metadata);
            let mask = ProjectionMask::roots(builder.parquet_schema(), kept);
            let mut builder = builder.with_projection(mask).with_batch_size(part.batch_rows);
            if let Some(rows) = part.rows {
                let ranges = rows.iter().map(|row| *row..*row + 1);
                builder =
                    builder.with_row_selection(RowSelection::from_consecutive_ranges(ranges, expected.rows as usize));
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

/// Converts a panic of the decoder to an error, without a message on stderr. After the check of the frame a panic is
/// still possible, for example for a run length of more than ten bytes, which is visible only after decompression.
pub(crate) fn guard<T>(read: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    static QUIET_HOOK: Once = Once::new();
    thread_local!(static IS_GUARDED: Cell<bool> = const { Cell::new(false) });
    QUIET_HOOK.call_once(|| {
        let hook = take_hook();
        set_hook(Box::new(move |panic| {
            if !IS_GUARDED.get() {
                hook(panic);
            }
        }));
    });
    IS_GUARDED.set(true);
    let caught = catch_unwind(AssertUnwindSafe(read));
    IS_GUARDED.set(false);
    caught.unwrap_or_else(|payload| {
        let text = payload.downcast_ref::<&str>().copied();
        let text = text.or_else(|| payload.downcast_ref::<String>().map(String::as_str));
        Err(format!("{PANICKED}{}", text.unwrap_or("no reason")))
    })
}

/// The failure of an error with its place: the file is damaged, unless memory ended, which says nothing about it.
pub(crate) fn undecoded(error: String) -> Failure {
    if MEMORY_ENDED.iter().any(|said| error.contains(said)) {
        Failure::new(ExitCode::TryAgain, format!("out of memory: {error}"))
    } else {
        Failure::new(ExitCode::Data, error)
    }
}

fn text(error: impl std::fmt::Display) -> String {
    error.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn where_memory_ends_the_file_is_not_called_damaged() {
        for said in ["zstd returned null pointer when creating new context", "Allocation error : not enough memory"] {
            let failure = undecoded(guard(|| -> Result<(), String> { panic!("{said}") }).unwrap_err());
            assert_eq!(failure.exit_code(), ExitCode::TryAgain, "{failure}");
            assert!(failure.to_string().starts_with("out of memory: "), "{failure}");
        }
        let failure = undecoded(guard(|| -> Result<(), String> { panic!("no such column") }).unwrap_err());
        assert_eq!(failure.exit_code(), ExitCode::Data, "{failure}");
    }
}
