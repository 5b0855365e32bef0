//! Parsing of outside bytes: depth images, grids, clouds, cameras, requests.
//!
//! Readers take bytes, not paths, so the command and the service share them. They treat the bytes as hostile: before
//! memory is allocated, a header is checked against the file's length and fixed limits, and a panic of a foreign
//! decoder becomes an error. Everything that can be checked without planning (units, rigidity, shapes) is checked here,
//! with the key's path in the message. The planner itself explains an empty scene.

mod assemble;
mod camera;
mod cloud;
mod color;
mod depth;
mod error;
mod file;
mod grey_png;
mod lens_file;
mod lists;
mod mask;
mod npy;
mod options;
mod request;
#[cfg(test)]
mod tests;
mod tsdf;

pub(crate) use assemble::decode_base64;
pub use assemble::{Request, assemble, from_file, from_json};
pub(crate) use camera::point;
pub use camera::{IntrinsicsInput, OrientationInput, PoseInput, PosePartsInput};
pub use color::read_color;
pub use depth::check_image;
pub use error::InputError;
pub(crate) use error::refuse;
pub use file::read_file;
pub use lens_file::{ReadLens, read_intrinsics};
pub(crate) use npy::each;
pub(crate) use options::options;
pub use options::options_from_json;
pub use request::{BoxInput, ConeInput, DataInput, RequestInput, SourceInput, ViewInput};
pub(crate) use request::{parse_json, parse_toml};
pub use tsdf::read_tsdf;
