//! Settings of the annotation of objects, and what is annotated.

use schema::{GripTest, Gripper, Vec3};
use serde::Serialize;

use crate::catalogue::CatalogueObject;

/// How grasps are drawn: shares of the tries.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct GraspShares {
    /// Between points that face each other.
    pub antipodal: f32,
    /// Along normals.
    pub normal: f32,
    /// Antipodal ones, displaced.
    pub displaced: f32,
}

/// Settings of the annotation of objects.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AnnotateParams {
    /// The gripper.
    pub gripper: Gripper,
    /// Grasps of an object: tried, or with `is_held_only` held.
    pub grasps: usize,
    /// Whether only grasps that hold are kept.
    pub is_held_only: bool,
    /// How many are kept in the end, the best that hold ([`schema::ObjectGrasps::keep_best`]); `None` for all. Given
    /// grasps are all kept.
    pub best: Option<u32>,
    /// How they are drawn.
    pub shares: GraspShares,
    /// What an object must bear to be held.
    pub test: GripTest,
    /// An object that the open gripper would touch on its way is pushed aside, at most so far, in metres; 0 for a
    /// collision, as in scenes.
    pub touch_m_max: f32,
    /// Whether to measure how much each grip bears.
    pub margins: bool,
    /// Most repeats of a grasp, with the errors below; 0 for none.
    pub repeats: u32,
    /// So many are enough where all of them end as the grasp itself did.
    pub repeats_min: u32,
    /// Errors of a grasp's position are normal, with this standard deviation along each axis, in metres …
    pub position_error_m: f32,
    /// … and those of its rotation with this one about each axis, in radians.
    pub rotation_error_rad: f32,
    /// The friction is one of these times as much …
    pub friction_factors: [f32; 2],
    /// … the object's mass one of these …
    pub mass_factors: [f32; 2],
    /// … and the force with which the gripper closes one of these.
    pub force_factors: [f32; 2],
    /// Drops that find an object's stable poses; 0 for none.
    pub drops: u32,
    /// Seed of every draw.
    pub seed: u64,
}

impl AnnotateParams {
    /// The gripper of each four repeats, and how many times as heavy the object is: of any two of friction, force and
    /// mass all four pairs (half of a factorial design).
    pub(super) fn repeated(&self) -> [(Gripper, f32); 4] {
        [[0, 0, 1], [1, 1, 1], [0, 1, 0], [1, 0, 0]].map(|[friction, force, mass]: [usize; 3]| {
            let mut gripper = self.gripper.clone();
            gripper.friction *= self.friction_factors[friction];
            gripper.finger_force_n *= self.force_factors[force];
            (gripper, self.mass_factors[mass])
        })
    }
}

/// An object to be annotated.
#[derive(Debug, Clone, PartialEq)]
pub struct Annotated {
    /// Body, mass and friction.
    pub object: CatalogueObject,
    /// The file it was read from.
    pub file: String,
    /// SHA-256 of that file in hex, if it is a mesh or a description.
    pub file_sha256: Option<String>,
    /// Metres per unit of that file.
    pub scale_m: f64,
    /// The origin of the body's frame in the frame in which grasps are given, which has the same axes.
    pub origin_m: Vec3,
    /// What was guessed of it, and what is unusual about it.
    pub warnings: Vec<String>,
}

impl Default for AnnotateParams {
    /// Those of `graspmill objects annotate`, with the built-in `parallel_jaw_80`.
    fn default() -> Self {
        Self {
            gripper: Gripper::from_toml(Gripper::BUILT_IN[0].1).expect("it is built in"),
            grasps: 2_000,
            is_held_only: false,
            best: None,
            shares: GraspShares { antipodal: 0.8, normal: 0.1, displaced: 0.1 },
            test: GripTest::Turn,
            touch_m_max: 0.003,
            margins: false,
            repeats: 4,
            repeats_min: 2,
            // Of a calibrated robot and a camera; of a robot's grasps whose poses are right to 5 mm, the share of 12
            // repeats so moved has an AUC of 0.65.
            position_error_m: 0.004,
            rotation_error_rad: 2.0_f32.to_radians(),
            friction_factors: [0.7, 1.3],
            mass_factors: [0.7, 1.4],
            force_factors: [0.8, 1.2],
            drops: 100,
            seed: 1,
        }
    }
}
