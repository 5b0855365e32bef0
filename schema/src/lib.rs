//! What a record means: grasps, outcomes, grids, cameras, the gripper; their units, frames and seeds.
//!
//! Every other crate speaks in these types. Nothing here does IO, and nothing here can fail except a constructor
//! that checks an invariant.
//!
//! # Frames
//!
//! - **workspace**: a cube, origin at a lower corner, z up; the table's top is at [`Grid::table_z_m`].
//! - **grid**: the workspace in voxels; voxel `(i, j, k)` has its centre at `(i + ½, j + ½, k + ½) · voxel_size_m`.
//! - **camera**: x right, y down, z forward.
//! - **object**: origin at the centre of the object's bounding box, axes along the shape's own ([`Solid`]).
//! - **grasp**: origin midway between the two finger tips, at their ends; +z approach, +y closing, x = y × z.
//!   A half turn about z is the same grasp.
//!
//! A transform is named `target_from_source`: `workspace_from_grasp * p_grasp = p_workspace`. Quaternions are xyzw.
//! SI units throughout; a name carries its unit (`width_m`, `tilt_rad`).
//!
//! ```
//! use schema::{Grid, Gripper, Pose, Vec3, axis_angle};
//!
//! // A grasp from straight above, with the finger tips 20 mm over the table.
//! let workspace_from_grasp = Pose::from_parts(Vec3::new(0.1, 0.1, 0.07), axis_angle(Vec3::X, std::f32::consts::PI));
//! let gripper = Gripper::from_toml(Gripper::BUILT_IN[0].1)?;
//! let roots = workspace_from_grasp * Vec3::new(0.0, 0.0, -gripper.finger_length_m);
//! assert!((roots.z - (Grid::PAPER.table_z_m + 0.02 + gripper.finger_length_m)).abs() < 1e-6);
//! # Ok::<(), settings::Error>(())
//! ```

mod camera;
mod container;
mod generation;
mod grasp;
mod grid;
mod gripper;
mod gripper_box;
mod grippers;
mod hull;
mod jaw;
mod law;
mod mass_integrals;
mod mesh;
mod model;
mod object_grasps;
mod outcome;
mod points;
mod polyhedron;
mod pose;
mod procedure;
mod record;
mod rule;
mod seed;
mod solid;
pub mod statistics;
mod surface;

pub use camera::{Camera, ColorImage, DepthImage, Intrinsics, View};
pub use container::{Container, ContainerKind};
pub use generation::{CameraParams, Engine, Physics, SettleParams, TsdfParams, ViewParams};
pub use grasp::{Grasp, are_alike};
pub use grid::{Grid, Lattice, VoxelGrid};
pub use gripper::{FingerTip, Gripper, Joint, PoseParts};
pub use gripper_box::GripperBox;
pub use grippers::{GRIPPERS_MAX, Grippers, gripper_of};
pub use jaw::{Jaw, JawBox, JawPath};
pub use law::{Drawn, Law, SLIDE_SHARE, TIP_DEPTH_M, Tilt, along_normal, law_of};
pub use mass_integrals::MassIntegrals;
pub use mesh::TriangleMesh;
pub use model::{CORNERS_MAX, MODELS_MAX, Model, ModelPart, NAME_MAX, ObjectShape, PARTS_MAX, Shape};
pub use object_grasps::{GraspSource, GripTest, Margins, ObjectGrasp, ObjectGrasps, StablePose};
pub use outcome::{Event, EventKind, HitKind, Outcome};
pub use points::samples_of;
pub use polyhedron::{Face, HullError, Polyhedron, bounds_m};
pub use pose::{Mat3, Pose, Quat, Vec2, Vec3, axis_angle, pose_from_parts};
pub use procedure::Procedure;
pub use record::{AttemptRecord, ObjectRecord, SceneRecord, SceneRejections, SceneRows};
pub use rule::{Approach, Axis, Rule};
pub use seed::{Purpose, Stream};
pub use solid::{FACETS, Plane, ShapeKind, Solid};
pub use surface::Surface;
