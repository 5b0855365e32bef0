//! Batches, read ahead by separate threads.

use std::io;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{Builder, Scope};

use program::{ExitCode, Failure};

use super::batches::batch;
use super::load::{GraspDataset, stopped};
use super::split_bits::NO_SAMPLE;
use crate::batch::{Batch, Scene, Scenes};
use crate::method::{Epoch, Method};
use crate::order::{LANES, SceneOrder, Step};

/// Number of batches to read ahead.
const AHEAD: usize = 2;
/// Number of scenes that each lane reads ahead: 256 MB in all, and most of a shard of 10,000 attempts.
const AHEAD_SCENES: usize = 128;

/// Calls `visit` with the batches of some steps and their sets, in order, until it breaks. Scenes are read in their
/// order, from place `start` on, each once. The next batches are read in the background. Those of training are
/// changed for an epoch, on the reading thread.
///
/// # Errors
/// If a scene cannot be read.
pub fn for_each_batch<M: Method>(
    dataset: &GraspDataset<'_, M>,
    order: &SceneOrder,
    start: usize,
    steps: impl Iterator<Item = Step> + Send,
    epoch: Option<&Epoch>,
    mut visit: impl FnMut(usize, Batch<M::Data>) -> ControlFlow<()>,
) -> Result<(), Failure> {
    std::thread::scope(|scope| {
        let mut window = Window::open(scope, dataset, order, start)?;
        let (sender, receiver) = sync_channel(AHEAD);
        Builder::new().spawn_scoped(scope, move || {
            for step in steps {
                let read = window.batch(step, epoch);
                let is_over = read.is_err();
                if sender.send(read).is_err() || is_over {
                    return; // the visitor stopped
                }
            }
        })?;
        for read in receiver {
            let (set, batch) = read?;
            if visit(set, batch).is_break() {
                break;
            }
        }
        Ok(())
    })
}

/// The scenes of an order that are in memory.
pub(super) struct Window<'a, M: Method> {
    order: &'a SceneOrder,
    dataset: &'a GraspDataset<'a, M>,
    lanes: Vec<Receiver<Result<Scene<M::Data>, Failure>>>,
    /// Scenes of the order that were read, and that were left behind.
    read: usize,
    left: usize,
    pub(super) open: Scenes<M::Data>,
}

impl<'a, M: Method> Window<'a, M> {
    /// Begins to read scenes, unless all are in memory.
    pub(super) fn open<'scope>(
        scope: &'scope Scope<'scope, 'a>,
        dataset: &'a GraspDataset<'a, M>,
        order: &'a SceneOrder,
        start: usize,
    ) -> io::Result<Self> {
        let mut lanes = Vec::new();
        for lane in (0..LANES).take_while(|_| dataset.kept.is_empty()) {
            let (sender, receiver) = sync_channel(AHEAD_SCENES);
            Builder::new().spawn_scoped(scope, move || read_lane(dataset, order, start, lane, &sender))?;
            lanes.push(receiver);
        }
        Ok(Self { order, dataset, lanes, read: start, left: start, open: dataset.kept.clone() })
    }

    /// Reads on until a scene is in memory.
    pub(super) fn reach(&mut self, scene: u32) -> Result<(), Failure> {
        while !self.open.contains_key(&scene) {
            let next = self.order.scenes.get(self.read).copied();
            let lane = next.map(|next| &self.lanes[self.order.lane(&self.dataset.marks, next)]);
            let (Some(next), Some(Ok(read))) = (next, lane.map(Receiver::recv)) else {
                return Err(Failure::new(ExitCode::Internal, format!("scene {scene} was not read")));
            };
            self.open.insert(next, Arc::new(read?));
            self.read += 1;
        }
        Ok(())
    }

    fn batch(&mut self, step: Step, epoch: Option<&Epoch>) -> Result<(usize, Batch<M::Data>), Failure> {
        step.samples.iter().try_for_each(|(scene, _)| self.reach(*scene))?;
        let batch = batch(&self.dataset.method, &self.open, step.samples, epoch);
        for scene in &self.order.scenes[self.left..step.done.max(self.left)] {
            self.open.remove(scene);
        }
        self.left = step.done.max(self.left);
        Ok((step.set, batch))
    }
}

/// Reads the scenes of a lane, a shard after another, until nobody wants them.
fn read_lane<M: Method>(
    dataset: &GraspDataset<'_, M>,
    order: &SceneOrder,
    start: usize,
    lane: usize,
    sender: &SyncSender<Result<Scene<M::Data>, Failure>>,
) {
    let own = order.scenes[start.min(order.scenes.len())..].iter().copied();
    let mut own = own.filter(|scene| order.lane(&dataset.marks, *scene) == lane).peekable();
    while let Some(first) = own.next() {
        let shard = dataset.shard_of(first);
        let scenes = dataset.marks[shard].scenes();
        let mut wanted = vec![first];
        wanted.extend(std::iter::from_fn(|| own.next_if(|scene| scenes.contains(scene))));
        let read = match dataset.read(shard, &wanted) {
            Ok(read) => read,
            Err(failure) => {
                let _ = sender.send(Err(failure)); // nobody may want it any more
                return;
            }
        };
        for scene in read {
            let is_over = scene.is_err();
            if sender.send(scene).is_err() || is_over {
                return;
            }
        }
    }
}

impl<M: Method> GraspDataset<'_, M> {
    /// Reads every scene that has a sample, to keep it: 256 kB each.
    ///
    /// # Errors
    /// If a scene cannot be read, or `stop` is set.
    pub fn keep(&mut self, stop: &AtomicBool, scene_done: &dyn Fn()) -> Result<(), Failure> {
        let order = SceneOrder::ascending(&self.marks, |mark| mark != NO_SAMPLE);
        self.kept = std::thread::scope(|scope| {
            let mut window = Window::open(scope, self, &order, 0)?;
            for scene in &order.scenes {
                window.reach(*scene)?;
                scene_done();
                if stop.load(Ordering::Relaxed) {
                    return Err(stopped());
                }
            }
            Ok(window.open)
        })?;
        Ok(())
    }
}
