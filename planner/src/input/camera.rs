//! Cameras and poses in requests. A matrix must be a rigid transform within a tolerance for printed digits and is
//! converted to a unit quaternion: near rotations are normalised, everything else is refused.

use std::fmt;

use glamx::{DQuat, DVec3};
use schema::{Intrinsics, Pose, Quat, Vec3, pose_from_parts};
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Error, MapAccess, SeqAccess, Unexpected, Visitor};
use serde::{Deserialize, Deserializer};

use crate::input::error::{InputError, refuse};
use crate::input::lists::{FirstEntries, Numbers, numbers};

/// Tolerance of a rotation: the error of three printed digits.
const RIGID_TOLERANCE: f64 = 1e-3;
const LAST_ROW_TOLERANCE: f64 = 1e-6;
/// Maximum translation; robot cells are smaller.
const TRANSLATION_M_MAX: f64 = 100.0;

/// Intrinsics of a pinhole camera, in pixels; the centre of pixel (0, 0) is at u = 0, v = 0.
// `remote` leaves serde's sequence form out: it took a list of six for width, height, fx, fy, cx, cy.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(remote = "Self", deny_unknown_fields)]
pub struct IntrinsicsInput {
    /// Pixels per row; if given, it must equal the image's.
    pub width_px: Option<usize>,
    /// Number of rows; if given, it must equal the image's.
    pub height_px: Option<usize>,
    /// Focal length along u.
    pub fx_px: f64,
    /// Focal length along v.
    pub fy_px: f64,
    /// Principal point, u.
    pub cx_px: f64,
    /// Principal point, v.
    pub cy_px: f64,
}

impl<'de> Deserialize<'de> for IntrinsicsInput {
    fn deserialize<D: Deserializer<'de>>(source: D) -> Result<Self, D::Error> {
        source.deserialize_any(IntrinsicsVisitor)
    }
}

/// A list is the camera matrix, row by row, a table the four numbers.
struct IntrinsicsVisitor;

impl<'de> Visitor<'de> for IntrinsicsVisitor {
    type Value = IntrinsicsInput;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("{ fx_px, fy_px, cx_px, cy_px } or a camera matrix of nine numbers")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<IntrinsicsInput, A::Error> {
        from_camera_matrix(numbers(SeqAccessDeserializer::new(list))?).map_err(A::Error::custom)
    }

    fn visit_map<A: MapAccess<'de>>(self, keys: A) -> Result<IntrinsicsInput, A::Error> {
        IntrinsicsInput::deserialize(MapAccessDeserializer::new(keys))
    }
}

/// A rigid transform: four rows of four numbers, or a position and a quaternion; or `"table"` of what is to be placed
/// on it.
#[derive(Debug, Clone, PartialEq)]
pub enum PoseInput {
    /// The table is to be found, and the workspace put on it.
    Table,
    /// Rows of a homogeneous matrix.
    Matrix([[f64; 4]; 4]),
    /// A position and a quaternion.
    Parts(PosePartsInput),
}

/// A rigid transform as position and orientation.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PosePartsInput {
    /// x, y, z in metres.
    #[serde(deserialize_with = "numbers")]
    pub position_m: [f64; 3],
    /// Unit quaternion x, y, z, w.
    #[serde(deserialize_with = "numbers")]
    pub quaternion_xyzw: [f64; 4],
}

/// An orientation.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OrientationInput {
    /// Unit quaternion x, y, z, w.
    #[serde(deserialize_with = "numbers")]
    pub quaternion_xyzw: [f64; 4],
}

impl<'de> Deserialize<'de> for PoseInput {
    fn deserialize<D: Deserializer<'de>>(source: D) -> Result<Self, D::Error> {
        source.deserialize_any(PoseVisitor)
    }
}

/// A list selects the matrix, keys the position and quaternion, so errors refer to the intended form.
struct PoseVisitor;

impl<'de> Visitor<'de> for PoseVisitor {
    type Value = PoseInput;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("four rows of four numbers, or { position_m, quaternion_xyzw }, or \"table\"")
    }

    fn visit_str<E: Error>(self, word: &str) -> Result<PoseInput, E> {
        if word == "table" { Ok(PoseInput::Table) } else { Err(E::invalid_value(Unexpected::Str(word), &self)) }
    }

    fn visit_seq<A: SeqAccess<'de>>(self, rows: A) -> Result<PoseInput, A::Error> {
        let FirstEntries { kept, count } = FirstEntries::<_, 4>::deserialize(SeqAccessDeserializer::new(rows))?;
        let wrong = || A::Error::custom(format!("a matrix must have 4 rows of 4 numbers, got {count} rows"));
        let rows = <[Numbers<4>; 4]>::try_from(kept).ok().filter(|_| count == 4).ok_or_else(wrong)?;
        Ok(PoseInput::Matrix(rows.map(|row| row.0)))
    }

    fn visit_map<A: MapAccess<'de>>(self, parts: A) -> Result<PoseInput, A::Error> {
        PosePartsInput::deserialize(MapAccessDeserializer::new(parts)).map(PoseInput::Parts)
    }
}

/// The intrinsics of a camera whose image has this size.
///
/// # Errors
/// [`InputError::Value`] if a number is out of range or the sizes differ; `at` is the key's path.
pub(crate) fn intrinsics(
    input: &IntrinsicsInput,
    [width_px, height_px]: [usize; 2],
    at: &str,
) -> Result<Intrinsics, InputError> {
    let refuse = |what: String| refuse(format!("{what}: {at}"));
    for (key, given, of_image) in [("width_px", input.width_px, width_px), ("height_px", input.height_px, height_px)] {
        if let Some(given) = given.filter(|given| *given != of_image) {
            return refuse(format!("{key} must be the image's {of_image}, got {given}"));
        }
    }
    for (key, focal_px) in [("fx_px", input.fx_px), ("fy_px", input.fy_px)] {
        if !(focal_px > 1.0 && focal_px < 1e5) {
            return refuse(format!("{key} must be between 1 and 100000, got {focal_px}"));
        }
    }
    for (key, centre_px, size_px) in [("cx_px", input.cx_px, width_px), ("cy_px", input.cy_px, height_px)] {
        let reach = 2.0 * size_px as f64;
        if !(-reach..=reach).contains(&centre_px) {
            return refuse(format!("{key} must be between -{reach} and {reach}, got {centre_px}"));
        }
    }
    let [fx_px, fy_px, cx_px, cy_px] = [input.fx_px, input.fy_px, input.cx_px, input.cy_px].map(|px| px as f32);
    Ok(Intrinsics { width_px, height_px, fx_px, fy_px, cx_px, cy_px })
}

/// The intrinsics of a camera matrix, row by row.
///
/// # Errors
/// [`InputError::Value`] if it is not that of a pinhole camera without skew.
pub(crate) fn from_camera_matrix(matrix: [f64; 9]) -> Result<IntrinsicsInput, InputError> {
    if matrix.iter().any(|number| !number.is_finite()) {
        return refuse("a camera matrix must have finite numbers");
    }
    let [fx_px, skew, cx_px, other_skew, fy_px, cy_px, x, y, z] = matrix;
    let is = |got: f64, wanted: f64| (got - wanted).abs() <= LAST_ROW_TOLERANCE;
    if !(is(x, 0.0) && is(y, 0.0) && is(z, 1.0)) {
        let hint = if is(cx_px, 0.0) && is(cy_px, 0.0) { ": is it transposed? rows come first" } else { "" };
        return refuse(format!("a camera matrix's last row must be 0 0 1, got {x} {y} {z}{hint}"));
    }
    if !(is(skew, 0.0) && is(other_skew, 0.0)) {
        return refuse(format!("a camera matrix must be without skew, 0 beside fx and fy, got {skew} {other_skew}"));
    }
    Ok(IntrinsicsInput { width_px: None, height_px: None, fx_px, fy_px, cx_px, cy_px })
}

/// The pose, with its rotation normalised.
///
/// # Errors
/// [`InputError::Value`] if it is not a rigid transform or far away; `at` is the key's path.
pub(crate) fn pose(input: &PoseInput, at: &str) -> Result<Pose, InputError> {
    let (rotation, translation) = match input {
        PoseInput::Matrix(matrix) => from_matrix(matrix),
        PoseInput::Table => refuse("\"table\" is for the first view's workspace_from_camera, or a cloud's pose"),
        PoseInput::Parts(PosePartsInput { position_m, quaternion_xyzw }) => finite("position_m", *position_m)
            .and_then(|position_m| Ok((unit_quaternion(*quaternion_xyzw)?, position_m))),
    }
    .map_err(|error| error.at(at))?;
    let is_far = |metres: &f64| !(-TRANSLATION_M_MAX..=TRANSLATION_M_MAX).contains(metres);
    if let Some(far) = translation.to_array().into_iter().find(is_far) {
        return refuse(format!(
            "a translation must be at most {TRANSLATION_M_MAX} m, got {far}: are these millimetres?: {at}"
        ));
    }
    Ok(pose_from_parts(rotation, translation.as_vec3()))
}

/// The unit quaternion of four numbers that are nearly normalised.
///
/// # Errors
/// [`InputError::Value`] if they are not; `at` is the key's path.
pub(crate) fn orientation(input: &OrientationInput, at: &str) -> Result<Quat, InputError> {
    unit_quaternion(input.quaternion_xyzw).map_err(|error| error.at(at))
}

/// A point of three finite numbers.
pub(crate) fn point(xyz: [f64; 3], at: &str) -> Result<Vec3, InputError> {
    finite("a point", xyz).map(|xyz| xyz.as_vec3()).map_err(|error| error.at(at))
}

fn finite(what: &str, xyz: [f64; 3]) -> Result<DVec3, InputError> {
    if xyz.iter().all(|number| number.is_finite()) {
        return Ok(DVec3::from_array(xyz));
    }
    refuse(format!("{what} must have finite numbers, got {xyz:?}"))
}

fn unit_quaternion(xyzw: [f64; 4]) -> Result<Quat, InputError> {
    let rotation = DQuat::from_array(xyzw);
    let norm = rotation.length();
    if !(1.0 - RIGID_TOLERANCE..=1.0 + RIGID_TOLERANCE).contains(&norm) {
        return refuse(format!("quaternion_xyzw must have a length of 1 within {RIGID_TOLERANCE}, got {norm:.4}"));
    }
    Ok(in_single_precision(rotation))
}

fn in_single_precision(rotation: DQuat) -> Quat {
    rotation.normalize().as_quat().normalize()
}

fn from_matrix(rows: &[[f64; 4]; 4]) -> Result<(Quat, DVec3), InputError> {
    if rows.iter().flatten().any(|number| !number.is_finite()) {
        return refuse("a matrix must have finite numbers");
    }
    let misses = |(got, wanted): (&f64, f64)| (got - wanted).abs() > LAST_ROW_TOLERANCE;
    if rows[3].iter().zip([0.0, 0.0, 0.0, 1.0]).any(misses) {
        let hint = if rows.iter().take(3).all(|row| row[3].abs() < LAST_ROW_TOLERANCE) {
            ": is it transposed? rows come first"
        } else {
            ""
        };
        return refuse(format!("a matrix's last row must be 0 0 0 1, got {:?}{hint}", rows[3]));
    }
    let [x, y, z, translation] =
        [0, 1, 2, 3].map(|column| DVec3::new(rows[0][column], rows[1][column], rows[2][column]));
    check_rotation([x, y, z])?;
    Ok((in_single_precision(quaternion_of([x, y, z])), translation))
}

/// Checks that three columns are a rotation, by their lengths, their angles, and its orientation.
fn check_rotation([x, y, z]: [DVec3; 3]) -> Result<(), InputError> {
    let lengths = [x, y, z].map(DVec3::length);
    if lengths.iter().any(|length| (length - 1.0).abs() > RIGID_TOLERANCE) {
        let [x, y, z] = lengths;
        return refuse(format!("not a rigid transform: its columns have lengths {x:.3}, {y:.3}, {z:.3}"));
    }
    let cosines = [x.dot(y), y.dot(z), z.dot(x)];
    if cosines.iter().any(|cosine| cosine.abs() > RIGID_TOLERANCE) {
        let [xy, yz, zx] = cosines.map(|cosine| format!("{cosine:.3}"));
        return refuse(format!("not a rigid transform: the cosines between its columns are {xy}, {yz}, {zx}, not 0"));
    }
    if x.cross(y).dot(z) < 0.0 {
        return refuse("not a rigid transform: the rotation's determinant is -1 (a reflection)");
    }
    Ok(())
}

/// The rotation with these columns, from the largest of the four components to avoid division by nearly 0 (Shepperd's
/// method); that component is positive.
fn quaternion_of([x, y, z]: [DVec3; 3]) -> DQuat {
    let trace = x.x + y.y + z.z;
    let squares = [x.x, y.y, z.z, trace].map(|s| 1.0 - trace + 2.0 * s);
    let largest = (0..4).max_by(|a, b| squares[*a].total_cmp(&squares[*b])).unwrap_or(3);
    let [xy, yz, zx] = [y.x + x.y, z.y + y.z, x.z + z.x];
    let [wx, wy, wz] = [y.z - z.y, z.x - x.z, x.y - y.x];
    DQuat::from_array(match largest {
        0 => [squares[0], xy, zx, wx],
        1 => [xy, squares[1], yz, wy],
        2 => [zx, yz, squares[2], wz],
        _ => [wx, wy, wz, squares[3]],
    })
}

#[cfg(test)]
mod tests {
    use schema::axis_angle;
    use serde_json::json;

    use super::*;
    use crate::input::request::{RequestInput, parse_json, parse_toml};

    fn read(value: serde_json::Value) -> Result<Pose, InputError> {
        let input: PoseInput = serde_json::from_value(value).map_err(|e| InputError::Value(e.to_string()))?;
        pose(&input, "views[1].workspace_from_camera")
    }

    fn message(value: serde_json::Value) -> String {
        read(value).unwrap_err().to_string()
    }

    /// The matrix of a pose from the images of the axes, independently of the conversion under test.
    fn matrix_of(pose: &Pose) -> [[f64; 4]; 4] {
        let columns = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| pose.rotation * axis);
        let row = |at: usize| {
            let of = |v: Vec3| f64::from(v.to_array()[at]);
            [of(columns[0]), of(columns[1]), of(columns[2]), of(pose.translation)]
        };
        [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
    }

    #[test]
    fn a_pose_comes_back_from_its_matrix_whatever_its_rotation() {
        let axes =
            [Vec3::X, Vec3::Y, Vec3::Z, Vec3::new(1.0, -2.0, 3.0).normalize(), Vec3::new(-1.0, 1.0, 0.1).normalize()];
        for axis in axes {
            for step in 0..25_u8 {
                let rotation = axis_angle(axis, f32::from(step) * 0.25);
                let wanted = pose_from_parts(rotation, Vec3::new(0.1, -0.2, 0.3));
                let got = pose(&PoseInput::Matrix(matrix_of(&wanted)), "here").unwrap();
                assert!((got.rotation.dot(wanted.rotation).abs() - 1.0).abs() < 1e-5, "{axis} {step}");
                assert!((got.rotation.length() - 1.0).abs() < 1e-6);
                assert_eq!(got.translation, wanted.translation);
            }
        }
    }

    #[test]
    fn a_position_and_a_quaternion_are_a_pose_too() {
        let got = read(json!({ "position_m": [1, 2, 3], "quaternion_xyzw": [0, 0, 0.7072, 0.7072] })).unwrap();
        assert!((got * Vec3::X - Vec3::new(1.0, 3.0, 3.0)).length() < 1e-4, "a quarter turn about z");
        assert!((got.rotation.length() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn what_is_not_rigid_is_refused_with_the_reason() {
        let reflected = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]);
        let expected =
            "not a rigid transform: the rotation's determinant is -1 (a reflection): views[1].workspace_from_camera";
        assert_eq!(message(reflected), expected);
        let scaled = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0.5, 0], [0, 0, 0, 1]]);
        assert!(message(scaled).contains("lengths 1.000, 1.000, 0.500"));
        let sheared = json!([[1, 0.6, 0, 0], [0, 0.8, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
        assert!(message(sheared).contains("cosines between its columns are 0.600, 0.000, 0.000"));
        let transposed = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0.1, 0.2, 0.3, 1]]);
        assert!(message(transposed).contains("is it transposed?"));
        assert!(message(json!([[1, 0, 0], [0, 1, 0], [0, 0, 1]])).contains("must have 4 numbers, got 3"));
        let rows = |count: usize| message(json!(vec![[1, 0, 0, 0]; count]));
        assert!(rows(3).contains("a matrix must have 4 rows of 4 numbers, got 3 rows"));
        assert!(rows(5).contains("got 5 rows") && rows(0).contains("got 0 rows"));
        let short = json!({ "position_m": [0, 0], "quaternion_xyzw": [0, 0, 0, 1] });
        assert!(message(short).contains("must have 3 numbers, got 2"));
        let far = json!([[1, 0, 0, 450.0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
        assert!(message(far).contains("at most 100 m, got 450: are these millimetres?"));
        let long = json!({ "position_m": [0, 0, 0], "quaternion_xyzw": [0, 0, 1, 1] });
        assert!(message(long).contains("length of 1 within 0.001, got 1.4142: views[1]"));
        let none = json!({ "position_m": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 0] });
        assert!(message(none).contains("got 0.0000"));
        assert!(
            message(json!({ "position_m": [0, 0, 0], "quaternion": [0, 0, 0, 1] }))
                .contains("unknown field `quaternion`")
        );
        assert!(message(json!("identity")).contains("four rows of four numbers, or { position_m"));
        let nan = PoseInput::Matrix([[f64::NAN; 4]; 4]);
        assert!(pose(&nan, "here").unwrap_err().to_string().contains("finite"));
    }

    #[test]
    fn lenses_are_checked() {
        let good = IntrinsicsInput {
            width_px: None,
            height_px: Some(480),
            fx_px: 540.0,
            fy_px: 540.0,
            cx_px: 320.0,
            cy_px: 240.0,
        };
        assert_eq!(intrinsics(&good, [640, 480], "intrinsics").unwrap(), Intrinsics::VGN);
        let said =
            |input: &IntrinsicsInput| intrinsics(input, [640, 480], "views[0].intrinsics").unwrap_err().to_string();
        let wide = IntrinsicsInput { width_px: Some(1280), ..good.clone() };
        assert_eq!(said(&wide), "width_px must be the image's 640, got 1280: views[0].intrinsics");
        for fx_px in [0.0, -540.0, 1e5, f64::NAN, f64::INFINITY] {
            assert!(said(&IntrinsicsInput { fx_px, ..good.clone() }).starts_with("fx_px must be between 1 and 100000"));
        }
        assert!(
            said(&IntrinsicsInput { cy_px: -961.0, ..good.clone() }).contains("cy_px must be between -960 and 960")
        );
        assert!(said(&IntrinsicsInput { cx_px: f64::NAN, ..good }).contains("cx_px"));
    }

    fn lens(value: serde_json::Value) -> Result<IntrinsicsInput, String> {
        serde_json::from_value(value).map_err(|error| error.to_string())
    }

    #[test]
    fn a_list_is_a_camera_matrix_or_refused() {
        let keys = lens(json!({ "fx_px": 525, "fy_px": 526.5, "cx_px": 319.5, "cy_px": 239.5 })).unwrap();
        assert_eq!(lens(json!([525, 0, 319.5, 0, 526.5, 239.5, 0, 0, 1])).unwrap(), keys);
        for (list, expected) in [
            (json!([640, 480, 525, 525, 319.5, 239.5]), "must have 9 numbers, got 6"),
            (json!([]), "must have 9 numbers, got 0"),
            (json!([525, 0, 319.5, 0, 0, 525, 239.5, 0, 0, 0, 1, 0]), "must have 9 numbers, got 12"),
            (json!([[1, 2, 3], [1, 2, 3], [1, 2, 3]]), "invalid type: sequence, expected f64"),
            (json!(["a"]), "invalid type: string \"a\", expected f64"),
            (json!(525), "invalid type: integer `525`, expected { fx_px, fy_px, cx_px, cy_px } or"),
            (json!({ "fx": 525 }), "unknown field `fx`"),
        ] {
            let said = lens(list).unwrap_err();
            assert!(said.starts_with(expected), "{said}");
        }
        let json = br#"{ "views": [{ "depth": "a", "intrinsics": [640, 480, 525.0, 525.0, 319.5, 239.5] }] }"#;
        let said = parse_json::<RequestInput>(json).unwrap_err().to_string();
        assert_eq!(said, "must have 9 numbers, got 6: views[0].intrinsics");
        let toml = b"intrinsics = [525.0, 0, 319.5, 0, 526.5, 239.5, 0, 0, 1]";
        assert_eq!(parse_toml(toml).unwrap().intrinsics, Some(keys));
    }

    #[test]
    fn what_is_not_a_pinholes_matrix_is_refused_with_the_reason() {
        let said = |matrix: [f64; 9]| from_camera_matrix(matrix).unwrap_err().to_string();
        let last = said([525.0, 0.0, 320.0, 0.0, 525.0, 240.0, 0.0, 0.0, 2.0]);
        assert_eq!(last, "a camera matrix's last row must be 0 0 1, got 0 0 2");
        let transposed = said([525.0, 0.0, 0.0, 0.0, 525.0, 0.0, 320.0, 240.0, 1.0]);
        assert!(transposed.ends_with("got 320 240 1: is it transposed? rows come first"), "{transposed}");
        let skewed = said([525.0, 0.5, 320.0, 0.0, 525.0, 240.0, 0.0, 0.0, 1.0]);
        assert_eq!(skewed, "a camera matrix must be without skew, 0 beside fx and fy, got 0.5 0");
        assert!(said([f64::NAN; 9]).contains("finite"));
    }
}
