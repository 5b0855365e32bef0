//! What the robot sees: cameras, depth with a sensor's faults, and the truncated signed distance field (TSDF) made of it.
//!
//! Training data, planning and experiments all come through here, so a network is never shown a grid that was made in
//! another way than those it learned from. A view is drawn ([`draw_views`]) and becomes a camera ([`camera_at`]); what
//! the camera saw, spoiled by [`add_depth_noise`] if the config asks for it, is fused into a [`Tsdf`], which leaves as
//! a [`schema::VoxelGrid`]. Depth comes in through a closure from pixel to metres, so this crate knows neither the
//! simulator nor a camera driver.
//!
//! For planning, the surface of a field becomes a cloud ([`surface_cloud`], [`normals`]), the table is found in it ([`find_plane`]), and
//! what is left falls into objects ([`clusters`]).

mod cells;
mod cloud_view;
mod clusters;
mod noise;
mod normals;
mod plane;
mod surface;
mod tsdf;
mod views;

pub use cloud_view::{cloud_image, view_from};
pub use clusters::{ClusterLaw, clusters};
pub use noise::{DepthNoise, DexNoise, StereoNoise, add_depth_noise};
pub use normals::normals;
pub use plane::{FoundPlane, PlaneLaw, find_plane};
pub use surface::{surface_cloud, thinned};
pub use tsdf::{TRUNCATION_VOXELS, Tsdf};
pub use views::{ViewLaw, camera_at, draw_views};
