//! Labelled grasps of objects alone: each is drawn on the object's surface, executed on the object as it floats, and, if
//! it holds, asked how much it bears.
//!
//! A set is a pure function of the object and the settings. Grasps are numbered, and each is tried on its own, so
//! neither threads nor an interruption change anything.

mod draw;
mod stable;
mod surface;

use core::f32::consts::PI;

use rayon::prelude::*;
use schema::{
    GraspSource, GripTest, Gripper, Margins, ObjectGrasp, ObjectGrasps, Outcome, Physics, Pose, Procedure, Purpose,
    Quat, StablePose, Stream, Vec3, axis_angle, pose_from_parts,
};
use serde::Serialize;
use simulator::{FloatingWorld, Grip, Hold, Load, Motion, Shake};

use self::draw::{Draw, Supply};
use self::stable::stable_poses;
use self::surface::Surface;
use crate::catalogue::CatalogueObject;

/// Grasps are tried this many at a time, on all cores.
const CHUNK: usize = 1_024;
/// Points that measure what is covered, and how near a contact must be.
const COVERAGE_NUMBERS: u64 = 4_000;
const COVERED_M: f32 = 0.01;
/// Standard gravity, in m/s².
const G_M_S2: f32 = 9.806_65;
/// An object is held if it stays so near to where it was gripped: half a lift, as in scenes.
const HOLD: Hold = Hold { moved_m_max: 0.05, turned_rad_max: PI };
/// A grip gives way when the object moves further.
const TIGHT: Hold = Hold { moved_m_max: 0.002, turned_rad_max: 0.1 };
/// How long a pull lasts, in seconds.
const LIFT_S: f32 = 0.25;
const MARGIN_S: f32 = 0.2;
/// Pulls between which the strongest is looked for, in g, by so many halvings: within 3 %.
const TUG_G: [f32; 2] = [0.125, 64.0];
const TUG_HALVINGS: u32 = 8;
/// Shares of the friction between which the smallest is looked for: within a hundredth of it.
const FRICTION_HALVINGS: u32 = 7;

/// How grasps are drawn: shares of the tries.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct GraspShares {
    /// Between points that face each other.
    pub antipodal: f32,
    /// Along normals.
    pub normal: f32,
    /// Antipodal ones, displaced.
    pub displaced: f32,
}

/// Settings of the annotation of objects.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AnnotateParams {
    /// The hand.
    pub gripper: Gripper,
    /// Grasps of an object: tried, or with `is_held_only` held.
    pub grasps: usize,
    /// Whether only grasps that hold are kept.
    pub is_held_only: bool,
    /// How they are drawn.
    pub shares: GraspShares,
    /// What an object must bear to be held.
    #[serde(serialize_with = "by_name")]
    pub test: GripTest,
    /// Whether to measure how much each grip bears.
    pub margins: bool,
    /// Repeats of a grasp that held, each moved: position and rotation by normal errors of these standard deviations
    /// along and about each axis.
    pub repeats: u32,
    /// In metres.
    pub position_error_m: f32,
    /// In radians.
    pub rotation_error_rad: f32,
    /// Drops that find an object's stable poses; 0 for none.
    pub drops: u32,
    /// Seed of every draw.
    pub seed: u64,
}

fn by_name<S: serde::Serializer>(test: &GripTest, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(test.name())
}

/// An object to be annotated.
#[derive(Debug, Clone, PartialEq)]
pub struct Annotated {
    /// Body, mass and friction.
    pub object: CatalogueObject,
    /// The file it was read from.
    pub file: String,
    /// Metres per unit of that file.
    pub scale_m: f64,
    /// The origin of the body's frame in the frame in which grasps are given, which has the same axes.
    pub origin_m: Vec3,
}

impl Default for AnnotateParams {
    /// Those of `graspmill objects annotate`, with the built-in `parallel_jaw_80`.
    fn default() -> Self {
        Self {
            gripper: Gripper::from_toml(Gripper::BUILT_IN[0].1).expect("it is built in"),
            grasps: 2_000,
            is_held_only: false,
            shares: GraspShares { antipodal: 0.8, normal: 0.1, displaced: 0.1 },
            test: GripTest::Lift,
            margins: false,
            repeats: 0,
            position_error_m: 0.002,
            rotation_error_rad: 2.0_f32.to_radians(),
            drops: 100,
            seed: 1,
        }
    }
}

/// Draws and labels the grasps of an object. `on_grasps` is told how many there are by now; where it says no, the work
/// is given up, and there is no set.
///
/// There are fewer than were asked for if the object has not so many that the hand can close on.
#[must_use]
pub fn annotate(
    annotated: &Annotated,
    params: &AnnotateParams,
    on_grasps: &mut dyn FnMut(usize) -> bool,
) -> Option<ObjectGrasps> {
    let surface = Surface::of(&annotated.object.body);
    let bench = Bench::new(annotated, params, &surface);
    let world = bench.world();
    let draw = Draw { params, world: &world, surface: &surface, friction: bench.friction };
    let mut supply = Supply::new(&draw);
    let mut grasps = Vec::new();
    while grasps.len() < params.grasps {
        let wanted = if params.is_held_only { CHUNK } else { CHUNK.min(params.grasps - grasps.len()) };
        let drawn = supply.next(wanted);
        if drawn.is_empty() {
            break;
        }
        let label = |(number, pose, source): &(u64, Pose, GraspSource)| bench.labelled(&world, *number, *pose, *source);
        let tried: Vec<Option<ObjectGrasp>> = drawn.par_iter().map(label).collect();
        grasps.extend(tried.into_iter().flatten());
        if !on_grasps(grasps.len().min(params.grasps)) {
            return None;
        }
    }
    grasps.truncate(params.grasps);
    let coverage = bench.coverage(&draw, &grasps);
    Some(bench.set(grasps, coverage))
}

/// Labels given grasps of an object, in their order; poses are in the frame in which grasps are given.
#[must_use]
pub fn relabel(annotated: &Annotated, params: &AnnotateParams, object_from_grasps: &[Pose]) -> ObjectGrasps {
    let params = &AnnotateParams { is_held_only: false, ..params.clone() };
    let surface = Surface::of(&annotated.object.body);
    let bench = Bench::new(annotated, params, &surface);
    let world = bench.world();
    let draw = Draw { params, world: &world, surface: &surface, friction: bench.friction };
    let label = |(number, pose): (usize, &Pose)| {
        let in_body = Pose::from_parts(pose.translation - annotated.origin_m, pose.rotation);
        bench.labelled(&world, number as u64, in_body, GraspSource::Given)
    };
    let grasps: Vec<ObjectGrasp> = object_from_grasps.par_iter().enumerate().filter_map(label).collect();
    let coverage = bench.coverage(&draw, &grasps);
    bench.set(grasps, coverage)
}

/// Everything that labels the grasps of one object.
struct Bench<'a> {
    annotated: &'a Annotated,
    params: &'a AnnotateParams,
    surface: &'a Surface,
    loads: Vec<Load>,
    stable: Vec<StablePose>,
    /// Of a contact between finger and object.
    friction: f32,
}

/// The settings of every floating world.
static PHYSICS: Physics = Physics::STANDARD;
static PROCEDURE: Procedure = Procedure::PAPER;

impl<'a> Bench<'a> {
    fn new(annotated: &'a Annotated, params: &'a AnnotateParams, surface: &'a Surface) -> Self {
        let stable = stable_poses(&annotated.object, params.seed, params.drops);
        let friction = params.gripper.friction * annotated.object.friction;
        Self { annotated, params, surface, loads: loads(params), stable, friction }
    }

    fn world(&self) -> FloatingWorld<'a> {
        let CatalogueObject { body, mass_kg, friction, .. } = &self.annotated.object;
        FloatingWorld::new(&PHYSICS, &self.params.gripper, &PROCEDURE, (body, *mass_kg, *friction))
    }

    /// A grasp with everything that is asked about it; `None` if only those that hold are kept and it does not.
    fn labelled(&self, world: &FloatingWorld<'_>, number: u64, pose: Pose, source: GraspSource) -> Option<ObjectGrasp> {
        let closed = world.close(&pose);
        let mut grasp = ObjectGrasp {
            object_from_grasp: self.given(&pose),
            source,
            outcome: Outcome::Slipped,
            width_m: None,
            contacts_m: [None; 2],
            normals: [None; 2],
            closing: None,
            test: None,
            margins: None,
            robust_share: None,
            is_free_on_table: Vec::new(),
        };
        match &closed {
            Err(execution) => (grasp.outcome, grasp.width_m) = (execution.outcome, execution.width_m),
            Ok(grip) => {
                let (is_held, test) = self.bears(grip);
                let contacts_m = grip.contacts_m();
                grasp.width_m = Some(grip.width_m());
                grasp.normals = contacts_m.map(|at_m| Some(self.surface.normal_at(at_m?)));
                grasp.contacts_m = contacts_m.map(|at_m| Some(at_m? + self.annotated.origin_m));
                (grasp.closing, grasp.test) = (Some(pair(grip.closing())), Some(pair(test)));
                if is_held {
                    grasp.outcome = Outcome::Held;
                    grasp.margins = self.params.margins.then(|| self.margins(grip));
                    grasp.robust_share = self.robust_share(world, number, &pose);
                }
            }
        }
        if self.params.is_held_only && grasp.outcome != Outcome::Held {
            return None;
        }
        grasp.is_free_on_table = self.stable.iter().map(|stable| self.is_free(stable, &pose)).collect();
        Some(grasp)
    }

    /// A pose in the frame in which grasps are given.
    fn given(&self, object_from_grasp: &Pose) -> Pose {
        Pose::from_parts(object_from_grasp.translation + self.annotated.origin_m, object_from_grasp.rotation)
    }

    /// Whether a grip bears all loads, and the largest motion.
    fn bears(&self, grip: &Grip<'_>) -> (bool, Motion) {
        let mut most = Motion::default();
        for load in &self.loads {
            let ending = grip.bear(load, &HOLD, 1.0);
            most.moved_m = most.moved_m.max(ending.motion.moved_m);
            most.turned_rad = most.turned_rad.max(ending.motion.turned_rad);
            if !ending.is_held {
                return (false, most);
            }
        }
        (true, most)
    }

    fn margins(&self, grip: &Grip<'_>) -> Margins {
        let pull =
            |direction: Vec3, g: f32| Load::Pull { acceleration_m_s2: direction * (g * G_M_S2), time_s: MARGIN_S };
        // The least over the directions: one that bears as much as the weakest so far needs no search.
        let [weakest_g, strongest_g] = TUG_G;
        let (mut tug_max_g, mut friction) = (strongest_g, 0.0_f32);
        for direction in sides() {
            let bears = |g: f32| grip.bear(&pull(direction, g), &TIGHT, 1.0).is_held;
            if bears(tug_max_g) {
                continue;
            }
            if !bears(weakest_g) {
                tug_max_g = 0.0;
                break;
            }
            let (mut low, mut high) = (weakest_g, tug_max_g);
            for _ in 0..TUG_HALVINGS {
                let middle = (low * high).sqrt();
                *if bears(middle) { &mut low } else { &mut high } = middle;
            }
            tug_max_g = low;
        }
        for direction in sides() {
            let bears = |share: f32| grip.bear(&pull(direction, 1.0), &TIGHT, share).is_held;
            if tug_max_g < 1.0 {
                break;
            }
            if bears(friction) {
                continue;
            }
            let (mut low, mut high) = (friction, 1.0);
            for _ in 0..FRICTION_HALVINGS {
                let middle = 0.5 * (low + high);
                *if bears(middle) { &mut high } else { &mut low } = middle;
            }
            friction = high;
        }
        let friction_min = (tug_max_g >= 1.0).then_some(friction * self.friction);
        Margins { friction_min, tug_max_g }
    }

    /// The share of the moved repeats that hold.
    fn robust_share(&self, world: &FloatingWorld<'_>, number: u64, pose: &Pose) -> Option<f32> {
        let AnnotateParams { repeats, position_error_m, rotation_error_rad, seed, .. } = *self.params;
        let held = (0..repeats).filter(|repeat| {
            let mut stream = Stream::new(seed, number, Purpose::Annotation, 2 + repeat);
            let mut draw = |deviation: f32| Vec3::from_array([(); 3].map(|()| stream.normal(0.0, deviation)));
            let (moved_m, turned) = (draw(position_error_m), draw(rotation_error_rad));
            let turn = turned.try_normalize().map_or(Quat::IDENTITY, |axis| axis_angle(axis, turned.length()));
            let moved = pose_from_parts((turn * pose.rotation).normalize(), pose.translation + moved_m);
            world.close(&moved).is_ok_and(|grip| self.bears(&grip).0)
        });
        let held = held.count() as f32;
        (repeats > 0).then(|| held / repeats as f32)
    }

    /// Whether the hand stays off the table on its way to a grasp.
    fn is_free(&self, stable: &StablePose, object_from_grasp: &Pose) -> bool {
        let gripper = &self.params.gripper;
        let table_from_grasp = stable.table_from_object * *object_from_grasp;
        let swept = gripper.open_hand().map(|b| b.swept_back(PROCEDURE.pregrasp_distance_m).grown(gripper.clearance_m));
        swept.iter().all(|b| b.lowest_z_m(&table_from_grasp) >= 0.0)
    }

    fn coverage(&self, draw: &Draw<'_>, grasps: &[ObjectGrasp]) -> Option<f32> {
        let held = grasps.iter().filter(|grasp| grasp.outcome == Outcome::Held);
        let contacts_m: Vec<Vec3> = held.flat_map(|grasp| grasp.contacts_m).flatten().collect();
        let points = (0..COVERAGE_NUMBERS).filter_map(|number| draw.point(number));
        let graspable: Vec<Vec3> = points
            .filter(|point| draw.pair(point, -point.normal).is_some())
            .map(|point| point.at_m + self.annotated.origin_m)
            .collect();
        let is_near = |at_m: &&Vec3| contacts_m.iter().any(|contact_m| (**at_m - *contact_m).length() <= COVERED_M);
        let near = graspable.iter().filter(is_near).count();
        (!graspable.is_empty()).then(|| near as f32 / graspable.len() as f32)
    }

    fn set(&self, grasps: Vec<ObjectGrasp>, coverage: Option<f32>) -> ObjectGrasps {
        let Annotated { object, file, scale_m, origin_m } = self.annotated;
        let given = |stable: &StablePose| {
            let translation = stable.table_from_object.translation - stable.table_from_object.rotation * *origin_m;
            let table_from_object = Pose::from_parts(translation, stable.table_from_object.rotation);
            StablePose { table_from_object, ..*stable }
        };
        ObjectGrasps {
            name: object.body.name().to_owned(),
            file: file.clone(),
            scale_m: *scale_m,
            gripper: self.params.gripper.clone(),
            test: self.params.test,
            mass_kg: object.mass_kg,
            friction: object.friction,
            extents_m: object.body.extents_m(),
            parts_m: object
                .body
                .polyhedra()
                .iter()
                .map(|part| part.corners_m().iter().map(|corner_m| *corner_m + *origin_m).collect())
                .collect(),
            centre_of_mass_m: self.world().centre_of_mass_m() + *origin_m,
            grasps,
            coverage,
            stable_poses: self.stable.iter().map(given).collect(),
        }
    }
}

fn pair(motion: Motion) -> (f32, f32) {
    (motion.moved_m, motion.turned_rad)
}

/// The six directions of the hand's axes, out of the hand first.
fn sides() -> [Vec3; 6] {
    [Vec3::Z, Vec3::X, -Vec3::X, -Vec3::Z, Vec3::Y, -Vec3::Y]
}

/// What the test puts a grip to.
fn loads(params: &AnnotateParams) -> Vec<Load> {
    let pull = |direction: Vec3, time_s: f32| Load::Pull { acceleration_m_s2: direction.normalize() * G_M_S2, time_s };
    match params.test {
        GripTest::Lift => vec![pull(Vec3::Z, LIFT_S)],
        GripTest::Turn => sides().map(|direction| pull(direction, LIFT_S)).to_vec(),
        GripTest::Tug => [[0.0, 0.0], [2.0, 0.0], [-2.0, 0.0], [0.0, 2.0], [0.0, -2.0]]
            .map(|[x, y]| pull(Vec3::new(x, y, 1.0), 0.5))
            .to_vec(),
        GripTest::Shake => {
            let base_m = params.gripper.finger_length_m + params.gripper.palm_length_m;
            vec![Load::Shake(Shake {
                way_m: Vec3::Z * 0.08,
                turn_rad: Vec3::Y,
                pivot_m: Vec3::Z * -base_m,
                rate_hz: 2.0,
                cycles: 2.0,
            })]
        }
    }
}
