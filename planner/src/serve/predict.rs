//! `POST /predict`, version 0.1.0, as the servers of GraspGen-X and DexGraspNet 2 answer it: an object's cloud and the
//! rest of the scene in any one frame, and grasps in the same. Clients of theirs work unchanged.
//!
//! The table is found in the clouds, so `scene_points` must show it; two keys more than the contract's say where
//! gravity points and where the camera is, for clouds that are not in a camera's frame. (Other servers leave out keys
//! that they do not know, and so does this one.)

use std::time::Instant;

use axum::http::StatusCode;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use schema::{Gripper, Mat3, Pose, Quat, Vec3};
use serde::{Deserialize, Serialize};

use super::fault::Fault;
use super::options::GraspFrame;
use super::planning::{Planned, server_timing};
use crate::plan::{Plan, RankedGrasp};
use crate::planner::fnv1a;
use crate::{FindTable, Limits, Observation, PlanOptions, Planner, Target};

/// Version of the contract.
const CONTRACT: &str = "0.1.0";
/// Fewest points of an object.
const POINTS_MIN: usize = 32;
/// Most points of a request.
const POINTS_MAX: usize = 1_000_000;
/// Most grasps if a request does not say how many.
const GRASPS: usize = 20;
/// A grasp's origin in words.
const REFERENCE: &str = "tcp_between_fingertips";

/// A request of `/predict`. Keys that it does not have are left out of account.
#[derive(Debug, Deserialize)]
pub(crate) struct PredictInput {
    /// Points of the object, [N, 3], in metres.
    point_cloud: ArrayInput,
    /// The rest of the scene, [M, 3], with the table; the object may be in it.
    scene_points: Option<ArrayInput>,
    /// Most grasps, 1 or more; by default 20.
    num_grasps: Option<usize>,
    /// Grasps with a lower score are left out; those below the settings' ε are anyway.
    min_score: Option<f64>,
    /// Read and given back; it changes nothing.
    category_sampling: Option<bool>,
    /// The direction of gravity in the clouds' frame, of any length; by default they are in the optical frame of a
    /// camera that stands upright and looks down. Not of the contract.
    down: Option<[f64; 3]>,
    /// Where the camera is in the clouds' frame, in metres; by default at its origin. Not of the contract.
    eye_m: Option<[f64; 3]>,
}

/// An array: its little-endian bytes in C's order.
#[derive(Debug, Deserialize)]
pub(crate) struct ArrayInput {
    /// `float32` or `float64`.
    dtype: String,
    /// Its shape.
    shape: Vec<u64>,
    /// Its bytes in base64 (standard alphabet, padded).
    data_b64: String,
}

/// An answer of `/predict`.
#[derive(Debug, Serialize)]
pub(crate) struct PredictAnswer {
    /// The best first.
    grasps: Vec<PredictGrasp>,
    meta: PredictMeta,
}

/// A grasp in the clouds' frame.
#[derive(Debug, Serialize)]
struct PredictGrasp {
    /// Its origin, midway between the finger tips' ends, in metres.
    translation: [f32; 3],
    /// Unit quaternion x, y, z, w with w ≥ 0.
    rotation_quat: [f32; 4],
    /// The same rotation, row by row; its columns are the axes that `/config` names.
    rotation_matrix: [[f32; 3]; 3],
    /// Quality, 0 to 1.
    score: f32,
    /// Distance between the fingers when holding, in metres; null where an end of what they hold was not seen.
    gripper_width: Option<f32>,
    /// Null: parallel jaws have none.
    joint_angles: Option<Vec<f32>>,
    /// Null.
    joint_names: Option<Vec<String>>,
    /// Where the hand goes, a unit vector.
    approach_axis: [f32; 3],
    /// 1: the object.
    object_id: u32,
}

/// What an answer says of itself.
#[derive(Debug, Serialize)]
struct PredictMeta {
    /// The hand.
    hand: String,
    /// The planner.
    model_name: &'static str,
    /// SHA-256 of the network's weights file.
    checkpoint: String,
    /// `unchanged_from_input`.
    frame_id: &'static str,
    /// N.
    num_input_points: usize,
    /// M.
    num_scene_points: usize,
    /// `scene_collision_filtered`.
    context_mode: &'static str,
    /// As in the request.
    category_sampling: Option<bool>,
    /// Time of the plan, in milliseconds.
    inference_ms: f64,
    /// The server's version.
    server_version: &'static str,
    /// A number of the request's bytes: equal requests have the same.
    request_id: String,
    /// `graspmill`.
    backend: &'static str,
    /// Version of the contract.
    api_version: &'static str,
    /// Why there are no grasps; null if there are some.
    reason: Option<String>,
    /// What is odd about the clouds.
    warnings: Vec<String>,
}

/// The hand, its frame, and limits of a request.
#[derive(Debug, Serialize)]
pub(crate) struct ConfigAnswer {
    hand: String,
    model_name: &'static str,
    checkpoint: String,
    /// Null: parallel jaws have none.
    joint_names: Option<Vec<String>>,
    /// A grasp's origin: `tcp_between_fingertips`.
    grasp_reference: &'static str,
    default_num_grasps: usize,
    min_points: usize,
    max_points: usize,
    server_version: &'static str,
    backend: &'static str,
    api_version: &'static str,
    gripper: String,
    /// The name of the axes.
    grasp_frame: &'static str,
    grasp_frame_description: String,
    /// Where the hand goes, in the axes of a grasp.
    approach_axis_local: [f32; 3],
    /// Along which it closes.
    jaw_axis_local: [f32; 3],
    /// How far the origin was moved along the approach, in metres: not at all.
    tcp_offset: f32,
    /// How far the fingers open, in metres.
    gripper_max_width: f32,
    /// Where the tips end, from the origin along the approach, in metres: at it.
    fingertip_depth: f32,
    planner: &'static str,
    width_mode: &'static str,
    approach_axis_convention: &'static str,
    scene_points_mode: &'static str,
    supports_category_sampling: bool,
}

/// Versions.
#[derive(Debug, Serialize)]
pub(crate) struct VersionAnswer {
    server_version: &'static str,
    api_version: &'static str,
    backend: &'static str,
}

impl VersionAnswer {
    pub(super) const NOW: Self =
        Self { server_version: env!("CARGO_PKG_VERSION"), api_version: CONTRACT, backend: "graspmill" };
}

impl ConfigAnswer {
    pub(super) fn new(planner: &Planner, frame: GraspFrame) -> Self {
        let Gripper { name, opening_m_max, .. } = &planner.config.gripper;
        let frame_from_grasp = frame.grasp_from_frame().inverse();
        let [approach, jaw] = [Vec3::Z, Vec3::Y].map(|axis| (frame_from_grasp * axis).round().to_array());
        let named = |axis: [f32; 3]| ["x", "y", "z"][axis.iter().position(|along| *along != 0.0).unwrap_or(0)];
        Self {
            hand: name.clone(),
            model_name: planner.config.network.name(),
            checkpoint: planner.model_id.clone(),
            joint_names: None,
            grasp_reference: REFERENCE,
            default_num_grasps: GRASPS,
            min_points: POINTS_MIN,
            max_points: POINTS_MAX,
            server_version: VersionAnswer::NOW.server_version,
            backend: VersionAnswer::NOW.backend,
            api_version: CONTRACT,
            gripper: name.clone(),
            grasp_frame: frame.name(),
            grasp_frame_description: format!(
                "{} approaches, {} closes, origin midway between the finger tips' ends",
                named(approach),
                named(jaw)
            ),
            approach_axis_local: approach,
            jaw_axis_local: jaw,
            tcp_offset: 0.0,
            gripper_max_width: *opening_m_max,
            fingertip_depth: 0.0,
            planner: planner.config.network.name(),
            width_mode: "held",
            approach_axis_convention: "true_approach",
            scene_points_mode: "collision_filter",
            supports_category_sampling: false,
        }
    }
}

/// Parses a request, plans, and serialises the answer.
pub(super) fn predict_bytes(planner: &Planner, frame: GraspFrame, body: &[u8]) -> Result<Planned, Fault> {
    let started = Instant::now();
    let input = parse(body)?;
    let mut object_m = input.point_cloud.points("point_cloud")?;
    must_be_finite(&object_m, "point_cloud")?;
    if object_m.len() < POINTS_MIN {
        let got = object_m.len();
        return Err(geometry(format!("must have at least {POINTS_MIN} points, got {got}: point_cloud")));
    }
    let mut points_m = input.scene_points.as_ref().map_or(Ok(Vec::new()), |array| array.points("scene_points"))?;
    must_be_finite(&points_m, "scene_points")?;
    let counts = [object_m.len(), points_m.len()];
    if counts[0] + counts[1] > POINTS_MAX {
        let message = format!("must have at most {POINTS_MAX} points together, got {}", counts[0] + counts[1]);
        return Err(Fault::new(StatusCode::PAYLOAD_TOO_LARGE, format!("{message}: point_cloud, scene_points")));
    }
    if points_m.is_empty() {
        return Err(geometry("must show the table under the object, got no points: scene_points".to_owned()));
    }
    points_m.extend(&object_m);
    // The table is looked for as a camera at the origin sees it.
    let eye_m = input.eye_m.map_or(Ok(Vec3::ZERO), |at_m| vector(at_m, "eye_m"))?;
    object_m.iter_mut().chain(&mut points_m).for_each(|at_m| *at_m -= eye_m);
    let parsed_ms = started.elapsed().as_secs_f64() * 1e3;
    let options = PlanOptions {
        find_table: Some(FindTable { down: direction(input.down)?, base_from_camera: None }),
        limits: Limits { target: Some(Target::Points(object_m)), ..Limits::default() },
        ..PlanOptions::default()
    };
    let plan = planner.plan(&Observation::Cloud { points_m, eyes_m: vec![Vec3::ZERO] }, &options);
    let plan = plan.map_err(|error| geometry(format!("{error}: point_cloud, scene_points")))?;
    let server_timing = server_timing(std::iter::once(("parse", parsed_ms)).chain(plan.timings_ms.iter().copied()));
    let inference_ms = started.elapsed().as_secs_f64() * 1e3;
    let grasps = offered(&plan, &input, frame, eye_m);
    let meta = PredictMeta {
        hand: plan.gripper,
        model_name: planner.config.network.name(),
        checkpoint: plan.model,
        frame_id: "unchanged_from_input",
        num_input_points: counts[0],
        num_scene_points: counts[1],
        context_mode: "scene_collision_filtered",
        category_sampling: input.category_sampling,
        inference_ms,
        server_version: VersionAnswer::NOW.server_version,
        request_id: format!("{:012x}", fnv1a(body.iter().copied()) >> 16),
        backend: VersionAnswer::NOW.backend,
        api_version: CONTRACT,
        reason: plan.reason,
        warnings: plan.warnings,
    };
    let answer = PredictAnswer { grasps, meta };
    Ok(Planned { body: serde_json::to_vec(&answer).map_err(|_| Fault::internal())?, server_timing })
}

fn parse(body: &[u8]) -> Result<PredictInput, Fault> {
    let unfit = |message: String| Fault::coded(StatusCode::UNPROCESSABLE_ENTITY, "invalid_request", message);
    let mut source = serde_json::Deserializer::from_slice(body);
    let input: PredictInput = serde_path_to_error::deserialize(&mut source)
        .map_err(|error| unfit(format!("{}: {}", error.inner(), error.path())))?;
    source.end().map_err(|error| unfit(format!("not JSON: {error}")))?;
    if input.num_grasps == Some(0) {
        return Err(unfit("must be 1 or more, got 0: num_grasps".to_owned()));
    }
    Ok(input)
}

fn geometry(message: String) -> Fault {
    Fault::coded(StatusCode::UNPROCESSABLE_ENTITY, "invalid_geometry", message)
}

fn must_be_finite(points_m: &[Vec3], key: &str) -> Result<(), Fault> {
    match points_m.iter().position(|at_m| !at_m.is_finite()) {
        Some(row) => Err(geometry(format!("must be finite, got {}: {key}[{row}]", points_m[row]))),
        None => Ok(()),
    }
}

fn vector(given: [f64; 3], key: &str) -> Result<Vec3, Fault> {
    let vector = Vec3::from_array(given.map(|along| along as f32));
    if vector.is_finite() { Ok(vector) } else { Err(geometry(format!("must be finite, got {given:?}: {key}"))) }
}

fn direction(given: Option<[f64; 3]>) -> Result<Option<Vec3>, Fault> {
    let direction = given.map(|down| vector(down, "down")).transpose()?;
    match direction {
        Some(down) if down.length() < 1e-6 => Err(geometry(format!("must have a length, got {down}: down"))),
        direction => Ok(direction),
    }
}

impl ArrayInput {
    fn points(&self, key: &str) -> Result<Vec<Vec3>, Fault> {
        let bad = |code, message: String| Fault::coded(StatusCode::BAD_REQUEST, code, format!("{message}: {key}"));
        let size_bytes = match self.dtype.as_str() {
            "float32" => 4,
            "float64" => 8,
            _ => return Err(bad("bad_dtype", "dtype must be float32 or float64".to_owned())),
        };
        let bytes = STANDARD
            .decode(&self.data_b64)
            .map_err(|error| bad("bad_base64", format!("data_b64 must be base64 of the standard alphabet: {error}")))?;
        let values = self.shape.iter().try_fold(size_bytes, |count: u64, side| count.checked_mul(*side));
        if values != Some(bytes.len() as u64) {
            let (dtype, shape, got) = (&self.dtype, &self.shape, bytes.len());
            let message = format!("data_b64 must have the bytes of {dtype} of shape {shape:?}, got {got}");
            return Err(bad("shape_dtype_mismatch", message));
        }
        if !matches!(self.shape[..], [_, 3]) {
            return Err(bad("bad_shape", format!("shape must be [N, 3], got {:?}", self.shape)));
        }
        let number = |bytes: &[u8]| match bytes.try_into() {
            Ok(four) => f32::from_le_bytes(four),
            // A chunk has four bytes or eight.
            Err(_) => f64::from_le_bytes(bytes.try_into().unwrap_or_default()) as f32,
        };
        let numbers: Vec<f32> = bytes.chunks_exact(size_bytes as usize).map(number).collect();
        Ok(numbers.chunks_exact(3).map(Vec3::from_slice).collect())
    }
}

/// The grasps of a plan that a request wants, in the clouds' frame, best first.
fn offered(plan: &Plan, input: &PredictInput, frame: GraspFrame, eye_m: Vec3) -> Vec<PredictGrasp> {
    let min_score = input.min_score.unwrap_or(0.0) as f32;
    let grasp = |grasp: &RankedGrasp| {
        let mut cloud_from_grasp = grasp.camera_from_grasp?;
        cloud_from_grasp.translation += eye_m;
        Some(PredictGrasp::new(cloud_from_grasp, frame, grasp))
    };
    let mut grasps: Vec<PredictGrasp> = plan.grasps.iter().filter_map(grasp).collect();
    grasps.retain(|grasp| grasp.score >= min_score);
    grasps.sort_by(|a, b| b.score.total_cmp(&a.score));
    grasps.truncate(input.num_grasps.unwrap_or(GRASPS));
    grasps
}

impl PredictGrasp {
    fn new(cloud_from_grasp: Pose, frame: GraspFrame, grasp: &RankedGrasp) -> Self {
        let rotation = (cloud_from_grasp.rotation * frame.grasp_from_frame()).normalize();
        let rotation =
            if rotation.w < 0.0 { Quat::from_array(rotation.to_array().map(|part| -part)) } else { rotation };
        Self {
            translation: cloud_from_grasp.translation.to_array(),
            rotation_quat: rotation.to_array(),
            rotation_matrix: Mat3::from_quat(rotation).transpose().to_cols_array_2d(),
            score: grasp.quality,
            gripper_width: grasp.width_m,
            joint_angles: None,
            joint_names: None,
            approach_axis: (cloud_from_grasp.rotation * Vec3::Z).to_array(),
            object_id: 1,
        }
    }
}
