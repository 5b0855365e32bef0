//! What the robot sees: cameras, depth images with sensor noise, and the truncated signed distance field (TSDF) made of
//! them.
//!
//! Training data, planning and experiments all use this crate, so all grids of a network are made in the same way. A
//! view is drawn ([`draw_views`]) and becomes a camera ([`camera_at`]). The camera's depth image, with noise from
//! [`add_depth_noise`] if configured, is fused into a [`Tsdf`], which is exported as a [`schema::VoxelGrid`]. Depth is
//! passed as a closure from pixel to metres, so this crate depends neither on the simulator nor on a camera driver.
//!
//! A camera that looks straight down at a bare table sees a surface where the table's top is:
//!
//! ```
//! use perception::{TRUNCATION_VOXELS, fuse_images, surface_cloud};
//! use schema::{Camera, DepthImage, Grid, Intrinsics, Pose, Vec3, axis_angle};
//!
//! let intrinsics = Intrinsics::VGN;
//! let eye = Vec3::new(0.15, 0.15, 0.55);
//! let down = Pose::from_parts(eye, axis_angle(Vec3::X, std::f32::consts::PI));
//! let camera = Camera { intrinsics, workspace_from_camera: down };
//! let (width_px, height_px) = (intrinsics.width_px, intrinsics.height_px);
//! let image = DepthImage { width_px, height_px, depth_m: vec![0.5; width_px * height_px] };
//! let tsdf = fuse_images(Grid::PAPER, TRUNCATION_VOXELS, &[(camera, &image)]);
//! let cloud = surface_cloud(&tsdf, 0.005);
//! assert!(!cloud.is_empty() && cloud.iter().all(|point| (point.z - 0.05).abs() < 1e-4));
//! ```
//!
//! For planning, the surface of a field becomes a cloud ([`surface_cloud`], [`normals`]). Then the table is found in
//! the cloud ([`find_plane`]), and the remaining points are clustered into objects ([`clusters`]). A map of heights
//! shows what stands apart ([`Pieces`]) and what is no thing: [`walls`], and what is [`Joined`] to something.

mod blocks;
mod cells;
mod cloud_view;
mod clusters;
mod fit;
mod fuse;
mod heights;
mod joined;
mod level;
mod noise;
mod normals;
mod plane;
mod rim;
mod seen;
mod sensor;
mod surface;
mod table;
mod tsdf;
mod views;
mod walls;

pub use blocks::{Field, SurfaceBlocks, mean_distance};
pub use cells::nearest;
pub use cloud_view::{NEAR_M, cloud_image, view_from};
pub use clusters::{ClusterParams, clusters};
pub use fuse::{COLUMNS_PX, Sights, fuse_images};
pub use heights::Pieces;
pub use joined::{Cut, Joined};
pub use level::{TableArea, depth_factor, table_around};
pub use noise::{DepthNoise, DexNoise, EdgeNoise, Loss, StereoNoise, add_depth_noise};
pub use normals::normals;
pub use plane::{FoundPlane, PlaneParams, find_plane};
pub use rim::Rim;
pub use seen::{ScaledView, SeenPoint, seen_above};
pub use sensor::{NoiseKind, Sensor, SensorParams};
pub use surface::{surface_beside, surface_cloud, surface_of_blocks, thinned};
pub use table::{Sides, TableCandidate, find_tables, upright};
pub use tsdf::{TRUNCATION_VOXELS, Tsdf};
pub use views::{ViewKind, camera_at, draw_kind, draw_views};
pub use walls::{Wall, walls};
