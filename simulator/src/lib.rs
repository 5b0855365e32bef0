//! The physics: objects that fall and stack, a gripper that grasps them, and a depth camera that observes them.
//!
//! Two engines are behind it: our own stepper, which datasets use, and rapier, the reference; no other crate uses
//! rapier. The interface is in the workspace frame: z up, metres, kilograms, seconds, explicit gravity. Most callers
//! need three things:
//!
//! - [`settle`] drops objects into a temporary box until they rest and returns their poses: a [`Scene`].
//! - [`AttemptWorld::execute`] executes one grasp of a free-floating parallel jaw in that scene and returns the
//!   outcome; [`AttemptWorld::execute_watched`] does the same and reports every step to a [`Watcher`].
//! - [`SceneRays`] casts the rays of a depth camera at the same faceted shapes that the physics uses, or at a mesh.
//!
//! An object's shape is a [`Body`]: one of the four solids, or a compound of convex parts, which [`convex_parts`] makes
//! of a mesh, and which may keep that mesh for cameras.
//!
//! Every result is a pure function of its arguments. A world is always rebuilt from poses, and nothing runs in parallel
//! inside a world.
//!
//! Two blocks fall on each other, and a gripper from above lifts the upper one:
//!
//! ```
//! use schema::{Gripper, Grid, Outcome, Physics, Pose, Procedure, SettleParams, ShapeKind, Solid, Vec3, axis_angle};
//! use simulator::{AttemptWorld, SceneObject, settle};
//!
//! let block = Solid::new(ShapeKind::Cuboid, Vec3::new(0.04, 0.06, 0.05)).expect("these are lengths");
//! let released = [0.1, 0.2].map(|z_m| SceneObject {
//!     body: block.into(),
//!     mass_kg: 0.06,
//!     friction: 1.0,
//!     workspace_from_object: Pose::from_translation(Vec3::new(0.15, 0.15, z_m)),
//! });
//! let physics = Physics::STANDARD;
//! let settled = settle(&physics, &SettleParams::STANDARD, &Grid::PAPER, &[], &released).expect("they come to rest");
//!
//! let gripper = Gripper::from_toml(Gripper::BUILT_IN[0].1).expect("it is built in");
//! let world = AttemptWorld::new(&physics, &gripper, &Procedure::PAPER, &settled.scene);
//! // The approach, +z of the grasp, points down; the fingers close along y, 20 mm below the block's top.
//! let workspace_from_grasp = Pose::from_parts(Vec3::new(0.15, 0.15, 0.13), axis_angle(Vec3::X, std::f32::consts::PI));
//! let execution = world.execute(&workspace_from_grasp, 1);
//! assert_eq!(execution.outcome, Outcome::Held);
//! assert!((execution.width_m.expect("it closed") - 0.06).abs() < 0.001);
//! ```

mod attempt;
mod bodies;
mod body;
mod convex_hull;
mod decompose;
mod depth;
mod engine;
mod faceted;
mod floating;
mod gate;
mod gripper;
mod load;
mod mass_scaling;
mod obstruction;
mod scene;
mod settle;
mod shortcuts;
mod stepper;
mod tested_part;
mod watch;

pub use attempt::{AttemptWorld, Execution};
pub use body::{Body, BodyError, Part, PartShape, bodies_of};
pub use convex_hull::convex_hull;
pub use decompose::{ConvexParts, PartsParams, convex_parts, few_cornered_hull, hull_volume_m3};
pub use depth::{SceneRays, ViewRays};
pub use floating::{Ending, FloatingWorld, Grip, Hold, Motion};
pub use gate::{Gate, Hit};
pub use load::{Load, Shake};
pub use obstruction::Obstruction;
pub use scene::{Scene, SceneObject};
pub use schema::{Physics, SettleParams};
pub use settle::{Settled, Unsettled, settle, settle_again};
pub use watch::{AttemptEvent, Moment, Phase, Watcher};
