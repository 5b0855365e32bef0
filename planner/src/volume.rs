//! From an observation to the inputs of planning: the grid for the network and the cloud for the objects.

use perception::{
    COLUMNS_PX, NEAR_M, ScaledView, SeenPoint, Sights, SurfaceBlocks, TRUNCATION_VOXELS, cloud_image, depth_factor,
    seen_above, surface_beside, surface_cloud, surface_of_blocks, table_around, thinned, view_from,
};
use rayon::prelude::*;
use schema::{Camera, DepthImage, Grid, Lattice, Vec3, VoxelGrid};

use crate::config::CloudParams;
use crate::input::{InputError, refuse};
use crate::observation::{Observation, View};
use crate::region::Region;

/// Where grasps are looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Workspace {
    /// In what was seen in a box, its lower and its upper corner in metres; otherwise in all of the grid, which a
    /// network of voxels needs.
    pub within_m: Option<[Vec3; 2]>,
    /// The voxels.
    pub grid: Grid,
}

impl Workspace {
    /// All of a grid.
    #[must_use]
    pub const fn cube(grid: Grid) -> Self {
        Self { within_m: None, grid }
    }
}

/// A fused observation.
#[derive(Debug, Clone, PartialEq)]
pub struct Volume {
    /// TSDF in VGN's values.
    pub grid: VoxelGrid,
    /// Surface points in the workspace, at the config's pitch where the observation is dense enough.
    pub points_m: Vec<Vec3>,
    /// The finer TSDF whose surface they are, if it is not `grid`.
    pub fine: Option<SurfaceBlocks>,
    /// The lower and the upper corner of the box in which grasps are looked for, in metres.
    pub reach_m: [Vec3; 2],
    /// The images as which a cloud was fused.
    pub rendered: Vec<View>,
    /// Warnings for the caller.
    pub warnings: Vec<String>,
}

/// Fuses an observation in a workspace; its cloud has a pitch of `params.pitch_m`. For depth images the cloud comes
/// from a separate, finer TSDF.
///
/// A TSDF must be on the workspace's grid, and an image have its lens's pixels: who reads or takes them sees to it.
///
/// # Errors
/// [`InputError`] for a viewpoint that cannot see the workspace, or a cloud that is not a surface.
pub fn fuse(observation: &Observation, workspace: &Workspace, params: CloudParams) -> Result<Volume, InputError> {
    let Workspace { within_m, grid } = workspace;
    match observation {
        Observation::Views(views) => {
            let mut warnings = Vec::new();
            let views = scaled(views, workspace, params, &mut warnings);
            let above = seen_off_table(workspace, &views);
            let seen_in = |within_m| Region::of_views(&above, within_m, grid);
            let Region { lattice, reach_m } = within_m.map_or_else(|| Region::cube(grid), seen_in);
            let sights = Sights::new(&views);
            let grid = sights.fuse(lattice, TRUNCATION_VOXELS);
            let fine = fuse_finely(&lattice, params, &above, &sights);
            let mut points_m = surface_beside(&grid, fine.as_ref(), params.pitch_m);
            points_m.extend(fine.iter().flat_map(|fine| surface_of_blocks(fine, params.pitch_m)));
            Ok(Volume { grid, points_m, fine, reach_m, rendered: Vec::new(), warnings })
        }
        Observation::Tsdf(given) => {
            let points_m = surface_cloud(given, params.pitch_m);
            let (grid, reach_m) = (given.clone(), given.lattice.corners_m());
            Ok(Volume { grid, points_m, fine: None, reach_m, rendered: Vec::new(), warnings: Vec::new() })
        }
        Observation::Cloud { points_m, eyes_m } => fuse_cloud(points_m, eyes_m, workspace, params),
    }
}

/// What views show above the table.
fn seen_off_table(workspace: &Workspace, views: &[ScaledView<'_>]) -> Vec<Vec<SeenPoint>> {
    views.par_iter().map(|view| seen_above(view, COLUMNS_PX, workspace.grid.table_z_m + ROUGH_M)).collect()
}

/// The finer TSDF of what views show above the table, if the settings want one: the bare table is as good in coarse
/// voxels.
fn fuse_finely(
    lattice: &Lattice,
    params: CloudParams,
    above: &[Vec<SeenPoint>],
    sights: &Sights<'_>,
) -> Option<SurfaceBlocks> {
    let share = params.resolution as f32 / Grid::PAPER.resolution as f32;
    let counts = lattice.counts.map(|count| (count as f32 * share).round() as usize);
    let fine = Lattice { counts, voxel_size_m: lattice.voxel_size_m / share, ..*lattice };
    (params.resolution != Grid::PAPER.resolution).then(|| sights.fuse_near(&fine, TRUNCATION_VOXELS, above))
}

/// What is seen no higher than this above the table's height is the table.
const ROUGH_M: f32 = 0.004;

/// Depth images as they are fused: scaled to the table if the settings say so.
fn scaled<'a>(
    views: &'a [View],
    workspace: &Workspace,
    params: CloudParams,
    warnings: &mut Vec<String>,
) -> Vec<ScaledView<'a>> {
    let Workspace { within_m, grid } = workspace;
    let table = within_m.map_or_else(|| table_around(grid), |within_m| (within_m, grid.table_z_m));
    let scaled = |View { image, camera, .. }: &'a View| {
        let factor = if params.scale_to_table { depth_factor(image, camera, &table) } else { 1.0 };
        (*camera, image, factor)
    };
    let scaled: Vec<ScaledView<'_>> = views.par_iter().map(scaled).collect();
    warnings.extend(scaled.iter().enumerate().filter_map(|(number, (_, _, factor))| far_off(number, *factor)));
    scaled
}

/// A sensor's depths are hardly wrong by more than this share; a camera's pose or the workspace's height may be.
const FACTOR_OFF_MAX: f32 = 0.02;

/// The warning for a table that was seen far from where it is.
fn far_off(number: usize, factor: f32) -> Option<String> {
    let percent = (factor - 1.0).abs() * 100.0;
    let where_to = if factor > 1.0 { "beyond" } else { "before" };
    ((factor - 1.0).abs() > FACTOR_OFF_MAX).then(|| {
        format!(
            "the table was seen {percent:.1} % {where_to} where it is believed to be, and the depths were scaled to it: check the \
             camera's pose, its depth scale and the workspace's height: views[{number}]"
        )
    })
}

/// A cloud is sparse if its points are further apart than this many times the pitch.
const SPARSE_PITCHES: f32 = 1.5;
/// Maximum number of points of a thinned cloud: at the paper's pitch about ten times that of a full workspace.
/// Clustering solid blocks of points would take minutes.
const THINNED_MAX: usize = 300_000;

fn fuse_cloud(
    points_m: &[Vec3],
    eyes_m: &[Vec3],
    workspace: &Workspace,
    params: CloudParams,
) -> Result<Volume, InputError> {
    let pitch_m = params.pitch_m;
    let Workspace { within_m, grid } = workspace;
    let cube = Region::cube(grid);
    let Region { lattice, reach_m } = within_m.map_or(cube, |within_m| Region::of_points(points_m, within_m, grid));
    let box_m = within_m.map_or(cube.reach_m, |[low_m, high_m]| [low_m.with_z(f32::NEG_INFINITY), high_m]);
    let mut warnings: Vec<String> = outside(points_m, box_m).into_iter().collect();
    let points_m = thinned(points_m, &lattice, pitch_m);
    if points_m.len() > THINNED_MAX {
        let got = points_m.len();
        return refuse(format!(
            "a cloud must be a surface, of at most {THINNED_MAX} points at the settings' pitch, got {got}: cloud"
        ));
    }
    let (spacing_m, is_at_least) = spacing_m(&points_m, &lattice);
    if spacing_m > SPARSE_PITCHES * pitch_m {
        let (got, wanted, about) = (spacing_m * 1e3, pitch_m * 1e3, if is_at_least { "at least" } else { "about" });
        warnings.push(format!(
            "the cloud is sparse: its points are {about} {got:.1} mm apart, the clusters' numbers are meant for {wanted:.1} mm"
        ));
    }
    if eyes_m.is_empty() {
        warnings.push("no viewpoint was given: the cloud is assumed to be seen from straight above".to_owned());
    }
    let [low_m, high_m] = lattice.corners_m();
    let wide_m = (high_m - low_m).truncate().max_element();
    // Straight above, at twice the workspace's width.
    let from_above = [(0.5 * (low_m + high_m)).with_z(low_m.z + 2.0 * wide_m)];
    let eyes_m = if eyes_m.is_empty() { &from_above } else { eyes_m };
    let (mut views, mut hidden_m) = (Vec::with_capacity(eyes_m.len()), points_m.clone());
    for eye_m in eyes_m {
        let Some(pose) = view_from(*eye_m, &lattice) else {
            if *eye_m == Vec3::ZERO {
                return refuse(
                    "the viewpoint is the origin, so the cloud seems to be in its camera's own frame: let the table be found \
                     (workspace_from_cloud = \"table\") or give the cloud's pose under that key: eyes_m or the cloud's viewpoint",
                );
            }
            return refuse(format!(
                "an eye must be above the floor and {} m to 1000 m from the middle of the workspace's floor, got \
                 {eye_m}: eyes_m or the cloud's viewpoint",
                wide_m.min(NEAR_M)
            ));
        };
        let spacing_m = spacing_m.max(pitch_m);
        let (camera, image) = cloud_image(&points_m, pose, spacing_m);
        hidden_m.retain(|point_m| !is_seen(*point_m, &camera, &image, HIDDEN_SPACINGS * spacing_m));
        views.push(View::new(image, camera));
    }
    warnings.extend(hidden(hidden_m.len(), points_m.len(), eyes_m.len()));
    let seen: Vec<ScaledView<'_>> = views.iter().map(|view| (view.camera, &view.image, 1.0)).collect();
    let sights = Sights::new(&seen);
    let grid = sights.fuse(lattice, TRUNCATION_VOXELS);
    let fine = fuse_finely(&lattice, params, &seen_off_table(workspace, &seen), &sights);
    Ok(Volume { grid, points_m, fine, reach_m, rendered: views, warnings })
}

/// A point is hidden if something is nearer to the eye by more than this many spacings, as in [`cloud_image`].
const HIDDEN_SPACINGS: f32 = 4.0;
/// A cloud that was seen from its eyes has hardly more hidden points than this share.
const HIDDEN_SHARE_MAX: f32 = 0.05;

/// Whether nothing of a cloud's image is before a point.
fn is_seen(point_m: Vec3, camera: &Camera, image: &DepthImage, tolerance_m: f32) -> bool {
    let seen_m = camera.workspace_from_camera.inverse() * point_m;
    let depth_m = camera.intrinsics.project(seen_m).and_then(|pixel| image.at(pixel));
    depth_m.is_some_and(|depth_m| seen_m.z <= depth_m + tolerance_m)
}

/// The warning for a cloud of which a part cannot have been seen from its viewpoints.
fn hidden(hidden: usize, points: usize, eyes: usize) -> Option<String> {
    let share = hidden as f32 / points.max(1) as f32;
    (share > HIDDEN_SHARE_MAX).then(|| {
        let from = if eyes == 1 { "the viewpoint".to_owned() } else { format!("any of the {eyes} viewpoints") };
        format!(
            "{:.0} % of the cloud's points cannot be seen from {from} and count as not seen: if it was merged from several views, \
             give the position of each sensor: eyes_m (--eye, once for each)",
            1e2 * share
        )
    })
}

/// The warning for a cloud that is mostly outside the workspace.
fn outside(points_m: &[Vec3], [low_m, high_m]: [Vec3; 2]) -> Option<String> {
    let is_outside = |at: &&Vec3| at.cmplt(low_m).any() || at.cmpge(high_m).any();
    let outside = points_m.iter().filter(is_outside).count();
    if 2 * outside <= points_m.len() {
        return None;
    }
    let low = points_m.iter().fold(Vec3::INFINITY, |low, p| low.min(*p));
    let high = points_m.iter().fold(Vec3::NEG_INFINITY, |high, p| high.max(*p));
    let hint = if (high - low).max_element() > 10.0 { " (millimetres?)" } else { "" };
    Some(format!(
        "{outside} of {} points lie outside the workspace of {low_m} to {high_m} m: they reach from {low} to {high}{hint}",
        points_m.len()
    ))
}

/// Approximate spacing of a thinned cloud: the side of the square per point, if the cloud is a surface. The area is
/// estimated by the covered voxels, since a level surface has one face per voxel. If each voxel has only one point, the
/// spacing is a lower bound.
fn spacing_m(points_m: &[Vec3], lattice: &Lattice) -> (f32, bool) {
    let mut voxels: Vec<[usize; 3]> = points_m.iter().filter_map(|point| lattice.voxel_at(*point)).collect();
    let count = voxels.len();
    voxels.sort_unstable();
    voxels.dedup();
    if count == 0 {
        return (0.0, false);
    }
    (lattice.voxel_size_m * (voxels.len() as f32 / count as f32).sqrt(), 10 * voxels.len() > 9 * count)
}

#[cfg(test)]
mod tests {
    use perception::camera_at;
    use schema::{DepthImage, Intrinsics, View as Viewpoint};

    use super::*;

    const PAPER: Workspace = Workspace::cube(Grid::PAPER);
    const LAW: CloudParams = CloudParams { resolution: 40, pitch_m: 0.0025, scale_to_table: false };

    fn level(viewpoint: &Viewpoint) -> View {
        let camera = camera_at(viewpoint, &Grid::PAPER, Intrinsics::VGN);
        let pose = camera.workspace_from_camera;
        let depth_at = |p: usize| {
            let fall = (pose.rotation * camera.intrinsics.ray([p % 640, p / 640])).z;
            (0.05 - pose.translation.z) / fall
        };
        let image = DepthImage { width_px: 640, height_px: 480, depth_m: (0..640 * 480).map(depth_at).collect() };
        View::new(image, camera)
    }

    #[test]
    fn a_table_seen_is_a_table_in_the_cloud() {
        let view = level(&Viewpoint { radius_m: 0.6, polar_rad: 0.3, azimuth_rad: 1.0 });
        let volume = fuse(&Observation::Views(vec![view.clone()]), &PAPER, LAW).unwrap();
        assert!(volume.points_m.len() > 13_000, "{}", volume.points_m.len());
        assert!(volume.points_m.iter().all(|point| (point.z - 0.05).abs() < 5e-4));
        let again = fuse(&Observation::Tsdf(volume.grid.clone()), &PAPER, LAW).unwrap();
        assert_eq!(again, volume);
        let cloud = Observation::Cloud { points_m: volume.points_m.clone(), eyes_m: vec![Vec3::new(0.3, 0.3, 0.6)] };
        let from_cloud = fuse(&cloud, &PAPER, LAW).unwrap();
        assert_eq!(from_cloud.warnings, Vec::<String>::new());
        let (level, field) = ([20, 20, 7], |volume: &Volume| volume.grid.values[Grid::PAPER.flat([20, 20, 7])]);
        assert!((field(&from_cloud) - field(&volume)).abs() < 0.02, "at {level:?}");
    }

    /// Scaling to the table would hide that a camera is believed to be 20 mm lower than it is.
    #[test]
    fn a_table_far_from_where_it_is_believed_to_be_is_told() {
        let scaling = CloudParams { scale_to_table: true, ..LAW };
        let view = level(&Viewpoint { radius_m: 0.6, polar_rad: 0.3, azimuth_rad: 1.0 });
        let mut low = view.clone();
        low.camera.workspace_from_camera.translation.z -= 0.02;
        let volume = fuse(&Observation::Views(vec![view, low]), &PAPER, scaling).unwrap();
        assert!(volume.points_m.iter().all(|point| (point.z - 0.05).abs() < 1e-3));
        let [warning] = &volume.warnings[..] else { panic!("{:?}", volume.warnings) };
        assert!(warning.starts_with("the table was seen 4.0 % beyond") && warning.ends_with("views[1]"), "{warning}");
    }

    #[test]
    fn an_eye_that_cannot_see_the_workspace_is_refused() {
        let inside = Observation::Cloud { points_m: Vec::new(), eyes_m: vec![Vec3::splat(0.1)] };
        let error = fuse(&inside, &PAPER, LAW).unwrap_err().to_string();
        assert!(error.contains("0.3 m to 1000 m from the middle of the workspace's floor"), "{error}");
    }

    #[test]
    fn depths_that_are_no_numbers_are_not_seen() {
        let mut view = level(&Viewpoint { radius_m: 0.6, polar_rad: 0.3, azimuth_rad: 1.0 });
        for (n, depth) in view.image.depth_m.iter_mut().enumerate() {
            *depth = [f32::NAN, f32::INFINITY, -1.0, 0.0][n % 4];
        }
        let volume = fuse(&Observation::Views(vec![view]), &PAPER, LAW).unwrap();
        assert!(volume.points_m.is_empty() && volume.grid.values.iter().all(|value| *value == 0.0));
    }

    /// A cube with all its sides, on a table: as if merged from views all around.
    #[test]
    fn a_merged_cloud_with_one_viewpoint_is_a_warning() {
        let lattice = |n: usize| (0..n * n).map(move |at| [(at / n) as f32 * 0.0025, (at % n) as f32 * 0.0025]);
        let mut points_m: Vec<Vec3> = lattice(120).map(|[x, y]| Vec3::new(x, y, 0.0501)).collect();
        for [u, v] in lattice(40) {
            let [low, high] = [0.1, 0.1975];
            points_m.extend([low, high].map(|x| Vec3::new(x, low + u, 0.0501 + v)));
            points_m.extend([low, high].map(|y| Vec3::new(low + u, y, 0.0501 + v)));
            points_m.push(Vec3::new(low + u, low + v, 0.1476));
        }
        let warnings = |eyes: &[[f32; 3]]| {
            let eyes_m = eyes.iter().copied().map(Vec3::from_array).collect();
            fuse(&Observation::Cloud { points_m: points_m.clone(), eyes_m }, &PAPER, LAW).unwrap().warnings
        };
        let one = warnings(&[[0.6, 0.15, 0.4]]);
        assert!(
            one.len() == 1 && one[0].contains("cannot be seen from the viewpoint and count as not seen"),
            "{one:?}"
        );
        let around = [[0.6, 0.15, 0.4], [-0.3, 0.15, 0.4], [0.15, 0.6, 0.4], [0.15, -0.3, 0.4]];
        assert_eq!(warnings(&around), Vec::<String>::new());
        let two = warnings(&around[..2]);
        assert!(two.len() == 1 && two[0].contains("from any of the 2 viewpoints"), "{two:?}");
    }

    #[test]
    fn a_sparse_cloud_is_a_warning() {
        let points_m = (0..900).map(|n| Vec3::new((n / 30) as f32 * 0.01, (n % 30) as f32 * 0.01, 0.0501)).collect();
        let cloud = Observation::Cloud { points_m, eyes_m: Vec::new() };
        let volume = fuse(&cloud, &PAPER, LAW).unwrap();
        assert_eq!(volume.warnings.len(), 2, "{:?}", volume.warnings);
        assert!(volume.warnings[0].starts_with("the cloud is sparse: its points are at least 7.5 mm apart"));
    }

    #[test]
    fn clouds_of_other_units_are_warnings_and_blocks_are_refused() {
        let fused = |points_m: Vec<Vec3>| fuse(&Observation::Cloud { points_m, eyes_m: Vec::new() }, &PAPER, LAW);
        let millimetres =
            fused((0..900).map(|n| Vec3::new((n / 30) as f32 * 10.0, (n % 30) as f32 * 10.0, 50.1)).collect());
        let warning = &millimetres.unwrap().warnings[0];
        assert!(
            warning.starts_with("900 of 900 points lie outside") && warning.ends_with("(millimetres?)"),
            "{warning}"
        );
        let block = (0..120 * 120 * 30).map(|n| Vec3::new((n / 3600) as f32, (n / 30 % 120) as f32, (n % 30) as f32));
        let error = fused(block.map(|p| p * 0.0025 + 0.001).collect()).unwrap_err().to_string();
        assert!(error.starts_with("a cloud must be a surface"), "{error}");
    }
}
