//! A table for programs in other languages: as a stream of Arrow's C interface, and as Parquet that old readers know.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::ops::Range;
use std::sync::Arc;

use arrow::ffi_stream::FFI_ArrowArrayStream;
use arrow::{RecordBatch, RecordBatchReader};
use arrow_schema::ArrowError;
use arrow_schema::SchemaRef;
use parquet::arrow::ArrowWriter;
use parquet::basic::Encoding;
use parquet::errors::ParquetError;
use program::Failure;

use crate::read::table_reader::{Batches, Part};
use crate::write::table_writer::properties;
use crate::{Dataset, Table};

/// Rows of a batch: of scenes, each a quarter of a megabyte, fewer.
const BATCH_ROWS: usize = 65_536;
const BATCH_SCENES: usize = 64;

fn part(table: Table, without: Option<&'static str>) -> Part<'static> {
    let batch_rows = if table == Table::Scenes { BATCH_SCENES } else { BATCH_ROWS };
    Part { batch_rows, without, ..Part::default() }
}

/// The union `ColumnOrder` of parquet.thrift with its first field, the order that all readers know. NaN is not stored,
/// and readers take no zero's sign for granted, so that the statistics are right by it, too.
const FIRST_ORDER: [u8; 3] = [0x1c, 0, 0];

/// A table's rows as Arrow's C stream.
pub type ArrowStream = FFI_ArrowArrayStream;

/// Shard after shard.
struct Shards {
    dataset: Arc<Dataset>,
    table: Table,
    without: Option<&'static str>,
    left: Range<u32>,
    open: Option<Batches>,
    schema: SchemaRef,
}

impl Iterator for Shards {
    type Item = Result<RecordBatch, ArrowError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(batch) = self.open.as_mut().and_then(Iterator::next) {
                return Some(batch.map_err(ArrowError::ParquetError));
            }
            let shard = self.left.next()?;
            match self.dataset.batches(shard, self.table, part(self.table, self.without)) {
                Ok(batches) => self.open = Some(batches),
                Err(failure) => return Some(Err(ArrowError::ExternalError(Box::new(failure)))),
            }
        }
    }
}

impl RecordBatchReader for Shards {
    fn schema(&self) -> SchemaRef {
        Arc::clone(&self.schema)
    }
}

impl Dataset {
    /// The rows of a table in some shards, in their order, read when they are asked for; scenes with their grids or
    /// without. A file's checksum is compared before it is decoded; whether each row keeps the rules is what
    /// [`crate::verify`] finds.
    ///
    /// # Errors
    /// [`Failure`] if there is no such shard.
    pub fn stream(self: &Arc<Self>, table: Table, shards: Range<u32>, grids: bool) -> Result<ArrowStream, Failure> {
        if let Some(last) = shards.clone().last() {
            self.scenes_of(last)?;
        }
        let without = (table == Table::Scenes && !grids).then_some("tsdf");
        let whole = table.arrow_schema(self.info().form());
        let kept = (0..whole.fields().len()).filter(|field| Some(whole.field(*field).name().as_str()) != without);
        let schema = whole.project(&kept.collect::<Vec<_>>()).unwrap_or_else(|_| whole.as_ref().clone());
        let dataset = Arc::clone(self);
        let rows = Shards { dataset, table, without, left: shards, open: None, schema: Arc::new(schema) };
        Ok(FFI_ArrowArrayStream::new(Box::new(rows)))
    }

    /// Writes a table of a shard as Parquet for old readers to an empty file. fastparquet does not know
    /// `BYTE_STREAM_SPLIT`, so floats are in the plain encoding; polars below 1.43 refuses a footer with the order of
    /// floats that parquet-rs names, `IEEE_754_TOTAL_ORDER`. The bytes are a pure function of the rows; a batch at a
    /// time is in memory.
    ///
    /// # Errors
    /// [`Failure`] if there is no such shard, its file is damaged, or `out` cannot be written.
    pub fn write_plain(&self, shard: u32, table: Table, mut out: &File) -> Result<(), Failure> {
        self.scenes_of(shard)?;
        let form = self.info().form();
        let failed = |error: ParquetError| match error {
            ParquetError::External(cause) => cause.downcast().map_or_else(io::Error::other, |cause| *cause),
            error => io::Error::other(error),
        };
        let properties = properties(table, form, Encoding::PLAIN)?;
        let mut parquet = ArrowWriter::try_new(out, table.arrow_schema(form), Some(properties)).map_err(failed)?;
        for batch in self.batches(shard, table, part(table, None))? {
            let batch = batch.map_err(|message| self.wrong(shard, table, &message))?;
            parquet.write(&batch).and_then(|()| parquet.flush()).map_err(failed)?;
        }
        let columns = parquet.close().map_err(failed)?.file_metadata().schema_descr().num_columns();
        // The footer ends with a union for each column, the end of the whole, the footer's length and the magic number.
        let orders = FIRST_ORDER.repeat(columns);
        out.seek(SeekFrom::End(-(orders.len() as i64 + 1 + 8)))?; // a few dozen columns
        Ok(out.write_all(&orders)?)
    }
}

#[cfg(test)]
mod tests {
    use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
    use parquet::basic::ColumnOrder;

    use super::*;

    /// Whether a file has what old readers refuse: an encoding, an order of columns; and its rows.
    fn read(file: File) -> ([bool; 2], Vec<RecordBatch>) {
        let builder = ParquetRecordBatchReaderBuilder::try_new(file).unwrap();
        let chunks = builder.metadata().row_groups().iter().flat_map(|group| group.columns());
        let is_split = chunks.flat_map(|chunk| chunk.encodings()).any(|one| one == Encoding::BYTE_STREAM_SPLIT);
        let orders = builder.metadata().file_metadata().column_orders().unwrap();
        let is_old = orders.iter().all(|order| matches!(order, ColumnOrder::TYPE_DEFINED_ORDER(_)));
        ([is_split, !is_old], builder.build().unwrap().collect::<Result<_, _>>().unwrap())
    }

    #[test]
    fn plain_tables_have_only_what_old_readers_know_and_the_same_rows() {
        let folder = tempfile::tempdir().unwrap();
        let info = crate::synthetic::info(3, 2, 58, 6);
        let draft = crate::Draft::begin(folder.path(), &info).unwrap();
        for shard in 0..info.shard_count {
            let mut writer = draft.shard(shard).unwrap();
            for scene in info.scenes_of(shard) {
                writer.push(&crate::synthetic::scene_rows(scene, info.seed, &info)).unwrap();
            }
            writer.commit().unwrap();
        }
        draft.finalize().unwrap();
        let dataset = Dataset::open(folder.path()).unwrap();
        for table in Table::ALL {
            let plain = tempfile::tempfile().unwrap();
            dataset.write_plain(1, table, &plain).unwrap();
            let own = File::open(folder.path().join(crate::layout::table_file(table, 1, 2))).unwrap();
            let (before, after) = (read(own), read(plain));
            assert_eq!((before.0, after.0), ([true; 2], [false; 2]), "{table:?}");
            assert_eq!(before.1, after.1, "{table:?}");
        }
    }
}
