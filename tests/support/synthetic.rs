//! Synthetic data for tests and benches: without physics, but with objects on the table, grids from camera views, and
//! outcomes that depend on the grasp, so that statistics are realistic and a network can learn from them.

use schema::{
    Approach, AttemptRecord, Axis, Container, ContainerKind, Grid, Gripper, HitKind, ObjectRecord, Outcome, Pose,
    Procedure, Purpose, Quat, Rule, SceneRecord, SceneRejections, SceneRows, ShapeKind, Solid, Stream, Vec3, View,
    axis_angle, pose_from_parts,
};

use shards::DatasetInfo;

/// The info of a synthetic dataset on the paper's grid. Lower `grid.resolution` for small files.
#[must_use]
pub(crate) fn info(seed: u64, shard_count: u32, attempt_count: u64, attempts_per_scene: u32) -> DatasetInfo {
    DatasetInfo {
        about: DatasetInfo::ABOUT.to_owned(),
        format_version: 1,
        code_version: "synthetic".to_owned(),
        seed,
        shard_count,
        scene_count: attempt_count.div_ceil(u64::from(attempts_per_scene)),
        attempt_count,
        attempts_per_scene,
        grid: Grid::PAPER,
        gripper: gripper(),
        procedure: procedure(),
        units: DatasetInfo::UNITS.to_owned(),
        frames: DatasetInfo::FRAMES.map(str::to_owned).to_vec(),
        facets: DatasetInfo::facets(),
        config: serde_json::json!({"kind": "synthetic"}),
        models: Vec::new(),
        grippers: Vec::new(),
    }
}

fn gripper() -> Gripper {
    Gripper {
        name: "synthetic_80".to_owned(),
        opening_m_max: 0.08,
        finger_length_m: 0.05,
        finger_width_m: 0.02,
        finger_thickness_m: 0.01,
        palm_length_m: 0.04,
        palm_width_m: 0.03,
        palm_breadth_m: 0.12,
        finger_mass_kg: 0.1,
        finger_force_n: 20.0,
        closing_speed_m_s: 0.1,
        friction: 1.0,
        clearance_m: 0.001,
        finger_tip: None,
        jaws: Vec::new(),
        flange_from_grasp: None,
        joint: None,
    }
}

fn procedure() -> Procedure {
    Procedure {
        pregrasp_distance_m: 0.05,
        retreat_distance_m: 0.1,
        retreat_cone_rad: core::f32::consts::FRAC_PI_3,
        retreat_speed_m_s: 0.1,
        close_time_s_max: 2.0,
        hold_time_s: 0.5,
        empty_width_m: 0.004,
        held_travel_share_min: 0.5,
        other_push_m_max: 0.01,
        other_lift_m_max: 0.01,
    }
}

/// All rows of a synthetic scene; equal for the same scene, seed and grid.
///
/// The scene's number of attempts is [`DatasetInfo::attempts_of_scene`].
#[must_use]
pub(crate) fn scene_rows(scene_id: u64, seed: u64, info: &DatasetInfo) -> SceneRows {
    let mut draw = Stream::new(seed, scene_id, Purpose::Objects, 0);
    let count = 1 + draw.index(5) as u32;
    let objects: Vec<ObjectRecord> = (0..count).map(|id| object(scene_id, id, &info.grid, &mut draw)).collect();
    let mut draw = Stream::new(seed, scene_id, Purpose::Candidates, 0);
    let attempts: Vec<AttemptRecord> = (0..info.attempts_of_scene(scene_id))
        .map(|id| attempt(id, &objects[id as usize % objects.len()], count, info, &mut draw))
        .collect();
    let mut draw = Stream::new(seed, scene_id, Purpose::Views, 0);
    let views: Vec<View> = (0..=draw.index(6)).map(|_| view(&info.grid, &mut draw)).collect();
    let scene = SceneRecord {
        scene_id,
        dropped_count: count + u32::from(draw.unit() < 0.2),
        object_count: count,
        attempt_count: attempts.len() as u32,
        settle_time_s: draw.uniform(0.8, 2.5),
        rejections: SceneRejections { unsettled: u32::from(draw.unit() < 0.05), empty: 0, unstable: 0 },
        tsdf: tsdf(&objects, &views, &info.grid),
        views,
        container: info.form().has_containers.then(|| container(scene_id)).flatten(),
    };
    SceneRows { scene, objects, attempts }
}

/// A container of each kind in turn, then none.
fn container(scene_id: u64) -> Option<Container> {
    let kind = ContainerKind::ALL.get(scene_id as usize % 4)?;
    Some(Container::of_sizes(*kind, [0.27, 0.25, 0.03, 0.004, 0.1]))
}

fn object(scene_id: u64, object_id: u32, grid: &Grid, draw: &mut Stream) -> ObjectRecord {
    let kind = ShapeKind::ALL[draw.index(ShapeKind::ALL.len())];
    let mut extents_m = draw.point(Vec3::splat(0.03), Vec3::splat(0.08));
    match kind {
        ShapeKind::Cylinder => extents_m.y = extents_m.x,
        ShapeKind::HalfCylinder => extents_m.z = 0.5 * extents_m.y,
        ShapeKind::Cuboid | ShapeKind::TriPrism => {}
    }
    let solid = Solid { kind, extents_m };
    let reach = grid.size_m * 0.25;
    let mut position = draw.point(Vec3::splat(reach), Vec3::splat(grid.size_m - reach));
    position.z = grid.table_z_m + 0.5 * extents_m.z;
    let rotation = axis_angle(Vec3::Z, draw.uniform(-3.0, 3.0)).normalize();
    ObjectRecord {
        scene_id,
        object_id,
        shape: solid.into(),
        mass_kg: 500.0 * solid.volume_m3(),
        friction: 1.0,
        workspace_from_object: pose_from_parts(rotation, position),
    }
}

fn view(grid: &Grid, draw: &mut Stream) -> View {
    View {
        radius_m: draw.uniform(1.6, 2.4) * grid.size_m,
        polar_rad: draw.uniform(0.0, core::f32::consts::FRAC_PI_4),
        azimuth_rad: draw.uniform(0.0, core::f32::consts::TAU),
    }
}

fn attempt(
    attempt_id: u32,
    target: &ObjectRecord,
    object_count: u32,
    info: &DatasetInfo,
    draw: &mut Stream,
) -> AttemptRecord {
    let approach = Axis::ALL[draw.index(3)];
    let closing = Axis::ALL[(approach as usize + 1 + draw.index(2)) % 3];
    let across = Axis::ALL[3 - approach as usize - closing as usize];
    let size = target.shape.extents_m();
    let tilt_rad = draw.normal(0.0, core::f32::consts::PI / 18.0);
    let depth_m = draw.uniform(0.015, 0.035) - 0.5 * approach.of(size);
    let slide_m = draw.normal(0.0, across.of(size) / 6.0);
    let rotation = (target.workspace_from_object.rotation * facing(target, approach, closing)).normalize();
    let rotation = (rotation * axis_angle(Vec3::Y, tilt_rad)).normalize();
    let offset = rotation * Vec3::new(slide_m, 0.0, depth_m);
    let workspace_from_grasp = pose_from_parts(rotation, target.workspace_from_object.translation + offset);
    let other = (object_count > 1).then(|| (target.object_id + 1) % object_count);
    let (outcome, hit) = judge(&workspace_from_grasp, closing.of(size), other.is_some(), info, draw);
    let width_m = match outcome {
        Outcome::PregraspCollision | Outcome::ApproachCollision => None,
        Outcome::Empty => Some(0.0),
        _ => Some((closing.of(size) - draw.uniform(0.0, 0.001)).min(info.gripper.opening_m_max)),
    };
    AttemptRecord {
        scene_id: target.scene_id,
        attempt_id,
        object_id: target.object_id,
        rule: Rule { shape: target.shape.shape(), approach: Approach::Axis(approach) },
        closing: Some(closing),
        tilt_rad,
        turn_rad: 0.0,
        depth_m,
        slide_m,
        workspace_from_grasp,
        outcome,
        hit,
        hit_object_id: match hit {
            Some(HitKind::Target) => Some(target.object_id),
            Some(HitKind::Other) => other,
            Some(HitKind::Table | HitKind::Container) | None => None,
        },
        width_m,
        robustness: (info.form().has_repeats && outcome == Outcome::Held).then_some(0.5),
    }
}

/// The rotation with the grasp's +z down along an object axis and its +y along another.
fn facing(target: &ObjectRecord, approach: Axis, closing: Axis) -> Quat {
    let axis = approach.unit();
    let is_up = (target.workspace_from_object.rotation * axis).z > 0.0;
    let first = Quat::from_rotation_arc(Vec3::Z, if is_up { -axis } else { axis });
    let side = first * Vec3::Y;
    let along = closing.unit();
    Quat::from_rotation_arc(side, if side.dot(along) < 0.0 { -along } else { along }) * first
}

/// A plausible outcome: low fingers hit the table, wide objects hit the fingers, and the rest mostly holds.
fn judge(
    grasp: &Pose,
    breadth_m: f32,
    has_other: bool,
    info: &DatasetInfo,
    draw: &mut Stream,
) -> (Outcome, Option<HitKind>) {
    let down = -(grasp.rotation * Vec3::Z).z;
    let tip_m = grasp.translation.z - info.grid.table_z_m;
    match draw.unit() {
        _ if tip_m < 0.005 || (down < 0.5 && tip_m < 0.02) => (Outcome::PregraspCollision, Some(HitKind::Table)),
        _ if breadth_m > info.gripper.opening_m_max - 0.015 => (Outcome::ApproachCollision, Some(HitKind::Target)),
        luck if has_other && luck < 0.2 => (Outcome::PregraspCollision, Some(HitKind::Other)),
        luck if has_other && luck < 0.25 => (Outcome::HitOther, Some(HitKind::Other)),
        luck if luck < 0.3 => (Outcome::Slipped, None),
        luck if luck < 0.4 => (Outcome::Empty, None),
        _ => (Outcome::Held, None),
    }
}

/// A projective TSDF: one ray per voxel and view, truncated at four voxels, averaged over the views that see the voxel.
fn tsdf(objects: &[ObjectRecord], views: &[View], grid: &Grid) -> Vec<f32> {
    let truncation_m = 4.0 * grid.voxel_size_m();
    let centre = Vec3::new(0.5 * grid.size_m, 0.5 * grid.size_m, 0.0);
    let bodies: Vec<Body> = objects.iter().map(Body::new).collect();
    let cameras: Vec<(Vec3, Vec3)> = views
        .iter()
        .map(|view| {
            let turn = axis_angle(Vec3::Z, view.azimuth_rad) * axis_angle(Vec3::Y, view.polar_rad);
            let outwards = turn * Vec3::Z;
            (centre + outwards * view.radius_m, -outwards)
        })
        .collect();
    let voxel = |i: usize| [i / grid.resolution.pow(2), i / grid.resolution % grid.resolution, i % grid.resolution];
    (0..grid.len())
        .map(|i| {
            let point = grid.centre_m(voxel(i));
            let distances = cameras.iter().filter_map(|(eye, forward)| {
                let ray = point - *eye;
                let table = (grid.table_z_m - eye.z) / ray.z;
                let hit = bodies.iter().filter_map(|body| body.hit(*eye, ray)).fold(table, f32::min);
                let distance = (hit - 1.0) * ray.dot(*forward) / truncation_m;
                (distance >= -1.0).then_some(distance.min(1.0))
            });
            let (count, sum) = distances.fold((0_u8, 0.0), |(count, sum), d| (count + 1, sum + d));
            let mean = sum / f32::from(count.max(1));
            if count > 0 && mean.abs() < 0.98 { 0.5 * (mean + 1.0) } else { 0.0 }
        })
        .collect()
}

/// A convex body as half-spaces in the workspace, with a bounding ball.
struct Body {
    centre: Vec3,
    radius_m: f32,
    planes: Vec<(Vec3, f32)>,
}

impl Body {
    fn new(object: &ObjectRecord) -> Self {
        let pose = &object.workspace_from_object;
        let solid = object.shape.as_solid().expect("synthetic objects are primitives");
        let planes = solid.planes().into_iter().map(|plane| {
            let normal = pose.rotation * plane.normal;
            (normal, plane.offset_m + normal.dot(pose.translation))
        });
        Self { centre: pose.translation, radius_m: solid.bounding_radius_m(), planes: planes.collect() }
    }

    /// The t at which `eye + t · ray` enters the body.
    fn hit(&self, eye: Vec3, ray: Vec3) -> Option<f32> {
        let to = self.centre - eye;
        let nearest = to - ray * (to.dot(ray) / ray.length_squared());
        if nearest.length_squared() > self.radius_m * self.radius_m {
            return None;
        }
        let (mut enter, mut leave) = (0.0_f32, f32::MAX);
        for (normal, offset_m) in &self.planes {
            let (speed, gap) = (normal.dot(ray), offset_m - normal.dot(eye));
            if speed < 0.0 {
                enter = enter.max(gap / speed);
            } else if speed > 0.0 {
                leave = leave.min(gap / speed);
            } else if gap < 0.0 {
                return None;
            }
        }
        (enter < leave).then_some(enter)
    }
}
