//! Whether what was seen can be what was said, asked of every way in: views, clouds and a TSDF, with poses and on a
//! table that was found. [`crate::mistake`] has what is tried as an explanation.

use core::f32::consts::PI;

use perception::{COLUMNS_PX, PlaneParams, find_plane, find_tables, surface_cloud};
use rayon::prelude::*;
use schema::{Grid, Intrinsics, Pose, Purpose, Stream, Vec3, VoxelGrid};

use crate::frame::{FoundTable, POINTS, bounds_m, describe, identity, seen_m, shown_m, sight, thinned};
use crate::mistake::{BETTER, Claim, DEPTHS, HEIGHT_OFF_M_MAX, Mistake, Place, Sight, TILT_RAD_MAX, likelihood};
use crate::observation::{FindTable, Observation, PlanOptions, PoseKey, View};

/// A quick look is at so many along an image's width, or at so many points of a cloud; a table is among what they show
/// with at least this share, and level.
const QUICK_COLUMNS_PX: usize = 80;
const QUICK_POINTS: usize = 5_000;
const QUICK_SHARE_MIN: f32 = 0.2;
const QUICK: PlaneParams =
    PlaneParams { threshold_m: 0.006, iterations: 30, refits_max: 3, tilt_rad_max: PLAIN_RAD_MAX, share_min: 0.3 };
/// What is tilted or shifted by less than this is a plain fault, not a mistaken convention.
const PLAIN_RAD_MAX: f32 = PI / 9.0;
const PLAIN_M_MAX: f32 = 0.1;
/// A fault of fewer tolerances is plain, whatever else would explain it.
const SMALL_FAULT: f32 = 2.5;
/// Planes of which fewer points are seen prove nothing …
const SHARE_MIN: f32 = 0.05;
/// … and those with less than this share of the best one's score neither.
const STRONG: f32 = 0.3;
/// A plane of a cloud with more evidence is its table, wherever the workspace has it.
const SURE_EVIDENCE: f32 = 0.02;
/// A plane that carries a few things has more.
const SOME_EVIDENCE: f32 = 0.005;
/// A principal point is rarely further from the middle of its image, in the image's sides.
const CENTRE_OFF_MAX: f32 = 0.2;
/// Sides of what a cloud shows, in metres.
const SIDE_M: [f32; 2] = [0.1, 4.0];
/// Distance between the points of a TSDF's surface.
const PITCH_M: f32 = 0.01;

/// Warnings for an observation in the workspace that does not show the table there.
pub(crate) fn of_given(observation: &Observation, options: &PlanOptions, grid: &Grid, seed: u64) -> Vec<String> {
    match observation {
        Observation::Views(views) => {
            let first = views.first().map_or(Pose::IDENTITY, |view| view.camera.workspace_from_camera);
            let base = options.base_from_workspace.map_or(Pose::IDENTITY, |base| base.inverse());
            let target = |view: &View| match view.key {
                PoseKey::FirstFromCamera => first,
                key if key.is_of_base() => base,
                _ => Pose::IDENTITY,
            };
            of_views(views, 0, target, grid, seed)
        }
        Observation::Cloud { points_m, .. } => {
            of_cloud(points_m, options.workspace_from_cloud, grid, seed).into_iter().collect()
        }
        Observation::Tsdf(field) => of_tsdf(field, grid, seed).into_iter().collect(),
    }
}

/// Warnings for an observation in its first camera's frame or its sensor's, in which a table was found, and which was
/// moved into the workspace there.
pub(crate) fn of_found(
    observation: &Observation,
    moved: &Observation,
    found: &FoundTable,
    wanted: &FindTable,
    grid: &Grid,
    seed: u64,
) -> Vec<String> {
    let mut sight = sight(observation, wanted, Vec::new(), seed);
    let (tables, best) = (&found.candidates[..], found.candidates[0]);
    let mut warnings = Vec::new();
    if sight.is_doubtful(tables) {
        sight.points_m = shown_m(observation).map(|points_m| thinned(&points_m, POINTS)).unwrap_or_default();
        let explained = sight.explained(tables);
        let otherwise = |what: &str| {
            let (taken, mistake) = (describe(&best.plane), sight.describe(&explained));
            format!("{taken} was taken for the table, and one would be {what} {mistake}")
        };
        warnings.extend(match explained.first() {
            Some(Mistake::Pose(_)) => Some(otherwise("level")),
            Some(_) => Some(sight.of_lens(&explained).unwrap_or_else(|| otherwise("likelier"))),
            None => sight.place.and_then(|place| unlevel(found, &place)),
        });
    }
    let views = observation.images().unwrap_or_default();
    if let (Some(first), true) = (views.first(), warnings.is_empty()) {
        warnings.extend(other_size(&first.camera.intrinsics).map(|said| format!("{said}: views[0]")));
    }
    let views = moved.images().unwrap_or_default();
    warnings.extend(of_views(views, 1, |_| found.workspace_from_first, grid, seed));
    warnings
}

/// What is said of a found table that is hardly the one that gravity makes level.
fn unlevel(found: &FoundTable, place: &Place) -> Option<String> {
    let (pose, best) = (place.without(&[])?, found.candidates[0]);
    let claim = place.claim(&pose, &best.plane, best.foot_m());
    let bare = || (best.evidence < SOME_EVIDENCE).then(|| format!("{} carries little", describe(&best.plane)));
    claim.told().or_else(bare).map(|said| format!("{said}: is {}{} right?", place.key, identity(place)))
}

/// Warnings for views from a number on whose poses or lenses disagree with what they show; one for all with the same
/// fault. `target` is the frame to which a view's pose leads.
fn of_views(views: &[View], from: usize, target: impl Fn(&View) -> Pose + Sync, grid: &Grid, seed: u64) -> Vec<String> {
    let asked = views.get(from..).unwrap_or_default();
    let found: Vec<Option<String>> = asked.par_iter().map(|view| misplaced(view, target(view), grid, seed)).collect();
    let mut warnings: Vec<String> = Vec::new();
    for said in found.iter().flatten() {
        let alike = (0..found.len()).filter(|at| found[*at].as_ref() == Some(said));
        let places: Vec<String> = alike.map(|at| format!("views[{}]", from + at)).collect();
        let warning = format!("{said}: {}", places.join(", "));
        if !warnings.contains(&warning) {
            warnings.push(warning);
        }
    }
    warnings
}

/// How far from the workspace's height points show a level table; `None` if they do not near it.
fn table_off_m(points_m: &[Vec3], grid: &Grid, seed: u64) -> Option<f32> {
    let on_table: Vec<Vec3> =
        points_m.iter().copied().filter(|at| (at.z - grid.table_z_m).abs() <= HEIGHT_OFF_M_MAX).collect();
    let plane = find_plane(&on_table, &QUICK, &mut Stream::new(seed, 0, Purpose::Plane, 2));
    let level = plane.is_some_and(|found| found.plane.normal.z >= libm::cosf(TILT_RAD_MAX));
    let is_table = level && on_table.len() as f32 >= QUICK_SHARE_MIN * points_m.len() as f32;
    let height_m = on_table.iter().map(|at| at.z).sum::<f32>() / on_table.len() as f32;
    is_table.then(|| (height_m - grid.table_z_m).abs())
}

/// What is wrong with a view's pose, unit or lens, by the table that it shows.
fn misplaced(view: &View, workspace_from_target: Pose, grid: &Grid, seed: u64) -> Option<String> {
    let (lens, given) = (view.camera.intrinsics, view.camera.workspace_from_camera);
    let is_likely = BETTER * likelihood(&lens) >= 1.0;
    // At most plans it is there.
    if is_likely && table_off_m(&seen_m(view, QUICK_COLUMNS_PX), grid, seed).is_some() {
        return None;
    }
    let camera_from_workspace = given.inverse();
    let target_from_camera = workspace_from_target.inverse() * given;
    let is_inverse = view.key.is_inverse();
    let given = if is_inverse { target_from_camera.inverse() } else { target_from_camera };
    let (upright_from_target, table_z_m) = (workspace_from_target, Some(grid.table_z_m));
    let place = Place { key: view.key.name(), given, is_inverse, upright_from_target, table_z_m };
    let points_m = seen_m(view, COLUMNS_PX).into_iter().map(|at| camera_from_workspace * at).collect();
    let sight = Sight { points_m, lens: Some(lens), is_cloud: false, place: Some(place), seed };
    elsewhere(&sight, &place, is_likely, SHARE_MIN)
}

/// What is said of a sensor that does not see the table where it was said to be. The share of points is the least of a
/// plane that proves something.
fn elsewhere(sight: &Sight, place: &Place, is_lens_likely: bool, share_min: f32) -> Option<String> {
    let (tables, pose) = (sight.tables(1.0), place.without(&[])?);
    let least = STRONG * tables.first().map_or(0.0, |best| best.score);
    let strong = tables.iter().filter(|table| table.score >= least && table.share >= share_min);
    let claims = strong.map(|table| place.claim(&pose, &table.plane, table.foot_m()));
    let nearest = claims.min_by(|a, b| a.fault().total_cmp(&b.fault()));
    let is_plain = |claim: &&Claim| claim.tilt_rad <= PLAIN_RAD_MAX && claim.height_m.abs() <= PLAIN_M_MAX;
    let plain = nearest.as_ref().filter(is_plain);
    if let Some(claim) = plain.filter(|claim| is_lens_likely && claim.fault() < SMALL_FAULT) {
        return claim.told();
    }
    let table_z_mm = 1e3 * place.table_z_m.unwrap_or_default();
    let nowhere = format!("the table was not seen at z = {table_z_mm:.0} mm, where the workspace has it");
    let explained = sight.explained(&tables);
    if !explained.is_empty() {
        let there = || format!("{nowhere}; it would be seen there {}", sight.describe(&explained));
        return Some(sight.of_lens(&explained).unwrap_or_else(there));
    }
    if let Some(said) = sight.lens.as_ref().and_then(other_size) {
        return Some(said);
    }
    if let Some(claim) = plain {
        return claim.told();
    }
    nearest?;
    let own_frame =
        if place.given == Pose::IDENTITY { ": the pose is the identity, the camera's own frame" } else { "" };
    Some(format!("{nowhere}{own_frame}; the table can be found, if {} is \"table\"", place.key))
}

/// What is said of a lens that belongs to an image of another size.
fn other_size(lens: &Intrinsics) -> Option<String> {
    let off = |centre_px: f32, side_px: usize| (centre_px / side_px as f32 - 0.5).abs();
    let is_off = off(lens.cx_px, lens.width_px).max(off(lens.cy_px, lens.height_px)) > CENTRE_OFF_MAX;
    is_off.then(|| size_said(lens))
}

fn size_said(lens: &Intrinsics) -> String {
    format!(
        "the principal point {:.0}, {:.0} is far from the middle of an image of {} x {}: are the intrinsics those of \
         another size?",
        lens.cx_px, lens.cy_px, lens.width_px, lens.height_px
    )
}

impl Sight {
    /// What is said of a mistake of the lens.
    fn of_lens(&self, explained: &[Mistake]) -> Option<String> {
        let lens = self.lens.as_ref()?;
        match explained.first()? {
            Mistake::Pose(_) | Mistake::Depths(_) => None,
            Mistake::Size(_) => Some(size_said(lens)),
            Mistake::Swapped | Mistake::Focal(_) => {
                let ([width_px, height_px], would) = ([lens.width_px, lens.height_px], self.describe(explained));
                Some(format!("the intrinsics hardly fit the image of {width_px} x {height_px}, and would {would}"))
            }
        }
    }
}

/// What is wrong with a cloud in the workspace, into which it came from a frame with this pose if it has one.
fn of_cloud(points_m: &[Vec3], workspace_from_cloud: Option<Pose>, grid: &Grid, seed: u64) -> Option<String> {
    let quick_m = thinned(points_m, QUICK_POINTS);
    if table_off_m(&quick_m, grid, seed).is_some() {
        return None;
    }
    if let Some(given) = workspace_from_cloud {
        let cloud_from_workspace = given.inverse();
        let (key, upright_from_target, table_z_m) = ("workspace_from_cloud", Pose::IDENTITY, Some(grid.table_z_m));
        let place = Place { key, given, is_inverse: false, upright_from_target, table_z_m };
        let points_m = thinned(points_m, POINTS).into_iter().map(|at| cloud_from_workspace * at).collect();
        let sight = Sight { points_m, lens: None, is_cloud: true, place: Some(place), seed };
        // Clouds may lack the table: little proves nothing.
        let is_sure = sight.tables(1.0).iter().any(|table| table.evidence > SURE_EVIDENCE);
        return elsewhere(&sight, &place, true, if is_sure { SHARE_MIN } else { 1.0 });
    }
    let on_table = quick_m.iter().filter(|at| (at.z - grid.table_z_m).abs() <= HEIGHT_OFF_M_MAX).count();
    if on_table as f32 >= SHARE_MIN * quick_m.len() as f32 {
        return None;
    }
    let nowhere = format!("the cloud has no table at z = {:.0} mm, where the workspace has it", 1e3 * grid.table_z_m);
    let off = |share: f32| {
        let scaled: Vec<Vec3> = quick_m.iter().map(|at| *at * share).collect();
        let [low_m, high_m] = bounds_m(&scaled);
        let is_wide = (SIDE_M[0]..SIDE_M[1]).contains(&(high_m - low_m).truncate().max_element());
        is_wide.then(|| Some((table_off_m(&scaled, grid, seed)?, share))).flatten()
    };
    if let Some((_, share)) = DEPTHS.into_iter().filter_map(off).min_by(|a, b| a.0.total_cmp(&b.0)) {
        return Some(format!("{nowhere}; it would be there if the cloud were {share} of what it is (metres)"));
    }
    let found = find_tables(points_m, None, None, &mut Stream::new(seed, 0, Purpose::Plane, 1));
    // Below a camera that stands upright, y points down and z forward.
    let is_seen_so = found.first().is_some_and(|best| best.share > 0.2 && best.plane.normal.z < 0.0);
    is_seen_so.then(|| {
        format!(
            "{nowhere}, but one as its camera would see it: is it in its camera's own frame (workspace_from_cloud = \
             \"table\")?"
        )
    })
}

/// What is wrong with the axes of a TSDF.
fn of_tsdf(field: &VoxelGrid, grid: &Grid, seed: u64) -> Option<String> {
    let (points_m, [low_m, high_m]) = (surface_cloud(field, PITCH_M), field.lattice.corners_m());
    let shows = |turn: &dyn Fn(&Vec3) -> Vec3| {
        table_off_m(&points_m.iter().map(turn).collect::<Vec<_>>(), grid, seed).is_some()
    };
    if shows(&|at| *at) {
        return None;
    }
    let said = if shows(&|at| Vec3::new(at.z, at.y, at.x)) {
        "its axes were z, y, x (transpose it)"
    } else if shows(&|at| at.with_z(low_m.z + high_m.z - at.z)) {
        "its z pointed down (reverse it)"
    } else {
        return None;
    };
    let table_z_mm = 1e3 * grid.table_z_m;
    Some(format!(
        "the TSDF has no table at z = {table_z_mm:.0} mm, where the workspace has it; it would be there if {said}"
    ))
}

#[cfg(test)]
mod tests {
    use schema::{Quat, axis_angle};

    use super::*;
    use crate::demo;
    use crate::frame::{find, moved};
    use crate::input::assemble;
    use crate::mistake::Step;

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
        said(views)
    }

    /// The warnings for views.
    fn said(views: Vec<View>) -> Vec<String> {
        let options = PlanOptions { base_from_workspace: Some(base_from_workspace()), ..PlanOptions::default() };
        of_given(&Observation::Views(views), &options, &Grid::PAPER, 1)
    }

    fn in_axes(pose: &Pose, axes: Step) -> Pose {
        Pose::from_parts(pose.translation, pose.rotation * axes.turn_to_optical().inverse())
    }

    fn in_mm(pose: &Pose) -> Pose {
        Pose::from_parts(pose.translation * 1e3, pose.rotation)
    }

    fn w_first(pose: &Pose) -> Pose {
        let [x, y, z, w] = pose.rotation.to_array();
        Pose::from_parts(pose.translation, Quat::from_xyzw(w, x, y, z))
    }

    type Done = fn(&Pose) -> Pose;

    #[test]
    fn every_usual_mistake_is_recognised_and_named() {
        for (key, inverse) in
            [(PoseKey::WorkspaceFromCamera, "camera_from_workspace"), (PoseKey::BaseFromCamera, "camera_from_base")]
        {
            assert_eq!(warnings(key, |pose| *pose), Vec::<String>::new());
            let cases: [(Done, String); 6] = [
                (|pose| in_axes(pose, Step::OpenGl), "in OpenGL's camera axes, y up and z backwards".to_owned()),
                (
                    |pose| in_axes(pose, Step::Body),
                    "the pose of the camera's body frame (x forward, y left, z up)".to_owned(),
                ),
                (|pose| pose.inverse(), format!("the inverse, {inverse}")),
                (in_mm, "in millimetres".to_owned()),
                // OpenGL's view matrix: from the world to the camera, in OpenGL's axes.
                (|pose| in_axes(pose, Step::OpenGl).inverse(), format!("the inverse, {inverse}, in OpenGL's")),
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
            let all = said(views);
            let said = format!("if the depths were {} of what they are (set depth_scale_m): views[1]", 1.0 / scale);
            assert!(all.len() == 1 && all[0].ends_with(&said), "{said}: {all:?}");
        }
        let mut views = demo_views();
        views[2].camera.intrinsics.cx_px = 640.0;
        let all = said(views);
        assert!(all.iter().any(|one| one.contains("those of another size?: views[2]")), "{all:?}");
    }

    /// A mistake in a pose, in a lens or in the unit of depths, and what is said of it.
    struct Case {
        pose: Done,
        lens: fn(&mut Intrinsics),
        depths: f32,
        words: &'static str,
        /// Whether gravity alone shows it.
        is_of_gravity: bool,
    }

    const SAME: Case = Case { pose: |pose| *pose, lens: |_| (), depths: 1.0, words: "", is_of_gravity: true };

    fn resized(lens: &mut Intrinsics, share: f32) {
        for px in [&mut lens.fx_px, &mut lens.fy_px, &mut lens.cx_px, &mut lens.cy_px] {
            *px *= share;
        }
    }

    fn cases() -> Vec<Case> {
        let pose = |pose: Done, words: &'static str| Case { pose, words, ..SAME };
        let lens = |lens: fn(&mut Intrinsics), words: &'static str| Case { lens, words, ..SAME };
        let unit =
            |depths: f32, words: &'static str, is_of_gravity: bool| Case { depths, words, is_of_gravity, ..SAME };
        vec![
            SAME,
            pose(|pose| in_axes(pose, Step::OpenGl), "in OpenGL's camera axes"),
            pose(|pose| in_axes(pose, Step::Body), "the camera's body frame"),
            pose(Pose::inverse, "the inverse, "),
            pose(w_first, "with w first in its quaternion"),
            pose(|_| Pose::IDENTITY, "the identity, the camera's own frame"),
            Case { is_of_gravity: false, ..pose(in_mm, "in millimetres") },
            lens(|lens| resized(lens, 2.0), "those of another size"),
            lens(|lens| resized(lens, 0.5), "those of another size"),
            lens(|lens| std::mem::swap(&mut lens.cx_px, &mut lens.cy_px), "if cx_px and cy_px changed places"),
            lens(|lens| lens.fx_px *= 0.5, "if fx_px and fy_px were 2 and 1 times what they are"),
            unit(10.0, "0.1 ", true),
            unit(8.0, "were 0.125 of", false),
            unit(5.0, "were 0.2 of", false),
            unit(4.0, "were 0.25 of", false),
            unit(0.1, "were 10 of", false),
        ]
    }

    /// The first view with this mistake, in its own frame, and the pose that was given.
    fn mistaken(case: &Case, target_from_workspace: &Pose) -> (View, Pose) {
        let mut view = demo_views().swap_remove(0);
        let given = (case.pose)(&(*target_from_workspace * view.camera.workspace_from_camera));
        view.camera.workspace_from_camera = Pose::IDENTITY;
        (case.lens)(&mut view.camera.intrinsics);
        view.image.depth_m.iter_mut().for_each(|depth_m| *depth_m *= case.depths);
        (view, given)
    }

    /// What is said of an observation whose table is found.
    fn said_of_found(seen: &Observation, wanted: &FindTable) -> String {
        match find(seen, wanted, &Grid::PAPER, 1) {
            Err(error) => error.to_string(),
            Ok(found) => {
                let moved = moved(seen, &found.workspace_from_first);
                of_found(seen, &moved, &found, wanted, &Grid::PAPER, 1).join("; ")
            }
        }
    }

    /// Every mistake by every way in that can show it; nothing of what is right.
    #[test]
    fn each_way_in_names_each_mistake() {
        let must_say = |way: &str, case: &Case, said: &str| {
            let is_right = case.words.is_empty();
            assert!(said.is_empty() == is_right && said.contains(case.words), "{way}, {}: {said}", case.words);
        };
        for case in cases() {
            let is_of_lens = case.words.contains("size") || case.words.contains("_px");
            let (view, given) = mistaken(&case, &Pose::IDENTITY);
            let mut placed = view.clone();
            placed.camera.workspace_from_camera = given;
            must_say("views", &case, &said(vec![placed]).join("; "));
            let points_m = seen_m(&view, COLUMNS_PX);
            let in_workspace = points_m.iter().map(|at_m| given * *at_m).collect();
            if !is_of_lens {
                let options = PlanOptions { workspace_from_cloud: Some(given), ..PlanOptions::default() };
                let cloud = Observation::Cloud { points_m: in_workspace, eyes_m: vec![given.translation] };
                must_say("a cloud", &case, &of_given(&cloud, &options, &Grid::PAPER, 1).join("; "));
            }
            if case.is_of_gravity {
                let (view, base_from_camera) = mistaken(&case, &base_from_workspace());
                let wanted = FindTable { base_from_camera: Some(base_from_camera), down: None };
                must_say("a found table", &case, &said_of_found(&Observation::Views(vec![view]), &wanted));
            }
            if case.is_of_gravity && !is_of_lens {
                let (_, base_from_camera) = mistaken(&case, &base_from_workspace());
                let wanted = FindTable { base_from_camera: Some(base_from_camera), down: None };
                let cloud = Observation::Cloud { points_m, eyes_m: Vec::new() };
                must_say("a found table in a cloud", &case, &said_of_found(&cloud, &wanted));
            }
        }
    }

    #[test]
    fn gravity_may_point_up_or_be_that_of_a_body() {
        let (view, given) = mistaken(&SAME, &Pose::IDENTITY);
        let (seen, down) = (Observation::Views(vec![view]), given.rotation.inverse() * Vec3::NEG_Z);
        let said = |down: Vec3| said_of_found(&seen, &FindTable { down: Some(down), base_from_camera: None });
        assert_eq!(said(9.81 * down), "");
        assert!(said(-down).contains("if down were the opposite"), "{}", said(-down));
        let of_body = Step::Body.turn_to_optical() * down;
        assert!(said(of_body).contains("in the axes of the camera's body"), "{}", said(of_body));
        let tilted = said(axis_angle(Vec3::X, 0.26) * down);
        assert!(tilted.contains("tilted by 15°") && tilted.contains("is down right?"), "{tilted}");
    }

    #[test]
    fn clouds_and_fields_in_the_workspace_are_asked_too() {
        let mut views = demo_views();
        let grid = {
            let seen: Vec<_> = views.iter().map(|view| (view.camera, &view.image)).collect();
            perception::fuse_images(Grid::PAPER, perception::TRUNCATION_VOXELS, &seen)
        };
        let axes = |turn: fn([usize; 3]) -> [usize; 3]| {
            let cell = |flat: usize| turn([flat / 1600, flat / 40 % 40, flat % 40]);
            let values = (0..Grid::PAPER.len()).map(|flat| grid.values[Grid::PAPER.flat(cell(flat))]).collect();
            let field = Observation::Tsdf(VoxelGrid::new(Grid::PAPER, values).unwrap());
            of_given(&field, &PlanOptions::default(), &Grid::PAPER, 1).join("; ")
        };
        assert_eq!(axes(|cell| cell), "");
        assert!(axes(|[x, y, z]| [z, y, x]).contains("transpose it"), "{}", axes(|[x, y, z]| [z, y, x]));
        assert!(axes(|[x, y, z]| [x, y, 39 - z]).contains("reverse it"), "{}", axes(|[x, y, z]| [x, y, 39 - z]));
        let points_m = seen_m(&views.swap_remove(0), COLUMNS_PX);
        let cloud = |scale: f32| {
            let points_m = points_m.iter().map(|at_m| *at_m * scale).collect();
            let cloud = Observation::Cloud { points_m, eyes_m: Vec::new() };
            of_given(&cloud, &PlanOptions::default(), &Grid::PAPER, 1).join("; ")
        };
        assert_eq!(cloud(1.0), "");
        assert!(cloud(1e3).contains("if the cloud were 0.001 of what it is"), "{}", cloud(1e3));
    }
}
