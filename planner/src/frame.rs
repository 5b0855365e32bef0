//! Where the workspace is: on a table that is found in what was seen, or about an object that is all that was seen.

use std::borrow::Cow;

use perception::{COLUMNS_PX, TableCandidate, find_tables, seen_above};
use schema::{Grid, Mat3, Plane, Pose, Purpose, Quat, Stream, Vec3, pose_from_parts};

use crate::doubt::border;
use crate::input::{InputError, refuse};
use crate::mistake::{DOWN, Place, Sight};
use crate::observation::{FindTable, Observation, Target, View};

/// Other planes are as good as the best from this share of its score.
const AS_GOOD: f32 = 0.5;
/// Things are higher than this above the table, and cut where so many pixels of the border show them.
const CUT_M: f32 = 0.02;
const CUT_PX_MIN: usize = 12;
/// Points of a cloud among which mistakes are looked for.
pub(crate) const POINTS: usize = 20_000;
/// A cloud of one object is no larger.
const ALONE_M: f32 = 0.5;
/// A table under things is at least this wide, off its plane is what is this far from it, and below it lies no more
/// than a share of what is seen, or than a share of what is above it.
const TABLE_WIDE_M: f32 = 0.12;
const OFF_M: f32 = 0.015;
const BELOW_SHARE: f32 = 0.02;
const BELOW_ABOVE: f32 = 0.3;
/// A cloud about its middle is taken as seen from this far before it.
const BEFORE_M: f32 = 0.5;
/// An object without a table floats this far above the workspace's.
const FLOAT_M: f32 = 0.1;
/// An object's points are no further from the rest of its scene.
const BESIDE_M: f32 = 0.05;

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

pub(crate) fn describe(plane: &Plane) -> String {
    let [x, y, z] = plane.normal.to_array();
    format!("the plane {:.2} m from the camera with normal {x:.2}, {y:.2}, {z:.2}", -plane.offset_m)
}

/// What an observation shows, in the first camera's frame or a cloud's, to find the table.
///
/// # Errors
/// [`InputError`] if it is a TSDF.
pub(crate) fn shown_m(observation: &Observation) -> Result<Cow<'_, [Vec3]>, InputError> {
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
    let candidates = find_tables(&points_m, wanted.gravity(), sides, &mut Stream::new(seed, 0, Purpose::Plane, 1));
    let Some(best) = candidates.first().filter(|best| best.score > 0.0) else {
        let sight = sight(observation, wanted, thinned(&points_m, POINTS), seed);
        let explained = sight.explained(&candidates);
        let hint = match (explained.is_empty(), sight.place) {
            (false, _) => format!("one would be seen {}", sight.describe(&explained)),
            (true, Some(place)) => format!("check {}{}, or leave it out", place.key, identity(&place)),
            (true, None) => "give the camera's pose, workspace_from_camera".to_owned(),
        };
        return refuse(format!("no table was found in what the camera sees between 0.1 m and 2.5 m: {hint}"));
    };
    // The middle of what stands on the table, at the table's height.
    let workspace_from_first = put(best.plane.normal, best.foot_m(), grid, 0.0);
    Ok(FoundTable { candidates, workspace_from_first })
}

/// The pose of the workspace with a direction up and a point in the middle of its table, or so far above it.
fn put(up: Vec3, foot_m: Vec3, grid: &Grid, above_m: f32) -> Pose {
    let along = (Vec3::X - up * up.x).try_normalize().unwrap_or_else(|| up.any_orthonormal_vector());
    let first_from_workspace = Quat::from_mat3(&Mat3::from_cols(along, up.cross(along), up)).normalize();
    let foot_in_workspace_m = Vec3::new(0.5 * grid.size_m, 0.5 * grid.size_m, grid.table_z_m + above_m);
    let rotation = first_from_workspace.inverse();
    pose_from_parts(rotation, foot_in_workspace_m - rotation * foot_m)
}

/// What is shown, and what was said of gravity, for mistakes to be looked for.
pub(crate) fn sight(observation: &Observation, wanted: &FindTable, points_m: Vec<Vec3>, seed: u64) -> Sight {
    let lens = match observation.images() {
        Some([only]) => Some(only.camera.intrinsics),
        _ => None,
    };
    let place =
        |key, given| Place { key, given, is_inverse: false, upright_from_target: Pose::IDENTITY, table_z_m: None };
    let hanging = |down: Vec3| pose_from_parts(Quat::from_rotation_arc(down.normalize(), Vec3::NEG_Z), Vec3::ZERO);
    let by_down = wanted.down.map(|down| place(DOWN, hanging(down)));
    let place = by_down.or_else(|| wanted.base_from_camera.map(|base| place("base_from_camera", base)));
    Sight { points_m, lens, is_cloud: observation.images().is_none(), place, seed }
}

/// What is said of a pose that nobody measured.
pub(crate) fn identity(place: &Place) -> &'static str {
    if place.given == Pose::IDENTITY && place.key != DOWN {
        " (it is the identity, the camera's own frame)"
    } else {
        ""
    }
}

/// A cloud that shows one object and no table, with its viewpoints; a workspace in which it floats above the table; and
/// the warning.
///
/// # Errors
/// [`InputError`] if the cloud has a table, and is about its own middle.
pub(crate) fn alone(
    observation: &Observation,
    wanted: &FindTable,
    grid: &Grid,
    seed: u64,
) -> Result<Option<(Observation, FoundTable, String)>, InputError> {
    let Observation::Cloud { points_m, eyes_m } = observation else { return Ok(None) };
    let [low_m, high_m] = bounds_m(points_m);
    // No point has a box without an end.
    if !(0.0..=ALONE_M).contains(&(high_m - low_m).max_element()) {
        return Ok(None);
    }
    let middle_m = 0.5 * (low_m + high_m);
    let is_inside = |eye_m: &Vec3| eye_m.cmpge(low_m).all() && eye_m.cmple(high_m).all();
    let is_centred = is_inside(&Vec3::ZERO);
    let eye_m = if is_centred { middle_m.with_z(low_m.z - BEFORE_M) } else { Vec3::ZERO };
    let shows_table = |scale: f32| {
        let few_m = thinned(points_m, POINTS).into_iter();
        let seen_m: Vec<Vec3> = few_m.map(|at_m| (at_m - eye_m) * scale).collect();
        let tables = find_tables(&seen_m, wanted.gravity(), None, &mut Stream::new(seed, 0, Purpose::Plane, 1));
        tables.first().is_some_and(|best| best.score > 0.0 && is_table(&best.plane, &seen_m))
    };
    if is_centred && shows_table(1.0) {
        return refuse("must be in the frame of its camera, got one with the origin among its points: cloud");
    }
    // A scene in tenths of a metre looks as small.
    if !is_centred && (shows_table(1.0) || shows_table(10.0)) {
        return Ok(None);
    }
    let mut eyes_m: Vec<Vec3> = eyes_m.iter().copied().filter(|eye_m| !is_inside(eye_m)).collect();
    if eyes_m.is_empty() {
        eyes_m.push(eye_m);
    }
    let to_eye = eyes_m[0] - middle_m;
    let by_gravity = wanted.gravity().map(|down| -down.normalize()).filter(|up| up.dot(to_eye) >= 0.0);
    let up = by_gravity.unwrap_or_else(|| to_eye.normalize());
    let lowest_m = points_m.iter().map(|at_m| up.dot(*at_m - middle_m)).fold(f32::INFINITY, f32::min);
    let workspace_from_first = put(up, middle_m + up * lowest_m, grid, FLOAT_M);
    let mut said =
        "the cloud shows one object and no table under it, and is planned afloat: give its scene, and it as object"
            .to_owned();
    if is_centred {
        said += "; the origin is in its middle, so it is taken as seen along its z";
    }
    let seen = Observation::Cloud { points_m: points_m.clone(), eyes_m };
    Ok(Some((seen, FoundTable { candidates: Vec::new(), workspace_from_first }, said)))
}

/// About so many of some points.
pub(crate) fn thinned(points_m: &[Vec3], count: usize) -> Vec<Vec3> {
    points_m.iter().copied().step_by(points_m.len().div_ceil(count).max(1)).collect()
}

/// The box of points.
pub(crate) fn bounds_m(points_m: &[Vec3]) -> [Vec3; 2] {
    let box_m = [Vec3::INFINITY, Vec3::NEG_INFINITY];
    points_m
        .iter()
        .filter(|at_m| at_m.is_finite())
        .fold(box_m, |[low_m, high_m], at_m| [low_m.min(*at_m), high_m.max(*at_m)])
}

/// Whether the points of a plane reach far, and the others lie above it.
fn is_table(plane: &Plane, points_m: &[Vec3]) -> bool {
    let height_m = |at_m: &Vec3| plane.normal.dot(*at_m) - plane.offset_m;
    let [above, below] =
        [1.0, -1.0].map(|way| points_m.iter().filter(|at_m| way * height_m(at_m) > OFF_M).count() as f32);
    let along = plane.normal.any_orthonormal_vector();
    let across = plane.normal.cross(along);
    let own = points_m.iter().filter(|at_m| height_m(at_m).abs() <= OFF_M);
    let own_m: Vec<Vec3> = own.map(|at_m| Vec3::new(along.dot(*at_m), across.dot(*at_m), 0.0)).collect();
    let [low_m, high_m] = bounds_m(&own_m);
    let wide_m = (high_m - low_m).truncate().min_element();
    wide_m >= TABLE_WIDE_M && below <= (BELOW_SHARE * points_m.len() as f32).max(BELOW_ABOVE * above)
}

/// Checks that the points of the object that is wanted lie at those of its scene, which they follow in the cloud.
///
/// # Errors
/// [`InputError`] if they are elsewhere.
pub(crate) fn check_object(observation: &Observation, target: Option<&Target>) -> Result<(), InputError> {
    let (Observation::Cloud { points_m, .. }, Some(Target::Points(object_m))) = (observation, target) else {
        return Ok(());
    };
    let scene_m = points_m.strip_suffix(&object_m[..]).unwrap_or_default();
    let [low_m, high_m] = bounds_m(object_m);
    let away_m = scene_m.iter().map(|at_m| (*at_m - at_m.clamp(low_m, high_m)).length()).fold(f32::INFINITY, f32::min);
    if scene_m.is_empty() || object_m.is_empty() || away_m <= BESIDE_M {
        return Ok(());
    }
    let is_centred = low_m.cmplt(Vec3::ZERO).all() && high_m.cmpgt(Vec3::ZERO).all();
    let hint = if is_centred { "; its middle is the origin: do not subtract it" } else { "" };
    refuse(format!(
        "none of the object's points lies in the scene, whose nearest is {away_m:.2} m away: both must be in one \
         frame{hint}: object"
    ))
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
pub(crate) fn seen_m(view: &View, columns_px: usize) -> Vec<Vec3> {
    let seen = seen_above(&(view.camera, &view.image, 1.0), columns_px, f32::NEG_INFINITY);
    seen.into_iter().map(|(at_m, _)| at_m).collect()
}

/// Warnings for views of which the border cuts things within reach.
pub(crate) fn cut(views: &[View], [low_m, high_m]: [Vec3; 2], table_z_m: f32) -> Vec<String> {
    let is_thing = |at: &Vec3| {
        let within = at.truncate().cmpge(low_m.truncate()).all() && at.truncate().cmple(high_m.truncate()).all();
        within && (table_z_m + CUT_M..high_m.z).contains(&at.z)
    };
    let is_cut = |view: &View| border(view).iter().filter(|cut| is_thing(&cut.at_m)).count() >= CUT_PX_MIN;
    let cut: Vec<String> = (0..views.len()).filter(|at| is_cut(&views[*at])).map(|at| format!("views[{at}]")).collect();
    let what = "the border of the image cuts things within reach: grasps of these come last or are left, and where no \
                camera looks beside them no grasp is offered";
    if cut.is_empty() { Vec::new() } else { vec![format!("{what}: {}", cut.join(", "))] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::demo;
    use crate::input::assemble;
    use crate::plausible;

    #[test]
    fn the_workspace_is_put_on_the_table_that_the_first_camera_sees() {
        let request = assemble(&demo::request().unwrap(), None, Grid::PAPER).unwrap();
        let first = request.observation.images().unwrap()[0].camera.workspace_from_camera;
        let (seen, wanted) = (moved(&request.observation, &first.inverse()), FindTable::default());
        let found = find(&seen, &wanted, &Grid::PAPER, 1).unwrap();
        assert!(found.sureness() > 0.5 && found.warning().is_none(), "{found:?}");
        // Up is up, and the table is at its height; where x and y are is chosen.
        let between = found.workspace_from_first * first.inverse();
        assert!((between.rotation * Vec3::Z).dot(Vec3::Z) > 0.999_99, "{between:?}");
        assert!((between * Vec3::new(0.15, 0.15, 0.05)).z - 0.05 < 1e-3, "{between:?}");
        let again = moved(&seen, &found.workspace_from_first);
        assert_eq!(plausible::of_given(&again, &Default::default(), &Grid::PAPER, 1), Vec::<String>::new());
        assert_eq!(plausible::of_found(&seen, &again, &found, &wanted, &Grid::PAPER, 1), Vec::<String>::new());
        let nothing = Observation::Cloud { points_m: Vec::new(), eyes_m: Vec::new() };
        let error = find(&nothing, &wanted, &Grid::PAPER, 1).unwrap_err().to_string();
        assert!(error.starts_with("no table was found"), "{error}");
    }

    /// Points of a rectangle from a corner, 4 mm apart.
    fn sheet(corner: Vec3, edges: [Vec3; 2]) -> Vec<Vec3> {
        let [across, down] = edges.map(|edge| (edge.length() / 0.004) as usize);
        let at = |n: usize, count: usize| n as f32 / count as f32;
        let point = |n: usize| corner + edges[0] * at(n % across, across) + edges[1] * at(n / across, down);
        (0..across * down).map(point).collect()
    }

    /// The three faces of a box that a camera sees which looks down at 45 degrees and 0.7 m, and a table under it; its
    /// frame has x right, y down, z forward.
    fn seen_box(table_side_m: f32) -> Vec<Vec3> {
        let half = core::f32::consts::FRAC_1_SQRT_2;
        let (right, ahead, up) = (Vec3::X, Vec3::new(0.0, -half, half), Vec3::new(0.0, -half, -half));
        let (low, size) = (Vec3::new(-0.03, 0.0, 0.7), [right * 0.06, ahead * 0.05, up * 0.12]);
        let top = sheet(low + size[2], [size[0], size[1]]);
        let faces = [sheet(low, [size[0], size[2]]), sheet(low, [size[1], size[2]]), top].concat();
        if table_side_m == 0.0 {
            return faces;
        }
        let corner = low - (right + ahead) * (0.5 * table_side_m);
        [faces, sheet(corner, [right * table_side_m, ahead * table_side_m])].concat()
    }

    fn cloud(points_m: &[Vec3]) -> Observation {
        Observation::Cloud { points_m: points_m.to_vec(), eyes_m: Vec::new() }
    }

    #[test]
    fn one_object_without_a_table_floats_however_its_cloud_is_centred() {
        let about = |points_m: &[Vec3]| alone(&cloud(points_m), &FindTable::default(), &Grid::PAPER, 1);
        let thing = seen_box(0.0);
        let [low_m, high_m] = bounds_m(&thing);
        let centred: Vec<Vec3> = thing.iter().map(|at_m| *at_m - 0.5 * (low_m + high_m)).collect();
        for (points_m, is_centred) in [(&thing, false), (&centred, true)] {
            let (seen, found, said) = about(points_m).unwrap().expect("an object alone");
            assert!(said.starts_with("the cloud shows one object and no table under it"), "{said}");
            assert_eq!(said.contains("the origin is in its middle"), is_centred, "{said}");
            let Observation::Cloud { points_m, eyes_m } = moved(&seen, &found.workspace_from_first) else {
                panic!("a cloud")
            };
            let [low_m, high_m] = bounds_m(&points_m);
            assert!((low_m.z - 0.15).abs() < 1e-4 && found.candidates.is_empty(), "{low_m}");
            let middle_m = 0.5 * (low_m + high_m).truncate();
            assert!((middle_m - 0.15).length() < 0.05, "{middle_m}");
            assert!(eyes_m.len() == 1 && eyes_m[0].z > 0.6, "seen from above: {eyes_m:?}");
        }
        assert_eq!(about(&seen_box(0.45)).unwrap(), None, "on a table");
        assert_eq!(about(&seen_box(0.9)).unwrap(), None, "in a scene");
        let table: Vec<Vec3> = seen_box(0.45).iter().map(|at_m| *at_m - Vec3::Z * 0.7).collect();
        let error = about(&table).unwrap_err().to_string();
        assert!(error.contains("the origin among its points: cloud"), "{error}");
        // A scene in tenths of a metre is no object.
        let small: Vec<Vec3> = seen_box(0.9).iter().map(|at_m| *at_m * 0.1).collect();
        assert_eq!(about(&small).unwrap(), None);
    }

    #[test]
    fn an_object_lies_in_its_scene() {
        let (thing, scene) = (seen_box(0.0), seen_box(0.9));
        let beside = |object_m: &[Vec3]| {
            let seen = cloud(&[&scene[..], object_m].concat());
            check_object(&seen, Some(&Target::Points(object_m.to_vec()))).map_err(|error| error.to_string())
        };
        assert_eq!(beside(&thing), Ok(()));
        let [low_m, high_m] = bounds_m(&thing);
        let centred: Vec<Vec3> = thing.iter().map(|at_m| *at_m - 0.5 * (low_m + high_m)).collect();
        let error = beside(&centred).unwrap_err();
        assert!(error.starts_with("none of the object's points lies in the scene"), "{error}");
        assert!(error.contains("its middle is the origin") && error.ends_with(": object"), "{error}");
        let aside: Vec<Vec3> = thing.iter().map(|at_m| *at_m + Vec3::Z * 3.0).collect();
        assert!(!beside(&aside).unwrap_err().contains("origin"));
    }
}
