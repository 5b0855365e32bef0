//! A table for programs in other languages: as a stream of Arrow's C interface.

use std::ops::Range;
use std::sync::Arc;

use arrow::ffi_stream::FFI_ArrowArrayStream;
use arrow::{RecordBatch, RecordBatchReader};
use arrow_schema::ArrowError;
use arrow_schema::SchemaRef;
use program::Failure;

use crate::read::table_reader::{Batches, Part};
use crate::{Dataset, Table};

/// Rows of a batch: of scenes, each a quarter of a megabyte, fewer.
const BATCH_ROWS: usize = 65_536;
const BATCH_SCENES: usize = 64;

fn part(table: Table, without: Option<&'static str>) -> Part<'static> {
    let batch_rows = if table == Table::Scenes { BATCH_SCENES } else { BATCH_ROWS };
    Part { batch_rows, without, ..Part::default() }
}

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
}
