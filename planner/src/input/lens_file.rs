//! Intrinsics from files of other programs, recognised by their content: ROS, RealSense, Open3D, NumPy, and ours.
//!
//! The YAML that ROS writes is keys, one level of indentation, and lists of numbers. A reader of that much is a few
//! lines; it reads `rs-enumerate-devices` as well, whose text is no YAML.

use serde::Deserialize as _;
use serde_json::{Map, Value};

use crate::input::camera::{IntrinsicsInput, from_camera_matrix};
use crate::input::error::{InputError, refuse, shown};
use crate::input::npy;

const BYTES_MAX: usize = 1 << 20;
const FORMS: &str = "{ fx_px, fy_px, cx_px, cy_px }, a ROS CameraInfo, a RealSense profile (fx, fy, ppx, ppy), \
                     Open3D's intrinsic_matrix, or a camera matrix of 3 x 3 or 3 x 4 numbers";
/// Where a camera is, in the order of preference; the first place is the file itself.
const PLACES: [&str; 5] = ["", "depth", "depth_intrinsics", "intrinsics", "intrinsic"];
const FX: [&str; 2] = ["fx_px", "fx"];
const MATRICES: [&str; 5] = ["k", "K", "camera_matrix", "intrinsic_matrix", "cam_K"];
const DISTORTIONS: [&str; 4] = ["d", "D", "distortion_coefficients", "coeffs"];

/// Intrinsics, and what the user should know of them.
#[derive(Debug, Clone, PartialEq)]
pub struct ReadLens {
    /// The intrinsics, with the image's size where the file has it.
    pub intrinsics: IntrinsicsInput,
    /// A warning about unusual but valid content.
    pub warning: Option<String>,
}

/// Reads intrinsics from a file's bytes: ours, a ROS CameraInfo, a RealSense profile, Open3D's, or a camera matrix.
///
/// # Errors
/// [`InputError`] if it is none of them, or not a pinhole camera without skew. Ranges are checked with the image.
pub fn read_intrinsics(bytes: &[u8]) -> Result<ReadLens, InputError> {
    if bytes.len() > BYTES_MAX {
        return refuse(format!("a file of intrinsics must have at most {BYTES_MAX} bytes, got {}", bytes.len()));
    }
    if npy::is_npy(bytes) {
        return from_npy(bytes);
    }
    let not_text = |_| InputError::Damaged("intrinsics must be text in UTF-8 or a NumPy array file".to_owned());
    let text = std::str::from_utf8(bytes).map_err(not_text)?.trim_start_matches('\u{feff}').trim_ascii_end();
    if text.is_empty() {
        return Err(InputError::Damaged(format!("intrinsics must be {FORMS}, got an empty file")));
    }
    let uncommented = text.lines().filter(|line| !line.trim_start().starts_with('#'));
    if let Some(numbers) = uncommented.map(numbers_of).collect::<Option<Vec<_>>>() {
        return from_matrix(&numbers.concat());
    }
    let is_toml = text.lines().any(|line| line.split_once('=').is_some_and(|(key, _)| is_word(key.trim())));
    let damaged = |language: &str, error: &str| InputError::Damaged(format!("not {language}: {}", shown(error)));
    let first = text.trim_ascii_start();
    let value = if first.starts_with('{') || (first.starts_with('[') && !is_toml) {
        serde_json::from_str(text).map_err(|error| damaged("JSON", &error.to_string()))?
    } else if is_toml {
        let source = toml::Deserializer::parse(text).map_err(|error| damaged("TOML", error.message()))?;
        Value::deserialize(source).map_err(|error| damaged("TOML", error.message()))?
    } else {
        Value::Object(from_lines(text)?)
    };
    let root = value.as_object();
    let place =
        |name: &'static &str| Some((*name, if name.is_empty() { root? } else { root?.get(*name)?.as_object()? }));
    let mut places = PLACES.iter().filter_map(place);
    if let Some((name, keys)) = places.find(|(_, keys)| first_of(keys, &MATRICES).or(first_of(keys, &FX)).is_some()) {
        return from_keys(keys).map_err(|error| if name.is_empty() { error } else { error.at(name) });
    }
    let keys: Vec<&str> = root.into_iter().flat_map(Map::keys).map(String::as_str).take(12).collect();
    let got = if keys.is_empty() { first } else { &format!("the keys {}", keys.join(", ")) };
    refuse(format!("intrinsics must be {FORMS}, got {}", shown(got)))
}

fn is_word(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"_-".contains(&byte))
}

/// The numbers of a text that has nothing else but brackets, commas and blanks.
fn numbers_of(text: &str) -> Option<Vec<f64>> {
    let words = text.split(|c: char| c.is_ascii_whitespace() || "[](),;".contains(c));
    words.filter(|word| !word.is_empty()).map(|word| word.parse().ok()).collect()
}

fn from_npy(bytes: &[u8]) -> Result<ReadLens, InputError> {
    let (header, data) = npy::split(bytes)?;
    if ![[3, 3].as_slice(), &[3, 4], &[9], &[12]].contains(&header.shape.as_slice()) {
        return refuse(format!("a camera matrix must have the shape [3, 3] or [3, 4], got {:?}", header.shape));
    }
    from_matrix(&header.decode(data).into_iter().map(f64::from).collect::<Vec<_>>())
}

fn from_matrix(numbers: &[f64]) -> Result<ReadLens, InputError> {
    from_camera_matrix(numbers).map(|intrinsics| ReadLens { intrinsics, warning: None })
}

/// The keys of lines `key: value`, in lower case, with those further to the right below the key before them. A line
/// without a key continues the value before it; of several messages the first is taken.
fn from_lines(text: &str) -> Result<Map<String, Value>, InputError> {
    let profiles = text.lines().filter(|line| line.trim_start().starts_with("PPX:")).count();
    if profiles > 1 {
        return refuse(format!("a file of intrinsics must have one RealSense profile, got {profiles}: keep one"));
    }
    let mut entries: Vec<(usize, String, String)> = Vec::new();
    for whole in text.lines().filter(|line| !line.starts_with('%')) {
        let mut line = whole.split(" #").next().unwrap_or(whole).trim();
        if line == "---" && !entries.is_empty() {
            break;
        }
        while let Some(rest) = line.strip_prefix("- ") {
            line = rest.trim_start();
        }
        let indent = whole.len() - whole.trim_start().len();
        match (line.split_once(':'), entries.last_mut()) {
            _ if line.is_empty() || line.starts_with('#') || line == "---" => {}
            (Some((key, value)), _) if value.is_empty() || value.starts_with([' ', '\t']) => {
                entries.push((indent, key.trim().to_lowercase(), value.to_owned()));
            }
            (_, Some((.., value))) => value.extend([" ", line]),
            (_, None) => {}
        }
    }
    let mut keys = Map::new();
    let first_indent = entries.first().map_or(0, |(indent, ..)| *indent);
    let mut above = String::new();
    for (indent, key, text) in entries {
        // { rows: 3, cols: 3, data: [ … ] } in one line.
        let data = text.split_once("data: [").and_then(|(_, rest)| rest.split_once(']'));
        let value = numbers_of(data.map_or(&text, |(data, _)| data)).map_or(Value::Null, Value::from);
        match keys.get_mut(&above) {
            Some(outer) if indent > first_indent && profiles == 0 => {
                if !outer.is_object() {
                    *outer = Value::Object(Map::new());
                }
                outer.as_object_mut().map(|inner| inner.entry(key).or_insert(value));
            }
            _ => {
                above.clone_from(&key);
                keys.entry(key).or_insert(value);
            }
        }
    }
    Ok(keys)
}

fn first_of<'a>(keys: &'a Map<String, Value>, names: &[&'static str]) -> Option<(&'static str, &'a Value)> {
    names.iter().find_map(|name| Some((*name, keys.get(*name)?)))
}

/// All numbers of a value: its own, those of a list or of a list of lists, or those of a matrix's `data`.
fn numbers_in(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(entries) => entries.iter().flat_map(numbers_in).collect(),
        Value::Object(matrix) => matrix.get("data").filter(|data| !data.is_object()).map_or(Vec::new(), numbers_in),
        value => value.as_f64().into_iter().collect(),
    }
}

fn matrix_under(name: &str, value: &Value) -> Result<IntrinsicsInput, InputError> {
    let mut numbers = numbers_in(value);
    // Open3D writes columns; of a matrix in rows the last row begins with zeros.
    if name == "intrinsic_matrix" && numbers.len() == 9 && numbers[6..8] != [0.0; 2] {
        numbers = [0, 3, 6, 1, 4, 7, 2, 5, 8].map(|at: usize| numbers[at]).to_vec();
    }
    from_camera_matrix(&numbers).map_err(|error| error.at(name))
}

fn from_keys(keys: &Map<String, Value>) -> Result<ReadLens, InputError> {
    let number = |names: &[&'static str]| {
        let (name, value) = first_of(keys, names)
            .ok_or_else(|| InputError::Value(format!("intrinsics lack {}", names.join(" or "))))?;
        match numbers_in(value)[..] {
            [number] => Ok(number),
            ref numbers => refuse(format!("{name} must be a number, got {} numbers", numbers.len())),
        }
    };
    let size = |names: &[&'static str]| match first_of(keys, names).map(|_| number(names)).transpose()? {
        Some(px) if px.fract() != 0.0 || !(0.0..1e9).contains(&px) => {
            refuse(format!("{} must be a whole number of pixels, got {px}", names.join(" or ")))
        }
        px => Ok(px.map(|px| px as usize)),
    };
    let mut intrinsics = match first_of(keys, &MATRICES).filter(|_| first_of(keys, &FX).is_none()) {
        Some((name, value)) => matrix_under(name, value)?,
        None => IntrinsicsInput {
            width_px: None,
            height_px: None,
            fx_px: number(&FX)?,
            fy_px: number(&["fy_px", "fy"])?,
            cx_px: number(&["cx_px", "ppx", "cx"])?,
            cy_px: number(&["cy_px", "ppy", "cy"])?,
        },
    };
    intrinsics.width_px = size(&["width_px", "width", "image_width"])?;
    intrinsics.height_px = size(&["height_px", "height", "image_height"])?;
    let distortion = first_of(keys, &DISTORTIONS).map_or(Vec::new(), |(_, value)| numbers_in(value));
    let warning = distortion.iter().any(|coefficient| *coefficient != 0.0).then(|| {
        "the lens has distortion, which is left out: images must be rectified, and the intrinsics be those of the \
         rectified image"
            .to_owned()
    });
    Ok(ReadLens { intrinsics, warning })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::tests::npy_of;

    /// `rostopic echo`.
    const ROS_1: &str = r#"header:
  seq: 808
  stamp:
    secs: 5
    nsecs:         0
  frame_id: "optical"
height: 480
width: 640
distortion_model: "plumb_bob"
D: [0.0, 0.0, 0.0, 0.0, 0.0]
K: [607.5, 0.0, 320.25, 0.0, 608.0, 241.0, 0.0, 0.0, 1.0]
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
P: [1.0, 0.0, 2.0, 0.0, 0.0, 1.0, 3.0, 0.0, 0.0, 0.0, 1.0, 0.0]
roi:
  height: 0
  width: 0
---
height: 1
K: []
---
"#;
    /// `ros2 topic echo`.
    const ROS_2: &str = "header:\n  stamp:\n    sec: 16\n  frame_id: optical\nheight: 480\nwidth: 640\n\
        distortion_model: plumb_bob\nd:\n- 0.0\n- 0.0\nk:\n- 607.5\n- 0.0\n- 320.25\n- 0.0\n- 608.0\n- 241.0\n\
        - 0.0\n- 0.0\n- 1.0\nr:\n- 1.0\np:\n- 1.0\nroi:\n  x_offset: 0\n  height: 0\n  width: 0\n---\n";
    /// What `camera_calibration` saves.
    const CALIBRATION: &str = "image_width: 640
image_height: 480
camera_name: head
camera_matrix:
  rows: 3
  cols: 3
  data: [607.5    ,   0.     , 320.25   ,
           0.     , 608.     , 241.     ,
           0.     ,   0.     ,   1.     ]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.050000, -0.171034, 0.000000, 0.000000, 0.000000]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1., 0., 0.,
         0., 1., 0.,
         0., 0., 1.]
";
    /// A profile of `rs-enumerate-devices -c`.
    const REALSENSE: &str = " Intrinsic of \"Depth\" / 640x480 / {Z16}
  Width:      \t640
  Height:     \t480
  PPX:        \t320.25
  PPY:        \t241
  Fx:         \t607.5
  Fy:         \t608
  Distortion: \tBrown Conrady
  Coeffs:     \t0  \t0  \t0  \t0  \t0
  FOV (deg):  \t55.48 x 43.06

";

    fn lens(size: [Option<usize>; 2]) -> IntrinsicsInput {
        let [width_px, height_px] = size;
        IntrinsicsInput { width_px, height_px, fx_px: 607.5, fy_px: 608.0, cx_px: 320.25, cy_px: 241.0 }
    }

    fn message(text: &str) -> String {
        read_intrinsics(text.as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn each_programs_file_is_the_same_lens() {
        let sized = [
            r#"{ "fx_px": 607.5, "fy_px": 608, "cx_px": 320.25, "cy_px": 241, "width_px": 640, "height_px": 480 }"#,
            "# Ours.\nwidth_px = 640\nheight_px = 480\nfx_px = 607.5\nfy_px = 608\ncx_px = 320.25\ncy_px = 241.0",
            "[intrinsics]\nfx_px = 607.5\nfy_px = 608\ncx_px = 320.25\ncy_px = 241.0\nwidth_px = 640\n\
             height_px = 480",
            ROS_1,
            ROS_2,
            r#"{"header": {"frame_id": "a"}, "height": 480, "width": 640, "d": [0.0, 0.0],
                "roi": {"height": 0, "width": 0}, "k": [607.5, 0, 320.25, 0, 608, 241, 0, 0, 1]}"#,
            "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480 # rows\ncamera_matrix: !!opencv-matrix\n   \
             rows: 3\n   cols: 3\n   dt: d\n   data: [ 6.075e+02, 0., 320.25, 0., 608., 241., 0.,\n       0., 1. ]\n",
            "image_width: 640\nimage_height: 480\ncamera_matrix: {cols: 3, data: [607.5, 0, 320.25, 0, 608, 241, 0, \
             0, 1], rows: 3}",
            REALSENSE,
            &REALSENSE[REALSENSE.find("  Width").unwrap()..],
            r#"{"width": 640, "height": 480, "ppx": 320.25, "ppy": 241.0, "fx": 607.5, "fy": 608.0,
                "model": "distortion.brown_conrady", "coeffs": [0.0, 0.0, 0.0, 0.0, 0.0]}"#,
            r#"{"color": {"fx": 1}, "depth": {"width": 640, "height": 480, "ppx": 320.25, "ppy": 241.0,
                "fx": 607.5, "fy": 608.0}, "depth_scale": 0.001}"#,
            r#"{"serial": "7", "intrinsics": {"width": 640, "height": 480, "ppx": 320.25, "ppy": 241,
                "fx": 607.5, "fy": 608}}"#,
            r#"{ "height" : 480, "intrinsic_matrix" : [ 607.5, 0.0, 0.0, 0.0, 608.0, 0.0, 320.25, 241.0, 1.0 ],
                "width" : 640 }"#,
        ];
        for text in sized {
            let read = read_intrinsics(text.as_bytes()).unwrap_or_else(|error| panic!("{error}\n{text}"));
            assert_eq!(read, ReadLens { intrinsics: lens([Some(640), Some(480)]), warning: None }, "{text}");
        }
        for text in [ROS_1, ROS_2, REALSENSE] {
            let indented = format!("    {}", text.replace('\n', "\n    "));
            for other in [text.replace('\n', "\r\n"), indented] {
                let wanted = read_intrinsics(text.as_bytes()).unwrap();
                assert_eq!(read_intrinsics(other.as_bytes()).unwrap(), wanted, "{other}");
            }
        }
    }

    #[test]
    fn a_matrix_is_read_from_text_json_and_numpy() {
        for text in [
            "[[607.5, 0, 320.25], [0, 608, 241], [0, 0, 1]]",
            "[607.5, 0, 320.25, 0, 608, 241, 0, 0, 1]",
            "[[607.5, 0, 320.25, 0], [0, 608, 241, 0], [0, 0, 1, 0]]",
            "6.075000000000000000e+02 0.000000000000000000e+00 3.202500000000000000e+02\n0 6.08e+02 2.41e2\n0 0 1",
            "# saved by hand\n607.5,0,320.25\n0,608,241\n0,0,1\n",
            "607.5 0 320.25 0\n0 608 241 0\n0 0 1 0",
            "\u{feff}[[607.5   0.   320.25]\n [  0.   608.   241.  ]\n [  0.     0.     1.  ]]",
            "K = [[607.5, 0, 320.25],\n     [0, 608, 241],\n     [0, 0, 1]]",
            "{ \"K\": [[607.5, 0, 320.25], [0, 608, 241], [0, 0, 1]] }",
            "k:\n- - 607.5\n  - 0.0\n  - 320.25\n- - 0.0\n  - 608.0\n  - 241.0\n- [0.0, -0.0, 1.0]\n",
        ] {
            let read = read_intrinsics(text.as_bytes()).unwrap_or_else(|error| panic!("{error}\n{text}"));
            assert_eq!(read, ReadLens { intrinsics: lens([None, None]), warning: None }, "{text}");
        }
        let wide = [607.5, 0.0, 320.25, 0.0, 0.0, 608.0, 241.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let square = [607.5, 0.0, 320.25, 0.0, 608.0, 241.0, 0.0, 0.0, 1.0];
        for bytes in [npy_of(&[3, 4], &wide), npy_of(&[3, 3], &square), npy_of(&[9], &square)] {
            assert_eq!(read_intrinsics(&bytes).unwrap().intrinsics, lens([None, None]));
        }
        let said = read_intrinsics(&npy_of(&[4, 3], &wide)).unwrap_err().to_string();
        assert_eq!(said, "a camera matrix must have the shape [3, 3] or [3, 4], got [4, 3]");
    }

    #[test]
    fn distortion_is_told() {
        let distorted = REALSENSE.replace("\t0\n", "\t-0.0224\n");
        for text in
            [CALIBRATION, &ROS_1.replace("D: [0.0", "D: [0.1"), &ROS_2.replacen("- 0.0", "- 1e-3", 1), &distorted]
        {
            let read = read_intrinsics(text.as_bytes()).unwrap();
            assert_eq!(read.intrinsics, lens([Some(640), Some(480)]));
            assert!(read.warning.unwrap().contains("images must be rectified"), "{text}");
        }
    }

    #[test]
    fn what_is_no_lens_is_refused_with_what_it_is() {
        let cases = [
            ("", "or a camera matrix of 3 x 3 or 3 x 4 numbers, got an empty file"),
            ("P6 640 480", "or 3 x 4 numbers, got P6 640 480"),
            ("{ \"color\": { \"fx\": 1 }, \"focal\": 2 }", "or 3 x 4 numbers, got the keys color, focal"),
            ("focal: 525\nimage:\n  width: 3\n", "or 3 x 4 numbers, got the keys focal, image"),
            ("[\"a\"]", "or 3 x 4 numbers, got [\\\"a\\\"]"),
            ("{ \"fx_px\": 525,", "not JSON: EOF while parsing a value at line 1 column 15"),
            ("fx_px = 525,0", "not TOML: "),
            ("525 525 319.5 239.5", "a camera matrix must have 9 or 12 numbers, got 4"),
            ("{ \"fx\": 525, \"fy\": 525, \"ppx\": 319.5 }", "intrinsics lack cy_px or ppy or cy"),
            ("{ \"depth\": { \"fx\": \"525\" } }", "fx must be a number, got 0 numbers: depth"),
            ("{ \"fx\": [525, 525] }", "fx must be a number, got 2 numbers"),
            ("k: [525, 0, 319.5]", "a camera matrix must have 9 or 12 numbers, got 3: k"),
            ("k: [525, 0, 319.5, 0, 525, nan, 0, 0, 1]", "a camera matrix must have 9 or 12 numbers, got 8: k"),
            ("525 1 319.5\n0 525 239.5\n0 0 1", "must be without skew, 0 beside fx and fy, got 1 0"),
            ("525 0 319.5\n0 525 239.5\n0 1 1", "last row must be 0 0 1, got 0 1 1"),
            ("525 0 0\n0 525 0\n319.5 239.5 1", "got 319.5 239.5 1: is it transposed? rows come first"),
            ("525 0 319.5 7\n0 525 239.5 0\n0 0 1 0", "fourth column must be 0 0 0, without a pose, got 7 0 0"),
            ("{ \"intrinsic_matrix\": [525, 0, 0, 1, 525, 0, 319.5, 239.5, 1] }", "got 1 0: intrinsic_matrix"),
            (&ROS_1.replace("607.5", "nan"), "got 8: k"),
            (&ROS_1.replace("width: 640", "width: 640.5"), "must be a whole number of pixels, got 640.5"),
            (&[REALSENSE, REALSENSE].concat(), "must have one RealSense profile, got 2: keep one"),
        ];
        for (text, expected) in cases {
            let said = message(text);
            assert!(said.contains(expected) && said.len() < 500, "{said}\n{text}");
        }
        assert!(message(&"0 ".repeat(600_000)).ends_with("at most 1048576 bytes, got 1200000"));
        assert!(read_intrinsics(b"\xff\xfe1\0").unwrap_err().to_string().contains("UTF-8"));
        assert!(message(&"[".repeat(1 << 20)).starts_with("a camera matrix must have 9 or 12 numbers, got 0"));
        assert!(message(&format!("[x{}", "[".repeat(1 << 19))).starts_with("not JSON"));
        assert!(message(&format!("a = {}", "[".repeat(1 << 19))).starts_with("not TOML"));
    }
}
