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
    /// How they are drawn.
    pub shares: GraspShares,
    /// What an object must bear to be held.
    pub test: GripTest,
    /// Whether to measure how much each grip bears.
    pub margins: bool,
    /// Repeats of a grasp that held, each moved: position and rotation by normal errors of these standard deviations
    /// along and about each axis.
    pub repeats: u32,
    /// In metres.
    pub position_error_m: f32,
    /// In radians.
    pub rotation_error_rad: f32,
    /// Drops that find an object's stable poses; 0 for none.
    pub drops: u32,
    /// Seed of every draw.
    pub seed: u64,
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
            shares: GraspShares { antipodal: 0.8, normal: 0.1, displaced: 0.1 },
            test: GripTest::Lift,
            margins: false,
            repeats: 0,
            position_error_m: 0.002,
            rotation_error_rad: 2.0_f32.to_radians(),
            drops: 100,
            seed: 1,
        }
    }
}
