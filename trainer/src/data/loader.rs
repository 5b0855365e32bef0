//! Batches, read ahead by a separate thread.

use std::io;
use std::ops::ControlFlow;
use std::sync::mpsc::sync_channel;

use super::item::{GraspDataset, TrainingTransform};
use crate::batch::Batch;

/// Number of batches to read ahead.
const AHEAD: usize = 2;

/// Calls `visit` with the samples in batches of `batch`, in order, until it breaks. The next batches are read in the
/// background. Those of training are changed by `transform`, on the reading thread.
///
/// # Errors
/// If a grid cannot be read.
pub fn for_each_batch(
    dataset: &GraspDataset,
    samples: &[usize],
    batch: usize,
    transform: Option<&TrainingTransform>,
    mut visit: impl FnMut(Batch) -> ControlFlow<()>,
) -> io::Result<()> {
    std::thread::scope(|scope| {
        let (sender, receiver) = sync_channel(AHEAD);
        std::thread::Builder::new().spawn_scoped(scope, move || {
            for numbers in samples.chunks(batch) {
                let batch = match transform {
                    None => dataset.batch(numbers),
                    Some(transform) => dataset.training_batch(numbers, transform),
                };
                if sender.send(batch).is_err() {
                    return; // the visitor stopped
                }
            }
        })?;
        for batch in receiver {
            if visit(batch?).is_break() {
                break;
            }
        }
        Ok(())
    })
}
