//! Everything that turns outside bytes into something to plan on: depth images, grids, clouds, cameras, requests.
//!
//! Readers take bytes, not paths, so that the command and the service share them, and take the bytes for hostile: a
//! header is believed only as far as the file's length and fixed limits allow, before memory is taken; what a decoder
//! of others panics on is an error like any other. What can be judged without planning (units, rigidity, shapes) is
//! judged here, with the key's path in the message; an empty scene is for the planner to explain.

mod assemble;
mod camera;
mod cloud;
mod depth;
mod error;
mod exr_image;
mod file;
mod lists;
mod lzf;
#[cfg(test)]
mod mutations;
mod npy;
mod pcd;
mod ply;
mod request;
mod row;
mod tsdf;

pub use assemble::{Request, assemble, wishes};
pub use camera::{IntrinsicsInput, OrientationInput, PoseInput, PosePartsInput, intrinsics, orientation, pose};
pub use cloud::{POINTS_MAX, ReadCloud, read_cloud};
pub use depth::{DepthFormat, ReadDepth, SIDE_PX_MAX, judge_depth, read_depth};
pub use error::InputError;
pub use file::read_file;
pub use npy::{Npy, NpyNumber, read_npy, write_npy_f32};
pub(crate) use request::parse_toml;
pub use request::{DataInput, RequestInput, SourceInput, ViewInput, from_file, from_json, parse_file};
pub use row::{ReadRow, read_row};
pub use tsdf::read_tsdf;
