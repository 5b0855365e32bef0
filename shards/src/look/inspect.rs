//! One scene as text: its objects, cameras and attempts, and two cuts through its grid.

use report::document::{Block, Cell, Document, Table};
use schema::{AttemptRecord, Axis, Grid, HitKind, Pose, SceneRows, Vec3};

use crate::DatasetInfo;

/// A scene, for a terminal.
#[must_use]
pub fn inspection(info: &DatasetInfo, rows: &SceneRows) -> Document {
    let blocks = vec![
        Block::Text(head(info, rows)),
        Block::Table(objects(rows)),
        Block::Table(views(rows)),
        Block::Table(attempts(rows)),
    ];
    Document { blocks: blocks.into_iter().chain(cuts(&info.grid, rows)).collect(), ..Document::default() }
}

fn head(info: &DatasetInfo, rows: &SceneRows) -> String {
    let scene = &rows.scene;
    let held = rows.attempts.iter().filter(|a| a.label() == 1).count();
    let shard = info.shard_of(scene.scene_id).unwrap_or_default();
    let rejected = scene.rejections;
    let (unsettled, empty, unstable) = (rejected.unsettled, rejected.empty, rejected.unstable);
    let tries = if unsettled + empty + unstable > 0 {
        format!("\nthrown away before: {unsettled} unsettled, {empty} empty, {unstable} unstable")
    } else {
        String::new()
    };
    format!(
        "scene {} (shard {shard}, seed {})\n\
         {} of {} dropped objects at rest after {:.2} s; {held} of {} attempts held{tries}",
        scene.scene_id, info.seed, scene.object_count, scene.dropped_count, scene.settle_time_s, scene.attempt_count
    )
}

fn number(value: impl Into<f64>, decimals: usize) -> Cell {
    Cell::Number(format!("{:.decimals$}", value.into()))
}

fn objects(rows: &SceneRows) -> Table {
    let rows = rows.objects.iter().map(|object| {
        let size = (object.shape.extents_m() * 1000.0).to_array().map(|side| format!("{side:.1}")).join(" ");
        let mut row = vec![number(object.object_id, 0), object.shape.name().into(), Cell::Number(size)];
        row.extend([number(object.mass_kg * 1000.0, 1), number(object.friction, 2)]);
        row.extend(pose(&object.workspace_from_object));
        row
    });
    Table::new(["object", "shape", "size, mm", "mass, g", "friction"].into_iter().chain(POSE), rows)
}

fn views(rows: &SceneRows) -> Table {
    let rows = rows.scene.views.iter().enumerate().map(|(number, view)| {
        let angle = |rad: f32| self::number(rad.to_degrees(), 1);
        vec![Cell::Count(number as u64), self::number(view.radius_m, 3), angle(view.polar_rad), angle(view.azimuth_rad)]
    });
    Table::new(["view", "radius, m", "polar, deg", "azimuth, deg"], rows)
}

fn attempts(rows: &SceneRows) -> Table {
    let rows = rows.attempts.iter().map(|attempt| {
        let mut row = vec![
            number(attempt.attempt_id, 0),
            number(attempt.object_id, 0),
            attempt.rule.name().into(),
            attempt.closing.map_or("-", Axis::name).into(),
        ];
        row.extend(pose(&attempt.workspace_from_grasp));
        row.push(attempt.width_m.map_or(Cell::number("-"), |width_m| number(width_m * 1000.0, 1)));
        row.push(format!("{}{}", attempt.outcome.name(), hit(attempt)).into());
        row
    });
    let head = ["attempt", "object", "rule", "close"].into_iter().chain(POSE);
    Table::new(head.chain(["width, mm", "outcome"]), rows)
}

fn hit(attempt: &AttemptRecord) -> String {
    match (attempt.hit, attempt.hit_object_id) {
        (None, _) => String::new(),
        (Some(HitKind::Other), Some(id)) => format!(" with object {id}"),
        (Some(kind), _) => format!(" with {}", kind.name()),
    }
}

const POSE: [&str; 7] = ["x, mm", "y, mm", "z, mm", "qx", "qy", "qz", "qw"];

fn pose(pose: &Pose) -> impl Iterator<Item = Cell> {
    let position = (pose.translation * 1000.0).to_array().map(|value| number(value, 1));
    position.into_iter().chain(pose.rotation.to_array().map(|value| number(value, 3)))
}

/// A level cut two centimetres above the table, and an upright one through the middle.
fn cuts(grid: &Grid, rows: &SceneRows) -> [Block; 5] {
    let level = grid.voxel_at(Vec3::new(0.0, 0.0, grid.table_z_m + 0.02)).map_or(grid.resolution / 2, |v| v[2]);
    let middle = grid.resolution / 2;
    let height_mm = grid.centre_m([0, 0, level]).z * 1000.0;
    let depth_mm = grid.centre_m([0, middle, 0]).y * 1000.0;
    let legend = "voxel grid: # surface, o behind it, + before it, . further before it, blank far or never seen";
    [
        Block::Text(legend.to_owned()),
        Block::Text(format!("level cut at z = {height_mm:.0} mm: x to the right, y up")),
        cut(grid, &rows.scene.tsdf, |right, up| [right, up, level]),
        Block::Text(format!("upright cut at y = {depth_mm:.0} mm: x to the right, z up")),
        cut(grid, &rows.scene.tsdf, |right, up| [right, middle, up]),
    ]
}

fn cut(grid: &Grid, tsdf: &[f32], voxel: impl Fn(usize, usize) -> [usize; 3]) -> Block {
    let lines = (0..grid.resolution).rev().map(|up| {
        let values = (0..grid.resolution).map(|right| tsdf.get(grid.flat(voxel(right, up))).copied().unwrap_or(0.0));
        format!("  |{}|", values.flat_map(|value| [mark(value); 2]).collect::<String>())
    });
    Block::List(lines.collect())
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
