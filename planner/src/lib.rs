//! From what a robot sees to ranked grasps: section 2.4 of the paper, on VGN's detection.
//!
//! # The map
//!
//! An [`Observation`] (depth images, a TSDF, a cloud) becomes a [`volume`]: the grid that the network reads and the surface as
//! points. The network's volumes become detections ([`mod@detect`]); the points fall into table and objects ([`mod@segment`]); each
//! detection gets its object and its place in the order ([`rank`]); [`hand`] turns it towards the wrist and looks whether
//! the way there is free, and [`refine`], beyond the paper, which way is better. [`Planner`] is the whole way and ends in a [`plan::Plan`], which [`answer`] tells as JSON,
//! [`picture`] draws and [`cloud_file`] writes for other programs.
//!
//! [`input`] reads what others wrote, [`serve`] does it all over HTTP, [`mod@bench`] measures.
//!
//! Everything is a pure function of the observation, the network and the [`config`]; how many threads there are changes no
//! bit.

pub mod answer;
pub mod bench;
pub mod cloud_file;
pub mod config;
pub mod demo;
pub mod detect;
pub mod hand;
pub mod input;
mod level;
mod observation;
pub mod picture;
pub mod plan;
mod planner;
pub mod rank;
pub mod refine;
pub mod segment;
pub mod serve;
pub mod volume;

pub use config::{Config, ConfigError, Policy};
pub use observation::{Observation, SeenView, Wishes};
pub use planner::{PlanError, Planner, PlannerError};
