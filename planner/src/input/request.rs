//! The description of what a robot saw and wants, as it is written in a file (TOML or JSON) or sent over HTTP (JSON).
//! These types are what the API's description shows; what they mean is `assemble.rs`'s business. A typed parser tells
//! what is wrong but not where, so a request that fails it is looked through once more, key by key, to name the place.

use std::fmt;
use std::path::Path;

use schema::Grid;
use serde::de::value::MapAccessDeserializer;
use serde::de::{DeserializeOwned, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::Value;
use utoipa::ToSchema;
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{ArrayBuilder, ArrayItems, Schema};

use crate::input::assemble::{Request, assemble};
use crate::input::camera::{IntrinsicsInput, OrientationInput, PoseInput, position_schema};
use crate::input::error::{InputError, shown};
use crate::input::file::read_file;

/// A request for a plan: exactly one of `views`, `tsdf` and `cloud`, and what the caller wishes.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RequestInput {
    /// Depth images with their cameras, 1 to 32.
    pub views: Option<Vec<ViewInput>>,
    /// The lens of all views that name none.
    pub intrinsics: Option<IntrinsicsInput>,
    /// A TSDF instead: an NPY file of shape [40, 40, 40] or [1, 40, 40, 40] in VGN's values, 0 to 1.
    #[schema(value_type = Option<DataInput>)]
    pub tsdf: Option<SourceInput>,
    /// A point cloud in the workspace frame instead: a PLY, PCD or NPY file, in metres.
    #[schema(value_type = Option<DataInput>)]
    pub cloud: Option<SourceInput>,
    /// Where the sensors stood that saw the cloud; without it, a PCD file's viewpoint counts.
    #[schema(schema_with = eyes_schema)]
    pub eyes_m: Option<Vec<Vec<f64>>>,
    /// The workspace in the robot's base frame: grasps are given there, too.
    pub base_from_workspace: Option<PoseInput>,
    /// The wrist's orientation now, in the workspace: of a grasp and its half turn the nearer one is given.
    pub workspace_from_wrist: Option<OrientationInput>,
    /// How grasps are ranked: `paper`, `vgn-random` or `vgn-best`.
    pub policy: Option<String>,
    /// Whether grasps whose hand would hit the cloud are dropped.
    pub check_collisions: Option<bool>,
    /// Most grasps that are given, 1 to 10000.
    pub grasps_max: Option<usize>,
    /// Whether to tell why candidates were dropped.
    pub explain: Option<bool>,
}

/// A depth image and the camera that took it.
#[derive(Debug, Clone, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ViewInput {
    /// The image: a grey PNG of 16 bits, an NPY or an EXR file.
    #[schema(value_type = DataInput)]
    pub depth: SourceInput,
    /// Metres per stored unit; without it whole numbers are millimetres, others metres.
    pub depth_scale_m: Option<f64>,
    /// The camera's lens; without it, that of the request.
    pub intrinsics: Option<IntrinsicsInput>,
    /// The camera in the workspace: x right, y down, z forward.
    pub workspace_from_camera: Option<PoseInput>,
    /// The camera in the robot's base frame instead; needs the request's `base_from_workspace`.
    pub base_from_camera: Option<PoseInput>,
}

/// The bytes of a file.
#[derive(Debug, Clone, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct DataInput {
    /// The file in base64 (standard alphabet, padded).
    pub data: String,
}

/// A file: by its path, which only a request in a file may give, or by its bytes.
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

fn eyes_schema() -> RefOr<Schema> {
    let what = "Where the sensors stood that saw the cloud, in metres; without it, a PCD file's viewpoint counts.";
    let items = ArrayItems::RefOrSchema(Box::new(position_schema()));
    ArrayBuilder::new().items(items).description(Some(what)).into()
}

/// A request as a service gets it: no paths, since a service reads nobody's files.
///
/// # Errors
/// [`InputError`], naming the key; [`InputError::is_syntax`] if it is not JSON.
pub fn from_json(bytes: &[u8], grid: Grid) -> Result<Request, InputError> {
    assemble(&parse_json(bytes)?, None, grid)
}

/// A request from a file, TOML or JSON; paths in it are relative to its folder.
///
/// # Errors
/// [`InputError`], naming the key and the file.
pub fn from_file(path: &Path, grid: Grid) -> Result<Request, InputError> {
    let folder = path.parent().unwrap_or(Path::new(""));
    assemble(&parse_file(path)?, Some(folder), grid).map_err(|error| error.at(&path.display().to_string()))
}

/// A file's request, TOML or JSON, of which nothing but the keys and their types was checked.
///
/// # Errors
/// [`InputError`], naming the key and the file.
pub fn parse_file(path: &Path) -> Result<RequestInput, InputError> {
    let bytes = read_file(path)?;
    let input = if is_json(path, &bytes) { parse_json(&bytes) } else { parse_toml(&bytes) };
    input.map_err(|error| error.at(&path.display().to_string()))
}

fn is_json(path: &Path, bytes: &[u8]) -> bool {
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("json") => true,
        Some("toml") => false,
        _ => bytes.trim_ascii_start().starts_with(b"{"),
    }
}

fn parse_json(bytes: &[u8]) -> Result<RequestInput, InputError> {
    serde_json::from_slice(bytes).map_err(|error| match serde_json::from_slice::<Value>(bytes) {
        Ok(value) => unfit(&value, &error.to_string()),
        Err(error) => InputError::Syntax(format!("not JSON: {}", shown(&error.to_string()))),
    })
}

pub(crate) fn parse_toml(bytes: &[u8]) -> Result<RequestInput, InputError> {
    let no_text = |_| InputError::Syntax("not TOML: it is not UTF-8".to_owned());
    let text = std::str::from_utf8(bytes).map_err(no_text)?;
    toml::from_str(text).map_err(|error| match toml::from_str::<toml::Table>(text) {
        Ok(table) => unfit(&serde_json::to_value(table).unwrap_or_default(), error.message()),
        Err(error) => InputError::Syntax(format!("not TOML: {}", shown(error.message()))),
    })
}

/// What is wrong with a request that parses but does not fit, and where; `whole` if no part of it is to blame.
fn unfit(value: &Value, whole: &str) -> InputError {
    match wrong_part(value) {
        Some((what, place)) => InputError::Value(format!("{}: {place}", shown(&what))),
        None => InputError::Value(shown(whole)),
    }
}

type Check = fn(&Value) -> Option<String>;

fn check<T: DeserializeOwned>(value: &Value) -> Option<String> {
    T::deserialize(value).err().map(|error| error.to_string())
}

const OF_REQUEST: [(&str, Check); 11] = [
    ("views", check::<Option<Vec<Value>>>),
    ("intrinsics", check::<Option<IntrinsicsInput>>),
    ("tsdf", check::<Option<SourceInput>>),
    ("cloud", check::<Option<SourceInput>>),
    ("eyes_m", check::<Option<Vec<Vec<f64>>>>),
    ("base_from_workspace", check::<Option<PoseInput>>),
    ("workspace_from_wrist", check::<Option<OrientationInput>>),
    ("policy", check::<Option<String>>),
    ("check_collisions", check::<Option<bool>>),
    ("grasps_max", check::<Option<usize>>),
    ("explain", check::<Option<bool>>),
];

const OF_VIEW: [(&str, Check); 5] = [
    ("depth", check::<SourceInput>),
    ("depth_scale_m", check::<Option<f64>>),
    ("intrinsics", check::<Option<IntrinsicsInput>>),
    ("workspace_from_camera", check::<Option<PoseInput>>),
    ("base_from_camera", check::<Option<PoseInput>>),
];

fn wrong_part(request: &Value) -> Option<(String, String)> {
    let views = request.get("views").and_then(Value::as_array);
    let wrong_view = views.into_iter().flatten().enumerate().find_map(|(at, view)| {
        let whole = check::<ViewInput>(view)?;
        let place = format!("views[{at}]");
        Some(wrong_key(view, &format!("{place}."), &OF_VIEW).unwrap_or((whole, place)))
    });
    wrong_view.or_else(|| wrong_key(request, "", &OF_REQUEST))
}

fn wrong_key(table: &Value, prefix: &str, checks: &[(&str, Check)]) -> Option<(String, String)> {
    checks.iter().find_map(|(key, check)| Some((check(table.get(key)?)?, format!("{prefix}{key}"))))
}

#[cfg(test)]
mod tests {
    use utoipa::PartialSchema;

    use super::*;

    #[test]
    fn the_apis_description_has_every_key_that_is_read() {
        let told = |schema: RefOr<Schema>| serde_json::to_value(schema).unwrap();
        let (request, view) = (told(RequestInput::schema()), told(ViewInput::schema()));
        assert_eq!(request["properties"].as_object().unwrap().len(), OF_REQUEST.len());
        assert!(OF_REQUEST.iter().all(|(key, _)| request["properties"].get(key).is_some()), "{request}");
        assert_eq!(view["properties"].as_object().unwrap().len(), OF_VIEW.len());
        assert!(OF_VIEW.iter().all(|(key, _)| view["properties"].get(key).is_some()), "{view}");
        assert_eq!(view["required"], serde_json::json!(["depth"]));
        let pose = told(PoseInput::schema());
        assert_eq!(pose["oneOf"][0]["items"]["maxItems"], 4, "{pose}");
        assert_eq!(pose["oneOf"][1]["properties"]["position_m"]["minItems"], 3, "{pose}");
    }

    #[test]
    fn a_files_language_is_told_by_its_name_then_by_its_first_byte() {
        assert!(is_json(Path::new("a.json"), b"") && !is_json(Path::new("a.toml"), b"{"));
        assert!(is_json(Path::new("a"), b" \n{") && !is_json(Path::new("a"), b"views"));
    }
}
