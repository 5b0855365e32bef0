//! Batches, read ahead by a separate thread.

use std::ops::ControlFlow;
use std::sync::mpsc::sync_channel;

use super::grids::SpoolError;
use super::item::{GraspDataset, TrainingTransform};
use crate::batch::Batch;

/// Number of batches to read ahead.
const AHEAD: usize = 2;

/// Calls `visit` with the samples in batches of `batch`, in order, until it breaks; returns whether it did not break.
/// The next batches are read in the background.
///
/// # Errors
/// [`SpoolError`] if a grid cannot be read.
pub fn for_each_batch(
    dataset: &GraspDataset,
    samples: &[usize],
    batch: usize,
    visit: impl FnMut(Batch) -> ControlFlow<()>,
) -> Result<(), SpoolError> {
    read_ahead(samples.chunks(batch), |numbers| dataset.batch(numbers), visit)
}

/// Like [`for_each_batch`] for training samples, which are rotated and shifted on the reading thread.
///
/// # Errors
/// As [`for_each_batch`].
pub fn for_each_training_batch(
    dataset: &GraspDataset,
    samples: &[usize],
    batch: usize,
    transform: &TrainingTransform,
    visit: impl FnMut(Batch) -> ControlFlow<()>,
) -> Result<(), SpoolError> {
    read_ahead(samples.chunks(batch), |numbers| dataset.training_batch(numbers, transform), visit)
}

fn read_ahead<'a>(
    batches: impl Iterator<Item = &'a [usize]> + Send,
    read: impl Fn(&[usize]) -> Result<Batch, SpoolError> + Send,
    mut visit: impl FnMut(Batch) -> ControlFlow<()>,
) -> Result<(), SpoolError> {
    std::thread::scope(|scope| {
        let (sender, receiver) = sync_channel(AHEAD);
        scope.spawn(move || {
            for numbers in batches {
                if sender.send(read(numbers)).is_err() {
                    return; // the visitor stopped
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
