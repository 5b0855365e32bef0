//! Labelled grasps of objects alone: each is drawn on the object's surface, executed on the object as it floats, and,
//! if it holds, asked how much it bears.
//!
//! A set is a pure function of the object and the settings. Grasps are numbered, and each is tried on its own, so
//! neither threads nor an interruption change anything.

mod bearing;
mod doubt;
mod draw;
mod objects;
mod params;
mod replay;
mod stable;
mod surface;

use std::sync::Arc;

use rayon::prelude::*;
use schema::{
    GraspSource, Gripper, GripperBox, Margins, ObjectGrasp, ObjectGrasps, Outcome, Pose, Purpose, StablePose, Stream,
    Vec3,
};
use simulator::{Ending, Execution, FloatingWorld, Grip, Load, Motion};

use self::bearing::{HOLD, hold, loads, pull, sides};
pub use self::bearing::{PHYSICS, PROCEDURE};
use self::doubt::Fingers;
use self::draw::{Draw, Supply};
pub use self::params::{AnnotateParams, Annotated, GraspShares};
pub use self::replay::{GraspReplay, grasp_replays};
use self::stable::stable_poses;
use self::surface::Surface;
use crate::catalogue::CatalogueObject;
use crate::robustness::moved_by_errors;

/// Grasps are tried this many at a time, on all cores.
const CHUNK: usize = 1_024;
/// Points that measure what is covered, and how near a contact must be.
const COVERAGE_NUMBERS: u64 = 2_000;
const COVERED_M: f32 = 0.01;
/// Pulls between which the strongest is looked for, in g.
const TUG_G: [f32; 2] = [0.125, 64.0];
/// Repeats of a grasp that holds are put to so many of the test's loads.
const HARDEST: usize = 2;
/// Halvings that find the strongest pull, within 3 %, and the smallest share of the friction, within a 256th.
const HALVINGS: u32 = 8;

/// Draws and labels the grasps of an object. `on_grasps` is told how many there are by now; where it says no, the work
/// is given up, and there is no set.
///
/// There are fewer than were asked for if the object has not so many that the gripper can close on. Where only the best
/// are kept, the coverage is that of all.
#[must_use]
pub fn annotate(
    annotated: &Annotated,
    params: &AnnotateParams,
    on_grasps: &mut dyn FnMut(usize) -> bool,
) -> Option<ObjectGrasps> {
    let repeated = params.repeated();
    let bench = Bench::new(annotated, params, &repeated);
    let draw = bench.draw();
    let mut supply = Supply::new(&draw);
    let mut grasps = Vec::new();
    while grasps.len() < params.grasps {
        let wanted = if params.is_held_only { CHUNK } else { CHUNK.min(params.grasps - grasps.len()) };
        let drawn = supply.next(wanted);
        if drawn.is_empty() {
            break;
        }
        let label = |(number, pose, source): &(u64, Pose, GraspSource)| bench.labelled(*number, *pose, *source);
        let tried: Vec<ObjectGrasp> = drawn.par_iter().map(label).collect();
        grasps.extend(tried.into_iter().filter(|grasp| !params.is_held_only || grasp.outcome == Outcome::Held));
        if !on_grasps(grasps.len().min(params.grasps)) {
            return None;
        }
    }
    grasps.truncate(params.grasps);
    let mut set = bench.set(grasps);
    if let Some(best) = params.best {
        set.keep_best(best as usize);
    }
    Some(set)
}

/// Labels given grasps of an object, in their order; poses are in the frame in which grasps are given. `on_grasps` is
/// that of [`annotate`]. A warning of the set tells where they seem to be in another frame or unit.
#[must_use]
pub fn relabel(
    annotated: &Annotated,
    params: &AnnotateParams,
    object_from_grasps: &[Pose],
    on_grasps: &mut dyn FnMut(usize) -> bool,
) -> Option<ObjectGrasps> {
    let repeated = params.repeated();
    let bench = Bench::new(annotated, params, &repeated);
    let label = |(number, pose): (usize, &Pose)| {
        let in_body = Pose::from_parts(pose.translation - annotated.origin_m, pose.rotation);
        bench.labelled(number as u64, in_body, GraspSource::Given)
    };
    let mut grasps: Vec<ObjectGrasp> = Vec::with_capacity(object_from_grasps.len());
    for chunk in object_from_grasps.chunks(CHUNK) {
        let first = grasps.len();
        grasps.par_extend(chunk.par_iter().enumerate().map(|(place, pose)| label((first + place, pose))));
        if !on_grasps(grasps.len()) {
            return None;
        }
    }
    let mut set = bench.set(grasps);
    let fingers = Fingers { gripper: &params.gripper, annotated, surface: &bench.surface };
    set.warnings.extend(fingers.doubt(object_from_grasps));
    Some(set)
}

/// Everything that labels the grasps of one object.
struct Bench<'a> {
    annotated: &'a Annotated,
    params: &'a AnnotateParams,
    surface: Surface,
    world: FloatingWorld<'a>,
    /// Those of its repeats, by turns.
    repeated: Vec<FloatingWorld<'a>>,
    loads: Vec<Load>,
    stable: Vec<StablePose>,
    /// Of a contact between finger and object.
    friction: f32,
}

impl<'a> Bench<'a> {
    fn new(annotated: &'a Annotated, params: &'a AnnotateParams, repeated: &'a [(Gripper, f32)]) -> Self {
        let CatalogueObject { body, mass_kg, friction, .. } = &annotated.object;
        let world = |gripper: &'a Gripper, times: f32| {
            FloatingWorld::new(&PHYSICS, gripper, &PROCEDURE, body, mass_kg * times, *friction)
        };
        let repeated = repeated.iter().take(params.repeats as usize);
        Self {
            annotated,
            params,
            surface: Surface::of(body),
            world: world(&params.gripper, 1.0),
            repeated: repeated.map(|(gripper, times)| world(gripper, *times)).collect(),
            loads: loads(params.test, &params.gripper),
            stable: stable_poses(&annotated.object, params.seed, params.drops),
            friction: params.gripper.friction * friction,
        }
    }

    fn draw(&self) -> Draw<'_> {
        Draw { params: self.params, world: &self.world, surface: &self.surface, friction: self.friction }
    }

    /// A grasp with everything that is asked about it.
    fn labelled(&self, number: u64, pose: Pose, source: GraspSource) -> ObjectGrasp {
        let (closed, pushed_m) = self.close(&self.world, &pose);
        let mut order: Vec<usize> = (0..self.loads.len()).collect();
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
            clearance_m: Some(self.world.clearance_m(&pose)),
            pushed_m,
            p_held: None,
            is_free_on_table: Vec::new(),
        };
        match &closed {
            Err(execution) => (grasp.outcome, grasp.width_m) = (execution.outcome, execution.width_m),
            Ok(grip) => {
                let (is_held, test);
                (is_held, test, order) = self.bears(grip, &order);
                let touched = grip.contacts_m().map(|pressed| pressed.map(|pressed| self.surface.touched(pressed)));
                grasp.width_m = Some(grip.width_m());
                grasp.contacts_m = touched.map(|point| Some(point?[0] + self.annotated.origin_m));
                grasp.normals = touched.map(|point| Some(point?[1]));
                (grasp.closing, grasp.test) = (Some(pair(grip.closing())), Some(pair(test)));
                if is_held {
                    grasp.outcome = Outcome::Held;
                    grasp.margins = self.params.margins.then(|| self.margins(grip));
                }
            }
        }
        let is_held = grasp.outcome == Outcome::Held;
        if is_held || !self.params.is_held_only {
            // What holds is lost, if at all, under the loads that move it most.
            let hardest = if is_held { order.get(..HARDEST).unwrap_or(&order) } else { &order };
            grasp.p_held = self.p_held(number, &pose, is_held, hardest);
        }
        grasp.is_free_on_table = self.stable.iter().map(|stable| self.is_free(stable, &pose)).collect();
        grasp
    }

    /// Closes the gripper at a grasp, and says how far it pushed the object aside on its way, if it had to.
    fn close<'w>(&self, world: &'w FloatingWorld<'_>, pose: &Pose) -> (Result<Grip<'w>, Execution>, Option<f32>) {
        let closed = world.close(pose);
        let is_blocked = closed.as_ref().is_err_and(|end| end.hit.is_some());
        match is_blocked.then(|| world.pushed_aside(pose, self.params.touch_m_max)).flatten() {
            Some((aside, pushed_m)) => (world.close(&aside), Some(pushed_m)),
            None => (closed, None),
        }
    }

    /// A pose in the frame in which grasps are given.
    fn given(&self, object_from_grasp: &Pose) -> Pose {
        Pose::from_parts(object_from_grasp.translation + self.annotated.origin_m, object_from_grasp.rotation)
    }

    /// Whether a grip bears loads, which are tried in this order; the largest motion; and the loads again, those first
    /// that came nearest to losing the object.
    fn bears(&self, grip: &Grip<'_>, order: &[usize]) -> (bool, Motion, Vec<usize>) {
        let (mut most, mut is_held, hold) = (Motion::default(), true, hold(self.params.test));
        let mut shares: Vec<(f32, usize)> = Vec::with_capacity(order.len());
        for number in order {
            let mut share = 0.0;
            if is_held {
                let Ending { motion, is_held: holds } = grip.bear(&self.loads[*number], &hold, 1.0);
                most.moved_m = most.moved_m.max(motion.moved_m);
                most.turned_rad = most.turned_rad.max(motion.turned_rad);
                share = (motion.moved_m / hold.moved_m_max).max(motion.turned_rad / hold.turned_rad_max);
                (is_held, share) = (holds, if holds { share } else { f32::INFINITY });
            }
            shares.push((share, *number));
        }
        shares.sort_by(|a, b| b.0.total_cmp(&a.0));
        (is_held, most, shares.into_iter().map(|(_, number)| number).collect())
    }

    fn margins(&self, grip: &Grip<'_>) -> Margins {
        // The least over the directions: one that bears as much as the weakest so far needs no search.
        let [weakest_g, strongest_g] = TUG_G;
        let (mut tug_max_g, mut friction) = (strongest_g, 0.0_f32);
        for direction in sides() {
            let bears = |g: f32| grip.bear(&pull(direction, g), &HOLD, 1.0).is_held;
            if bears(tug_max_g) {
                continue;
            }
            // Its own weight is asked for as the tests do, so that margins and outcomes agree.
            let ends = if tug_max_g > 1.0 && bears(1.0) { [1.0, tug_max_g] } else { [weakest_g, tug_max_g.min(1.0)] };
            if ends[0] < 1.0 && !bears(weakest_g) {
                tug_max_g = 0.0;
                break;
            }
            tug_max_g = last_borne(ends, |[low, high]| (low * high).sqrt(), bears);
        }
        for direction in sides() {
            let bears = |share: f32| grip.bear(&pull(direction, 1.0), &HOLD, share).is_held;
            if tug_max_g < 1.0 {
                break;
            }
            if bears(friction) {
                continue;
            }
            friction = last_borne([1.0, friction], |[high, low]| 0.5 * (low + high), bears);
        }
        let friction_min = (tug_max_g >= 1.0).then_some(friction * self.friction);
        Margins { friction_min, tug_max_g }
    }

    /// The share of a grasp's repeats that hold. Few are made where all end as the grasp did: most hold whatever the
    /// errors, or never do.
    fn p_held(&self, number: u64, pose: &Pose, is_held: bool, loads: &[usize]) -> Option<f32> {
        let AnnotateParams { repeats, repeats_min, .. } = *self.params;
        let (mut made, mut others) = (0, 0);
        while made < repeats && (made < repeats_min || others > 0) {
            others += u32::from(self.holds_again(number, pose, made, loads) != is_held);
            made += 1;
        }
        let held = if is_held { made - others } else { others };
        (made > 0).then(|| held as f32 / made as f32)
    }

    /// Whether a repeat of a grasp holds. The pose errs in each second one as far to the other side: few repeats say
    /// more so.
    fn holds_again(&self, number: u64, pose: &Pose, repeat: u32, loads: &[usize]) -> bool {
        let AnnotateParams { position_error_m, rotation_error_rad, seed, .. } = *self.params;
        let mut stream = Stream::new(seed, number, Purpose::Annotation, 2 + repeat / 2);
        let side = if repeat.is_multiple_of(2) { 1.0 } else { -1.0 };
        let moved = moved_by_errors(pose, side * position_error_m, side * rotation_error_rad, &mut stream);
        let world = &self.repeated[repeat as usize % self.repeated.len()];
        self.close(world, &moved).0.is_ok_and(|grip| self.bears(&grip, loads).0)
    }

    /// Whether the gripper stays off the table on its way to a grasp.
    fn is_free(&self, stable: &StablePose, object_from_grasp: &Pose) -> bool {
        let gripper = &self.params.gripper;
        let table_from_grasp = stable.table_from_object * *object_from_grasp;
        let swept = |b: GripperBox| b.swept_back(PROCEDURE.pregrasp_distance_m).grown(gripper.clearance_m);
        gripper.open_gripper().into_iter().all(|b| swept(b).lowest_z_m(&table_from_grasp) >= 0.0)
    }

    fn coverage(&self, grasps: &[ObjectGrasp]) -> Option<f32> {
        let draw = self.draw();
        let held = grasps.iter().filter(|grasp| grasp.outcome == Outcome::Held);
        let contacts_m: Vec<Vec3> = held.flat_map(|grasp| grasp.contacts_m).flatten().collect();
        let is_near = |at_m: Vec3| contacts_m.iter().any(|contact_m| (at_m - *contact_m).length() <= COVERED_M);
        // Where something was held, nobody has to ask whether a gripper can come.
        let covered = |number: u64| {
            let point = draw.point(number).filter(|point| !draw.middles_m(point, -point.normal).is_empty())?;
            let is_covered = is_near(point.at_m + self.annotated.origin_m);
            (is_covered || draw.is_graspable(&point)).then_some(is_covered)
        };
        let graspable: Vec<bool> = (0..COVERAGE_NUMBERS).into_par_iter().filter_map(covered).collect();
        let near = graspable.iter().filter(|is_covered| **is_covered).count();
        (!graspable.is_empty()).then(|| near as f32 / graspable.len() as f32)
    }

    fn set(&self, grasps: Vec<ObjectGrasp>) -> ObjectGrasps {
        let Annotated { object, file, scale_m, origin_m, warnings, .. } = self.annotated;
        let given = |stable: &StablePose| {
            let translation = stable.table_from_object.translation - stable.table_from_object.rotation * *origin_m;
            let table_from_object = Pose::from_parts(translation, stable.table_from_object.rotation);
            StablePose { table_from_object, ..*stable }
        };
        ObjectGrasps {
            name: object.body.name().to_owned(),
            file: file.clone(),
            scale_m: *scale_m,
            warnings: warnings.clone(),
            gripper: self.params.gripper.clone(),
            test: self.params.test,
            mass_kg: object.mass_kg,
            friction: object.friction,
            extents_m: object.body.extents_m(),
            parts: object.body.polyhedra().iter().map(|part| part.moved(&Pose::from_translation(*origin_m))).collect(),
            mesh: object.body.mesh().map(|mesh| Arc::new(mesh.moved(*origin_m))),
            centre_of_mass_m: self.world.centre_of_mass_m() + *origin_m,
            coverage: self.coverage(&grasps),
            grasps,
            stable_poses: self.stable.iter().map(given).collect(),
        }
    }
}

/// Between something that a grip bears and something that it does not, the last that it bears.
fn last_borne(ends: [f32; 2], middle: fn([f32; 2]) -> f32, bears: impl Fn(f32) -> bool) -> f32 {
    let halved = |[borne, other]: [f32; 2], _| {
        let middle = middle([borne, other]);
        if bears(middle) { [middle, other] } else { [borne, middle] }
    };
    (0..HALVINGS).fold(ends, halved)[0]
}

fn pair(motion: Motion) -> (f32, f32) {
    (motion.moved_m, motion.turned_rad)
}

#[cfg(test)]
mod tests {
    use core::f32::consts::{FRAC_PI_2, PI};

    use rayon::ThreadPoolBuilder;
    use schema::{Gripper, ShapeKind, Solid, axis_angle};
    use simulator::{Body, Part, PartShape};

    use super::bearing::G_M_S2;
    use super::*;

    fn annotated(body: Body, mass_kg: f32, friction: f32) -> Annotated {
        let object = CatalogueObject { body, mass_kg, friction, origin_m: Vec3::ZERO };
        Annotated {
            object,
            file: "a test".to_owned(),
            file_sha256: None,
            scale_m: 1.0,
            origin_m: Vec3::new(0.5, -1.0, 2.0),
            warnings: Vec::new(),
        }
    }

    fn cuboid(extents_m: [f32; 3]) -> Body {
        Solid::new(ShapeKind::Cuboid, Vec3::from_array(extents_m)).unwrap().into()
    }

    /// An L of two boxes.
    fn ell() -> Body {
        let part = |size_m: [f32; 3], at_m: Vec3| Part {
            shape: PartShape::Solid(Solid::new(ShapeKind::Cuboid, Vec3::from_array(size_m)).unwrap()),
            object_from_part: Pose::from_translation(at_m),
        };
        let lying = part([0.08, 0.04, 0.02], Vec3::new(0.0, 0.0, 0.01));
        let standing = part([0.02, 0.04, 0.06], Vec3::new(-0.03, 0.0, 0.05));
        Body::of_parts("ell", vec![lying, standing]).unwrap()
    }

    fn few(grasps: usize) -> AnnotateParams {
        AnnotateParams { grasps, drops: 0, repeats: 0, ..AnnotateParams::default() }
    }

    fn all(annotated: &Annotated, params: &AnnotateParams) -> ObjectGrasps {
        annotate(annotated, params, &mut |_| true).unwrap()
    }

    #[test]
    fn a_set_is_the_same_whatever_the_threads_and_its_sources_have_their_shares() {
        let object = annotated(ell(), 0.1, 0.8);
        let params = AnnotateParams { margins: true, repeats: 2, drops: 5, ..few(300) };
        let on = |threads: usize| {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| all(&object, &params))
        };
        let set = on(1);
        assert_eq!(set, on(3));
        assert_eq!(set.grasps.len(), 300);
        for (source, share) in
            [(GraspSource::Antipodal, 0.8), (GraspSource::Normal, 0.1), (GraspSource::Displaced, 0.1)]
        {
            let count = set.grasps.iter().filter(|grasp| grasp.source == source).count() as f32;
            assert!((count / 300.0 - share).abs() < 0.02, "{source:?}: {count}");
        }
        // The open gripper comes to every antipodal grasp, and what is drawn first is not changed by how many follow.
        let reached = |grasp: &&ObjectGrasp| grasp.source == GraspSource::Antipodal;
        assert!(set.grasps.iter().filter(reached).all(|grasp| grasp.width_m.is_some()));
        assert_eq!(all(&object, &AnnotateParams { grasps: 100, ..params }).grasps, set.grasps[..100]);
        assert!(annotate(&object, &few(100), &mut |_| false).is_none());
    }

    #[test]
    fn only_what_holds_is_kept_where_that_is_asked_for_and_covers_the_object() {
        let object = annotated(ell(), 0.1, 0.8);
        let set = all(&object, &AnnotateParams { is_held_only: true, ..few(400) });
        assert!(set.grasps.len() == 400 && set.held().count() == 400);
        assert!(set.coverage.unwrap() > 0.95, "{:?}", set.coverage);
        // Contacts are in the frame in which grasps are given, on the surface, although the middle of several may be
        // beside it; a few are where one part meets the other.
        let contacts_m: Vec<Vec3> = set.grasps.iter().flat_map(|grasp| grasp.contacts_m).flatten().collect();
        let off_m = |at_m: &Vec3| object.object.body.distance_outside_m(*at_m - object.origin_m).abs();
        let on_surface = contacts_m.iter().filter(|at_m| off_m(at_m) < 1e-5).count();
        assert!(contacts_m.len() == 800 && on_surface >= 780, "{on_surface} of {}", contacts_m.len());
    }

    /// Antipodal grasps of a box that is taller than wide: each closes across one of its two widths.
    #[test]
    fn facing_points_are_mostly_gripped_flat_along_edges_and_near_the_centre_of_mass_and_bear_much() {
        let object = annotated(cuboid([0.06, 0.06, 0.2]), 0.288, 0.8);
        let gripper = Gripper::from_toml(Gripper::BUILT_IN[3].1).unwrap();
        let shares = GraspShares { antipodal: 1.0, normal: 0.0, displaced: 0.0 };
        let params = AnnotateParams { gripper, shares, margins: true, ..few(500) };
        let set = all(&object, &params);
        let poses: Vec<Pose> = set.grasps.iter().map(|grasp| grasp.object_from_grasp).collect();
        let sorted = |number: &dyn Fn(&Pose) -> f32| {
            let mut numbers: Vec<f32> = poses.iter().map(number).collect();
            numbers.sort_by(f32::total_cmp);
            numbers
        };
        let from_axes_deg = |direction: Vec3| libm::acosf(direction.abs().max_element().min(1.0)).to_degrees();
        let skews_deg = sorted(&|pose| from_axes_deg(pose.rotation * Vec3::Y));
        let turns_deg = sorted(&|pose| from_axes_deg(pose.rotation * Vec3::Z));
        // The cone's edge is at 38.7 degrees.
        assert!(skews_deg[250] < 0.5 && skews_deg[350] < 5.0 && skews_deg[499] > 20.0, "{skews_deg:?}");
        assert!(turns_deg[250] < 5.0 && turns_deg[499] > 20.0, "{turns_deg:?}");
        let heights_m = sorted(&|pose| (pose.translation.z - object.origin_m.z).abs());
        let mean_m = heights_m.iter().sum::<f32>() / 500.0;
        assert!(mean_m < 0.045 && heights_m[499] > 0.09, "{mean_m}, {}", heights_m[499]);
        let tugs_g: Vec<f32> = set.held().filter_map(|grasp| Some(grasp.margins?.tug_max_g)).collect();
        let share = |g: f32| tugs_g.iter().filter(|tug_g| **tug_g >= g).count() as f32 / tugs_g.len() as f32;
        assert!(share(5.0) > 0.4 && share(1.0) > 0.6, "{} and {}", share(5.0), share(1.0));
    }

    /// By a slow search: a grasp is left out if it is like a stronger one that is kept, or weaker than all of them.
    #[test]
    fn the_best_are_the_strongest_that_are_not_like_stronger_ones() {
        let object = annotated(ell(), 0.1, 0.8);
        let params = AnnotateParams { margins: true, repeats: 2, ..few(300) };
        let every = all(&object, &params);
        let best = all(&object, &AnnotateParams { best: Some(12), ..params.clone() });
        assert_eq!((best.grasps.len(), best.coverage), (12, every.coverage));
        let strength =
            |grasp: &ObjectGrasp| f64::from(grasp.margins.unwrap().tug_max_g) * f64::from(grasp.p_held.unwrap());
        assert!(best.grasps.windows(2).all(|pair| strength(&pair[0]) >= strength(&pair[1])));
        let are_near = |one: &ObjectGrasp, other: &ObjectGrasp| {
            let (a, b) = (one.object_from_grasp, other.object_from_grasp);
            let axes = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| (a.rotation * axis).dot(b.rotation * axis));
            let cosine = 0.5 * ((axes[0] + axes[1]).abs() + axes[2] - 1.0);
            (a.translation - b.translation).length() <= 0.02 && cosine >= 0.75_f32.sqrt()
        };
        for grasp in every.held() {
            let stronger = best.grasps.iter().filter(|kept| strength(kept) >= strength(grasp));
            let near = stronger.clone().filter(|kept| are_near(kept, grasp)).count();
            let is_kept = best.grasps.contains(grasp);
            assert!(if is_kept { near == 1 } else { near > 0 || stronger.count() == 12 }, "{grasp:?}");
        }
        assert_eq!(all(&object, &AnnotateParams { best: Some(400), ..params }).grasps[..12], best.grasps);
    }

    #[test]
    fn a_wall_too_wide_for_the_gripper_has_no_grasps() {
        let object = annotated(cuboid([0.2, 0.25, 0.3]), 1.0, 0.8);
        let params = AnnotateParams { shares: GraspShares { antipodal: 1.0, normal: 0.0, displaced: 0.0 }, ..few(50) };
        let set = all(&object, &params);
        assert_eq!((set.grasps.len(), set.coverage), (0, None));
    }

    /// Without errors that is the label; with each of them fewer hold, and no label changes.
    #[test]
    fn p_held_is_the_share_of_repeats_with_errors_of_every_kind() {
        let object = annotated(ell(), 0.3, 0.5);
        let (one, exact) = ([1.0; 2], AnnotateParams { position_error_m: 0.0, rotation_error_rad: 0.0, ..few(100) });
        let plain =
            AnnotateParams { repeats: 12, friction_factors: one, mass_factors: one, force_factors: one, ..exact };
        let set = all(&object, &plain);
        assert!(set.count(Outcome::Held) > 40, "{}", set.count(Outcome::Held));
        // A rotation is rounded once more, which a grasp on the verge feels.
        let is_label = |grasp: &&ObjectGrasp| grasp.p_held == Some(f32::from(grasp.outcome.label()));
        assert!(set.grasps.iter().filter(is_label).count() >= 99);
        let outcomes = |set: &ObjectGrasps| set.grasps.iter().map(|grasp| grasp.outcome).collect::<Vec<_>>();
        let sum = |set: &ObjectGrasps| set.grasps.iter().filter_map(|grasp| grasp.p_held).sum::<f32>();
        for (what, params) in [
            ("position", AnnotateParams { position_error_m: 0.02, ..plain.clone() }),
            ("rotation", AnnotateParams { rotation_error_rad: 0.5, ..plain.clone() }),
            ("friction", AnnotateParams { friction_factors: [0.05, 1.0], ..plain.clone() }),
            ("mass", AnnotateParams { mass_factors: [1.0, 20.0], ..plain.clone() }),
            ("force", AnnotateParams { force_factors: [0.05, 1.0], ..plain.clone() }),
        ] {
            let harder = all(&object, &params);
            assert_eq!(outcomes(&harder), outcomes(&set), "{what}");
            assert!(sum(&harder) < 0.9 * sum(&set), "{what}: {} of {}", sum(&harder), sum(&set));
            // Of four that end as the grasp itself, or of twelve.
            let are_twelfths = |grasp: &ObjectGrasp| {
                let count = 12.0 * grasp.p_held.unwrap();
                (count - count.round()).abs() < 1e-4
            };
            assert!(harder.grasps.iter().all(are_twelfths), "{what}");
        }
        let kept = all(&object, &AnnotateParams { is_held_only: true, repeats: 3, ..few(30) });
        assert!(kept.grasps.iter().all(|grasp| grasp.p_held.is_some()));
        assert!(all(&object, &few(30)).grasps.iter().all(|grasp| grasp.p_held.is_none()));
    }

    #[test]
    fn an_object_that_is_touched_by_little_is_pushed_aside_where_that_is_asked_for() {
        let object = annotated(cuboid([0.04, 0.04, 0.02]), 0.1, 0.8);
        // One finger would be 1.3 and 8 mm in the block, and no nearer than 1 mm is free.
        let beside =
            [0.0, 0.0213, 0.028].map(|y_m| Pose::from_translation(object.origin_m + Vec3::new(0.0, y_m, 0.015)));
        let told = |touch_m_max: f32| {
            let params = AnnotateParams { touch_m_max, ..few(1) };
            let set = relabel(&object, &params, &beside, &mut |_| true).unwrap();
            let [clear, touched, inside] = [0, 1, 2].map(|number| &set.grasps[number]);
            for (grasp, clearance_m) in [(clear, 0.02), (touched, -0.0013), (inside, -0.008)] {
                assert!((grasp.clearance_m.unwrap() - clearance_m).abs() < 1e-4, "{grasp:?}");
            }
            assert_eq!([clear, inside].map(|grasp| (grasp.outcome.label(), grasp.pushed_m)), [(1, None), (0, None)]);
            assert_eq!(touched.object_from_grasp, beside[1]);
            (touched.outcome, touched.pushed_m)
        };
        assert_eq!(told(0.003), (Outcome::Held, Some(0.0025)));
        assert_eq!(told(0.002), (Outcome::ApproachCollision, None));
        assert_eq!(told(0.0), (Outcome::ApproachCollision, None));
    }

    /// 2 μ F = m a: with the grip in the middle of a block, in every direction but that of closing.
    #[test]
    fn margins_are_those_of_coulomb() {
        let object = annotated(cuboid([0.04, 0.04, 0.02]), 0.5, 0.5);
        let params = AnnotateParams { margins: true, ..few(1) };
        let middle = Pose::from_translation(object.origin_m + Vec3::new(0.0, 0.0, 0.015));
        let beside = Pose::from_translation(object.origin_m + Vec3::new(0.012, 0.0, 0.015));
        let set = relabel(&object, &params, &[middle, beside], &mut |_| true).unwrap();
        let gripper = &params.gripper;
        let tug_g = 2.0 * gripper.friction * 0.5 * gripper.finger_force_n / (0.5 * G_M_S2);
        let friction = 0.5 * 0.5 * G_M_S2 / gripper.finger_force_n;
        let [middle, beside] = [0, 1].map(|number| set.grasps[number].margins.unwrap());
        assert!((middle.tug_max_g / tug_g - 1.0).abs() < 0.03, "{middle:?}, by the closed form {tug_g} g");
        assert!((middle.friction_min.unwrap() / friction - 1.0).abs() < 0.03, "{middle:?}, {friction}");
        // 12 mm beside the middle the weight turns the block, too.
        assert!(beside.tug_max_g < 0.8 * middle.tug_max_g && beside.friction_min > middle.friction_min, "{beside:?}");
    }

    #[test]
    fn a_brick_lies_on_its_six_sides_and_grasps_from_below_are_in_the_table() {
        let mut object = annotated(cuboid([0.03, 0.05, 0.07]), 0.1, 0.8);
        object.origin_m = Vec3::new(0.1, 0.2, 0.3);
        let down = Pose::from_parts(object.origin_m, axis_angle(Vec3::X, PI));
        let aside = Pose::from_parts(object.origin_m, axis_angle(Vec3::Y, FRAC_PI_2));
        let params = AnnotateParams { drops: 120, ..few(1) };
        let set = relabel(&object, &params, &[down, aside], &mut |_| true).unwrap();
        let poses = &set.stable_poses;
        let sum: f32 = poses.iter().map(|pose| pose.probability).sum();
        assert!(poses.len() <= 6 && poses.len() >= 4 && sum > 0.95, "{poses:?}");
        assert!(poses.windows(2).all(|pair| pair[0].probability >= pair[1].probability));
        for (number, pose) in poses.iter().enumerate() {
            // The object's middle is half a side above the table.
            let middle_m = pose.table_from_object.transform_point(object.origin_m);
            assert!(middle_m.truncate().length() < 1e-3 && (0.014..0.036).contains(&middle_m.z), "{middle_m}");
            for grasp in &set.grasps {
                let approach = pose.table_from_object.rotation * grasp.object_from_grasp.rotation * Vec3::Z;
                let is_free = grasp.is_free_on_table[number];
                assert!(approach.z.abs() < 0.5 || is_free == (approach.z < 0.0), "{approach}: {is_free}");
            }
        }
    }
}
