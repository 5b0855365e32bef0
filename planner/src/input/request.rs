//! The format of a request, in a file (TOML or JSON) or over HTTP (JSON). `assemble.rs` checks
//! and interprets it. A request is parsed in one pass that tracks the key's path for messages
//! and stores no more than these types can hold.

use std::fmt;
use std::path::Path;

use serde::de::value::MapAccessDeserializer;
use serde::de::{DeserializeOwned, IgnoredAny, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::error::Category;

use crate::Policy;
use crate::input::camera::{IntrinsicsInput, OrientationInput, PoseInput};
use crate::input::error::{InputError, shown};
use crate::input::file::read_file;
use crate::input::lists::{at_most, maybe_numbers, numbers, rows};

/// Maximum number of views of a request.
pub(crate) const VIEWS_MAX: usize = 32;
/// Maximum number of viewpoints of a cloud.
const EYES_MAX: usize = 32;
/// Maximum number of grasps to avoid, and of things.
const AVOID_MAX: usize = 256;
/// Maximum number of planes that keep the gripper out.
const KEEP_OUT_MAX: usize = 64;

/// A request for a plan: exactly one of `views`, `tsdf` and `cloud`, and options.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RequestInput {
    /// Depth images with their cameras, 1 to 32.
    #[serde(default, deserialize_with = "at_most::<_, _, VIEWS_MAX>")]
    pub views: Option<Vec<ViewInput>>,
    /// The intrinsics of all views without their own.
    pub intrinsics: Option<IntrinsicsInput>,
    /// A TSDF instead: an NPY file of shape [40, 40, 40] or [1, 40, 40, 40] in VGN's values, 0 to 1; of another
    /// workspace as many voxels as it has.
    pub tsdf: Option<SourceInput>,
    /// A point cloud instead: an NPY file of shape [N, 3] or [H, W, 3], in metres.
    pub cloud: Option<SourceInput>,
    /// What to grasp: a cloud of the one object, in the frame of `cloud`, which has the rest of the scene and may have
    /// the object, too.
    pub object: Option<SourceInput>,
    /// The cloud's frame in the workspace, by default the same. Or `"table"`: the cloud is in the optical frame of
    /// its camera, the table is found in it, and the workspace put on it.
    pub workspace_from_cloud: Option<PoseInput>,
    /// The direction of gravity, of any length, in the frame of the first camera or of the cloud, to find the table;
    /// by default the camera is believed to stand upright and to look down.
    #[serde(default, deserialize_with = "maybe_numbers")]
    pub down: Option<[f64; 3]>,
    /// The first camera, or that of the cloud, in the robot's base frame, where the table is found: grasps are given
    /// in the base's frame, too, and gravity is along its -z unless `down` is given.
    pub base_from_camera: Option<PoseInput>,
    /// Positions of the sensors that saw the cloud, at most 32; by default the origin of its own frame, or straight
    /// above.
    #[serde(default, deserialize_with = "rows::<_, 3, EYES_MAX>")]
    pub eyes_m: Option<Vec<[f64; 3]>>,
    /// Side of the workspace, in metres, 0.2 to 1.2. By default networks of voxels look at 0.3 m, and a judge at all
    /// that was seen within the reach of its settings.
    pub workspace_size_m: Option<f64>,
    /// The workspace in the robot's base frame: grasps are given there, too.
    pub base_from_workspace: Option<PoseInput>,
    /// The wrist's orientation now, in the workspace: of a grasp and its half turn the nearer one is given.
    pub workspace_from_wrist: Option<OrientationInput>,
    /// The order of the grasps: `paper`, `vgn-random` or `vgn-best`.
    pub policy: Option<Policy>,
    /// Whether grasps that collide with the cloud are dropped.
    pub check_collisions: Option<bool>,
    /// Maximum number of grasps, 1 to 10000.
    pub grasps_max: Option<usize>,
    /// Whether the best grasp of each object comes first, then the others; more is asked about objects without one.
    pub each: Option<bool>,
    /// Whether to list dropped candidates with reasons.
    pub explain: Option<bool>,
    /// The best grasp of the last plan, given as in `avoid`: of grasps whose qualities are within 0.05 of the best
    /// one's the nearest to it comes first, so that a plan for each image stays where it was.
    pub previous: Option<PoseInput>,
    /// Grasps that failed, at most 256: the `workspace_from_grasp` of grasps of earlier plans or, where the table is
    /// found, their `camera_from_grasp`. No grasp is offered whose tips are within 10 mm and whose axes are within
    /// 30° of one of them.
    #[serde(default, deserialize_with = "at_most::<_, _, AVOID_MAX>")]
    pub avoid: Option<Vec<PoseInput>>,
    /// Things to be left for now, at most 256: no grasp is offered whose tips are within a radius of a point, given as
    /// x, y, z, radius in metres, in the workspace or, where the table is found, in the first camera's frame.
    #[serde(default, deserialize_with = "rows::<_, 4, AVOID_MAX>")]
    pub avoid_objects: Option<Vec<[f64; 4]>>,
    /// Only grasps of the object at this point of the workspace, in metres: of the cluster of the seen surface that is
    /// nearest to it, and within 50 mm. For single objects in a heap give masks.
    #[serde(default, deserialize_with = "maybe_numbers")]
    pub target_m: Option<[f64; 3]>,
    /// Only grasps that approach within an angle of a direction.
    pub approach: Option<ConeInput>,
    /// Planes that the open gripper does not cross on its way, at most 64: each a normal x, y, z, which points to
    /// where the gripper may be, and its offset in metres, in the workspace. The gripper stays where
    /// normal · x ≥ offset.
    #[serde(default, deserialize_with = "rows::<_, 4, KEEP_OUT_MAX>")]
    pub keep_out: Option<Vec<[f64; 4]>>,
    /// Only grasps whose tips are within this box of the workspace.
    pub reach: Option<BoxInput>,
}

/// Directions about one, in the workspace.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConeInput {
    /// The direction: x, y, z of any length; straight down is 0, 0, -1.
    #[serde(deserialize_with = "numbers")]
    pub direction: [f64; 3],
    /// Largest angle from it, in radians, 0 to π.
    pub angle_rad_max: f64,
}

/// A box along the axes of the workspace.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoxInput {
    /// The lower corner: x, y, z in metres.
    #[serde(deserialize_with = "numbers")]
    pub low_m: [f64; 3],
    /// The upper corner.
    #[serde(deserialize_with = "numbers")]
    pub high_m: [f64; 3],
}

/// A depth image and the camera that took it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ViewInput {
    /// The image: a grey PNG of 16 bits or an NPY file.
    pub depth: SourceInput,
    /// What to grasp: a grey PNG or an NPY file (bool or uint8) of the image's size, not 0 where the target is.
    pub mask: Option<SourceInput>,
    /// Metres per stored unit; by default integers are millimetres and floats metres.
    pub depth_scale_m: Option<f64>,
    /// The camera's intrinsics; by default those of the request.
    pub intrinsics: Option<IntrinsicsInput>,
    /// The camera in the workspace: x right, y down, z forward. Or, of the first view, `"table"`: the table is found
    /// in what the cameras see, and the workspace put on it.
    pub workspace_from_camera: Option<PoseInput>,
    /// Its inverse instead, the workspace in the camera's frame: extrinsics as OpenCV has them.
    pub camera_from_workspace: Option<PoseInput>,
    /// The camera in the robot's base frame instead; needs the request's `base_from_workspace`.
    pub base_from_camera: Option<PoseInput>,
    /// Its inverse instead, the robot's base in the camera's frame; needs `base_from_workspace`, too.
    pub camera_from_base: Option<PoseInput>,
    /// The camera in the frame of the first view's camera instead.
    pub first_from_camera: Option<PoseInput>,
}

/// The bytes of a file.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DataInput {
    /// The file in base64 (standard alphabet, padded).
    pub data: String,
}

/// A file, given by its bytes or, only in request files, by its path.
#[derive(Debug, Clone, PartialEq)]
pub enum SourceInput {
    /// A path relative to the request's folder.
    Path(String),
    /// The bytes.
    Data(DataInput),
}

impl<'de> Deserialize<'de> for SourceInput {
    fn deserialize<D: Deserializer<'de>>(source: D) -> Result<Self, D::Error> {
        source.deserialize_any(SourceVisitor)
    }
}

struct SourceVisitor;

impl<'de> Visitor<'de> for SourceVisitor {
    type Value = SourceInput;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a path, or { data } with base64")
    }

    fn visit_str<E: serde::de::Error>(self, path: &str) -> Result<SourceInput, E> {
        Ok(SourceInput::Path(path.to_owned()))
    }

    fn visit_map<A: MapAccess<'de>>(self, data: A) -> Result<SourceInput, A::Error> {
        DataInput::deserialize(MapAccessDeserializer::new(data)).map(SourceInput::Data)
    }
}

/// A request from a file, TOML or JSON, with only keys and types checked.
///
/// # Errors
/// [`InputError`], naming the key and the file.
pub(crate) fn parse_file(path: &Path) -> Result<RequestInput, InputError> {
    let bytes = read_file(path)?;
    let is_json = path.extension().is_some_and(|it| it == "json") || bytes.trim_ascii_start().starts_with(b"{");
    let input = if is_json { parse_json(&bytes) } else { parse_toml(&bytes) };
    input.map_err(|error| error.at(&path.display().to_string()))
}

/// What JSON says, with only keys and types checked.
pub(crate) fn parse_json<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, InputError> {
    let text = std::str::from_utf8(bytes).map_err(|_| InputError::Syntax("not JSON: it is not UTF-8".to_owned()))?;
    let mut source = serde_json::Deserializer::from_str(text);
    let input = serde_path_to_error::deserialize(&mut source);
    let input = input.map_err(|error| unfit_json(text, error.inner(), error.path()))?;
    source.end().map_err(|error| not_json(&error))?;
    Ok(input)
}

fn not_json(error: &serde_json::Error) -> InputError {
    InputError::Syntax(format!("not JSON: {}", shown(&error.to_string())))
}

/// The error of a text that is not a request, with its place.
fn unfit_json(text: &str, error: &serde_json::Error, path: &serde_path_to_error::Path) -> InputError {
    // The parser reports numbers out of range and too long lists as syntax errors. A second pass, which takes no
    // memory, determines whether the text is JSON.
    if error.classify() != Category::Data && serde_json::from_str::<IgnoredAny>(text).is_err() {
        return not_json(error);
    }
    let message = error.to_string();
    let position = format!(" at line {} column {}", error.line(), error.column());
    unfit(message.strip_suffix(&position).unwrap_or(&message), path)
}

pub(crate) fn parse_toml(bytes: &[u8]) -> Result<RequestInput, InputError> {
    let text = std::str::from_utf8(bytes).map_err(|_| InputError::Syntax("not TOML: it is not UTF-8".to_owned()))?;
    let not_toml = |error: toml::de::Error| InputError::Syntax(format!("not TOML: {}", shown(error.message())));
    let source = toml::Deserializer::parse(text).map_err(not_toml)?;
    serde_path_to_error::deserialize(source).map_err(|error| unfit(error.inner().message(), error.path()))
}

/// The error of a key; the key itself is outside text, too.
fn unfit(what: &str, path: &serde_path_to_error::Path) -> InputError {
    let is_whole = path.iter().next().is_none();
    let what = shown(what);
    InputError::Value(if is_whole { what } else { format!("{what}: {}", shown(&path.to_string())) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_has_the_place_of_an_error_and_nothing_else_of_the_text() {
        let message = |text: &str| parse_json::<RequestInput>(text.as_bytes()).unwrap_err().to_string();
        let misplaced = message("{\"views\": [{\"depth\": \"a\"},\n{\"depth\": {\"data\": 7}}]}");
        assert_eq!(misplaced, "invalid type: integer `7`, expected a string: views[1].depth.data");
        assert!(message("7").starts_with("invalid type: integer `7`") && !message("7").contains("line"));
        assert!(message("{\"views\": [").starts_with("not JSON: EOF") && message("{} {}").contains("line 1 column 4"));
        assert_eq!(message("{\"intrinsics\": {\"fx_px\": 1e999}}"), "number out of range: intrinsics.fx_px");
        let long = message(&format!("{{\"{}\": 0}}", "x".repeat(10_000)));
        assert!(long.starts_with("unknown field `xxx") && long.len() < 1000, "{long}");
        let toml =
            parse_toml(b"[[views]]\ndepth = \"a\"\nworkspace_from_camera = [[1, 0, 0]]").unwrap_err().to_string();
        assert_eq!(toml, "must have 4 numbers, got 3: views[0].workspace_from_camera[0]");
    }
}
