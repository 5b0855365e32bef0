//! How an object stands or lies on a table: it is dropped many times, and drops that end alike are one pose.

use schema::{Grid, Physics, Pose, Purpose, SettleParams, StablePose, Stream, Vec3};
use simulator::{SceneObject, settle};

use crate::catalogue::CatalogueObject;

/// Poses in which down is within this angle (its cosine) in the object's frame are one.
const ALIKE_COS: f32 = 0.9848;
/// The object's lowest corner falls from so high.
const HEIGHT_M: f32 = 0.02;
/// Poses that are kept, at most.
const POSES_MAX: usize = 32;

/// The poses in which an object rests after `count` drops in random orientations, likeliest first. A drop after which
/// it does not come to rest counts for none.
pub(super) fn stable_poses(object: &CatalogueObject, seed: u64, count: u32) -> Vec<StablePose> {
    let radius_m = object.body.bounding_radius_m();
    let grid = Grid { size_m: (8.0 * radius_m).max(Grid::PAPER.size_m), ..Grid::PAPER };
    let mut found: Vec<(Vec3, Pose, u32)> = Vec::new();
    let mut stream = Stream::new(seed, 0, Purpose::Annotation, u32::MAX);
    for _ in 0..count {
        let rotation = stream.rotation();
        let lowest_m = object.body.vertices_m().iter().map(|c| (rotation * *c).z).fold(f32::INFINITY, f32::min);
        let middle = 0.5 * grid.size_m;
        let at_m = Vec3::new(middle, middle, grid.table_z_m + HEIGHT_M - lowest_m);
        let dropped = SceneObject {
            body: object.body.clone(),
            mass_kg: object.mass_kg,
            friction: object.friction,
            workspace_from_object: Pose::from_parts(at_m, rotation),
        };
        let Ok(settled) = settle(&Physics::STANDARD, &SettleParams::STANDARD, &grid, &[], &[dropped]) else { continue };
        let rested = settled.scene.objects[0].workspace_from_object;
        let down = rested.rotation.inverse() * -Vec3::Z;
        match found.iter_mut().find(|(known, ..)| known.dot(down) > ALIKE_COS) {
            Some((.., times)) => *times += 1,
            None => {
                let at_m = Vec3::new(0.0, 0.0, rested.translation.z - grid.table_z_m);
                found.push((down, Pose::from_parts(at_m, rested.rotation), 1));
            }
        }
    }
    found.sort_by_key(|(.., times)| core::cmp::Reverse(*times));
    found.truncate(POSES_MAX);
    let share = |times: u32| times as f32 / count as f32;
    found
        .into_iter()
        .map(|(_, table_from_object, times)| StablePose { table_from_object, probability: share(times) })
        .collect()
}
