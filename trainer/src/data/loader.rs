//! Batches, read ahead by a thread of their own.

use std::ops::ControlFlow;
use std::sync::mpsc::sync_channel;

use super::grids::SpoolError;
use super::item::GraspDataset;
use crate::batch::Batch;

/// Batches that are read ahead.
const AHEAD: usize = 2;

/// Calls `visit` with the samples in batches of `batch`, in order, until it breaks; whether it did not. The next
/// batches are read meanwhile.
///
/// # Errors
/// [`SpoolError`] if a grid cannot be read.
pub fn for_each_batch(
    dataset: &GraspDataset,
    samples: &[usize],
    batch: usize,
    mut visit: impl FnMut(Batch) -> ControlFlow<()>,
) -> Result<(), SpoolError> {
    std::thread::scope(|scope| {
        let (sender, receiver) = sync_channel(AHEAD);
        scope.spawn(move || {
            for numbers in samples.chunks(batch) {
                if sender.send(dataset.batch(numbers)).is_err() {
                    return; // the visitor broke off
                }
            }
        });
        for batch in receiver {
            if visit(batch?).is_break() {
                break;
            }
        }
        Ok(())
    })
}
