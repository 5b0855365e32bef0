//! VGN's grasps: an observed surface point, the gripper along its normal, six yaws about it (`generate_data.py`).
//!
//! There are two differences from the published code. It tries yaws from 0 to π including both ends, which are the same
//! grasp; here the six yaws are distinct. And it draws points until one is acceptable; here the last is used after
//! [`TRIES_MAX`].
//!
//! On objects of several parts, points are drawn where a line enters their union, so the inside of a cup is drawn in
//! proportion to the area of its inner wall.

use perception::camera_at;
use schema::{
    Approach, Camera, ObjectRecord, Polyhedron, Rule, Stream, Vec3, View, along_normal, axis_angle, pose_from_parts,
};
use simulator::{Scene, SceneObject, SceneRays, ViewRays};

use crate::candidates::Candidate;
use crate::config::{Config, YAWS};

/// Maximum number of draws for an acceptable point.
const TRIES_MAX: u32 = 1_000;
/// VGN's ε: the depth of the finger tips is between −ε and 1 + ε finger lengths behind the surface.
const DEPTH_SHARE: f32 = 0.1;
/// The normal must not point down: its z must exceed this.
const NORMAL_Z_MIN: f32 = -0.1;
/// Points must be at least this far above the table …
const ABOVE_TABLE_M: f32 = 0.005;
/// … and inside the workspace by this share of its side.
const MARGIN_SIZES: f32 = 1.0 / 15.0;
/// A point is visible if the camera's depth there differs by at most this.
const SEEN_WITHIN_M: f32 = 0.003;
/// Between parts closer to each other than this along a line there is no surface.
pub(crate) const SEAM_M: f32 = 1e-4;

/// A point of an object's surface.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Touch {
    object_id: usize,
    point_m: Vec3,
    normal: Vec3,
}

/// Draws `count` candidates in a scene, given with its rows, that is observed from `views`: [`YAWS`] consecutive ones
/// at each point (the last point may have fewer).
///
/// # Panics
/// If there are no objects.
#[must_use]
pub(crate) fn draw_along_normals(
    config: &Config,
    scene: &Scene,
    objects: &[ObjectRecord],
    rays: &SceneRays,
    views: &[View],
    count: usize,
    stream: &mut Stream,
) -> Vec<Candidate> {
    let seen = |view: &View| {
        let camera = camera_at(view, &config.grid, config.camera.intrinsics());
        (camera, rays.seen_from(&camera))
    };
    let cameras: Vec<(Camera, ViewRays)> = views.iter().map(seen).collect();
    let mut candidates = Vec::with_capacity(count.next_multiple_of(YAWS));
    while candidates.len() < count {
        let touch = draw_seen(config, &scene.objects, &cameras, stream);
        let length_m = config.gripper.of_scene(objects[0].scene_id).finger_length_m;
        let depth_m = length_m * stream.uniform(-DEPTH_SHARE, 1.0 + DEPTH_SHARE);
        let shape = objects[touch.object_id].shape.shape();
        candidates.extend((0..YAWS).map(|yaw| {
            let turn_rad = core::f32::consts::PI * yaw as f32 / YAWS as f32;
            let rule = Rule { shape, approach: Approach::Normal };
            // Along the inward normal, its tips so deep behind the surface, turned from the orientation in which its x
            // is in the plane of the workspace's x (VGN: `sample_grasp_point`, `evaluate_grasp_point`).
            let rotation = along_normal(touch.normal, turn_rad);
            let grasp = pose_from_parts(rotation, touch.point_m - touch.normal * depth_m);
            Candidate { turn_rad, depth_m, ..Candidate::undrawn(rule, touch.object_id, grasp) }
        }));
    }
    candidates.truncate(count);
    candidates
}

/// A visible surface point with an upward normal inside the workspace; after [`TRIES_MAX`] draws the last one.
fn draw_seen(config: &Config, targets: &[SceneObject], cameras: &[(Camera, ViewRays)], stream: &mut Stream) -> Touch {
    let grid = &config.grid;
    let inside = MARGIN_SIZES * grid.size_m..=(1.0 - MARGIN_SIZES) * grid.size_m;
    let will_do = |touch: &Touch| {
        let Touch { point_m, normal, .. } = touch;
        normal.z > NORMAL_Z_MIN
            && point_m.z > grid.table_z_m + ABOVE_TABLE_M
            && inside.contains(&point_m.x)
            && inside.contains(&point_m.y)
            && cameras.iter().any(|(camera, rays)| sees(camera, rays, touch))
    };
    let top_of_first = Touch { object_id: 0, point_m: targets[0].workspace_from_object.translation, normal: Vec3::Z };
    let mut last = top_of_first;
    // Of an object of many parts (at most PARTS_MAX) one of a line's possible entries is drawn, and often is not there.
    let parts_most = targets.iter().map(|target| target.body.polyhedra().len()).max().unwrap_or(1) as u32;
    for _ in 0..TRIES_MAX * parts_most {
        if let Some(touch) = draw_touch(targets, stream) {
            last = touch;
            if will_do(&touch) {
                break;
            }
        }
    }
    last
}

fn sees(camera: &Camera, rays: &ViewRays, Touch { point_m, normal, .. }: &Touch) -> bool {
    // A point just behind an edge has nearly the depth of the visible surface.
    if (camera.workspace_from_camera.translation - *point_m).dot(*normal) <= 0.0 {
        return false;
    }
    let local_m = camera.workspace_from_camera.inverse_transform_point(*point_m);
    let depth_m = camera.intrinsics.project(local_m).and_then(|pixel| rays.depth_at(pixel));
    depth_m.is_some_and(|depth_m| (depth_m - local_m.z).abs() < SEEN_WITHIN_M)
}

/// The point where a random straight line enters an object, or `None` if it misses. Lines drawn uniformly among all
/// that hit a ball enter the solids in it uniformly over their surfaces (Crofton), so no area has to be computed. A
/// line may enter an object of n parts up to n times, so the object is drawn n times as often, and each draw selects
/// one of n possible entries, which may not exist.
fn draw_touch(targets: &[SceneObject], stream: &mut Stream) -> Option<Touch> {
    let disc = |SceneObject { body, .. }: &SceneObject| {
        body.bounding_radius_m() * body.bounding_radius_m() * body.polyhedra().len() as f32
    };
    let discs: Vec<f32> = targets.iter().map(disc).collect();
    let mut left = stream.uniform(0.0, discs.iter().sum());
    let object_id = discs.iter().position(|disc| {
        left -= disc;
        left < 0.0
    });
    let object_id = object_id.unwrap_or(targets.len() - 1);
    let (rotation, radius_share) = (stream.rotation(), stream.uniform(0.0, 1.0).sqrt());
    let around = axis_angle(Vec3::Z, stream.uniform(0.0, core::f32::consts::TAU));
    let SceneObject { body, workspace_from_object: pose, .. } = &targets[object_id];
    let (parts, radius_m) = (body.polyhedra(), body.bounding_radius_m());
    let aside_m = rotation * around * Vec3::X * (radius_share * radius_m);
    let wanted = if parts.len() == 1 { 0 } else { stream.index(parts.len()) };
    let direction = rotation * Vec3::Z;
    let Within { enter_m, normal, .. } = within(parts, aside_m, direction).into_iter().nth(wanted)?;
    let point_m = pose.transform_point(aside_m + direction * enter_m);
    Some(Touch { object_id, point_m, normal: pose.rotation * normal })
}

/// An interval of a line inside convex parts, as distances along it, and the normals at its start and its end.
pub(crate) struct Within {
    pub(crate) enter_m: f32,
    pub(crate) exit_m: f32,
    pub(crate) normal: Vec3,
    pub(crate) exit_normal: Vec3,
}

/// Where the line through `at_m` along `direction` is inside the union of convex parts, in order.
pub(crate) fn within<'a>(parts: impl IntoIterator<Item = &'a Polyhedron>, at_m: Vec3, direction: Vec3) -> Vec<Within> {
    let mut inside: Vec<Within> = parts.into_iter().filter_map(|part| within_part(part, at_m, direction)).collect();
    inside.sort_by(|a, b| a.enter_m.total_cmp(&b.enter_m));
    inside.dedup_by(|next, last| {
        let is_joined = next.enter_m <= last.exit_m + SEAM_M;
        if is_joined && next.exit_m > last.exit_m {
            (last.exit_m, last.exit_normal) = (next.exit_m, next.exit_normal);
        }
        is_joined
    });
    inside
}

fn within_part(part: &Polyhedron, at_m: Vec3, direction: Vec3) -> Option<Within> {
    let (mut enter, mut exit, mut face, mut exit_normal) = (f32::NEG_INFINITY, f32::INFINITY, None, Vec3::ZERO);
    for plane in part.planes() {
        let (speed, gap_m) = (plane.normal.dot(direction), plane.offset_m - plane.normal.dot(at_m));
        if speed < 0.0 {
            if gap_m / speed > enter {
                (enter, face) = (gap_m / speed, Some(plane.normal));
            }
        } else if speed > 0.0 {
            if gap_m / speed < exit {
                (exit, exit_normal) = (gap_m / speed, plane.normal);
            }
        } else if gap_m < 0.0 {
            return None;
        }
        // Most lines pass by most parts.
        if enter >= exit {
            return None;
        }
    }
    face.filter(|_| enter < exit).map(|normal| Within { enter_m: enter, exit_m: exit, normal, exit_normal })
}

#[cfg(test)]
mod tests {
    use schema::{Pose, Purpose, Quat, ShapeKind, Solid};
    use simulator::Scene;
    use simulator::{Body, Part};

    use super::*;
    use crate::config::Overrides;

    fn record(solid: Solid, at: Vec3, rotation: Quat) -> ObjectRecord {
        let workspace_from_object = pose_from_parts(rotation, at);
        let shape = solid.into();
        ObjectRecord { scene_id: 0, object_id: 0, shape, mass_kg: 0.1, friction: 1.0, workspace_from_object }
    }

    /// Lines enter each face in proportion to its area, and the point lies on that face.
    #[test]
    fn touches_are_uniform_over_the_surface() {
        let mut stream = Stream::new(4, 0, Purpose::Candidates, 0);
        let solid = Solid::new(ShapeKind::Cuboid, Vec3::new(0.03, 0.05, 0.08)).unwrap();
        let objects = [record(solid, Vec3::ZERO, Quat::IDENTITY)];
        let targets = Scene::from_records(0.0, Vec::new(), &objects, &[]).objects;
        let touches: Vec<Touch> = (0..40_000).filter_map(|_| draw_touch(&targets, &mut stream)).collect();
        let area = 2.0 * (0.03 * 0.05 + 0.05 * 0.08 + 0.08 * 0.03);
        for (axis, face) in [(Vec3::X, 0.05 * 0.08), (Vec3::Y, 0.08 * 0.03), (Vec3::Z, 0.03 * 0.05)] {
            for normal in [axis, -axis] {
                let on: Vec<&Touch> = touches.iter().filter(|t| t.normal.dot(normal) > 0.99).collect();
                let share = on.len() as f32 / touches.len() as f32;
                assert!((share / (face / area) - 1.0).abs() < 0.06, "{normal}: {share} of {}", face / area);
                let half = 0.5 * solid.extents_m.dot(axis);
                assert!(on.iter().all(|t| (t.point_m.dot(normal) - half).abs() < 1e-6), "{normal}");
                // Uniform on the face: as many in the middle half of each side as outside it.
                let in_middle = |t: &&&Touch| {
                    let share = (t.point_m / solid.extents_m).abs();
                    [share.x, share.y, share.z].into_iter().filter(|s| *s < 0.25).count() == 2
                };
                let middle = on.iter().filter(in_middle).count() as f32 / on.len() as f32;
                assert!((middle - 0.25).abs() < 0.035, "{normal}: {middle} in the middle quarter");
            }
        }
    }

    /// An L of two boxes that share a face: the shared face is no surface; the faces in the corner are, in proportion
    /// to their area.
    #[test]
    fn touches_of_parts_are_uniform_over_the_surface_of_their_union() {
        let box_at = |size: Vec3, at: Vec3| Part {
            shape: simulator::PartShape::Solid(Solid::new(ShapeKind::Cuboid, size).unwrap()),
            object_from_part: Pose::from_translation(at),
        };
        let lying = box_at(Vec3::new(0.08, 0.04, 0.02), Vec3::new(0.0, 0.0, 0.01));
        let standing = box_at(Vec3::new(0.02, 0.04, 0.06), Vec3::new(-0.03, 0.0, 0.05));
        let body = Body::of_parts("ell", vec![lying, standing]).unwrap();
        let workspace_from_object = Pose::IDENTITY;
        let targets = [SceneObject { body, mass_kg: 0.1, friction: 1.0, workspace_from_object }];
        let mut stream = Stream::new(5, 0, Purpose::Candidates, 0);
        let touches: Vec<Touch> = (0..60_000).filter_map(|_| draw_touch(&targets, &mut stream)).collect();
        let share =
            |of: &dyn Fn(&Touch) -> bool| touches.iter().filter(|t| of(t)).count() as f32 / touches.len() as f32;
        // Ends at -x and +x (one of them in the corner) 0.08 x 0.04 each, two ells of 0.0028, below and above 0.08 x
        // 0.04.
        let area = 2.0 * 0.08 * 0.04 + 2.0 * 0.0028 + 2.0 * 0.08 * 0.04;
        // The frame's origin is the middle of the box: the bottom is at z = -0.04, the step at -0.02.
        let in_corner = |t: &Touch| t.normal.x > 0.99 && t.point_m.x < 0.0;
        let on_step = |t: &Touch| t.normal.z > 0.99 && t.point_m.z < 0.0;
        let on_seam = |t: &Touch| t.normal.z.abs() > 0.99 && (t.point_m.z + 0.02).abs() < 1e-5 && t.point_m.x < -0.02;
        for (got, of) in [(share(&in_corner), 0.06 * 0.04), (share(&on_step), 0.06 * 0.04)] {
            assert!((got / (of / area) - 1.0).abs() < 0.06, "{got} of {}", of / area);
        }
        assert_eq!(share(&on_seam), 0.0);
        assert!((share(&|t| t.normal.y.abs() > 0.99) / (2.0 * 0.0028 / area) - 1.0).abs() < 0.06);
    }

    #[test]
    fn a_points_six_grasps_share_origin_and_approach_and_touch_what_a_camera_sees() {
        let config = Config::load(None, Overrides::default()).unwrap();
        let solid = Solid::new(ShapeKind::Cylinder, Vec3::new(0.05, 0.05, 0.07)).unwrap();
        let objects = [
            record(solid, Vec3::new(0.12, 0.15, 0.085), Quat::IDENTITY),
            record(solid, Vec3::new(0.2, 0.15, 0.075), axis_angle(Vec3::Y, core::f32::consts::FRAC_PI_2)),
        ];
        let scene = Scene::from_records(config.grid.table_z_m, Vec::new(), &objects, &[]);
        let rays = SceneRays::new(&scene);
        // From the side of small x, so that faces towards large x are hidden.
        let views = [View { radius_m: 0.6, polar_rad: 1.0, azimuth_rad: core::f32::consts::PI }];
        let mut stream = Stream::new(4, 1, Purpose::Candidates, 0);
        let drawn = draw_along_normals(&config, &scene, &objects, &rays, &views, 602, &mut stream);
        assert_eq!(drawn.len(), 602);
        let camera = camera_at(&views[0], &config.grid, config.camera.intrinsics());
        for point in drawn.chunks(YAWS) {
            let first = point[0].workspace_from_grasp;
            let approach = first.rotation * Vec3::Z;
            let surface_m = first.translation - approach * point[0].depth_m;
            assert!(
                (surface_m - camera.workspace_from_camera.translation).dot(approach) > 0.0,
                "faces away: {approach}"
            );
            assert!((-0.005..=0.055).contains(&point[0].depth_m) && approach.z < 0.1);
            for (yaw, candidate) in point.iter().enumerate() {
                let pose = candidate.workspace_from_grasp;
                assert_eq!((pose.translation, candidate.depth_m), (first.translation, point[0].depth_m));
                assert!(((pose.rotation * Vec3::Z) - approach).length() < 1e-5);
                let back = axis_angle(approach, -core::f32::consts::PI * yaw as f32 / 6.0);
                assert!((back * pose.rotation * Vec3::Y - first.rotation * Vec3::Y).length() < 1e-5, "{yaw}");
            }
        }
        let hit: Vec<usize> = drawn.iter().map(|c| c.object_id).collect();
        assert!(hit.contains(&0) && hit.contains(&1));
    }
}
