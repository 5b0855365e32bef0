//! The options of a request: what is wanted of the grasps. The command line, HTTP and Python give them as a
//! [`RequestInput`], and they are checked here alone.

use schema::Vec3;

use crate::input::camera::{PoseInput, orientation, point, pose};
use crate::input::error::{InputError, refuse};
use crate::input::request::{BoxInput, ConeInput, RequestInput, parse_json};
use crate::{Ball, Cone, FindTable, Limits, PlanOptions, Target, WORKSPACE_M, plane};

/// Lengths of vectors that are directions.
const DIRECTION_MIN: f64 = 1e-6;
const DIRECTION_MAX: f64 = 1e6;
/// Maximum number of requested grasps.
const GRASPS_MAX: usize = 10_000;
/// Largest radius of a thing to be left, in metres.
const RADIUS_M_MAX: f64 = 1.0;

/// The options in the JSON of a request that has nothing else; the observation is the caller's.
///
/// # Errors
/// [`InputError`], naming the key.
pub fn options_from_json(text: &[u8], finds_table: bool) -> Result<PlanOptions, InputError> {
    options(&parse_json::<RequestInput>(text)?, finds_table)
}

/// The options of a request. `finds_table` says whether the table is to be found in the observation.
///
/// # Errors
/// [`InputError`], naming the key.
pub(crate) fn options(input: &RequestInput, finds_table: bool) -> Result<PlanOptions, InputError> {
    if finds_table && input.base_from_workspace.is_some() {
        return refuse(
            "must not be given where the workspace is found, as its place in the base's frame is not known (give \
             base_from_camera): base_from_workspace",
        );
    }
    let alone = [("down", input.down.is_some()), ("base_from_camera", input.base_from_camera.is_some())];
    if let Some((key, _)) = alone.into_iter().find(|(_, is_given)| *is_given && !finds_table) {
        return refuse(format!("{key} goes with a table that is to be found, \"table\" in place of a pose: {key}"));
    }
    let base_from_workspace = input.base_from_workspace.as_ref().map(|input| pose(input, "base_from_workspace"));
    let base_from_camera = input.base_from_camera.as_ref().map(|input| pose(input, "base_from_camera"));
    let placed = input.workspace_from_cloud.as_ref().filter(|place| **place != PoseInput::Table);
    let workspace_from_cloud = placed.map(|input| pose(input, "workspace_from_cloud"));
    let workspace_from_wrist =
        input.workspace_from_wrist.as_ref().map(|input| orientation(input, "workspace_from_wrist"));
    if let Some(got) = input.grasps_max.filter(|count| !(1..=GRASPS_MAX).contains(count)) {
        return refuse(format!("must be between 1 and {GRASPS_MAX}, got {got}: grasps_max"));
    }
    let avoid = input.avoid.as_deref().unwrap_or_default();
    let workspace_size_m = input.workspace_size_m.map(|size_m| size_m as f32);
    if let Some(got) = workspace_size_m.filter(|size_m| !WORKSPACE_M.contains(size_m)) {
        let (low, high) = (WORKSPACE_M.start(), WORKSPACE_M.end());
        return refuse(format!("must be between {low} and {high}, got {got}: workspace_size_m"));
    }
    let limits = limits(input)?;
    let down = input.down.map(|down| direction(down, "down")).transpose()?;
    let previous = input.previous.as_ref().map(|input| pose(input, "previous"));
    let failed = |(number, input): (usize, &PoseInput)| pose(input, &format!("avoid[{number}]"));
    Ok(PlanOptions {
        workspace_size_m,
        find_table: finds_table.then_some(FindTable { down, base_from_camera: base_from_camera.transpose()? }),
        workspace_from_cloud: workspace_from_cloud.transpose()?,
        base_from_workspace: base_from_workspace.transpose()?,
        workspace_from_wrist: workspace_from_wrist.transpose()?,
        policy: input.policy,
        check_collisions: input.check_collisions,
        grasps_max: input.grasps_max,
        each: input.each.unwrap_or(false),
        explain: input.explain.unwrap_or(false),
        previous: previous.transpose()?,
        avoid: avoid.iter().enumerate().map(failed).collect::<Result<_, _>>()?,
        limits,
    })
}

/// A vector that is a direction.
fn direction(xyz: [f64; 3], at: &str) -> Result<Vec3, InputError> {
    let length = xyz.iter().map(|x| x * x).sum::<f64>().sqrt();
    if !(DIRECTION_MIN..=DIRECTION_MAX).contains(&length) {
        return refuse(format!("must be a direction, of a length of 1e-6 to 1e6, got {xyz:?}: {at}"));
    }
    Ok(Vec3::from_array(xyz.map(|x| x as f32)))
}

/// The limits of a request, but for masks.
///
/// # Errors
/// [`InputError`], naming the key.
fn limits(input: &RequestInput) -> Result<Limits, InputError> {
    let approach = input.approach.map(|ConeInput { direction: given, angle_rad_max }| {
        if !(0.0..=std::f64::consts::PI).contains(&angle_rad_max) {
            return refuse(format!("must be between 0 and 3.1416, got {angle_rad_max}: approach.angle_rad_max"));
        }
        Ok(Cone::about(direction(given, "approach.direction")?, angle_rad_max as f32))
    });
    let planes = input.keep_out.as_deref().unwrap_or_default();
    let beyond = |(number, [x, y, z, offset_m]): (usize, &[f64; 4])| {
        let at = format!("keep_out[{number}]");
        let plane = plane(direction([*x, *y, *z], &at)?, *offset_m as f32);
        point([f64::from(plane.offset_m); 3], &at).map(|_| plane)
    };
    let avoided = input.avoid_objects.as_deref().unwrap_or_default();
    let ball = |(number, [x, y, z, radius_m]): (usize, &[f64; 4])| {
        let at = format!("avoid_objects[{number}]");
        if !(0.0..=RADIUS_M_MAX).contains(radius_m) {
            return refuse(format!("must have a radius between 0 and {RADIUS_M_MAX} m, got {radius_m}: {at}"));
        }
        Ok(Ball { centre_m: point([*x, *y, *z], &at)?, radius_m: *radius_m as f32 })
    };
    let reach_m = input.reach.map(|BoxInput { low_m, high_m }| {
        let [low, high] = [point(low_m, "reach.low_m")?, point(high_m, "reach.high_m")?];
        if low.cmpgt(high).any() {
            return refuse(format!("must be at least low_m, {low_m:?}, got {high_m:?}: reach.high_m"));
        }
        Ok([low, high])
    });
    let target = input.target_m.map(|target_m| point(target_m, "target_m").map(Target::Point));
    Ok(Limits {
        approach: approach.transpose()?,
        keep_out: planes.iter().enumerate().map(beyond).collect::<Result<_, InputError>>()?,
        reach_m: reach_m.transpose()?,
        avoid_objects: avoided.iter().enumerate().map(ball).collect::<Result<_, InputError>>()?,
        target: target.transpose()?,
    })
}
