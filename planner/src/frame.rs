//! Where the workspace is: on a table that is found in what was seen, or where the cameras' poses say. Poses are held
//! against the table that the images show, and the usual mistakes are tried as explanations.

use core::f32::consts::PI;
use std::borrow::Cow;

use perception::{COLUMNS_PX, PlaneParams, TableCandidate, find_plane, find_tables, seen_above};
use rayon::prelude::*;
use schema::{Grid, Mat3, Plane, Pose, Purpose, Quat, Stream, Vec3, pose_from_parts};

use crate::input::{InputError, refuse};
use crate::observation::{FindTable, Observation, View};

/// A quick look is at so many along an image's width; a table is among what they show with at least this share, and
/// level.
const QUICK_COLUMNS_PX: usize = 80;
const QUICK_SHARE_MIN: f32 = 0.2;
const QUICK: PlaneParams =
    PlaneParams { threshold_m: 0.006, iterations: 30, refits_max: 3, tilt_rad_max: 0.0, share_min: 0.3 };
/// Other planes are as good as the best from this share of its score.
const AS_GOOD: f32 = 0.5;
/// A table tilted by more, or seen further above or below its height, is not where the workspace has it: sensors'
/// scales are off by 3 %.
const TILT_RAD_MAX: f32 = PI / 60.0;
const HEIGHT_OFF_M_MAX: f32 = 0.025;
/// What is tilted or shifted by less than this is a plain fault, not a mistaken convention.
const PLAIN_RAD_MAX: f32 = PI / 9.0;
const PLAIN_M_MAX: f32 = 0.1;
/// A fault of fewer tolerances is plain, whatever else would explain it.
const SMALL_FAULT: f32 = 2.5;
/// Planes of which fewer points are seen prove nothing …
const SHARE_MIN: f32 = 0.05;
/// … and those with less than this share of the best one's score neither.
const STRONG: f32 = 0.3;
/// Things are higher than this above the table, and cut where so many pixels of the border show them.
const CUT_M: f32 = 0.02;
const CUT_PX_MIN: usize = 12;
/// Units of depth that are taken for millimetres, in millimetres.
const UNITS: [f32; 4] = [0.1, 0.25, 0.125, 10.0];
/// A principal point is rarely further from the middle of its image, in the image's sides.
const CENTRE_OFF_MAX: f32 = 0.2;

/// A table that was found.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundTable {
    /// The planes that may be the table in the frame of the first camera or of the cloud, the chosen one first.
    pub candidates: Vec<TableCandidate>,
    /// The workspace that was put on it.
    pub workspace_from_first: Pose,
}

impl FoundTable {
    /// How sure the choice is: 1 where no other plane is nearly as good, 0 where another one is as good.
    #[must_use]
    pub fn sureness(&self) -> f32 {
        let [first, second] = [0, 1].map(|place| self.candidates.get(place).map_or(0.0, |plane| plane.score));
        if first > 0.0 { 1.0 - second / first } else { 0.0 }
    }

    /// The warning for a choice that is no better than another one.
    pub(crate) fn warning(&self) -> Option<String> {
        let rivals = self.candidates.iter().skip(1).filter(|plane| plane.score > AS_GOOD * self.candidates[0].score);
        let said: Vec<String> = rivals.map(|rival| describe(&rival.plane)).collect();
        (!said.is_empty()).then(|| {
            format!(
                "{} was taken for the table, but it might be {}: give the direction of gravity (down) or the camera's pose",
                describe(&self.candidates[0].plane),
                said.join(", or ")
            )
        })
    }
}

fn describe(plane: &Plane) -> String {
    let [x, y, z] = plane.normal.to_array();
    format!("the plane {:.2} m from the camera with normal {x:.2}, {y:.2}, {z:.2}", -plane.offset_m)
}

/// What an observation shows, in the first camera's frame or a cloud's, to find the table.
///
/// # Errors
/// [`InputError`] if it is a TSDF.
fn shown_m(observation: &Observation) -> Result<Cow<'_, [Vec3]>, InputError> {
    match observation {
        Observation::Views(views) => {
            Ok(views.iter().flat_map(|view| seen_m(view, COLUMNS_PX)).collect::<Vec<_>>().into())
        }
        Observation::Cloud { points_m, .. } => Ok(points_m.into()),
        Observation::Tsdf(_) => refuse("in a TSDF the table is at its height, and cannot be found: tsdf"),
    }
}

/// Finds the table in an observation and puts the workspace on it: z along its normal, x along the camera's, the things
/// there that the camera is pointed at in the middle of a network's grid.
///
/// # Errors
/// [`InputError`] if no plane was seen, or it is a TSDF.
pub(crate) fn find(
    observation: &Observation,
    wanted: &FindTable,
    grid: &Grid,
    seed: u64,
) -> Result<FoundTable, InputError> {
    let points_m = shown_m(observation)?;
    let sides = observation.images().and_then(<[View]>::first).map(|first| {
        let lens = first.camera.intrinsics;
        [[0, 0], [lens.width_px, lens.height_px]].map(|pixel| lens.ray(pixel).truncate())
    });
    let tables = |points_m: &[Vec3]| {
        find_tables(points_m, wanted.gravity(), sides, &mut Stream::new(seed, 0, Purpose::Plane, 1))
    };
    let candidates = tables(&points_m);
    let Some(best) = candidates.first().filter(|best| best.score > 0.0) else {
        let of_other_unit = UNITS.into_iter().find(|unit| {
            let scaled: Vec<Vec3> = points_m.iter().map(|at| *at * *unit).collect();
            tables(&scaled).first().is_some_and(|best| best.share > SHARE_MIN)
        });
        let hint = match of_other_unit {
            Some(unit) => format!("one would be seen if the depths were {unit} of what they are (set depth_scale_m)"),
            None => "give the camera's pose, workspace_from_camera".to_owned(),
        };
        return refuse(format!("no table was found in what the camera sees between 0.1 m and 2.5 m: {hint}"));
    };
    let up = best.plane.normal;
    let along = (Vec3::X - up * up.x).try_normalize().unwrap_or_else(|| up.any_orthonormal_vector());
    let first_from_workspace = Quat::from_mat3(&Mat3::from_cols(along, up.cross(along), up)).normalize();
    // The middle of what stands on the table, at the table's height.
    let middle_in_workspace_m = Vec3::new(0.5 * grid.size_m, 0.5 * grid.size_m, grid.table_z_m);
    let rotation = first_from_workspace.inverse();
    let workspace_from_first = pose_from_parts(rotation, middle_in_workspace_m - rotation * best.foot_m());
    Ok(FoundTable { candidates, workspace_from_first })
}

/// An observation in another frame.
pub(crate) fn moved(observation: &Observation, target_from_source: &Pose) -> Observation {
    match observation {
        Observation::Views(views) => {
            let mut views = views.clone();
            for View { camera, .. } in &mut views {
                camera.workspace_from_camera = *target_from_source * camera.workspace_from_camera;
            }
            Observation::Views(views)
        }
        Observation::Cloud { points_m, eyes_m } => {
            let moved = |points_m: &[Vec3]| points_m.iter().map(|at| *target_from_source * *at).collect();
            // A cloud without viewpoints is in its sensor's frame.
            let eyes_m = if eyes_m.is_empty() { &vec![Vec3::ZERO] } else { eyes_m };
            Observation::Cloud { points_m: moved(points_m), eyes_m: moved(eyes_m) }
        }
        Observation::Tsdf(grid) => Observation::Tsdf(grid.clone()),
    }
}

/// What a view shows, in the frame of its pose.
fn seen_m(view: &View, columns_px: usize) -> Vec<Vec3> {
    let seen = seen_above(&(view.camera, &view.image, 1.0), columns_px, f32::NEG_INFINITY);
    seen.into_iter().map(|(at_m, _)| at_m).collect()
}

/// A camera's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Axes {
    Optical,
    /// y up and z backwards.
    OpenGl,
    /// x forward, y left and z up.
    Body,
}

impl Axes {
    /// The optical frame in these axes.
    fn turn_to_optical(self) -> Quat {
        match self {
            Self::Optical => Quat::IDENTITY,
            Self::OpenGl => Quat::from_xyzw(1.0, 0.0, 0.0, 0.0),
            // The optical x is right, -y of the body; y is down, -z; z is forward, x.
            Self::Body => Quat::from_mat3(&Mat3::from_cols(-Vec3::Y, -Vec3::Z, Vec3::X)),
        }
    }
}

/// Mistakes that occur together.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Mistakes {
    is_inverted: bool,
    axes: Axes,
    is_in_mm: bool,
    is_w_first: bool,
    /// The true depths in those that were given.
    depths: f32,
}

impl Mistakes {
    const NONE: Self =
        Self { is_inverted: false, axes: Axes::Optical, is_in_mm: false, is_w_first: false, depths: 1.0 };

    /// What is tried, the simplest explanation first.
    fn tried() -> Vec<Self> {
        let axes = [Axes::OpenGl, Axes::Body].map(|axes| Self { axes, ..Self::NONE });
        let inverted = Self { is_inverted: true, ..Self::NONE };
        let single = [inverted, Self { is_in_mm: true, ..Self::NONE }, Self { is_w_first: true, ..Self::NONE }];
        let units = UNITS.map(|depths| Self { depths, ..Self::NONE });
        let both = axes.map(|axes| Self { is_inverted: true, ..axes });
        let in_mm = [axes[0], inverted, both[0]].map(|mistakes| Self { is_in_mm: true, ..mistakes });
        [&axes[..], &single, &units, &both, &in_mm].concat()
    }

    /// What was given instead of the pose of a key.
    fn describe(self, key: &str) -> String {
        if self.depths != 1.0 {
            return format!("if the depths were {} of what they are (set depth_scale_m)", self.depths);
        }
        let inverse = key.split_once("_from_").map_or_else(String::new, |(to, from)| format!("{from}_from_{to}"));
        let parts = [
            (self.is_inverted, format!("the inverse, {inverse}")),
            (self.axes == Axes::OpenGl, "in OpenGL's camera axes, y up and z backwards".to_owned()),
            (
                self.axes == Axes::Body,
                "the pose of the camera's body frame (x forward, y left, z up), not of its optical frame".to_owned(),
            ),
            (self.is_in_mm, "in millimetres".to_owned()),
            (self.is_w_first, "given with w first in its quaternion".to_owned()),
        ];
        let parts: Vec<String> = parts.into_iter().filter(|(is, _)| *is).map(|(_, what)| what).collect();
        format!("if {key} were {}", parts.join(", "))
    }

    /// The camera in the workspace if its pose was given with these mistakes.
    fn corrected(self, view: &View, base_from_workspace: Option<Pose>) -> Pose {
        let key = view.key;
        let workspace_from_target = match base_from_workspace {
            Some(base_from_workspace) if key.is_of_base() => base_from_workspace.inverse(),
            _ => Pose::IDENTITY,
        };
        let target_from_camera = workspace_from_target.inverse() * view.camera.workspace_from_camera;
        let mut given = if key.is_inverse() { target_from_camera.inverse() } else { target_from_camera };
        if self.is_in_mm {
            given.translation *= 1e-3;
        }
        if self.is_w_first {
            let [w, x, y, z] = given.rotation.to_array();
            given.rotation = Quat::from_xyzw(x, y, z, w);
        }
        let target_from_axes = if key.is_inverse() == self.is_inverted { given } else { given.inverse() };
        let corrected = workspace_from_target * target_from_axes;
        pose_from_parts(corrected.rotation * self.axes.turn_to_optical(), corrected.translation)
    }
}

/// Where a camera's pose has a plane that the camera sees.
struct Claim {
    tilt_rad: f32,
    /// Above the table's height in the middle of what is carried.
    height_m: f32,
}

impl Claim {
    fn of(workspace_from_camera: &Pose, table: &TableCandidate, grid: &Grid) -> Self {
        let up = workspace_from_camera.rotation * table.plane.normal;
        let at_m = *workspace_from_camera * table.foot_m();
        Self { tilt_rad: libm::acosf(up.z.clamp(-1.0, 1.0)), height_m: at_m.z - grid.table_z_m }
    }

    fn is_within(&self, tilt_rad: f32, height_m: f32) -> bool {
        self.tilt_rad <= tilt_rad && self.height_m.abs() <= height_m
    }

    /// What is said of a table that is tilted, or too high or low; `None` if it is where it should be.
    fn told(&self) -> Option<String> {
        let (degrees, off_mm) = (self.tilt_rad.to_degrees(), 1e3 * self.height_m.abs());
        let way = if self.height_m > 0.0 { "above" } else { "below" };
        if self.tilt_rad > TILT_RAD_MAX {
            return Some(format!("the table is seen tilted by {degrees:.0}°: check the rotation of the camera's pose"));
        }
        (self.height_m.abs() > HEIGHT_OFF_M_MAX).then(|| {
            format!("the table is seen {off_mm:.0} mm {way} where the workspace has it: check the camera's position")
        })
    }

    /// In tolerances.
    fn fault(&self) -> f32 {
        self.tilt_rad / TILT_RAD_MAX + self.height_m.abs() / HEIGHT_OFF_M_MAX
    }
}

/// Warnings for an observation whose frame is not where what it shows says.
pub(crate) fn doubts(
    observation: &Observation,
    base_from_workspace: Option<Pose>,
    grid: &Grid,
    seed: u64,
) -> Vec<String> {
    match observation {
        Observation::Views(views) => disagreements(views, base_from_workspace, grid, seed),
        Observation::Cloud { points_m, .. } => in_camera_frame(points_m, grid, seed).into_iter().collect(),
        Observation::Tsdf(_) => Vec::new(),
    }
}

/// Warnings for views whose poses or lenses disagree with what they show; one for all views with the same fault.
fn disagreements(views: &[View], base_from_workspace: Option<Pose>, grid: &Grid, seed: u64) -> Vec<String> {
    let of_view = |view: &View| [misplaced(view, base_from_workspace, grid, seed), other_lens(view)];
    let found: Vec<[Option<String>; 2]> = views.par_iter().map(of_view).collect();
    let mut warnings: Vec<String> = Vec::new();
    for said in found.iter().flatten().flatten() {
        let of = |(number, faults): (usize, &[Option<String>; 2])| {
            faults.iter().flatten().any(|fault| fault == said).then(|| format!("views[{number}]"))
        };
        let places: Vec<String> = found.iter().enumerate().filter_map(of).collect();
        let warning = format!("{said}: {}", places.join(", "));
        if !warnings.contains(&warning) {
            warnings.push(warning);
        }
    }
    warnings
}

/// A quick look at whether a view shows the table where its pose has it: at most plans it is.
fn is_plainly_right(view: &View, grid: &Grid, seed: u64) -> bool {
    let seen_m = seen_m(view, QUICK_COLUMNS_PX);
    let on_table: Vec<Vec3> =
        seen_m.iter().copied().filter(|at| (at.z - grid.table_z_m).abs() <= HEIGHT_OFF_M_MAX).collect();
    let params = PlaneParams { tilt_rad_max: PLAIN_RAD_MAX, ..QUICK };
    let plane = find_plane(&on_table, &params, &mut Stream::new(seed, 0, Purpose::Plane, 2));
    let level = plane.is_some_and(|found| found.plane.normal.z >= libm::cosf(TILT_RAD_MAX));
    level && on_table.len() as f32 >= QUICK_SHARE_MIN * seen_m.len() as f32
}

/// What is wrong with a view's pose, by the table that it shows.
fn misplaced(view: &View, base_from_workspace: Option<Pose>, grid: &Grid, seed: u64) -> Option<String> {
    if is_plainly_right(view, grid, seed) {
        return None;
    }
    let given = view.camera.workspace_from_camera;
    let camera_from_workspace = given.inverse();
    let own_m: Vec<Vec3> = seen_m(view, COLUMNS_PX).into_iter().map(|at| camera_from_workspace * at).collect();
    let tables = |depths: f32| {
        let scaled: Vec<Vec3> = own_m.iter().map(|at| *at * depths).collect();
        let mut found = find_tables(&scaled, None, None, &mut Stream::new(seed, 0, Purpose::Plane, 1));
        let least = STRONG * found.first().map_or(0.0, |best| best.score);
        found.retain(|table| table.score >= least && table.share >= SHARE_MIN);
        found
    };
    let own = tables(1.0);
    let claims = own.iter().map(|table| Claim::of(&given, table, grid));
    let nearest = claims.min_by(|a, b| a.fault().total_cmp(&b.fault()));
    let plain = nearest.as_ref().filter(|claim| claim.is_within(PLAIN_RAD_MAX, PLAIN_M_MAX));
    if let Some(claim) = plain.filter(|claim| claim.fault() < SMALL_FAULT) {
        return claim.told();
    }
    let explains = |mistakes: &Mistakes| {
        let corrected = mistakes.corrected(view, base_from_workspace);
        let found = if mistakes.depths == 1.0 { own.clone() } else { tables(mistakes.depths) };
        found.first().is_some_and(|table| Claim::of(&corrected, table, grid).is_within(TILT_RAD_MAX, HEIGHT_OFF_M_MAX))
    };
    let elsewhere = format!("the table was not seen at z = {:.0} mm, where the workspace has it", 1e3 * grid.table_z_m);
    if let Some(mistakes) = Mistakes::tried().iter().find(|mistakes| explains(mistakes)) {
        return Some(format!("{elsewhere}; it would be seen there {}", mistakes.describe(view.key.name())));
    }
    if let Some(claim) = plain {
        return claim.told();
    }
    nearest?;
    let own_frame = if given == Pose::IDENTITY { ": the pose is the identity, the camera's own frame" } else { "" };
    Some(format!("{elsewhere}{own_frame}; the table can be found, if {} is \"table\"", view.key.name()))
}

/// The warning for a cloud that shows no table where the workspace has it, but one as a camera sees it.
fn in_camera_frame(points_m: &[Vec3], grid: &Grid, seed: u64) -> Option<String> {
    let on_table = points_m.iter().filter(|at| (at.z - grid.table_z_m).abs() <= HEIGHT_OFF_M_MAX).count();
    if on_table as f32 >= SHARE_MIN * points_m.len() as f32 {
        return None;
    }
    let found = find_tables(points_m, None, None, &mut Stream::new(seed, 0, Purpose::Plane, 1));
    // Below a camera that stands upright, y points down and z forward.
    let is_seen_so = |best: &TableCandidate| best.share > 0.2 && best.plane.normal.z < 0.0;
    found.first().is_some_and(is_seen_so).then(|| {
        format!(
            "the cloud has no table at z = {:.0} mm, where the workspace has it, but one as its camera would see it: is it in its \
             camera's own frame (workspace_from_cloud = \"table\")?",
            1e3 * grid.table_z_m
        )
    })
}

/// Warnings for views of which the border cuts things within reach.
pub(crate) fn cut(views: &[View], [low_m, high_m]: [Vec3; 2], table_z_m: f32) -> Vec<String> {
    let is_thing = |at: &Vec3| {
        let within = at.truncate().cmpge(low_m.truncate()).all() && at.truncate().cmple(high_m.truncate()).all();
        within && (table_z_m + CUT_M..high_m.z).contains(&at.z)
    };
    let is_cut = |View { image, camera, .. }: &View| {
        let (last_u, last_v) = (image.width_px - 1, image.height_px - 1);
        let rows = (0..image.width_px).flat_map(|u| [[u, 0], [u, last_v]]);
        let border = rows.chain((0..image.height_px).flat_map(|v| [[0, v], [last_u, v]]));
        let seen = border.filter_map(|pixel| Some((pixel, image.at(pixel).filter(|depth_m| depth_m.is_finite())?)));
        let points = seen.map(|(pixel, m)| camera.workspace_from_camera * (camera.intrinsics.ray(pixel) * m));
        points.filter(is_thing).count() >= CUT_PX_MIN
    };
    let cut: Vec<String> = (0..views.len()).filter(|at| is_cut(&views[*at])).map(|at| format!("views[{at}]")).collect();
    let what =
        "the border of the image cuts things within reach: where no camera looks beside them no grasp is offered";
    if cut.is_empty() { Vec::new() } else { vec![format!("{what}: {}", cut.join(", "))] }
}

/// Whether the principal point is that of another image.
fn other_lens(view: &View) -> Option<String> {
    let lens = view.camera.intrinsics;
    let off = |centre_px: f32, side_px: usize| (centre_px / side_px as f32 - 0.5).abs();
    let is_off = off(lens.cx_px, lens.width_px).max(off(lens.cy_px, lens.height_px)) > CENTRE_OFF_MAX;
    is_off.then(|| {
        format!(
            "the principal point {:.0}, {:.0} is far from the middle of an image of {} x {}: are the intrinsics those of \
             another size?",
            lens.cx_px, lens.cy_px, lens.width_px, lens.height_px
        )
    })
}

#[cfg(test)]
mod tests {
    use schema::axis_angle;

    use super::*;
    use crate::PoseKey;
    use crate::demo;
    use crate::input::assemble;

    /// The demo's views.
    fn demo_views() -> Vec<View> {
        let request = assemble(&demo::request().unwrap(), None, Grid::PAPER).unwrap();
        assert_eq!(request.warnings, Vec::<String>::new());
        let Observation::Views(views) = request.observation else { panic!("the demo has views") };
        views
    }

    fn base_from_workspace() -> Pose {
        Pose::from_parts(Vec3::new(0.4, -0.2, 0.1), axis_angle(Vec3::Z, 0.7))
    }

    /// The warnings if the demo's poses are given wrongly under this key.
    fn warnings(key: PoseKey, given: impl Fn(&Pose) -> Pose) -> Vec<String> {
        let target_from_workspace = if key.is_of_base() { base_from_workspace() } else { Pose::IDENTITY };
        let mut views = demo_views();
        for view in &mut views {
            let given = given(&(target_from_workspace * view.camera.workspace_from_camera));
            let target_from_camera = if key.is_inverse() { given.inverse() } else { given };
            view.camera.workspace_from_camera = target_from_workspace.inverse() * target_from_camera;
            view.key = key;
        }
        disagreements(&views, Some(base_from_workspace()), &Grid::PAPER, 1)
    }

    fn in_axes(pose: &Pose, axes: Axes) -> Pose {
        Pose::from_parts(pose.translation, pose.rotation * axes.turn_to_optical().inverse())
    }

    fn in_mm(pose: &Pose) -> Pose {
        Pose::from_parts(pose.translation * 1e3, pose.rotation)
    }

    fn w_first(pose: &Pose) -> Pose {
        let [x, y, z, w] = pose.rotation.to_array();
        Pose::from_parts(pose.translation, Quat::from_xyzw(w, x, y, z))
    }

    type Mistake = fn(&Pose) -> Pose;

    #[test]
    fn every_usual_mistake_is_recognised_and_named() {
        for (key, inverse) in
            [(PoseKey::WorkspaceFromCamera, "camera_from_workspace"), (PoseKey::BaseFromCamera, "camera_from_base")]
        {
            assert_eq!(warnings(key, |pose| *pose), Vec::<String>::new());
            let cases: [(Mistake, String); 6] = [
                (|pose| in_axes(pose, Axes::OpenGl), "in OpenGL's camera axes, y up and z backwards".to_owned()),
                (
                    |pose| in_axes(pose, Axes::Body),
                    "the pose of the camera's body frame (x forward, y left, z up)".to_owned(),
                ),
                (|pose| pose.inverse(), format!("the inverse, {inverse}")),
                (in_mm, "in millimetres".to_owned()),
                // OpenGL's view matrix: from the world to the camera, in OpenGL's axes.
                (|pose| in_axes(pose, Axes::OpenGl).inverse(), format!("the inverse, {inverse}, in OpenGL's")),
                (|pose| in_mm(&pose.inverse()), format!("the inverse, {inverse}, in millimetres")),
            ];
            for (mistake, expected) in cases {
                let all = warnings(key, mistake);
                let [warning] = &all[..] else { panic!("{expected}: {all:?}") };
                assert!(warning.contains(&expected), "{expected}: {warning}");
                assert!(warning.ends_with(": views[0], views[1], views[2]"), "{warning}");
            }
        }
        // One of the three poses hardly changes so.
        let first = warnings(PoseKey::WorkspaceFromCamera, w_first);
        assert!(
            first.iter().any(|one| one.contains("with w first in its quaternion: views[0], views[1]")),
            "{first:?}"
        );
        let inverted = &warnings(PoseKey::CameraFromBase, Pose::inverse)[..];
        assert_eq!(inverted, Vec::<String>::new());
        let inverted = &warnings(PoseKey::CameraFromBase, |pose| *pose)[0];
        assert!(inverted.contains("if camera_from_base were the inverse, base_from_camera"), "{inverted}");
    }

    /// A fault of so many millimetres or degrees is told as what it is.
    #[test]
    fn plain_faults_are_no_mistaken_conventions() {
        let key = PoseKey::WorkspaceFromCamera;
        for (off_m, said) in [(0.03, "seen 30 mm above"), (-0.06, "seen 60 mm below")] {
            let all = warnings(key, |pose| Pose::from_parts(pose.translation + Vec3::Z * off_m, pose.rotation));
            assert!(all.len() == 1 && all[0].contains(said), "{all:?}");
        }
        for (degrees, is_told) in [(2.0_f32, false), (5.0, true), (10.0, true)] {
            let turn = axis_angle(Vec3::X, degrees.to_radians());
            let about = Pose::from_parts(Vec3::new(0.15, 0.15, 0.05), turn);
            let middle = Pose::from_parts(Vec3::new(0.15, 0.15, 0.05), Quat::IDENTITY);
            let all = warnings(key, |pose| about * middle.inverse() * *pose);
            assert_eq!(all.iter().any(|one| one.contains(&format!("tilted by {degrees:.0}°"))), is_told, "{all:?}");
        }
        let aside = warnings(key, |pose| Pose::from_parts(pose.translation + Vec3::new(1.0, 0.0, 0.3), pose.rotation));
        assert!(aside[0].contains("was not seen at z = 50 mm") && !aside[0].contains("would be seen"), "{aside:?}");
        let own = warnings(key, |_| Pose::IDENTITY);
        assert!(own[0].contains("the pose is the identity, the camera's own frame"), "{own:?}");
    }

    #[test]
    fn depths_in_another_unit_and_another_lens_are_named_for_the_view_that_has_them() {
        for scale in [10.0, 4.0, 8.0, 0.1] {
            let mut views = demo_views();
            views[1].image.depth_m.iter_mut().for_each(|depth_m| *depth_m *= scale);
            let all = disagreements(&views, None, &Grid::PAPER, 1);
            let said = format!("if the depths were {} of what they are (set depth_scale_m): views[1]", 1.0 / scale);
            assert!(all.len() == 1 && all[0].ends_with(&said), "{said}: {all:?}");
        }
        let mut views = demo_views();
        views[2].camera.intrinsics.cx_px = 640.0;
        let all = disagreements(&views, None, &Grid::PAPER, 1);
        assert!(all.iter().any(|one| one.contains("those of another size?: views[2]")), "{all:?}");
    }

    #[test]
    fn the_workspace_is_put_on_the_table_that_the_first_camera_sees() {
        let views = demo_views();
        let first = views[0].camera.workspace_from_camera;
        let seen = moved(&Observation::Views(views), &first.inverse());
        let found = find(&seen, &FindTable::default(), &Grid::PAPER, 1).unwrap();
        assert!(found.sureness() > 0.5 && found.warning().is_none(), "{found:?}");
        // Up is up, and the table is at its height; where x and y are is chosen.
        let between = found.workspace_from_first * first.inverse();
        assert!((between.rotation * Vec3::Z).dot(Vec3::Z) > 0.999_99, "{between:?}");
        assert!((between * Vec3::new(0.15, 0.15, 0.05)).z - 0.05 < 1e-3, "{between:?}");
        let Observation::Views(again) = moved(&seen, &found.workspace_from_first) else { panic!("views") };
        assert_eq!(disagreements(&again, None, &Grid::PAPER, 1), Vec::<String>::new());
        let nothing = Observation::Cloud { points_m: Vec::new(), eyes_m: Vec::new() };
        let error = find(&nothing, &FindTable::default(), &Grid::PAPER, 1).unwrap_err().to_string();
        assert!(error.starts_with("no table was found"), "{error}");
    }
}
