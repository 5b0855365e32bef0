//! From shards to samples.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use network::GraspOrigin;
use network::judge::Crop;
use network::receptive_field::RESOLUTION;
use program::{ExitCode, Failure};
use rayon::prelude::*;
use schema::{AttemptRecord, Axis, Grid, ObjectRecord, Pose, SceneRows, ShapeKind, Vec3};
use shards::Dataset;

use crate::config::Targets;
use crate::loss::Closings;

use super::item::{HandRecord, Record, Scene};
use super::marks::{FAILED, HELD, HITS_TABLE, Marks, NO_SAMPLE, shard_of};

/// How a network sees grasps.
#[derive(Debug, Clone, Copy)]
pub enum Seen<'a> {
    /// In voxels.
    Voxels {
        /// Where the network has a grasp's origin.
        origin: GraspOrigin,
        /// Whether all attempts of a voxel are one sample.
        targets: Targets,
    },
    /// As hands, by a judge: those of the first dataset, then those of the next.
    Hands(&'a [Crop]),
}

/// The samples of some datasets, whose scenes are numbered on. In memory are two bits for each attempt, and the scenes
/// themselves only if they are few ([`Self::keep`]).
#[derive(Debug)]
pub struct GraspDataset<'a> {
    shards: Vec<Shard<'a>>,
    seen: Seen<'a>,
    /// For each shard the marks of its attempts.
    pub marks: Vec<Marks>,
    /// Number of attempts without a sample, because their grasp's origin is outside the grid.
    pub outside: u64,
    /// Every scene by its number, or none.
    pub(super) kept: BTreeMap<u32, Arc<Scene>>,
}

impl<'a> GraspDataset<'a> {
    /// Reads every attempt, but no grid, and marks how it ended. Shards are read in parallel; after a failed shard no
    /// later ones are read. Files are checked against the manifest's checksums. `scene_done` is called once per scene,
    /// from any thread. `seen` is how the network sees grasps.
    ///
    /// # Errors
    /// If a dataset cannot be read or trained on, or `stop` is set; the first error in the order of shards.
    pub fn survey(
        datasets: &'a [Dataset],
        seen: Seen<'a>,
        stop: &AtomicBool,
        scene_done: &(dyn Fn() + Sync),
    ) -> Result<Self, Failure> {
        let shards = Shard::all(datasets)?;
        let failed = AtomicUsize::new(usize::MAX); // the first shard that failed
        let survey = |(number, shard): (usize, &Shard<'_>)| {
            if failed.load(Ordering::Relaxed) < number {
                return Err(stopped()); // after the failure, so the result is not used
            }
            shard.survey(seen, stop, scene_done).inspect_err(|_| {
                failed.fetch_min(number, Ordering::Relaxed);
            })
        };
        let surveyed: Vec<Result<_, Failure>> = shards.par_iter().enumerate().map(survey).collect();
        let surveyed: Vec<(Marks, u64)> = surveyed.into_iter().collect::<Result<_, _>>()?;
        let outside = surveyed.iter().map(|(_, outside)| outside).sum();
        let marks = surveyed.into_iter().map(|(marks, _)| marks).collect();
        Ok(Self { shards, seen, marks, outside, kept: BTreeMap::new() })
    }

    /// Scene and attempt of every sample, ascending.
    pub fn ids(&self) -> impl Iterator<Item = (u32, u32)> {
        let of_scene = |marks: &'_ Marks, scene| {
            let own = marks.of_scene(scene).filter(|(_, mark)| *mark != NO_SAMPLE);
            own.map(|(attempt, _)| (scene, attempt)).collect::<Vec<_>>()
        };
        self.marks.iter().flat_map(move |marks| marks.scenes().flat_map(move |scene| of_scene(marks, scene)))
    }

    /// The place among all shards of the one that has a scene.
    pub(super) fn shard_of(&self, scene: u32) -> usize {
        shard_of(&self.marks, scene)
    }

    /// Reads some scenes of a shard, ascending.
    pub(super) fn read(
        &self,
        shard: usize,
        scenes: &[u32],
    ) -> Result<impl Iterator<Item = Result<Scene, Failure>>, Failure> {
        let (shard, seen) = (&self.shards[shard], self.seen);
        let wanted = scenes.iter().map(|scene| u64::from(scene - shard.first_scene)).collect();
        let rows = shard.dataset.some_scenes(shard.shard, wanted)?;
        Ok(rows.map(move |rows| rows.map(|rows| shard.scene(rows, seen))))
    }
}

/// An item is a scene with its samples, read alone.
impl burn_dataset::Dataset<Scene, Failure> for GraspDataset<'_> {
    fn get(&self, index: usize) -> Result<Scene, Failure> {
        let scene = index as u32; // below `len`
        let shard = &self.shards[self.shard_of(scene)];
        let rows = shard.dataset.read_scene(u64::from(scene - shard.first_scene))?;
        Ok(shard.scene(rows, self.seen))
    }

    fn len(&self) -> usize {
        self.marks.last().map_or(0, |last| last.scenes().end as usize)
    }
}

pub(super) fn stopped() -> Failure {
    Failure::new(ExitCode::TryAgain, "stopped by a signal while reading the dataset")
}

/// A shard of one of the datasets.
#[derive(Debug)]
struct Shard<'a> {
    dataset: &'a Dataset,
    shard: u32,
    /// The number that its dataset's first scene has among all.
    first_scene: u32,
    /// The same of its dataset's first attempt.
    first_attempt: u64,
    /// The same of its dataset's first hand.
    first_hand: usize,
}

impl<'a> Shard<'a> {
    /// All shards of some datasets.
    fn all(datasets: &'a [Dataset]) -> Result<Vec<Self>, Failure> {
        let (mut scenes, mut first_attempt, mut first_hand) = (0_u64, 0, 0);
        let mut shards = Vec::new();
        for dataset in datasets {
            let info = dataset.info();
            if info.grid.resolution != RESOLUTION {
                let has = info.grid.resolution;
                let text = format!("the network takes grids of {RESOLUTION}^3 voxels, the dataset has {has}^3");
                return Err(Failure::new(ExitCode::Config, text));
            }
            let first_scene = scenes as u32; // checked below
            let shard = |shard| Self { dataset, shard, first_scene, first_attempt, first_hand };
            shards.extend((0..info.shard_count).map(shard));
            first_hand += info.hands().len();
            scenes += info.scene_count;
            first_attempt += info.attempt_count;
            // Samples have four bytes for the number of their scene.
            if scenes > u64::from(u32::MAX) {
                let text = format!("at most {} scenes can be trained on, the data have {scenes}", u32::MAX);
                return Err(Failure::new(ExitCode::Config, text));
            }
        }
        Ok(shards)
    }

    /// Marks how its attempts ended, and counts those without a sample.
    fn survey(
        &self,
        seen: Seen<'_>,
        stop: &AtomicBool,
        scene_done: &(dyn Fn() + Sync),
    ) -> Result<(Marks, u64), Failure> {
        let info = self.dataset.info();
        let ids = info.scenes_of(self.shard);
        let attempts = ids.clone().map(|scene| info.attempts_of_scene(scene) as usize).sum();
        let scenes = self.first_scene + ids.start as u32..self.first_scene + ids.end as u32;
        let (mut marks, mut outside) = (Marks::new(scenes, info.attempts_per_scene as usize, attempts), 0);
        for attempts in self.dataset.attempts_by_scene(self.shard)? {
            if stop.load(Ordering::Relaxed) {
                return Err(stopped());
            }
            let Samples { records, hands, outside: own_outside } = self.samples(&attempts?, 0, seen);
            outside += own_outside;
            for (at, record) in records.iter().enumerate() {
                let mark = match hands.get(at) {
                    Some(hand) if hand.hits_table => HITS_TABLE,
                    _ if record.label == 1 => HELD,
                    _ => FAILED,
                };
                marks.set(record.scene, record.attempt, mark);
            }
            scene_done();
        }
        Ok((marks, outside))
    }

    fn scene(&self, SceneRows { scene, objects, attempts }: SceneRows, seen: Seen<'_>) -> Scene {
        let Samples { mut records, hands, .. } = self.samples(&attempts, scene.views.len(), seen);
        let opening_m_max = self.dataset.info().gripper.opening_m_max;
        for record in records.iter_mut().filter(|record| hands.is_empty() && record.label == 1) {
            // A damaged table may name an object that its scene does not have.
            let attempt = &attempts[record.attempt as usize];
            if let Some(object) = objects.get(attempt.object_id as usize) {
                record.closings = closings(&attempt.workspace_from_grasp, object, opening_m_max);
            }
        }
        Scene {
            number: self.first_scene + scene.scene_id as u32,
            first_attempt: self.first_attempt + scene.scene_id * u64::from(self.dataset.info().attempts_per_scene),
            grid: scene.tsdf.into(),
            records,
            hands,
        }
    }

    /// The samples of a scene with so many views.
    fn samples(&self, attempts: &[AttemptRecord], views: usize, seen: Seen<'_>) -> Samples {
        let numbered = |record: Record| Record { scene: self.first_scene + record.scene, ..record };
        let info = self.dataset.info();
        let (origin, targets) = match seen {
            Seen::Voxels { origin, targets } => (origin, targets),
            // A judge is asked about every hand, wherever its origin is.
            Seen::Hands(crops) => {
                let count = info.hands().len() as u64;
                let hand = |attempt: &AttemptRecord| {
                    let crop = self.first_hand + (attempt.scene_id % count) as usize;
                    HandRecord {
                        crop: crop as u16,
                        workspace_from_grasp: attempt.workspace_from_grasp,
                        views: views as u8,
                        outcome: attempt.outcome,
                        hits_table: crops[crop].hits_table(&attempt.workspace_from_grasp),
                    }
                };
                let hands = attempts.iter().map(hand).collect();
                let records = attempts.iter().map(|attempt| numbered(record(attempt, [0; 3], 0.0))).collect();
                return Samples { records, hands, outside: 0 };
            }
        };
        let samples = schema::samples_of(attempts);
        let inside = samples.iter().filter_map(|sample| at_voxel(sample, &info.grid, origin));
        let mut records: Vec<Record> = inside.map(numbered).collect();
        let outside = (samples.len() - records.len()) as u64;
        if targets == Targets::Voxel {
            records = one_per_voxel(records);
        }
        Samples { records, hands: Vec::new(), outside }
    }
}

/// The samples of a scene, and how many attempts are none.
struct Samples {
    records: Vec<Record>,
    hands: Vec<HandRecord>,
    outside: u64,
}

/// Of a scene's samples one for each voxel: the first that held, or else the first; by attempt.
fn one_per_voxel(mut records: Vec<Record>) -> Vec<Record> {
    records.sort_by_key(|record| (record.voxel, record.label == 0, record.attempt));
    records.dedup_by_key(|record| record.voxel);
    records.sort_by_key(|record| record.attempt);
    records
}

/// The sample of an attempt, or `None` if its grasp's origin is outside the grid.
fn at_voxel(attempt: &AttemptRecord, grid: &Grid, origin: GraspOrigin) -> Option<Record> {
    let voxel = origin.voxel_of(&attempt.workspace_from_grasp, grid)?;
    // Only a held object's width is a target.
    let width_m = attempt.width_m.filter(|_| attempt.label() == 1).unwrap_or(0.0);
    Some(record(attempt, voxel.map(|index| index as u8), width_m / grid.voxel_size_m()))
}

/// By which turns a hand holds its object as well: those about an axis of the object along which it approaches.
fn closings(workspace_from_grasp: &Pose, object: &ObjectRecord, opening_m_max: f32) -> Closings {
    let Some(solid) = object.shape.as_solid() else { return Closings::Half };
    let object_from_workspace = object.workspace_from_object.rotation.inverse();
    let along = |grasp_axis: Vec3| {
        let axis = object_from_workspace * (workspace_from_grasp.rotation * grasp_axis);
        Axis::ALL.into_iter().find(|own| own.of(axis).abs() > NEAR_COS)
    };
    let Some(approach) = along(Vec3::Z) else { return Closings::Half };
    let fits = |axis: Axis| axis.of(solid.extents_m) <= opening_m_max - FINGER_ROOM_M;
    let across = || Axis::ALL.into_iter().filter(|axis| *axis != approach).all(fits);
    match solid.kind {
        ShapeKind::Cylinder if approach == Axis::Z => Closings::Any,
        ShapeKind::Cuboid if along(Vec3::Y).is_some() && across() => Closings::Quarter,
        _ => Closings::Half,
    }
}

/// Cosine of the largest angle between an axis of the hand and the object's: 30°, three deviations of the paper's
/// tilts.
const NEAR_COS: f32 = 0.866;
/// How much wider than an object the fingers must open to go about it with a few degrees of tilt.
const FINGER_ROOM_M: f32 = 0.01;

fn record(attempt: &AttemptRecord, voxel: [u8; 3], width_voxels: f32) -> Record {
    Record {
        scene: attempt.scene_id as u32,
        attempt: attempt.attempt_id,
        voxel,
        rule: attempt.rule,
        label: attempt.label(),
        rotation: attempt.workspace_from_grasp.rotation.to_array(),
        closings: Closings::Half,
        width_voxels,
    }
}

#[cfg(test)]
mod tests {
    use schema::{Quat, Rule, Solid, axis_angle, pose_from_parts};

    use super::*;

    /// A box of 40 × 60 × 90 mm and cylinders, gripped along each axis with a few degrees of tilt.
    #[test]
    fn what_fits_between_the_fingers_may_be_gripped_by_more_turns() {
        let closings_of = |kind: ShapeKind, extents_m: [f32; 3], rotation: Quat| {
            let workspace_from_object = pose_from_parts(axis_angle(Vec3::X, 0.4), Vec3::splat(0.1));
            let object = ObjectRecord {
                scene_id: 0,
                object_id: 0,
                shape: Solid::new(kind, Vec3::from_array(extents_m)).unwrap().into(),
                mass_kg: 0.1,
                friction: 1.0,
                workspace_from_object,
            };
            let tilted = rotation * axis_angle(Vec3::Y, 0.2);
            closings(&(workspace_from_object * pose_from_parts(tilted, Vec3::ZERO)), &object, 0.08)
        };
        let (along_z, along_x) = (Quat::IDENTITY, axis_angle(Vec3::Y, core::f32::consts::FRAC_PI_2));
        let cuboid = |extents_m, rotation| closings_of(ShapeKind::Cuboid, extents_m, rotation);
        assert_eq!(cuboid([0.04, 0.06, 0.09], along_z), Closings::Quarter);
        assert_eq!(cuboid([0.04, 0.06, 0.09], along_x), Closings::Half, "90 mm are too broad");
        assert_eq!(cuboid([0.04, 0.075, 0.09], along_z), Closings::Half, "75 mm leave no room");
        assert_eq!(cuboid([0.04, 0.06, 0.09], axis_angle(Vec3::Z, 0.7)), Closings::Half, "over a corner");
        assert_eq!(cuboid([0.04, 0.06, 0.09], axis_angle(Vec3::X, 0.8)), Closings::Half, "over an edge");
        let cylinder = |rotation| closings_of(ShapeKind::Cylinder, [0.04, 0.04, 0.06], rotation);
        assert_eq!([cylinder(along_z), cylinder(along_x)], [Closings::Any, Closings::Half]);
        assert_eq!(closings_of(ShapeKind::TriPrism, [0.04, 0.06, 0.05], along_z), Closings::Half);
    }

    #[test]
    fn a_voxel_held_if_any_of_its_attempts_did() {
        let rule = Rule::of_the_paper()[0];
        let sample = |attempt: u32, x: u8, label: u8| Record {
            scene: 3,
            attempt,
            voxel: [x, 1, 2],
            rule,
            label,
            rotation: [0.0, 0.0, 0.0, 1.0],
            closings: Closings::Half,
            width_voxels: f32::from(label) * attempt as f32,
        };
        let all = [(0, 5, 0), (1, 9, 0), (2, 5, 1), (4, 9, 0), (5, 5, 1), (7, 0, 1), (8, 0, 0)];
        let records = all.map(|(attempt, x, label)| sample(attempt, x, label)).to_vec();
        let kept = one_per_voxel(records.clone());
        assert_eq!(kept, [records[1], records[2], records[5]]);
        for record in &records {
            let own: Vec<&Record> = kept.iter().filter(|kept| kept.voxel == record.voxel).collect();
            let any = records.iter().any(|other| other.voxel == record.voxel && other.label == 1);
            assert_eq!((own.len(), own[0].label), (1, u8::from(any)));
        }
    }
}
