//! The world: objects that fall and stack, a hand that grasps them, and what a depth camera sees of them.
//!
//! This is the only crate that knows rapier. What goes in and comes out is in the workspace: z up, metres, kilograms,
//! seconds, gravity set explicitly. The three things it does:
//!
//! - [`settle`] drops objects into a temporary box until they rest and gives their poses: a [`Scene`].
//! - [`AttemptWorld::execute`] lets a free-floating parallel jaw try one grasp in that scene and says how it ended;
//!   [`AttemptWorld::execute_watched`] does the same before the eyes of a [`Watcher`].
//! - [`SceneRays`] casts the rays of a depth camera at the very same faceted shapes that the physics feels.
//!
//! An object's shape is a [`Body`]: one of the four solids, or a [`Compound`] of convex parts, which [`convex_parts`] makes of
//! a mesh.
//!
//! Every result is a pure function of its arguments: worlds are rebuilt from poses, never carried over, and nothing
//! runs in parallel inside a world.

mod attempt;
mod body;
mod convex_hull;
mod decompose;
mod depth;
mod engine;
mod faceted;
mod gate;
mod hand;
mod hull;
mod obstruction;
mod scene;
mod settle;
mod shortcuts;
mod watch;

pub use attempt::{AttemptWorld, Execution};
pub use body::{Body, Compound, CompoundError, Convex, ModelError, Part, Piece, bodies_of};
pub use convex_hull::{ConvexHull, HullError};
pub use decompose::{ConvexParts, PartsLaw, convex_parts, few_cornered_hull, hull_volume_m3};
pub use depth::{SceneRays, ViewRays};
pub use engine::Physics;
pub use gate::{Gate, Hit};
pub use obstruction::Obstruction;
pub use scene::{Scene, SceneObject};
pub use settle::{Drop, SettleLaw, Settled, Unsettled, settle, settle_again};
pub use watch::{AttemptEvent, Contact, Moment, Phase, Toucher, Watcher};
