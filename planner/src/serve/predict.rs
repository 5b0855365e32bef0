//! `POST /predict`, version 0.1.0, as the servers of GraspGen-X and DexGraspNet 2 answer it: an object's cloud and the
//! rest of the scene in any one frame, and grasps in the same. Clients of theirs work unchanged.
//!
//! The table is found in the clouds; without `scene_points` the object floats. Two keys more than the contract's say
//! where gravity points and where the camera is, for clouds that are not in a camera's frame. (Other servers leave out
//! keys that they do not know, and so does this one.)

use std::time::Instant;

use axum::http::StatusCode;
use schema::{Gripper, Mat3, Pose, Quat, Vec3};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::fault::Fault;
use super::model::written;
use super::options::GraspFrame;
use super::planning::Planned;
use crate::input::{InputError, RequestInput, decode_base64, each, options, parse_json, point};
use crate::plan::RankedGrasp;
use crate::planner::fnv1a;
use crate::timing::ms_since;
use crate::{Observation, PlanOptions, Planner, Target};

/// Version of the contract.
const CONTRACT: &str = "0.1.0";
/// The server and its version.
const BACKEND: &str = "graspmill";
const SERVER: &str = env!("CARGO_PKG_VERSION");
/// Fewest points of an object.
const POINTS_MIN: usize = 32;
/// Most points of a request.
const POINTS_MAX: usize = 1_000_000;
/// Farthest of an object and of the camera from the origin along an axis, in metres: single precision has steps of 8 µm
/// there, and of 1 mm at 10 km.
const FAR_M: f32 = 100.0;
/// Most grasps if a request does not say how many.
const GRASPS: usize = 20;

/// A request of `/predict`. Keys that it does not have are left out of account.
#[derive(Debug, Deserialize)]
struct PredictInput {
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
struct ArrayInput {
    /// `float32` or `float64`.
    dtype: String,
    /// Its shape.
    shape: Vec<u64>,
    /// Its bytes in base64 (standard alphabet, padded).
    data_b64: String,
}

/// An answer of `/predict`.
#[derive(Debug, Serialize)]
struct PredictAnswer {
    /// The best first.
    grasps: Vec<PredictGrasp>,
    meta: Value,
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
    joint_angles: (),
    joint_names: (),
    /// Where the gripper goes, a unit vector.
    approach_axis: [f32; 3],
    /// 1: the object.
    object_id: u32,
}

/// Versions: `GET /version`.
pub(super) fn version() -> Value {
    json!({ "server_version": SERVER, "api_version": CONTRACT, "backend": BACKEND })
}

/// What a client must know: the gripper, its frame and the limits of a request: `GET /config`.
pub(super) fn config(planner: &Planner, frame: GraspFrame) -> Value {
    let Gripper { name, opening_m_max, .. } = &planner.config.gripper;
    let frame_from_grasp = frame.grasp_from_frame().inverse();
    let [approach, jaw] = [Vec3::Z, Vec3::Y].map(|axis| (frame_from_grasp * axis).round().to_array());
    let [approaches, closes] =
        [approach, jaw].map(|axis| ["x", "y", "z"][axis.iter().position(|along| *along != 0.0).unwrap_or(0)]);
    let described = format!("{approaches} approaches, {closes} closes, origin midway between the finger tips' ends");
    json!({
        "hand": name, "gripper": name, "gripper_max_width": written(opening_m_max), "joint_names": null,
        "model_name": planner.config.network.name(), "planner": planner.config.network.name(),
        "checkpoint": planner.model_id, "server_version": SERVER, "backend": BACKEND, "api_version": CONTRACT,
        "default_num_grasps": GRASPS, "min_points": POINTS_MIN, "max_points": POINTS_MAX,
        "grasp_frame": frame.name(), "grasp_frame_description": described,
        "approach_axis_local": approach, "jaw_axis_local": jaw, "approach_axis_convention": "true_approach",
        // The origin is where the tips end, and was not moved along the approach.
        "grasp_reference": "tcp_between_fingertips", "fingertip_depth": 0.0, "tcp_offset": 0.0,
        "width_mode": "held", "scene_points_mode": "collision_filter", "supports_category_sampling": false,
    })
}

/// Parses a request, plans, and serialises the answer.
pub(super) fn predict_bytes(planner: &Planner, frame: GraspFrame, body: &[u8]) -> Result<Planned, Fault> {
    let started = Instant::now();
    let unfit = |message: String| Fault::coded(StatusCode::UNPROCESSABLE_ENTITY, "invalid_request", message);
    let input: PredictInput = parse_json(body).map_err(|error| unfit(error.to_string()))?;
    if input.num_grasps == Some(0) {
        return Err(unfit("must be 1 or more, got 0: num_grasps".to_owned()));
    }
    let mut object_m = input.point_cloud.points("point_cloud")?;
    if object_m.len() < POINTS_MIN {
        let got = object_m.len();
        return Err(geometry(format!("must have at least {POINTS_MIN} points, got {got}: point_cloud")));
    }
    let mut points_m = input.scene_points.as_ref().map_or(Ok(Vec::new()), |array| array.points("scene_points"))?;
    let counts = [object_m.len(), points_m.len()];
    if counts[0] + counts[1] > POINTS_MAX {
        let message = format!("must have at most {POINTS_MAX} points together, got {}", counts[0] + counts[1]);
        return Err(Fault::new(StatusCode::PAYLOAD_TOO_LARGE, format!("{message}: point_cloud, scene_points")));
    }
    points_m.extend(&object_m);
    let of_input = |error: InputError| geometry(error.to_string());
    // The table is looked for as a camera at the origin sees it.
    let eye_m = input.eye_m.map_or(Ok(Vec3::ZERO), |at_m| point(at_m, "eye_m")).map_err(of_input)?;
    let is_far = |at_m: &&Vec3| at_m.abs().max_element() > FAR_M;
    if let Some(far_m) = object_m.iter().chain([&eye_m]).find(is_far) {
        return Err(geometry(format!("must be within {FAR_M} m of the origin, got {far_m}: point_cloud, eye_m")));
    }
    object_m.iter_mut().chain(&mut points_m).for_each(|at_m| *at_m -= eye_m);
    let wanted = RequestInput { down: input.down, ..RequestInput::default() };
    let mut wanted: PlanOptions = options(&wanted, true).map_err(of_input)?;
    wanted.limits.target = Some(Target::Points(object_m));
    let parse_ms = ms_since(started);
    let plan = planner.plan(&Observation::Cloud { points_m, eyes_m: vec![Vec3::ZERO] }, &wanted);
    let plan = plan.map_err(|error| geometry(format!("{error}: point_cloud, scene_points")))?;
    let meta = json!({
        "hand": plan.gripper, "model_name": planner.config.network.name(), "checkpoint": plan.model,
        "frame_id": "unchanged_from_input", "context_mode": "scene_collision_filtered",
        "num_input_points": counts[0], "num_scene_points": counts[1], "category_sampling": input.category_sampling,
        "inference_ms": ms_since(started), "server_version": SERVER, "backend": BACKEND, "api_version": CONTRACT,
        // A number of the request's bytes: equal requests have the same.
        "request_id": format!("{:012x}", fnv1a(body.iter().copied()) >> 16),
        "reason": plan.reason, "warnings": plan.warnings,
    });
    let grasps = plan.grasps.iter().filter_map(|grasp| PredictGrasp::new(grasp, frame, eye_m));
    let mut grasps: Vec<PredictGrasp> =
        grasps.filter(|grasp| grasp.score >= input.min_score.unwrap_or(0.0) as f32).collect();
    grasps.sort_by(|a, b| b.score.total_cmp(&a.score));
    grasps.truncate(input.num_grasps.unwrap_or(GRASPS));
    Planned::new(&PredictAnswer { grasps, meta }, parse_ms, &plan.timings_ms)
}

fn geometry(message: String) -> Fault {
    Fault::coded(StatusCode::UNPROCESSABLE_ENTITY, "invalid_geometry", message)
}

impl ArrayInput {
    fn points(&self, key: &str) -> Result<Vec<Vec3>, Fault> {
        let bad = |code, message: String| Fault::coded(StatusCode::BAD_REQUEST, code, format!("{message}: {key}"));
        let size_bytes: u64 = match self.dtype.as_str() {
            "float32" => 4,
            "float64" => 8,
            _ => return Err(bad("bad_dtype", "dtype must be float32 or float64".to_owned())),
        };
        let bytes = decode_base64(&self.data_b64)
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
        let values: Vec<f32> = match size_bytes {
            4 => each(&bytes, f32::from_le_bytes),
            _ => each(&bytes, |eight| f64::from_le_bytes(eight) as f32),
        };
        let points_m: Vec<Vec3> = values.chunks_exact(3).map(Vec3::from_slice).collect();
        match points_m.iter().position(|at_m| !at_m.is_finite()) {
            Some(row) => Err(geometry(format!("must be finite, got {}: {key}[{row}]", points_m[row]))),
            None => Ok(points_m),
        }
    }
}

impl PredictGrasp {
    /// A grasp of a plan in the clouds' frame, in which the camera is at `eye_m`.
    fn new(grasp: &RankedGrasp, frame: GraspFrame, eye_m: Vec3) -> Option<Self> {
        let Pose { rotation: grasp_rotation, translation, .. } = grasp.camera_from_grasp?;
        let rotation = (grasp_rotation * frame.grasp_from_frame()).normalize();
        let rotation =
            if rotation.w < 0.0 { Quat::from_array(rotation.to_array().map(|part| -part)) } else { rotation };
        Some(Self {
            translation: (translation + eye_m).to_array(),
            rotation_quat: rotation.to_array(),
            rotation_matrix: Mat3::from_quat(rotation).transpose().to_cols_array_2d(),
            score: grasp.quality,
            gripper_width: grasp.width_m,
            joint_angles: (),
            joint_names: (),
            approach_axis: (grasp_rotation * Vec3::Z).to_array(),
            object_id: 1,
        })
    }
}
