//! Monitoring of a run: TensorBoard events. Failures cause warnings, and training continues.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use crate::events::Event;
use crate::tensorboard::{Events, FOLDER};

/// A monitored run.
pub(crate) struct Watch {
    run: PathBuf,
    checkpoint_every_steps: u32,
    /// None before training begins, and after a failure.
    events: Mutex<Option<Events>>,
}

impl Watch {
    pub(crate) fn new(run: &Path, checkpoint_every_steps: u32) -> Self {
        Self { run: run.to_owned(), checkpoint_every_steps, events: Mutex::new(None) }
    }

    /// Handles an event.
    pub(crate) fn see(&self, event: &Event<'_>) {
        match event {
            Event::Loading(_) | Event::SceneLoaded | Event::NoBetter(_) => {}
            Event::Begun(beginning) => {
                let folder = self.run.join(FOLDER);
                let place = (beginning.progress.step, beginning.progress.epoch);
                let begun = Events::begin(&folder, self.checkpoint_every_steps, place);
                *self.events.lock().unwrap_or_else(PoisonError::into_inner) = warned(begun);
            }
            Event::Step { step, loss, .. } => self.keep(|events| events.step(*step, *loss)),
            Event::Epoch(report) => self.keep(|events| events.epoch(report)),
        }
    }

    fn keep(&self, write: impl FnOnce(&mut Events) -> std::io::Result<()>) {
        let mut events = self.events.lock().unwrap_or_else(PoisonError::into_inner);
        let written = events.as_mut().map_or(Ok(()), write);
        if warned(written).is_none() {
            *events = None;
        }
    }
}

fn warned<T>(outcome: std::io::Result<T>) -> Option<T> {
    outcome.inspect_err(|error| tracing::warn!("TensorBoard events are no longer written: {error}")).ok()
}
