//! A table for programs in other languages: as a stream of Arrow's C interface.

use std::iter::once;
use std::ops::Range;
use std::sync::Arc;

use arrow::ffi_stream::FFI_ArrowArrayStream;
use arrow::{RecordBatch, RecordBatchIterator};
use arrow_schema::ArrowError;
use program::Failure;

use crate::read::table_reader::Part;
use crate::{Dataset, Table};

/// Rows of a batch: of scenes, each a quarter of a megabyte, fewer.
const BATCH_ROWS: usize = 65_536;
const BATCH_SCENES: usize = 64;

/// A table's rows as Arrow's C stream.
pub type ArrowStream = FFI_ArrowArrayStream;

/// A shard's batches, or why there are none.
type OfShard = Box<dyn Iterator<Item = Result<RecordBatch, ArrowError>> + Send>;

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
        let batch_rows = if table == Table::Scenes { BATCH_SCENES } else { BATCH_ROWS };
        let part = Part { batch_rows, without, ..Part::default() };
        let dataset = Arc::clone(self);
        let batches = shards.flat_map(move |shard| -> OfShard {
            match dataset.batches(shard, table, part) {
                Ok(batches) => Box::new(batches.map(|batch| batch.map_err(ArrowError::ParquetError))),
                Err(failure) => Box::new(once(Err(ArrowError::ExternalError(Box::new(failure))))),
            }
        });
        Ok(FFI_ArrowArrayStream::new(Box::new(RecordBatchIterator::new(batches, Arc::new(schema)))))
    }
}
