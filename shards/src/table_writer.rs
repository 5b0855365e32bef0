//! A Parquet file being written: how each column is encoded, and the constants that keep the bytes the same on every
//! machine.
//!
//! Measured on scenes of three views (`cargo bench`-free, by `examples/codecs.rs`): see CHANGELOG for the numbers.

use arrow::array::RecordBatch;
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, Encoding, ZstdLevel};
use parquet::errors::ParquetError;
use parquet::file::properties::{EnabledStatistics, WriterProperties, WriterVersion};
use parquet::schema::types::ColumnPath;

use crate::column::{Kind, float_leaves};
use crate::store::{Ready, Staged, Store, StoreError};
use crate::summary::FileSummary;
use crate::{FormatVersion, Table, layout};

/// Why a table could not be written.
#[derive(Debug, thiserror::Error)]
pub enum TableError {
    /// The disk refused.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The columns could not be made or written.
    #[error("failed to write {table}: {message}", table = .table.name())]
    Write {
        /// The table.
        table: Table,
        /// What happened.
        message: String,
        /// Whether it was the disk.
        is_io: bool,
    },
}

/// zstd level of every column.
pub(crate) const ZSTD_LEVEL: i32 = 3;

/// A table's file of one shard.
pub(crate) struct TableWriter {
    table: Table,
    name: String,
    rows: u64,
    parquet: ArrowWriter<Staged>,
}

impl TableWriter {
    pub(crate) fn create(
        store: &Store,
        table: Table,
        [shard, shard_count]: [u32; 2],
        resolution: usize,
    ) -> Result<Self, TableError> {
        let name = layout::table_file(table, shard, shard_count);
        let staged = store.stage(&name)?;
        let parquet = ArrowWriter::try_new(staged, table.arrow_schema(resolution), Some(properties(table)?))
            .map_err(|e| broken(table, &e))?;
        Ok(Self { table, name, rows: 0, parquet })
    }

    pub(crate) fn write(&mut self, batch: &RecordBatch) -> Result<(), TableError> {
        self.rows += batch.num_rows() as u64;
        self.parquet.write(batch).map_err(|e| broken(self.table, &e))
    }

    /// Ends the row group.
    pub(crate) fn flush(&mut self) -> Result<(), TableError> {
        self.parquet.flush().map_err(|e| broken(self.table, &e))
    }

    /// Writes the footer and flushes the file to the disk, without giving it its name yet.
    pub(crate) fn finish(self) -> Result<(Ready, FileSummary), TableError> {
        let ready = self.parquet.into_inner().map_err(|e| broken(self.table, &e))?.finish()?;
        let summary =
            FileSummary { path: self.name, bytes: ready.bytes(), rows: self.rows, sha256: ready.sha256.clone() };
        Ok((ready, summary))
    }
}

fn properties(table: Table) -> Result<WriterProperties, TableError> {
    let level = ZstdLevel::try_new(ZSTD_LEVEL).map_err(|e| broken(table, &e))?;
    let mut builder = WriterProperties::builder()
        .set_created_by(format!("graspmill format {}", FormatVersion::CURRENT.number()))
        .set_writer_version(WriterVersion::PARQUET_1_0)
        .set_max_row_group_row_count(None) // row groups end where the writer says: all tables after the same scene
        .set_compression(Compression::ZSTD(level));
    for column in table.columns() {
        for path in float_leaves(column).into_iter().map(ColumnPath::new) {
            builder = builder
                .set_column_dictionary_enabled(path.clone(), false)
                .set_column_encoding(path.clone(), Encoding::BYTE_STREAM_SPLIT);
            if column.kind == Kind::Voxels {
                builder = builder.set_column_statistics_enabled(path, EnabledStatistics::None);
            }
        }
    }
    Ok(builder.build())
}

pub(crate) fn broken(table: Table, error: &ParquetError) -> TableError {
    let is_io = matches!(error, ParquetError::External(source) if source.downcast_ref::<std::io::Error>().is_some());
    TableError::Write { table, message: error.to_string(), is_io }
}
