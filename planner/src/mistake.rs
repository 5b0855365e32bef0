//! The mistakes that people make with units, lenses and poses, in one table, and how well each explains what was seen.
//!
//! A plane has evidence for being the table by what it carries, and less where what was said of the sensor tilts it or
//! puts it at another height. A mistake is named if the planes have far more evidence without it.

use core::f32::consts::PI;
use core::mem::discriminant;

use perception::{TableCandidate, find_tables, upright};
use rayon::prelude::*;
use schema::{Intrinsics, Mat3, Plane, Pose, Purpose, Quat, Stream, Vec3, pose_from_parts};

/// One explanation is far better than another with so many times its score.
pub(crate) const BETTER: f32 = 8.0;
/// A mistake explains what was seen if without it there is this part of the evidence for the best plane.
const CLOSE: f32 = 4.0;
/// A plane with less evidence is no table: a bare one over half of an image has more.
const EVIDENCE_MIN: f32 = 1e-3;
/// A table tilted by more, or seen further above or below its height, is not where the workspace has it: sensors'
/// scales are off by 3 %. Gravity is known less well than a workspace.
pub(crate) const TILT_RAD_MAX: f32 = PI / 60.0;
const LEVEL_RAD_MAX: f32 = PI / 30.0;
pub(crate) const HEIGHT_OFF_M_MAX: f32 = 0.025;
/// Tables are rarely nearer to a camera than the first distance, and the planner's rarely further than the second: then
/// the unit of depth is doubted.
const SEEN_M: [f32; 2] = [0.2, 1.8];
const NEARER_LOG: f32 = 0.25;
/// By how much lenses usually differ from one that looks through the middle of its image and has square pixels, and
/// focal lengths in widths of the image.
const CENTRE_OFF: f32 = 0.12;
const RATIO_LOG: f32 = 0.25;
const FOCAL: [f32; 2] = [0.4, 3.5];
const FOCAL_LOG: f32 = 0.15;
/// The key under which gravity is given.
pub(crate) const DOWN: &str = "down";

/// What was done to a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Step {
    Millimetres,
    WFirst,
    Inverse,
    /// The camera's axes have y up and z backwards.
    OpenGl,
    /// They have x forward, y left and z up.
    Body,
    /// A direction points the other way.
    Opposite,
}

/// The pose as it was given.
const NOTHING: &[Step] = &[];

use Step::{Body, Inverse, Millimetres, OpenGl, Opposite, WFirst};

/// A mistake, or some that occur together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Mistake {
    /// What was done to the pose.
    Pose(&'static [Step]),
    /// The true depths in those that were given.
    Depths(f32),
    /// The lens is that of an image of another size: the true lens in the given one.
    Size(f32),
    /// The principal point's numbers changed places.
    Swapped,
    /// The true focal lengths in those that were given.
    Focal([f32; 2]),
}

use Mistake::{Depths, Focal, Size, Swapped};

/// All that are tried: what may have been done to a pose …
const POSES: [&[Step]; 11] = [
    &[Opposite],
    &[OpenGl],
    &[Body],
    &[Inverse],
    &[Millimetres],
    &[WFirst],
    &[Inverse, OpenGl],
    &[Inverse, Body],
    &[OpenGl, Millimetres],
    &[Inverse, Millimetres],
    &[Inverse, OpenGl, Millimetres],
];
/// … the true depths in those that were given: the units that sensors have, in millimetres, and other units of length …
pub(crate) const DEPTHS: [f32; 8] = [0.1, 0.2, 0.25, 0.125, 0.001, 0.01, 10.0, 1000.0];
/// … and the true lens in the given one.
const SIZES: [f32; 6] = [0.5, 2.0, 2.0 / 3.0, 1.5, 1.0 / 3.0, 3.0];
const FOCALS: [[f32; 2]; 6] = [[2.0, 1.0], [1.0, 2.0], [0.5, 1.0], [1.0, 0.5], [2.0, 2.0], [0.5, 0.5]];

impl Step {
    /// The optical frame in the axes of this one, if it has others.
    pub(crate) fn turn_to_optical(self) -> Quat {
        match self {
            OpenGl => Quat::from_xyzw(1.0, 0.0, 0.0, 0.0),
            // The optical x is right, -y of the body; y is down, -z; z is forward, x.
            Body => Quat::from_mat3(&Mat3::from_cols(-Vec3::Y, -Vec3::Z, Vec3::X)),
            Millimetres | WFirst | Inverse | Opposite => Quat::IDENTITY,
        }
    }

    fn describe(self, key: &str) -> String {
        let said = match self {
            Inverse => {
                let (target, source) = key.split_once("_from_").unwrap_or_default();
                return format!("the inverse, {source}_from_{target}");
            }
            Millimetres => "in millimetres",
            WFirst => "given with w first in its quaternion",
            OpenGl => "in OpenGL's camera axes, y up and z backwards",
            Body if key == DOWN => "in the axes of the camera's body (x forward, y left, z up)",
            Body => "the pose of the camera's body frame (x forward, y left, z up), not of its optical frame",
            Opposite => "the opposite: what an accelerometer at rest measures points up",
        };
        said.to_owned()
    }
}

impl Mistake {
    /// All that are tried; of those that explain as much the first is meant.
    fn all() -> Vec<Self> {
        let lenses = SIZES.map(Size).into_iter().chain([Swapped]).chain(FOCALS.map(Focal));
        POSES.map(Self::Pose).into_iter().chain(DEPTHS.map(Depths)).chain(lenses).collect()
    }

    /// The true lens in place of one that was given with this mistake; none if it is no mistake of a lens.
    fn true_lens(self, given: &Intrinsics) -> Option<Intrinsics> {
        let Intrinsics { fx_px, fy_px, cx_px, cy_px, .. } = *given;
        let [fx_px, fy_px, cx_px, cy_px] = match self {
            Size(share) => [fx_px, fy_px, cx_px, cy_px].map(|px| px * share),
            Swapped => [fx_px, fy_px, cy_px, cx_px],
            Focal([x, y]) => [fx_px * x, fy_px * y, cx_px, cy_px],
            Self::Pose(_) | Depths(_) => return None,
        };
        Some(Intrinsics { fx_px, fy_px, cx_px, cy_px, ..*given })
    }
}

/// How likely a lens is that of an image of its size.
pub(crate) fn likelihood(lens: &Intrinsics) -> f32 {
    let square = |off: f32, usual: f32| (off / usual) * (off / usual);
    let off = |centre_px: f32, side_px: usize| square(centre_px / side_px as f32 - 0.5, CENTRE_OFF);
    let centre = off(lens.cx_px, lens.width_px) + off(lens.cy_px, lens.height_px);
    let focal = lens.fx_px / lens.width_px as f32;
    let beyond = libm::logf(FOCAL[0] / focal).max(libm::logf(focal / FOCAL[1])).max(0.0);
    let ratio = libm::logf(lens.fx_px / lens.fy_px);
    libm::expf(-centre - square(beyond, FOCAL_LOG) - square(ratio, RATIO_LOG))
}

/// What was said of where a sensor is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    /// How: `camera_from_base`, or [`DOWN`].
    pub(crate) key: &'static str,
    /// The pose as it was given; of gravity a turn into a frame that stands upright.
    pub(crate) given: Pose,
    /// Whether it was given as the inverse.
    pub(crate) is_inverse: bool,
    /// The frame to which it leads in one that stands upright.
    pub(crate) upright_from_target: Pose,
    /// The table's height there, if it is known.
    pub(crate) table_z_m: Option<f32>,
}

impl Place {
    /// The pose of the sensor if this was done to what was given, or `None` if it cannot have been.
    pub(crate) fn without(&self, steps: &[Step]) -> Option<Pose> {
        let (mut given, mut is_inverse, mut turn) = (self.given, self.is_inverse, Quat::IDENTITY);
        let may_be = |step: &Step| matches!(step, OpenGl | Body) || (*step == Opposite) == (self.key == DOWN);
        // Nobody measured the identity.
        let is_none = given == Pose::IDENTITY && self.key != DOWN;
        if !steps.is_empty() && (is_none || !steps.iter().all(may_be)) {
            return None;
        }
        for step in steps {
            match step {
                Millimetres => given.translation *= 1e-3,
                WFirst => {
                    let [w, x, y, z] = given.rotation.to_array();
                    given.rotation = Quat::from_xyzw(x, y, z, w);
                }
                Inverse => is_inverse = !is_inverse,
                OpenGl | Body => turn = step.turn_to_optical(),
                Opposite => given.rotation = Quat::from_xyzw(1.0, 0.0, 0.0, 0.0) * given.rotation,
            }
        }
        let target_from_sensor = if is_inverse { given.inverse() } else { given };
        let upright_from_sensor = self.upright_from_target * target_from_sensor;
        Some(pose_from_parts(upright_from_sensor.rotation * turn, upright_from_sensor.translation))
    }

    /// Where it has a plane of which the sensor sees a point, if the sensor has this pose.
    pub(crate) fn claim(&self, pose: &Pose, plane: &Plane, at_m: Vec3) -> Claim {
        let up = pose.rotation * plane.normal;
        let height_m = self.table_z_m.map_or(0.0, |z_m| (*pose * at_m).z - z_m);
        let tilt_rad_max = if self.table_z_m.is_some() { TILT_RAD_MAX } else { LEVEL_RAD_MAX };
        Claim { tilt_rad: libm::acosf(up.z.clamp(-1.0, 1.0)), tilt_rad_max, height_m }
    }
}

/// Where a pose has a plane that is seen.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Claim {
    pub(crate) tilt_rad: f32,
    tilt_rad_max: f32,
    /// Above the table's height.
    pub(crate) height_m: f32,
}

impl Claim {
    /// In tolerances.
    pub(crate) fn fault(&self) -> f32 {
        self.tilt_rad / self.tilt_rad_max + self.height_m.abs() / HEIGHT_OFF_M_MAX
    }

    /// What is said of a table that is tilted, or too high or low; `None` if it is where it should be.
    pub(crate) fn told(&self) -> Option<String> {
        let (degrees, off_mm) = (self.tilt_rad.to_degrees(), 1e3 * self.height_m.abs());
        let way = if self.height_m > 0.0 { "above" } else { "below" };
        if self.tilt_rad > self.tilt_rad_max {
            return Some(format!("the table is seen tilted by {degrees:.0}°: check the rotation of the camera's pose"));
        }
        (self.height_m.abs() > HEIGHT_OFF_M_MAX).then(|| {
            format!("the table is seen {off_mm:.0} mm {way} where the workspace has it: check the camera's position")
        })
    }

    /// 1 of a table that is where it should be, and far less at a tolerance.
    fn fit(&self) -> f32 {
        let [tilt, height] = [self.tilt_rad / self.tilt_rad_max, self.height_m / HEIGHT_OFF_M_MAX];
        libm::expf(-libm::logf(BETTER) * (tilt * tilt + height * height))
    }
}

/// What a sensor saw, and what was said of it.
#[derive(Debug, Clone)]
pub(crate) struct Sight {
    /// Points in the sensor's frame, in metres.
    pub(crate) points_m: Vec<Vec3>,
    /// The lens, if they are of one depth image.
    pub(crate) lens: Option<Intrinsics>,
    /// Whether they were given as a cloud.
    pub(crate) is_cloud: bool,
    /// Where the sensor is; without it a camera is believed to stand upright.
    pub(crate) place: Option<Place>,
    pub(crate) seed: u64,
}

impl Sight {
    /// Planes in the points, if their depths are scaled.
    pub(crate) fn tables(&self, depths: f32) -> Vec<TableCandidate> {
        let scaled: Vec<Vec3> = self.points_m.iter().map(|at_m| *at_m * depths).collect();
        find_tables(&scaled, None, None, &mut Stream::new(self.seed, 0, Purpose::Plane, 1))
    }

    /// Whether planes, the likeliest table first, are not what was to be expected.
    pub(crate) fn is_doubtful(&self, tables: &[TableCandidate]) -> bool {
        let is_odd = |lens: Intrinsics| BETTER * likelihood(&lens) < 1.0;
        let is_out_of_range = |best: &TableCandidate| !(SEEN_M[0]..=SEEN_M[1]).contains(&best.foot_m().length());
        self.lens.is_some_and(is_odd)
            || tables.first().is_none_or(is_out_of_range)
            || BETTER * self.score(tables, self.lens, NOTHING) < most(tables)
    }

    /// The mistakes without which planes have far more evidence; several only if they are of one kind and explain
    /// about as much.
    pub(crate) fn explained(&self, given: &[TableCandidate]) -> Vec<Mistake> {
        let of_given = self.score(given, self.lens, NOTHING);
        // Without the table's height units are hardly to be told apart, and any tilt is a focal length's.
        let is_rough = self.place.is_none_or(|place| place.table_z_m.is_none());
        let of = |mistake: &Mistake| {
            let scaled;
            let (mut tables, mut lens, mut steps) = (given, self.lens, NOTHING);
            match *mistake {
                Mistake::Pose(done) => steps = done,
                Depths(share) => {
                    scaled = self.tables(share);
                    tables = &scaled;
                }
                Focal([x, y]) if is_rough && x == y => return None,
                of_lens => lens = Some(of_lens.true_lens(self.lens.as_ref()?)?),
            }
            let score = self.score(tables, lens, steps);
            (score > BETTER * of_given && CLOSE * score >= most(tables)).then_some((*mistake, score))
        };
        let found: Vec<(Mistake, f32)> = Mistake::all().par_iter().filter_map(of).collect();
        let Some((best, most)) = found.iter().copied().reduce(|best, one| if one.1 > best.1 { one } else { best })
        else {
            return Vec::new();
        };
        let least = most / if is_rough && matches!(best, Depths(_)) { BETTER } else { 2.0 };
        let alike =
            found.into_iter().filter(|(one, score)| *score >= least && discriminant(one) == discriminant(&best));
        alike.map(|(one, _)| one).collect()
    }

    /// The evidence for the plane that is the table, if a lens took the image and this was done to the pose.
    fn score(&self, tables: &[TableCandidate], lens: Option<Intrinsics>, steps: &[Step]) -> f32 {
        let place = match self.place {
            Some(place) => place.without(steps).map(|pose| Some((place, pose))),
            None => steps.is_empty().then_some(None),
        };
        let Some(place) = place else { return 0.0 };
        let of = |table: &TableCandidate| {
            let (plane, at_m) = match (self.lens, lens) {
                (Some(given), Some(other)) => through(&given, &other, table),
                _ => (table.plane, table.foot_m()),
            };
            let fit = place.map_or_else(|| upright(plane.normal), |(said, pose)| said.claim(&pose, &plane, at_m).fit());
            evidence(table) * fit
        };
        tables.iter().map(of).fold(0.0, f32::max) * lens.map_or(1.0, |lens| likelihood(&lens))
    }

    /// What would be otherwise without mistakes of one kind.
    pub(crate) fn describe(&self, mistakes: &[Mistake]) -> String {
        let key = self.place.map_or("", |place| place.key);
        let shares: Vec<String> = mistakes
            .iter()
            .filter_map(|one| if let Depths(share) = one { Some(share.to_string()) } else { None })
            .collect();
        match mistakes.first() {
            Some(Mistake::Pose(steps)) => {
                let done: Vec<String> = steps.iter().map(|step| step.describe(key)).collect();
                format!("if {key} were {}", done.join(", "))
            }
            Some(Focal([x, y])) => format!("if fx_px and fy_px were {x} and {y} times what they are"),
            Some(Swapped) => "if cx_px and cy_px changed places".to_owned(),
            Some(Size(share)) => format!("if the intrinsics, those of another size, were {share:.2} of what they are"),
            _ if self.is_cloud => format!("if the cloud were {} of what it is (metres)", shares.join(" or ")),
            _ => format!("if the depths were {} of what they are (set depth_scale_m)", shares.join(" or ")),
        }
    }
}

/// The evidence for a table as it was seen.
fn evidence(table: &TableCandidate) -> f32 {
    let nearer = libm::logf(SEEN_M[0] / table.foot_m().length()).max(0.0) / NEARER_LOG;
    table.evidence * libm::expf(-nearer * nearer)
}

/// The most evidence for any of some planes, or as much as a table must have.
fn most(tables: &[TableCandidate]) -> f32 {
    tables.iter().map(evidence).fold(CLOSE * EVIDENCE_MIN, f32::max)
}

/// A plane and a point of it as they would be if another lens than the given one had taken the image: a plane, too, as
/// points move along x and y by shares of their x, y and z.
fn through(given: &Intrinsics, other: &Intrinsics, table: &TableCandidate) -> (Plane, Vec3) {
    let shift = Vec3::new((given.cx_px - other.cx_px) / other.fx_px, (given.cy_px - other.cy_px) / other.fy_px, 1.0);
    let stretch = Mat3::from_cols(Vec3::X * (given.fx_px / other.fx_px), Vec3::Y * (given.fy_px / other.fy_px), shift);
    let normal = stretch.inverse().transpose() * table.plane.normal;
    let length = normal.length();
    (Plane { normal: normal / length, offset_m: table.plane.offset_m / length }, stretch * table.foot_m())
}
