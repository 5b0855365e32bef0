//! Planning: from observations to ranked grasps, by section 2.4 of the paper with VGN's detection.
//!
//! # Map
//!
//! An [`Observation`] (depth images, a TSDF, a cloud) becomes a [`volume`]: the grid for the network and the
//! surface as points. Candidates come from one of two methods: the detections of a network that answers for every
//! voxel ([`mod@voxel`]), or what a judge expects of proposed grasps. The points are segmented into table and
//! objects ([`mod@segment`]). Each candidate gets its object, what speaks against it ([`Doubt`]) and its rank
//! ([`rank`]), and each object its grasps (`objects.rs`). [`gripper_volume`] turns the grasp towards the wrist and
//! checks its way for collisions. [`Planner`] runs all stages and returns a [`plan::Plan`], which is printed as JSON.
//!
//! [`input`] reads files and requests, [`serve`] is the HTTP service.
//!
//! A plan is a pure function of the observation, the network and the [`config`]; the number of threads changes no bit.

pub mod config;
pub mod demo;
mod doubt;
mod frame;
pub mod gripper_volume;
pub mod input;
mod judge;
mod limits;
mod method;
mod mistake;
mod objects;
mod observation;
pub mod plan;
mod planner;
mod plausible;
pub mod rank;
mod region;
pub mod segment;
pub mod serve;
mod steady;
mod timing;
pub mod volume;
pub mod voxel;
mod width;

pub use config::{BuiltIn, Config, Policy};
pub use doubt::Doubt;
pub use frame::FoundTable;
pub use limits::WillDo;
pub use observation::{
    Ball, Cone, FindTable, Limits, Mask, Observation, PlanOptions, PoseKey, Target, View, WORKSPACE_M, plane,
};
pub use planner::Planner;
