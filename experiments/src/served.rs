//! Anyone's planner behind an address, as GraspGen-X's and DexGraspNet 2's servers have it: `POST /predict`, contract
//! 0.1.0. It is asked about one object after the other, as these planners are used, with the true segmentation.
//!
//! The contract's answers say nothing of the fingers, so the server's `/config`, or the caller, says where their tips
//! are. Nothing that a server does ends the run: each failure is the end of a round.

use std::fmt::Write as _;
use std::time::Duration;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use planner::View;
use planner::hand::are_alike;
use program::{Context as _, ExitCode, Failure};
use reqwest::{Client, Response, StatusCode, Url};
use schema::{Mat3, Pose, Quat, Vec3, pose_from_parts};
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::runtime::{Builder, Runtime};

use crate::files::sha256;
use crate::offer::{Look, NoPlan, Offer, Plans};

/// Most grasps of an object that are asked for.
const GRASPS: usize = 100;
/// Most points of a request, whatever a server takes: what the contract's servers take if they do not say otherwise.
const POINTS_MAX: usize = 65_536;
/// Fewest points of an object that is asked about, if a server does not say.
const POINTS_MIN: usize = 128;
/// Longest answer.
const ANSWER_BYTES_MAX: usize = 64 << 20;
/// A rotation's rows are orthonormal but for this.
const RIGID: f32 = 0.01;

/// What a caller knows of a server.
#[derive(Debug, Clone)]
pub struct Server {
    /// The address of its `/predict`.
    pub url: String,
    /// Longest wait for an answer.
    pub patience: Duration,
    /// From a grasp's origin along its approach to the end of the finger tips, in metres; by default what `/config`
    /// says.
    pub tip_depth_m: Option<f32>,
}

/// A planner behind an address.
#[derive(Debug)]
pub struct Served {
    url: Url,
    client: Client,
    runtime: Runtime,
    id: String,
    /// Our axes and origin in those of its grasps.
    theirs_from_ours: Pose,
    points: [usize; 2],
}

/// What `/config` says. Keys that are left out are those of DexGraspNet 2's server.
#[derive(Debug, Default, Deserialize)]
struct About {
    approach_axis_local: Option<[f32; 3]>,
    jaw_axis_local: Option<[f32; 3]>,
    fingertip_depth: Option<f32>,
    tcp_offset: Option<f32>,
    min_points: Option<usize>,
    max_points: Option<usize>,
}

#[derive(Debug, Deserialize)]
struct Answer {
    grasps: Vec<Grasp>,
}

#[derive(Debug, Deserialize)]
struct Grasp {
    translation: [f32; 3],
    rotation_matrix: [[f32; 3]; 3],
    score: f32,
    gripper_width: Option<f32>,
}

impl Served {
    /// Asks a server what it is.
    ///
    /// # Errors
    /// If it does not answer, or neither it nor the caller says where the finger tips are.
    pub fn connect(server: &Server) -> Result<Self, Failure> {
        let wrong = |why: String| Failure::new(ExitCode::Config, format!("--planner {}: {why}", server.url));
        let url = Url::parse(&server.url).map_err(|error| wrong(format!("must be an address: {error}")))?;
        if !["http", "https"].contains(&url.scheme()) {
            return Err(wrong("must begin with http:// or https://".to_owned()));
        }
        // reqwest is built without a default TLS provider; an already installed one is fine.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let client = Client::builder().timeout(server.patience).build().map_err(|error| wrong(chain(&error)))?;
        let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build();
        let runtime = runtime.context("failed to start the client's thread")?;
        let config = url.join("config").map_err(|error| wrong(error.to_string()))?;
        let told = runtime.block_on(async {
            let answer = client.get(config).send().await.map_err(|error| chain(&error))?;
            if answer.status() == StatusCode::NOT_FOUND { Ok(b"{}".to_vec()) } else { body(answer).await }
        });
        let silent =
            |why: String| Failure::new(ExitCode::TryAgain, format!("--planner {}: {why}: /config", server.url));
        let told = told.map_err(silent)?;
        let odd = |error: serde_json::Error| wrong(format!("/config must be JSON as the contract has it: {error}"));
        let about: About = serde_json::from_slice(&told).map_err(odd)?;
        let depth_m = about.fingertip_depth.map(|depth_m| depth_m - about.tcp_offset.unwrap_or(0.0));
        let tip_depth_m = server.tip_depth_m.or(depth_m).ok_or_else(|| {
            wrong("its /config does not say where the finger tips are (fingertip_depth): give --tip-depth".to_owned())
        })?;
        let theirs_from_ours = theirs_from_ours(&about, tip_depth_m).ok_or_else(|| {
            wrong("/config must have unit axes at right angles: approach_axis_local, jaw_axis_local".to_owned())
        })?;
        Ok(Self {
            url,
            client,
            runtime,
            id: format!("served-{}", sha256([&told[..], &tip_depth_m.to_le_bytes()].concat())),
            theirs_from_ours,
            points: [about.min_points.unwrap_or(POINTS_MIN), about.max_points.unwrap_or(POINTS_MAX).min(POINTS_MAX)],
        })
    }

    fn ask(&self, request: &Value) -> Result<Vec<Grasp>, String> {
        let text = request.to_string();
        self.runtime.block_on(async {
            let post = self.client.post(self.url.clone()).header("content-type", "application/json").body(text);
            let answer = body(post.send().await.map_err(|error| chain(&error))?).await?;
            let answer: Answer = serde_json::from_slice(&answer)
                .map_err(|error| format!("an answer must be the contract's: {error}"))?;
            Ok(answer.grasps)
        })
    }

    /// A grasp in the workspace, if it makes sense.
    fn offer(&self, workspace_from_cloud: &Pose, grasp: &Grasp, opening_m: f32) -> Result<Offer, String> {
        let rows = grasp.rotation_matrix.map(Vec3::from_array);
        let is_unit = |at: usize| (rows[at].length() - 1.0).abs() < RIGID;
        let is_right = |at: usize| rows[at].dot(rows[(at + 1) % 3]).abs() < RIGID;
        let is_rigid = (0..3).all(|at| is_unit(at) && is_right(at)) && rows[0].cross(rows[1]).dot(rows[2]) > 0.0;
        let at_m = Vec3::from_array(grasp.translation);
        let width_m = grasp.gripper_width.unwrap_or(opening_m);
        if !is_rigid || !at_m.is_finite() || !grasp.score.is_finite() || !width_m.is_finite() {
            return Err(format!("a grasp must have a rotation and finite numbers, got {grasp:?}"));
        }
        let rotation = Quat::from_mat3(&Mat3::from_cols(rows[0], rows[1], rows[2]).transpose()).normalize();
        let theirs = pose_from_parts(rotation, at_m);
        let workspace_from_grasp = *workspace_from_cloud * theirs * self.theirs_from_ours;
        Ok(Offer { workspace_from_grasp, width_m, quality: grasp.score, rho_m: None })
    }
}

impl Plans for Served {
    fn id(&self) -> String {
        self.id.clone()
    }

    fn plan(&self, look: Look<'_>) -> Result<Vec<Offer>, NoPlan> {
        let workspace_from_cloud = look.workspace_from_first().unwrap_or(Pose::IDENTITY);
        let cloud_from_workspace = workspace_from_cloud.inverse();
        let (objects_m, rest_m) = clouds(&look, &cloud_from_workspace);
        let opening_m = look.config.plan.gripper.opening_m_max;
        let mut offers = Vec::new();
        let eye = look.views.first().map(|view| view.camera.workspace_from_camera.translation);
        for (object, object_m) in objects_m.iter().enumerate() {
            if object_m.len() < self.points[0] {
                continue;
            }
            let others = objects_m.iter().enumerate().filter(|(other, _)| *other != object);
            let scene_m: Vec<Vec3> = others.flat_map(|(_, points_m)| points_m).chain(&rest_m).copied().collect();
            let thing_m = thinned(object_m, self.points[1] / 2);
            let request = json!({
                "point_cloud": encoded(&thing_m),
                "scene_points": encoded(&thinned(&scene_m, self.points[1].saturating_sub(thing_m.len()))),
                "num_grasps": GRASPS,
                "down": (cloud_from_workspace.rotation * Vec3::NEG_Z).to_array(),
                "eye_m": eye.map(|at_m| (cloud_from_workspace * at_m).to_array()),
            });
            let grasps = self.ask(&request).map_err(NoPlan::NoAnswer)?;
            for grasp in &grasps {
                offers.push(self.offer(&workspace_from_cloud, grasp, opening_m).map_err(NoPlan::NoAnswer)?);
            }
        }
        let is_new = |offer: &Offer| !look.failed.iter().any(|failed| are_alike(failed, &offer.workspace_from_grasp));
        offers.retain(is_new);
        offers.sort_by(|a, b| b.quality.total_cmp(&a.quality));
        Ok(offers)
    }
}

/// Our axes (z approaches, y closes) and our origin at the tips in a server's.
fn theirs_from_ours(about: &About, tip_depth_m: f32) -> Option<Pose> {
    let approach = Vec3::from_array(about.approach_axis_local.unwrap_or([1.0, 0.0, 0.0]));
    let jaw = Vec3::from_array(about.jaw_axis_local.unwrap_or([0.0, 1.0, 0.0]));
    let is_unit = |axis: Vec3| (axis.length() - 1.0).abs() < RIGID;
    (is_unit(approach) && is_unit(jaw) && approach.dot(jaw).abs() < RIGID).then(|| {
        let rotation = Quat::from_mat3(&Mat3::from_cols(jaw.cross(approach), jaw, approach)).normalize();
        pose_from_parts(rotation, approach * tip_depth_m)
    })
}

/// Of each object the points that the views show, and everything else, in the clouds' frame.
fn clouds(look: &Look<'_>, cloud_from_workspace: &Pose) -> (Vec<Vec<Vec3>>, Vec<Vec3>) {
    let (mut objects_m, mut rest_m) = (vec![Vec::new(); look.scene.objects.len()], Vec::new());
    for (View { image, camera, .. }, shown) in look.views.iter().zip(look.shown()) {
        let cloud_from_camera = *cloud_from_workspace * camera.workspace_from_camera;
        for (pixel, (depth_m, shown)) in image.depth_m.iter().zip(shown).enumerate() {
            if !(depth_m.is_finite() && *depth_m > 0.0) {
                continue;
            }
            let ray = camera.intrinsics.ray([pixel % image.width_px, pixel / image.width_px]);
            let at_m = cloud_from_camera * (ray * *depth_m);
            match shown {
                Some(object) => objects_m[object].push(at_m),
                None => rest_m.push(at_m),
            }
        }
    }
    (objects_m, rest_m)
}

/// Every so-manieth point, so that there are no more than that many.
fn thinned(points_m: &[Vec3], count_max: usize) -> Vec<Vec3> {
    points_m.iter().step_by(points_m.len().div_ceil(count_max.max(1)).max(1)).copied().collect()
}

fn encoded(points_m: &[Vec3]) -> Value {
    let bytes: Vec<u8> = points_m.iter().flat_map(|at_m| at_m.to_array()).flat_map(f32::to_le_bytes).collect();
    json!({ "dtype": "float32", "shape": [points_m.len(), 3], "data_b64": STANDARD.encode(bytes) })
}

/// The body of an answer.
async fn body(mut answer: Response) -> Result<Vec<u8>, String> {
    let status = answer.status();
    let mut bytes = Vec::new();
    while let Some(chunk) = answer.chunk().await.map_err(|error| chain(&error))? {
        if bytes.len() + chunk.len() > ANSWER_BYTES_MAX {
            return Err(format!("an answer must have at most {ANSWER_BYTES_MAX} bytes"));
        }
        bytes.extend_from_slice(&chunk);
    }
    if status.is_success() {
        return Ok(bytes);
    }
    let said: String =
        String::from_utf8_lossy(&bytes).chars().filter(|letter| !letter.is_control()).take(300).collect();
    Err(format!("status {}: {said}", status.as_u16()))
}

/// An error with its causes; addresses are known anyway.
fn chain(error: &reqwest::Error) -> String {
    let mut text = if error.is_timeout() { "no answer in time".to_owned() } else { error.to_string() };
    let mut cause = std::error::Error::source(error);
    while let Some(inner) = cause {
        // Writing to a string does not fail.
        let _ = write!(text, ": {inner}");
        cause = inner.source();
    }
    text
}
