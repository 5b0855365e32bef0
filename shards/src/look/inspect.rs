//! One scene as text: its objects, cameras and attempts, and two cuts through its grid.

use std::fmt::{self, Display, Formatter};

use schema::{AttemptRecord, Axis, Grid, HitKind, Pose, SceneRows, Vec3};

use crate::DatasetInfo;

/// A scene that prints itself.
#[derive(Debug)]
pub struct Inspection<'a> {
    /// What the dataset is.
    pub info: &'a DatasetInfo,
    /// The scene.
    pub rows: &'a SceneRows,
}

impl Display for Inspection<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        head(f, self)?;
        objects(f, self.rows)?;
        views(f, self.rows)?;
        attempts(f, self.rows)?;
        cuts(f, &self.info.grid, self.rows)
    }
}

fn head(f: &mut Formatter<'_>, Inspection { info, rows }: &Inspection<'_>) -> fmt::Result {
    let scene = &rows.scene;
    let held = rows.attempts.iter().filter(|a| a.label() == 1).count();
    let shard = info.shard_of(scene.scene_id).unwrap_or_default();
    writeln!(f, "scene {} (shard {shard}, seed {})", scene.scene_id, info.seed)?;
    writeln!(
        f,
        "{} of {} dropped objects at rest after {:.2} s; {held} of {} attempts held",
        scene.object_count, scene.dropped_count, scene.settle_time_s, scene.attempt_count
    )?;
    let rejected = scene.rejections;
    let tries = rejected.unsettled + rejected.empty + rejected.unstable;
    if tries > 0 {
        let (unsettled, empty, unstable) = (rejected.unsettled, rejected.empty, rejected.unstable);
        writeln!(f, "thrown away before: {unsettled} unsettled, {empty} empty, {unstable} unstable")?;
    }
    Ok(())
}

fn objects(f: &mut Formatter<'_>, rows: &SceneRows) -> fmt::Result {
    writeln!(f, "\nobject shape            size, mm        mass, g friction  {POSE_HEAD}")?;
    for object in &rows.objects {
        let size = object.shape.extents_m() * 1000.0;
        writeln!(
            f,
            "{:>6} {:<14}{:>5.1} {:>5.1} {:>5.1}{:>10.1}{:>9.2}  {}",
            object.object_id,
            object.shape.name(),
            size.x,
            size.y,
            size.z,
            object.mass_kg * 1000.0,
            object.friction,
            Placed(&object.workspace_from_object)
        )?;
    }
    Ok(())
}

fn views(f: &mut Formatter<'_>, rows: &SceneRows) -> fmt::Result {
    writeln!(f, "\n  view  radius, m  polar, deg  azimuth, deg")?;
    for (number, view) in rows.scene.views.iter().enumerate() {
        let (polar, azimuth) = (view.polar_rad.to_degrees(), view.azimuth_rad.to_degrees());
        writeln!(f, "{number:>6}{:>11.3}{polar:>12.1}{azimuth:>14.1}", view.radius_m)?;
    }
    Ok(())
}

fn attempts(f: &mut Formatter<'_>, rows: &SceneRows) -> fmt::Result {
    writeln!(f, "\nattempt object rule             close  {POSE_HEAD}  width, mm  outcome")?;
    for attempt in &rows.attempts {
        let width = attempt.width_m.map_or("-".to_owned(), |width_m| format!("{:.1}", width_m * 1000.0));
        writeln!(
            f,
            "{:>7}{:>7} {:<18}{:<4}  {}{width:>11}  {}{}",
            attempt.attempt_id,
            attempt.object_id,
            attempt.rule.name(),
            attempt.closing.map_or("-", Axis::name),
            Placed(&attempt.workspace_from_grasp),
            attempt.outcome.name(),
            hit(attempt)
        )?;
    }
    Ok(())
}

fn hit(attempt: &AttemptRecord) -> String {
    match (attempt.hit, attempt.hit_object_id) {
        (None, _) => String::new(),
        (Some(HitKind::Other), Some(id)) => format!(" with object {id}"),
        (Some(kind), _) => format!(" with {}", kind.name()),
    }
}

const POSE_HEAD: &str = "   x, mm    y, mm    z, mm      qx     qy     qz     qw";

struct Placed<'a>(&'a Pose);

impl Display for Placed<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Vec3 { x, y, z } = self.0.translation * 1000.0;
        let [qx, qy, qz, qw] = self.0.rotation.to_array();
        write!(f, "{x:>8.1} {y:>8.1} {z:>8.1}  {qx:>6.3} {qy:>6.3} {qz:>6.3} {qw:>6.3}")
    }
}

/// A level cut two centimetres above the table, and an upright one through the middle.
fn cuts(f: &mut Formatter<'_>, grid: &Grid, rows: &SceneRows) -> fmt::Result {
    let level = grid.voxel_at(Vec3::new(0.0, 0.0, grid.table_z_m + 0.02)).map_or(grid.resolution / 2, |v| v[2]);
    let middle = grid.resolution / 2;
    writeln!(f, "\nvoxel grid: # surface, o behind it, + before it, . further before it, blank far or never seen")?;
    let height_mm = grid.centre_m([0, 0, level]).z * 1000.0;
    writeln!(f, "\nlevel cut at z = {height_mm:.0} mm: x to the right, y up")?;
    cut(f, grid, &rows.scene.tsdf, |right, up| [right, up, level])?;
    let depth_mm = grid.centre_m([0, middle, 0]).y * 1000.0;
    writeln!(f, "\nupright cut at y = {depth_mm:.0} mm: x to the right, z up")?;
    cut(f, grid, &rows.scene.tsdf, |right, up| [right, middle, up])
}

fn cut(f: &mut Formatter<'_>, grid: &Grid, tsdf: &[f32], voxel: impl Fn(usize, usize) -> [usize; 3]) -> fmt::Result {
    for up in (0..grid.resolution).rev() {
        let values = (0..grid.resolution).map(|right| tsdf.get(grid.flat(voxel(right, up))).copied().unwrap_or(0.0));
        let line: String = values.flat_map(|value| [mark(value); 2]).collect();
        writeln!(f, "  |{line}|")?;
    }
    Ok(())
}

fn mark(value: f32) -> char {
    match value {
        v if v <= 0.0 => ' ',
        v if v < 0.4 => 'o',
        v if v < 0.6 => '#',
        v if v < 0.8 => '+',
        _ => '.',
    }
}
