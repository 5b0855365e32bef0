//! Whether given grasps were read as they are meant. Where the object lies between the open fingers in few of them, a
//! unit or a frame is wrong, and the usual mistakes are tried.
//!
//! Outcomes do not tell: an honest file may have many grasps that collide or slip. But whoever drew them had the
//! object between the fingers, even of those that failed.

use core::f32::consts::{FRAC_PI_2, PI};

use rayon::prelude::*;
use schema::{Gripper, Pose, Quat, Vec3, axis_angle, bounds_m};

use super::params::Annotated;
use super::surface::Surface;

/// Grasps that are looked at, at most, spread over all.
const SAMPLE: usize = 200;
/// Lines from finger to finger, from the tips to the palm.
const LINES: u8 = 10;
/// Grasps are doubted if the object is between the fingers in a smaller share of them. In 99 % of ACRONYM's examples it
/// is, and in up to 25 % if their origin is taken for the other end of the gripper; GraspDataGen displaces a fifth.
const FEW: f32 = 1.0 / 3.0;
/// A mistake explains them if without it the object is there in this share …
const MANY: f32 = 0.5;
/// … and they are spread over more than this share of the object: a point inside it is between all fingers.
const SPREAD: f32 = 0.1;

const BACK: &str = "the gripper comes along their -z";
const MILLIMETRES: &str = "their positions are in millimetres";
const UNITS: &str = "their positions are in units of the mesh";

/// What is so without a mistake; factors of positions and of the object, and how many lengths of the gripper the pose
/// moves along its approach; its turn after that.
type Mistake = (&'static str, [f32; 3], Quat);

/// The open fingers, to be put around an object.
pub(super) struct Fingers<'a> {
    pub(super) gripper: &'a Gripper,
    pub(super) annotated: &'a Annotated,
    pub(super) surface: &'a Surface,
}

impl Fingers<'_> {
    /// Says of given grasps that the object lies between the fingers in few of them, if it does, and which mistake
    /// explains that best, if one does.
    pub(super) fn doubt(&self, object_from_grasps: &[Pose]) -> Option<String> {
        let every = object_from_grasps.len().div_ceil(SAMPLE).max(1);
        let sample: Vec<Pose> = object_from_grasps.iter().step_by(every).copied().collect();
        let of_all = |share: f32| share * sample.len() as f32;
        let as_read = self.count(&sample, 1.0);
        if as_read as f32 >= of_all(FEW) {
            return None;
        }
        let (mut most, mut why) = (as_read, "");
        for (text, [positions, size, lengths], turn) in self.mistakes() {
            let meant = Pose::from_parts(Vec3::Z * (lengths * self.gripper.base_to_tips_m()), turn);
            let undone = |pose: &Pose| Pose::from_parts(pose.translation * positions, pose.rotation) * meant;
            let poses: Vec<Pose> = sample.iter().map(undone).collect();
            let [low_m, high_m] = bounds_m(poses.iter().map(|pose| &pose.translation));
            let object_m = size * self.annotated.object.body.extents_m().length();
            let count = self.count(&poses, size);
            if count > most && (high_m - low_m).length() > SPREAD * object_m {
                (most, why) = (count, text);
            }
        }
        let explained = most as f32 >= of_all(MANY);
        let but = if explained { format!(", but in {most} if {why}") } else { String::new() };
        let check = "check the scale of the mesh, and the unit and the frame of the grasps";
        let all = sample.len();
        Some(format!("the object lies between the open fingers in {as_read} of {all} grasps{but}: {check}"))
    }

    fn mistakes(&self) -> [Mistake; 15] {
        let [same, aside, back] = [Quat::IDENTITY, axis_angle(Vec3::Z, FRAC_PI_2), axis_angle(Vec3::X, PI)];
        let unit_m = self.annotated.scale_m as f32;
        [
            ("their origin is the gripper's base", [1.0, 1.0, 1.0], same),
            ("their origin is between the tips", [1.0, 1.0, -1.0], same),
            ("the gripper closes along their other axis", [1.0, 1.0, 0.0], aside),
            ("their origin is the gripper's base, and it closes along their other axis", [1.0, 1.0, 1.0], aside),
            ("their origin is between the tips, which close along their other axis", [1.0, 1.0, -1.0], aside),
            (BACK, [1.0, 1.0, 0.0], back),
            (BACK, [1.0, 1.0, -1.0], back),
            // What was read as the base was moved to where the tips would be: the wrong way, which counts twice.
            (BACK, [1.0, 1.0, -2.0], back),
            (MILLIMETRES, [0.001, 1.0, 0.0], same),
            (MILLIMETRES, [0.001, 1.0, 1.0], same),
            (UNITS, [unit_m, 1.0, 0.0], same),
            (UNITS, [unit_m, 1.0, 1.0], same),
            ("a unit of the mesh is 1 m", [1.0, 1.0 / unit_m, 0.0], same),
            ("a unit of the mesh is 1 cm", [1.0, 0.01 / unit_m, 0.0], same),
            ("a unit of the mesh is 1 mm", [1.0, 0.001 / unit_m, 0.0], same),
        ]
    }

    /// In how many of some grasps an object, so many times as large, lies between the fingers.
    fn count(&self, object_from_grasps: &[Pose], size: f32) -> usize {
        object_from_grasps.par_iter().filter(|pose| self.are_around(pose, size)).count()
    }

    /// Whether the object is between the fingers and at neither end, on one of the lines from one to the other, and is
    /// not where the palm is.
    fn are_around(&self, object_from_grasp: &Pose, size: f32) -> bool {
        let Gripper { opening_m_max, finger_length_m, palm_length_m, .. } = *self.gripper;
        // Those parts of a line inside the object that reach into a stretch of it.
        let crossed = |at_m: Vec3, along: Vec3, [low_m, high_m]: [f32; 2]| -> Vec<[f32; 2]> {
            let from_m = object_from_grasp.transform_point(at_m) / size - self.annotated.origin_m;
            let inside = self.surface.inside(from_m, object_from_grasp.rotation * along).into_iter();
            let ends_m = inside.map(|of| [of.enter_m * size, of.exit_m * size]);
            ends_m.filter(|[enter_m, exit_m]| *exit_m > low_m && *enter_m < high_m).collect()
        };
        let (half_m, palm_m) = (0.5 * opening_m_max, [finger_length_m, finger_length_m + palm_length_m]);
        let is_around = |line: u8| {
            let behind_m = finger_length_m * (f32::from(line) + 0.5) / f32::from(LINES);
            let between = crossed(Vec3::NEG_Z * behind_m, Vec3::Y, [-half_m, half_m]);
            !between.is_empty() && between.iter().all(|[enter_m, exit_m]| *enter_m > -half_m && *exit_m < half_m)
        };
        crossed(Vec3::ZERO, Vec3::NEG_Z, palm_m).is_empty() && (0..LINES).any(is_around)
    }
}

#[cfg(test)]
mod tests {
    use schema::{ShapeKind, Solid};

    use super::*;
    use crate::catalogue::CatalogueObject;
    use crate::{AnnotateParams, GraspShares, annotate, relabel};

    /// A box whose file has this unit, far from its frame's origin.
    fn cuboid(extents_m: [f32; 3], scale_m: f64) -> Annotated {
        let body = Solid::new(ShapeKind::Cuboid, Vec3::from_array(extents_m)).unwrap().into();
        let object = CatalogueObject { body, mass_kg: 0.2, friction: 0.6, origin_m: Vec3::ZERO };
        let origin_m = Vec3::new(0.05, -0.1, 0.2);
        Annotated { object, file: "a test".to_owned(), file_sha256: None, scale_m, origin_m, warnings: Vec::new() }
    }

    fn params() -> AnnotateParams {
        let shares = GraspShares { antipodal: 1.0, normal: 0.0, displaced: 0.0 };
        AnnotateParams { grasps: 60, drops: 0, repeats: 0, shares, ..AnnotateParams::default() }
    }

    fn grasps(object: &Annotated) -> Vec<Pose> {
        let set = annotate(object, &params(), &mut |_| true).unwrap();
        set.grasps.iter().map(|grasp| grasp.object_from_grasp).collect()
    }

    /// What is said where the poses are read so instead.
    fn said(object: &Annotated, poses: &[Pose], read: impl Fn(&Pose) -> Pose) -> Option<String> {
        let surface = Surface::of(&object.object.body);
        let gripper = &AnnotateParams::default().gripper;
        let poses: Vec<Pose> = poses.iter().map(read).collect();
        Fingers { gripper, annotated: object, surface: &surface }.doubt(&poses)
    }

    #[test]
    fn a_frame_or_a_unit_that_is_wrong_is_named() {
        let base_m = AnnotateParams::default().gripper.base_to_tips_m();
        let along = |way_m: f32| Pose::from_translation(Vec3::Z * way_m);
        let aside = Pose::from_parts(Vec3::ZERO, axis_angle(Vec3::Z, FRAC_PI_2));
        let back = Pose::from_parts(Vec3::ZERO, axis_angle(Vec3::X, PI));
        let times = |pose: &Pose, factor: f32| Pose::from_parts(pose.translation * factor, pose.rotation);
        let brick = cuboid([0.04, 0.06, 0.05], 0.02);
        let poses = grasps(&brick);
        assert_eq!(said(&brick, &poses, |pose| *pose), None);
        assert_eq!(said(&brick, &[], |pose| *pose), None);
        let plate = cuboid([0.2, 0.2, 0.01], 1.0);
        let of_plate = grasps(&plate);
        let huge = cuboid([0.4, 0.6, 0.5], 0.01);
        for (text, told) in [
            ("if their origin is the gripper's base:", said(&brick, &poses, |pose| *pose * along(-base_m))),
            ("if their origin is between the tips:", said(&brick, &poses, |pose| *pose * along(base_m))),
            (BACK, said(&brick, &poses, |pose| *pose * back * along(base_m))),
            (BACK, said(&brick, &poses, |pose| *pose * back * along(2.0 * base_m))),
            (MILLIMETRES, said(&brick, &poses, |pose| times(pose, 1000.0))),
            (MILLIMETRES, said(&brick, &poses, |pose| times(&(*pose * along(-base_m)), 1000.0) * along(base_m))),
            (UNITS, said(&brick, &poses, |pose| times(pose, 50.0))),
            ("if the gripper closes along their other axis:", said(&plate, &of_plate, |pose| *pose * aside)),
            ("base, and it closes", said(&plate, &of_plate, |pose| *pose * along(-base_m) * aside)),
            // Its middle is where the brick's is, but it is ten times as large.
            (
                "if a unit of the mesh is 1 mm:",
                said(&Annotated { origin_m: brick.origin_m * 10.0, ..huge }, &poses, |pose| *pose),
            ),
        ] {
            assert!(told.as_ref().is_some_and(|told| told.contains(text)), "{text}: {told:?}");
        }
    }

    #[test]
    fn what_no_mistake_explains_is_told_without_one_and_goes_with_the_set() {
        let brick = cuboid([0.04, 0.06, 0.05], 1.0);
        let aside = |pose: &Pose| Pose::from_parts(pose.translation + Vec3::new(0.0, 0.0, 0.7), pose.rotation);
        let poses: Vec<Pose> = grasps(&brick).iter().map(aside).collect();
        let set = relabel(&brick, &params(), &poses, &mut |_| true).unwrap();
        let [told] = &set.warnings[..] else { panic!("{:?}", set.warnings) };
        assert!(
            told.starts_with("the object lies between the open fingers in 0 of 60 grasps: check the scale"),
            "{told}"
        );
        // One point inside the object is between all fingers: that all are there is no explanation.
        let millimetres = said(&brick, &poses, |_| Pose::from_translation(brick.origin_m * 1000.0)).unwrap();
        assert!(!millimetres.contains("but in"), "{millimetres}");
    }
}
