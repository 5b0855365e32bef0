//! Labelled grasps of one object that floats: what `graspmill objects annotate` makes.

use core::cmp::Reverse;
use std::sync::Arc;

use settings::words;

use crate::{Gripper, Outcome, Polyhedron, Pose, TriangleMesh, Vec3, are_alike};

/// The best grasps have tips that are further apart than this, or axes that are.
const APART_M: f32 = 0.02;
const APART_RAD: f32 = core::f32::consts::FRAC_PI_6;

words! {
    /// How a grasp of an object was drawn.
    pub enum GraspSource {
        /// Between two points that face each other within the cone of friction, so deep that the open gripper fits.
        Antipodal = "antipodal",
        /// Along the inward normal of a point (VGN).
        Normal = "normal",
        /// An antipodal grasp, moved by up to 30 mm and turned by up to 30 degrees.
        Displaced = "displaced",
        /// Given by somebody else.
        Given = "given",
    }
}

words! {
    /// What a floating object has to bear in the gripper to be held.
    pub enum GripTest {
        /// Its weight, as it hangs from a gripper that came from above.
        Lift = "lift",
        /// Its weight along each of the six directions of the gripper's axes: it is held whichever way is down.
        Turn = "turn",
        /// GraspDataGen's five pulls of 1 g for half a second: out of the gripper, and aslant to each side.
        Tug = "tug",
        /// To and fro along the approach by 40 mm to each side, then turned by 0.5 rad to each side about the closing
        /// direction through the gripper's base, two times a second, twice each: ACRONYM's directions, Newton's
        /// numbers.
        Shake = "shake",
    }
}

/// A labelled grasp, in the object's frame.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectGrasp {
    /// Grasp frame: +z approach, +y closing, origin midway between the tips.
    pub object_from_grasp: Pose,
    /// How it was drawn.
    pub source: GraspSource,
    /// How it ended; `held` if the object bore the test.
    pub outcome: Outcome,
    /// Distance between the fingers after closing, in metres.
    pub width_m: Option<f32>,
    /// Where the left (−y) and the right finger press, in metres.
    pub contacts_m: [Option<Vec3>; 2],
    /// The outward normals of the object there.
    pub normals: [Option<Vec3>; 2],
    /// How far the centre of mass moved while the gripper closed, in metres, and how far the object turned, in radians.
    pub closing: Option<(f32, f32)>,
    /// The same at the end of the test, against the closed fingers; of several loads the largest.
    pub test: Option<(f32, f32)>,
    /// How much it bears, if it was held and that was asked for.
    pub margins: Option<Margins>,
    /// How near the open gripper comes to the object, there and on its straight way, in metres: by so much its boxes
    /// could grow before they touch; below 0 how deep they are in it. Between -0.02 and 0.02.
    pub clearance_m: Option<f32>,
    /// How far the object was pushed aside, in metres, where the open gripper would touch it by little; `None` if it
    /// was not.
    pub pushed_m: Option<f32>,
    /// Of its repeats with errors of pose, friction, mass and force, whether it held or not, the share that held.
    pub p_held: Option<f32>,
    /// Whether the gripper stays off the table on its way to it, for each of the object's stable poses.
    pub is_free_on_table: Vec<bool>,
}

/// How much a grip bears before it gives way by 1 mm or 0.05 rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Margins {
    /// The smallest friction coefficient between finger and object at which it bears the object's weight in all six
    /// directions; `None` if it gives way under it with the friction that it has.
    pub friction_min: Option<f32>,
    /// The strongest pull that it bears in all six directions, in g; 0 below an eighth, 64 at most.
    pub tug_max_g: f32,
}

/// A pose in which an object stays on a table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StablePose {
    /// Table frame: z up, its top at z = 0; the object's frame is over its origin.
    pub table_from_object: Pose,
    /// Share of the drops that ended so.
    pub probability: f32,
}

/// An object with its labelled grasps.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectGrasps {
    /// The object's name.
    pub name: String,
    /// The file it was read from.
    pub file: String,
    /// Metres per unit of that file.
    pub scale_m: f64,
    /// What was guessed of the object, and what is unusual about it.
    pub warnings: Vec<String>,
    /// The gripper.
    pub gripper: Gripper,
    /// What it had to bear.
    pub test: GripTest,
    /// Mass in kilograms.
    pub mass_kg: f32,
    /// Friction coefficient; with the gripper's it makes that of a contact.
    pub friction: f32,
    /// Full lengths of its bounding box, in metres.
    pub extents_m: Vec3,
    /// Its convex parts.
    pub parts: Vec<Polyhedron>,
    /// Its mesh, if it has one.
    pub mesh: Option<Arc<TriangleMesh>>,
    /// Its centre of mass.
    pub centre_of_mass_m: Vec3,
    /// The grasps.
    pub grasps: Vec<ObjectGrasp>,
    /// Of the surface on which the open gripper can come and close, straight across a wall or the object, the share
    /// within 10 mm of a contact of a grasp that held.
    pub coverage: Option<f32>,
    /// How it can stand or lie, likeliest first.
    pub stable_poses: Vec<StablePose>,
}

impl ObjectGrasp {
    /// By which the weakest comes first: whether it held, the pull that it bears times the share of its repeats that
    /// held, and that share, as far as they are known. Bits of numbers that are not negative are in their order.
    #[must_use]
    pub fn strength(&self) -> [u64; 3] {
        let likely = f64::from(self.p_held.unwrap_or(1.0));
        let tug_g = self.margins.map_or(1.0, |margins| f64::from(margins.tug_max_g));
        [f64::from(self.outcome.label()), tug_g * likely, likely].map(f64::to_bits)
    }
}

impl ObjectGrasps {
    /// How many grasps ended so.
    #[must_use]
    pub fn count(&self, outcome: Outcome) -> usize {
        self.grasps.iter().filter(|grasp| grasp.outcome == outcome).count()
    }

    /// Keeps the strongest of the grasps that held, at most so many, strongest first, and none that is within 20 mm and
    /// 30° of a stronger one ([`ObjectGrasp::strength`]).
    pub fn keep_best(&mut self, most: usize) {
        let mut held: Vec<ObjectGrasp> = self.held().cloned().collect();
        held.sort_by_key(|grasp| Reverse(grasp.strength()));
        self.grasps.clear();
        for grasp in held {
            let pose = &grasp.object_from_grasp;
            let is_like = |kept: &ObjectGrasp| are_alike(&kept.object_from_grasp, pose, APART_M, APART_RAD);
            if self.grasps.len() < most && !self.grasps.iter().any(is_like) {
                self.grasps.push(grasp);
            }
        }
    }

    /// The grasps that held.
    pub fn held(&self) -> impl Iterator<Item = &ObjectGrasp> {
        self.grasps.iter().filter(|grasp| grasp.outcome == Outcome::Held)
    }
}
