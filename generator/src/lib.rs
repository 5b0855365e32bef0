//! Grasp datasets: config → random stacked scenes → candidates by the rules of Appendix A → attempts in physics →
//! shards.
//!
//! [`schema::law_of`] gives the distributions of a rule, one row of the paper's Appendix A. [`make_scene`] computes the
//! rows of one scene, as a pure function of config, seed and scene number. [`generate`] does this for all scenes of the
//! requested shards, on all cores, and commits each shard when it is complete.

mod annotate;
mod build;
mod candidates;
pub mod catalogue;
mod config;
mod containers;
mod dataset_info;
mod depth_images;
mod import;
mod measured;
mod mesh;
mod mesh_file;
mod mixture;
mod models;
mod normals;
mod objects;
mod packed;
mod policy;
pub mod recorder;
mod repeat;
mod replay;
mod robustness;
mod run;
#[cfg(any(test, fuzzing))]
mod tests;

pub use annotate::{
    AnnotateParams, Annotated, GraspReplay, GraspShares, PHYSICS, PROCEDURE, annotate, grasp_replays, relabel,
};
pub use build::{NoScene, Stage, make_scene, make_scene_watched};
pub use candidates::{Candidate, draw_candidate, draw_candidates};
pub use config::{Config, ObjectParams, Overrides, PackedParams, RuleClosing, Sampler};
pub use containers::{ContainerParams, container_faults, draw_container, room_m};
pub use dataset_info::{bodies_of, physics_of};
pub use depth_images::depth_images;
pub use import::{ImportParams, Imported, ImportedObject, LeftOut, Source, import_objects, sources};
pub use models::Models;
pub use objects::{draw_drops, draw_release};
pub use packed::draw_packed;
pub use policy::Policy;
pub use repeat::{Difference, Repeated, repeat};
pub use replay::{AttemptId, Replay, replay, replays};
pub use run::{Event, LOOK_SHARDS_MAX, REJECTED_SHARE_MAX, Report, attempts_of, generate};
#[cfg(any(test, fuzzing))]
pub use tests::fuzzing;
