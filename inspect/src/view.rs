//! One scene to look at: its objects, what the cameras saw of them, and every attempt with how it ended.

use generator::recorder::describe_outcome;
use report::view::{Body, Class, Line, View, flat_points};
use schema::{AttemptRecord, Axis, CameraParams, Intrinsics, Lattice, Outcome, SceneRows};
use shards::DatasetInfo;

/// Values this near the surface's, 0.5, are points of it: with a truncation of four voxels, those nearer than 0.8
/// voxels.
const SURFACE: std::ops::Range<f32> = 0.4..0.6;

/// A scene as things in space. Its attempts are forks, those that held last; the jaws of an attempt that never closed
/// are open.
#[must_use]
pub fn scene_view(info: &DatasetInfo, dataset_id: &str, rows: &SceneRows) -> View {
    let (scene, grid) = (&rows.scene, &info.grid);
    let held = rows.attempts.iter().filter(|attempt| attempt.label() == 1).count();
    let objects =
        if rows.objects.len() == 1 { "1 object".to_owned() } else { format!("{} objects", rows.objects.len()) };
    let attempts = rows.attempts.len();
    let mut view = View::new(format!("Scene {}: {objects}, {held} of {attempts} attempts held", scene.scene_id));
    view.bodies.push(Body::table(grid.size_m, grid.table_z_m));
    view.bodies.extend(Body::of_container(scene, grid));
    view.bodies.extend(rows.objects.iter().map(|object| Body::of_object(Class::Object, object)));
    view.lines.push(Line::workspace(Lattice::from(*grid).corners_m()));
    // The lens by which the TSDF was made, VGN's where the config does not say.
    let lens = info.section::<CameraParams>("camera").map_or(Intrinsics::VGN, |camera| camera.intrinsics());
    for (number, camera) in scene.views.iter().enumerate() {
        let (polar, azimuth) = (camera.polar_rad.to_degrees(), camera.azimuth_rad.to_degrees());
        let label = format!("view {number}: {:.3} m away, polar {polar:.1}°, azimuth {azimuth:.1}°", camera.radius_m);
        view.lines.push(Line::camera(label, &camera.workspace_from_camera(grid), &lens));
    }
    let gripper = info.gripper_of(scene.scene_id);
    for is_held in [false, true] {
        for attempt in rows.attempts.iter().filter(|a| (a.outcome == Outcome::Held) == is_held) {
            let width_m = attempt.width_m.unwrap_or(gripper.opening_m_max);
            let (class, label) = (Class::Grasp(attempt.outcome), attempt_label(attempt));
            view.lines.push(Line::fork(class, label, gripper, &attempt.workspace_from_grasp, width_m));
        }
    }
    view.points.push(surface(info, rows));
    facts(&mut view, info, dataset_id, rows);
    // Most attempts collide: with their grasps shown there is little else to be seen.
    view.hidden = ["approach_collision", "pregrasp_collision", "camera"].map(str::to_owned).into();
    view
}

/// An attempt in words: its id as commands take it, its outcome and what it hit, its width, its target and rule.
fn attempt_label(attempt: &AttemptRecord) -> String {
    let closing = attempt.closing.map_or(String::new(), |axis| format!(", closes along {}", Axis::name(axis)));
    let ending = describe_outcome(attempt.outcome, attempt.hit.map(|kind| (kind, attempt.hit_object_id)), None);
    let width = attempt.width_m.map_or("never closed".to_owned(), |width_m| format!("{:.1} mm", width_m * 1000.0));
    let (scene, id, object, rule) = (attempt.scene_id, attempt.attempt_id, attempt.object_id, attempt.rule.name());
    format!("{scene}/{id} at object {object}\n{ending}, {width}\nrule {rule}{closing}")
}

fn surface(info: &DatasetInfo, rows: &SceneRows) -> Line {
    let grid = &info.grid;
    let side = grid.resolution;
    let near = (0..).zip(&rows.scene.tsdf).filter(|(_, value)| SURFACE.contains(value));
    let points_m = flat_points(near.map(|(at, _)| grid.centre_m([at / side.pow(2), at / side % side, at % side])));
    let label = format!("voxels of {:.1} mm within 0.8 voxels of the surface", grid.voxel_size_m() * 1000.0);
    Line { class: Class::Surface, label, points_m, frames: None }
}

fn facts(view: &mut View, info: &DatasetInfo, dataset_id: &str, rows: &SceneRows) {
    let scene = &rows.scene;
    view.fact("dataset", dataset_id.get(..12).unwrap_or(dataset_id));
    view.fact("seed", info.seed.to_string());
    view.fact("shard", info.shard_of(scene.scene_id).unwrap_or_default().to_string());
    view.fact("objects", format!("{} of {} dropped", scene.object_count, scene.dropped_count));
    view.fact("at rest after", format!("{:.2} s", scene.settle_time_s));
    if let Some(container) = scene.container {
        view.fact("container", container.kind.name());
    }
    for outcome in Outcome::ALL {
        let count = rows.attempts.iter().filter(|a| a.outcome == outcome).count();
        view.fact(outcome.name(), count.to_string());
    }
    let gripper = info.gripper_of(scene.scene_id);
    view.fact("gripper", format!("{}, opens {:.0} mm", gripper.name, gripper.opening_m_max * 1000.0));
}

#[cfg(test)]
mod tests {
    use schema::{Pose, Vec3};

    use super::*;
    use crate::synthetic;

    fn sample() -> (DatasetInfo, SceneRows) {
        let mut info = synthetic::info(5, 1, 60, 20);
        info.grid.resolution = 16;
        let rows = synthetic::scene_rows(1, info.seed, &info);
        (info, rows)
    }

    #[test]
    fn every_object_stands_where_its_row_says() {
        let (info, rows) = sample();
        let view = scene_view(&info, "0123456789abcdef", &rows);
        let objects: Vec<&Body> = view.bodies.iter().filter(|body| body.class == Class::Object).collect();
        assert_eq!((view.bodies.len(), objects.len()), (rows.objects.len() + 1, rows.objects.len()));
        for (body, row) in objects.iter().zip(&rows.objects) {
            let [x, y, z, qx, qy, qz, qw] = body.poses[0];
            assert_eq!(body.poses.len(), 1);
            let pose = Pose::from_parts(Vec3::new(x, y, z), schema::Quat::from_xyzw(qx, qy, qz, qw));
            assert_eq!(pose, row.workspace_from_object);
            assert_eq!(body.corners_m, flat_points(row.shape.as_solid().unwrap().vertices_m()));
            assert_eq!(body.faces.len(), row.shape.as_solid().unwrap().planes().len());
            assert!(body.label.starts_with(&format!("object {}: {}", row.object_id, row.shape.name())));
        }
        let held = rows.attempts.iter().filter(|attempt| attempt.outcome == Outcome::Held).count();
        let (objects, attempts) = (rows.objects.len(), rows.attempts.len());
        assert_eq!(view.title, format!("Scene 1: {objects} objects, {held} of {attempts} attempts held"));
    }

    #[test]
    fn a_scene_s_container_stands_where_its_row_says() {
        let (info, mut rows) = sample();
        let sizes = [0.26, 0.2, 0.1, 0.004, 0.1];
        rows.scene.container = Some(schema::Container::of_sizes(schema::ContainerKind::Bin, sizes));
        let view = scene_view(&info, "", &rows);
        let bin = view.bodies.iter().find(|body| body.class == Class::Container).unwrap();
        assert_eq!((bin.corners_m.len(), bin.faces.len()), (4 * 8, 4 * 6));
        assert!(bin.label.starts_with("bin\n260 × 200 mm inside, walls 100 mm high"), "{}", bin.label);
        // The wall at -x ends at 0.15 - 0.13 - 0.004.
        let low = bin.corners_m.iter().map(|corner| corner[0]).fold(f32::INFINITY, f32::min);
        assert!((low - 0.016).abs() < 1e-6, "{low}");
    }

    #[test]
    fn every_attempt_is_a_fork_of_its_outcome_and_width() {
        let (info, rows) = sample();
        let view = scene_view(&info, "", &rows);
        let grasps: Vec<&Line> = view.lines.iter().filter(|line| line.label.starts_with("1/")).collect();
        assert_eq!(grasps.len(), rows.attempts.len());
        for row in &rows.attempts {
            let label = format!("1/{} at object {}\n", row.attempt_id, row.object_id);
            let fork = grasps.iter().find(|line| line.label.starts_with(&label)).unwrap();
            assert_eq!(fork.class, Class::Grasp(row.outcome));
            let [first, last] = [0, 6].map(|i| Vec3::from_array(fork.points_m[i]));
            let width_m = row.width_m.unwrap_or(info.gripper.opening_m_max);
            assert!(((last - first).length() - width_m - info.gripper.finger_thickness_m).abs() < 1e-6, "{row:?}");
            assert!((0.5 * (first + last) - row.workspace_from_grasp.translation).length() < 1e-6, "{row:?}");
        }
        assert_eq!(view.lines.iter().filter(|line| line.class == Class::Camera).count(), rows.scene.views.len());
    }

    #[test]
    fn the_surface_is_where_the_grid_s_values_are_near_a_half() {
        let (info, mut rows) = sample();
        rows.scene.tsdf.fill(0.0);
        let voxel = [3, 5, 7];
        rows.scene.tsdf[info.grid.flat(voxel)] = 0.5;
        rows.scene.tsdf[info.grid.flat([4, 5, 7])] = 0.7;
        let view = scene_view(&info, "", &rows);
        assert_eq!(view.points[0].points_m, flat_points([info.grid.centre_m(voxel)]));
    }
}
