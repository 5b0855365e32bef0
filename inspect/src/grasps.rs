//! Files of an object's labelled grasps: a table with everything, and what is said of the object. The package turns
//! them into the forms that other programs read.

mod given;
mod page;
mod stored;

use report::view::flat_points;
use schema::{ObjectGrasp, ObjectGrasps, Outcome, Pose, StablePose, Vec3};
use serde_json::{Value, json};
use shards::{PlainColumn, plain_table, pose_columns};

use program::Failure;

pub use given::given_grasps;
pub use page::browse_grasps;
pub use stored::{grasp_sets, read_grasp_set};

/// What the name of an object's table ends with.
pub(crate) const TABLE: &str = ".parquet";

/// The bytes of `NAME.parquet`: [`grasp_columns`].
///
/// # Errors
/// [`Failure`] if a library fails to write into memory.
pub fn grasps_table(set: &ObjectGrasps) -> Result<Vec<u8>, Failure> {
    plain_table(grasp_columns(set))
}

/// Everything that is known of the grasps, a row for each. `free_on_table` has bit n set if the gripper stays off
/// the table in the n-th stable pose.
#[must_use]
pub fn grasp_columns(set: &ObjectGrasps) -> Vec<(&'static str, PlainColumn)> {
    let grasps = &set.grasps;
    let poses: Vec<&Pose> = grasps.iter().map(|grasp| &grasp.object_from_grasp).collect();
    let real = |value: &dyn Fn(&ObjectGrasp) -> Option<f32>| PlainColumn::Real(grasps.iter().map(value).collect());
    let text =
        |value: fn(&ObjectGrasp) -> &str| PlainColumn::Text(grasps.iter().map(|g| value(g).to_owned()).collect());
    let whole = |value: &dyn Fn(&ObjectGrasp) -> u64| PlainColumn::Whole(grasps.iter().map(value).collect());
    let axis = |at: Option<Vec3>, axis: usize| at.map(|at| at.to_array()[axis]);
    let before = [
        ("grasp_id", PlainColumn::Whole((0..grasps.len() as u64).collect())),
        ("source", text(|g| g.source.name())),
        ("outcome", text(|g| g.outcome.name())),
        ("held", whole(&|g| u64::from(g.outcome.label()))),
    ];
    let mut columns: Vec<(&'static str, PlainColumn)> = before.into_iter().chain(pose_columns(&poses)).collect();
    columns.push(("width_m", real(&|g| g.width_m)));
    for (side, names) in CONTACTS.into_iter().enumerate() {
        for (number, name) in names.into_iter().enumerate() {
            let (of, along) = (number / 3, number % 3);
            let value = |g: &ObjectGrasp| axis(if of == 0 { g.contacts_m[side] } else { g.normals[side] }, along);
            columns.push((name, real(&value)));
        }
    }
    columns.extend([
        ("closing_moved_m", real(&|g| g.closing.map(|motion| motion.0))),
        ("closing_turned_rad", real(&|g| g.closing.map(|motion| motion.1))),
        ("test_moved_m", real(&|g| g.test.map(|motion| motion.0))),
        ("test_turned_rad", real(&|g| g.test.map(|motion| motion.1))),
        ("friction_min", real(&|g| g.margins?.friction_min)),
        ("tug_max_g", real(&|g| g.margins.map(|margins| margins.tug_max_g))),
        ("p_held", real(&|g| g.p_held)),
        ("clearance_m", real(&|g| g.clearance_m)),
        ("pushed_m", real(&|g| g.pushed_m)),
        ("free_on_table", whole(&free_poses)),
        ("free_on_table_share", real(&|g| free_share(g, &set.stable_poses))),
    ]);
    columns
}

/// Columns of the left finger, then of the right: where it presses, and the object's normal there.
pub(super) const CONTACTS: [[&str; 6]; 2] = [
    ["left_x_m", "left_y_m", "left_z_m", "left_normal_x", "left_normal_y", "left_normal_z"],
    ["right_x_m", "right_y_m", "right_z_m", "right_normal_x", "right_normal_y", "right_normal_z"],
];

fn free_poses(grasp: &ObjectGrasp) -> u64 {
    grasp.is_free_on_table.iter().enumerate().map(|(number, is_free)| u64::from(*is_free) << number).sum()
}

/// How likely an object lies so that the gripper stays off the table; none if its poses are not known.
pub(super) fn free_share(grasp: &ObjectGrasp, poses: &[StablePose]) -> Option<f32> {
    let known: f32 = poses.iter().map(|pose| pose.probability).sum();
    let free = poses.iter().zip(&grasp.is_free_on_table).filter(|(_, is_free)| **is_free);
    let free: f32 = free.map(|(pose, _)| pose.probability).sum();
    // The sum of nothing is -0.
    (known > 0.0).then(|| free.max(0.0) / known)
}

/// What is said of an object beside its grasps, as `NAME.json` has it.
#[must_use]
pub fn grasps_info(set: &ObjectGrasps) -> Value {
    let outcomes = Outcome::ALL.map(|outcome| (outcome.name().to_owned(), json!(set.count(outcome))));
    let outcomes: serde_json::Map<String, Value> = outcomes.into_iter().collect();
    let shares: Vec<f32> = set.grasps.iter().filter_map(|grasp| grasp.p_held).collect();
    let pose = |stable: &StablePose| {
        let Pose { translation, rotation, .. } = stable.table_from_object;
        json!({
            "probability": stable.probability,
            "position_m": translation.to_array(),
            "quaternion_xyzw": rotation.to_array(),
        })
    };
    json!({
        "object": {
            "name": set.name,
            "file": set.file,
            "scale_m": set.scale_m,
            "extents_m": set.extents_m.to_array(),
            "centre_of_mass_m": set.centre_of_mass_m.to_array(),
            "parts_m": set.parts.iter().map(|part| flat_points(part.corners_m().iter().copied())).collect::<Vec<_>>(),
            "mesh": set.mesh,
            "mass_kg": set.mass_kg,
            "friction": set.friction,
            "warnings": set.warnings,
        },
        "test": set.test.name(),
        "gripper": set.gripper,
        "base_to_tips_m": set.gripper.base_to_tips_m(),
        "grasps": set.grasps.len(),
        "outcomes": outcomes,
        "pushed": set.grasps.iter().filter(|grasp| grasp.pushed_m.is_some()).count(),
        "p_held": (!shares.is_empty()).then(|| shares.iter().sum::<f32>() / shares.len() as f32),
        "coverage": set.coverage,
        "stable_poses": set.stable_poses.iter().map(pose).collect::<Vec<_>>(),
    })
}
