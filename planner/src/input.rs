//! Parsing of outside bytes: depth images, grids, clouds, cameras, requests.
//!
//! Readers take bytes, not paths, so the command and the service share them. They treat the bytes as hostile: before
//! memory is allocated, a header is checked against the file's length and fixed limits, and a panic of a foreign
//! decoder becomes an error. Everything that can be checked without planning (units, rigidity, shapes) is checked here,
//! with the key's path in the message. The planner itself explains an empty scene.

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
pub use tsdf::read_tsdf;
