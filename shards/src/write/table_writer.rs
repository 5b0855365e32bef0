//! Writes a Parquet file: the encoding of each column, and the constants that make the bytes equal on every machine.
//!
//! Measured with `benches/codecs.rs` on scenes of one to six views with 40³ voxels, half of them 0, in bytes per scene
//! and milliseconds for writing one: plain 264,274 (0.8 ms); zstd 1 43,635 (0.9); zstd 1 over BYTE_STREAM_SPLIT 33,310
//! (1.0); zstd 3 33,495 (1.1); zstd 6 32,163 (2.2); zstd 9 31,636 (2.8); dictionary 66,604 (2.2). Reading takes 0.7 to
//! 0.9 ms with every codec. On scenes from physics: plain 264,322; zstd 1 44,011; over BYTE_STREAM_SPLIT 38,340; zstd 9
//! 36,218. Higher levels cost more time than they save bytes; BYTE_STREAM_SPLIT costs nothing.

use arrow::RecordBatch;
use parquet::arrow::{ArrowSchemaConverter, ArrowWriter};
use parquet::basic::{Compression, Encoding, Type, ZstdLevel};
use parquet::errors::ParquetError;
use parquet::file::properties::{EnabledStatistics, WriterProperties, WriterVersion};
use program::{ExitCode, Failure};

use crate::Table;
use crate::format::column::Form;
use crate::format::layout;
use crate::format::summary::FileSummary;
use crate::store::{Ready, Staged, Storage, Trouble};

/// zstd level of every column.
const ZSTD_LEVEL: i32 = 1;

/// A table's file of one shard.
#[derive(Debug)]
pub(crate) struct TableWriter {
    table: Table,
    name: String,
    rows: u64,
    trouble: Trouble,
    parquet: ArrowWriter<Staged>,
}

impl TableWriter {
    pub(crate) fn create(
        storage: &Storage,
        table: Table,
        [shard, shard_count]: [u32; 2],
        form: Form,
    ) -> Result<Self, Failure> {
        let name = layout::table_file(table, shard, shard_count);
        let staged = storage.stage(&name)?;
        let trouble = staged.trouble();
        let parquet = ArrowWriter::try_new(staged, table.arrow_schema(form), Some(properties(table, form)?))
            .map_err(|e| broken(table, &trouble, &e))?;
        Ok(Self { table, name, rows: 0, trouble, parquet })
    }

    pub(crate) fn write(&mut self, batch: &RecordBatch) -> Result<(), Failure> {
        self.rows += batch.num_rows() as u64;
        self.parquet.write(batch).map_err(|e| broken(self.table, &self.trouble, &e))
    }

    /// Ends the row group.
    pub(crate) fn flush(&mut self) -> Result<(), Failure> {
        self.parquet.flush().map_err(|e| broken(self.table, &self.trouble, &e))
    }

    /// Writes the footer and flushes the file to the disk, without publishing it yet.
    pub(crate) fn finish(self) -> Result<(Ready, FileSummary), Failure> {
        let staged = self.parquet.into_inner().map_err(|e| broken(self.table, &self.trouble, &e))?;
        let ready = staged.finish()?;
        let summary =
            FileSummary { path: self.name, bytes: ready.bytes, rows: self.rows, sha256: ready.sha256.clone() };
        Ok((ready, summary))
    }
}

/// Floats have no dictionary, and grids no statistics.
fn properties(table: Table, form: Form) -> Result<WriterProperties, Failure> {
    let schema = ArrowSchemaConverter::new().convert(&table.arrow_schema(form)).map_err(|e| unwritten(table, &e))?;
    let level = ZstdLevel::try_new(ZSTD_LEVEL).map_err(|e| unwritten(table, &e))?;
    let mut builder = WriterProperties::builder()
        .set_created_by("graspmill format 1".to_owned()) // of every version, for the same bytes
        .set_writer_version(WriterVersion::PARQUET_1_0)
        .set_max_row_group_row_count(None) // the writer ends row groups: in all tables after the same scene
        .set_compression(Compression::ZSTD(level));
    for leaf in schema.columns().iter().filter(|leaf| leaf.physical_type() == Type::FLOAT) {
        let path = leaf.path();
        builder = builder
            .set_column_dictionary_enabled(path.clone(), false)
            .set_column_encoding(path.clone(), Encoding::BYTE_STREAM_SPLIT);
        if path.parts()[0] == "tsdf" {
            builder = builder.set_column_statistics_enabled(path.clone(), EnabledStatistics::None);
        }
    }
    Ok(builder.build())
}

/// The disk's error, if the disk caused it.
fn broken(table: Table, trouble: &Trouble, error: &ParquetError) -> Failure {
    trouble.get().cloned().unwrap_or_else(|| unwritten(table, error))
}

/// Columns that could not be made or written: a defect of the program.
pub(crate) fn unwritten(table: Table, error: &dyn std::fmt::Display) -> Failure {
    Failure::new(ExitCode::Internal, format!("failed to write {}: {error}", table.name()))
}
