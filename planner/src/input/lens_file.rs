//! Intrinsics from a file: ours, or a camera matrix. The Python package makes ours of other programs' files.

use serde::Deserialize as _;
use serde_json::{Map, Value};

use crate::input::camera::{IntrinsicsInput, from_camera_matrix};
use crate::input::error::{InputError, refuse, shown};
use crate::input::npy;

const BYTES_MAX: usize = 1 << 20;
const KEYS: [&str; 6] = ["width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px"];

/// Intrinsics, with the image's size where a file has it, and a warning about unusual but valid content.
pub type ReadLens = (IntrinsicsInput, Option<String>);

/// Reads intrinsics from a file's bytes: ours, or a camera matrix as text or as an array.
///
/// # Errors
/// [`InputError`] if it is neither, or not a pinhole camera without skew. Ranges are checked with the image.
pub fn read_intrinsics(bytes: &[u8]) -> Result<ReadLens, InputError> {
    if bytes.len() > BYTES_MAX {
        return refuse(format!("a file of intrinsics must have at most {BYTES_MAX} bytes, got {}", bytes.len()));
    }
    if npy::is_npy(bytes) {
        let (header, data) = npy::split(bytes)?;
        return from_matrix(&header.decode(data).into_iter().map(f64::from).collect::<Vec<_>>());
    }
    let not_text = |_| InputError::Damaged("intrinsics must be text in UTF-8 or a NumPy array file".to_owned());
    let text = std::str::from_utf8(bytes).map_err(not_text)?.trim_start_matches('\u{feff}').trim_ascii();
    let uncommented = text.lines().filter(|line| !line.trim_start().starts_with('#'));
    if let Some(numbers) = uncommented.map(numbers_of).collect::<Option<Vec<_>>>() {
        return from_matrix(&numbers.concat());
    }
    let value: Value = if text.starts_with('{') {
        let not_json =
            |error: serde_json::Error| InputError::Damaged(format!("not JSON: {}", shown(&error.to_string())));
        serde_json::from_str(text).map_err(not_json)?
    } else {
        let not_toml = |error: toml::de::Error| InputError::Damaged(other(&format!("no TOML: {}", error.message())));
        toml::Deserializer::parse(text).and_then(Value::deserialize).map_err(not_toml)?
    };
    let inner = value.get("intrinsics").filter(|inner| inner.is_object()).unwrap_or(&value);
    from_keys(inner.as_object().unwrap_or(&Map::new()))
}

/// What is said of a file in another form.
fn other(got: &str) -> String {
    format!(
        "intrinsics must be fx_px, fy_px, cx_px and cy_px in JSON or TOML, or a camera matrix of 3 x 3 numbers, \
         got {}: the program of the Python package (pip install graspmill) reads those that ROS, RealSense, \
         Open3D and OpenCV write",
        shown(got)
    )
}

/// The numbers of a text that has nothing else but brackets, commas and blanks.
fn numbers_of(text: &str) -> Option<Vec<f64>> {
    let words = text.split(|c: char| c.is_ascii_whitespace() || "[](),;".contains(c));
    words.filter(|word| !word.is_empty()).map(|word| word.parse().ok()).collect()
}

fn from_matrix(numbers: &[f64]) -> Result<ReadLens, InputError> {
    match <[f64; 9]>::try_from(numbers) {
        Ok(matrix) => Ok((from_camera_matrix(matrix)?, None)),
        Err(_) => refuse(format!("a camera matrix must have 9 numbers, got {}", numbers.len())),
    }
}

/// Ours, among other keys.
fn from_keys(keys: &Map<String, Value>) -> Result<ReadLens, InputError> {
    if !keys.contains_key("fx_px") {
        let names: Vec<&str> = keys.keys().map(String::as_str).take(12).collect();
        return refuse(other(&format!("the keys {}", names.join(", "))));
    }
    let ours = keys.iter().filter(|(key, _)| KEYS.contains(&key.as_str()));
    let ours = Value::Object(ours.map(|(key, value)| (key.clone(), value.clone())).collect());
    let intrinsics = serde_json::from_value(ours).map_err(|error| InputError::Value(shown(&error.to_string())))?;
    let distortion = keys.get("distortion_coefficients").and_then(Value::as_array);
    let is_distorted = distortion.is_some_and(|all| all.iter().any(|one| one.as_f64() != Some(0.0)));
    let warning = is_distorted.then(|| {
        "the lens has distortion, which is left out: images must be rectified, and the intrinsics be those of the \
         rectified image"
            .to_owned()
    });
    Ok((intrinsics, warning))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::tests::npy_of;

    fn lens(size: [Option<usize>; 2]) -> IntrinsicsInput {
        let [width_px, height_px] = size;
        IntrinsicsInput { width_px, height_px, fx_px: 607.5, fy_px: 608.0, cx_px: 320.25, cy_px: 241.0 }
    }

    fn message(text: &str) -> String {
        read_intrinsics(text.as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn our_keys_are_read_from_json_and_toml() {
        for text in [
            r#"{ "fx_px": 607.5, "fy_px": 608, "cx_px": 320.25, "cy_px": 241, "width_px": 640, "height_px": 480 }"#,
            "# Ours.\nwidth_px = 640\nheight_px = 480\nfx_px = 607.5\nfy_px = 608\ncx_px = 320.25\ncy_px = 241.0",
            "[intrinsics]\nfx_px = 607.5\nfy_px = 608\ncx_px = 320.25\ncy_px = 241.0\nwidth_px = 640\nheight_px = 480",
            "\u{feff}name = \"head\"\r\ndistortion_coefficients = [0, 0.0]\r\nwidth_px = 640\r\nheight_px = 480\r\n\
             fx_px = 607.5\r\nfy_px = 608\r\ncx_px = 320.25\r\ncy_px = 241.0\r\n",
        ] {
            let read = read_intrinsics(text.as_bytes()).unwrap_or_else(|error| panic!("{error}\n{text}"));
            assert_eq!(read, (lens([Some(640), Some(480)]), None), "{text}");
        }
    }

    #[test]
    fn a_matrix_is_read_from_text_json_and_numpy() {
        for text in [
            "[[607.5, 0, 320.25], [0, 608, 241], [0, 0, 1]]",
            "[607.5, 0, 320.25, 0, 608, 241, 0, 0, 1]",
            "6.075000000000000000e+02 0.000000000000000000e+00 3.202500000000000000e+02\n0 6.08e+02 2.41e2\n0 0 1",
            "# saved by hand\n607.5,0,320.25\n0,608,241\n0,0,1\n",
            "\u{feff}[[607.5   0.   320.25]\n [  0.   608.   241.  ]\n [  0.     0.     1.  ]]",
        ] {
            let read = read_intrinsics(text.as_bytes()).unwrap_or_else(|error| panic!("{error}\n{text}"));
            assert_eq!(read, (lens([None, None]), None), "{text}");
        }
        let square = [607.5, 0.0, 320.25, 0.0, 608.0, 241.0, 0.0, 0.0, 1.0];
        for bytes in [npy_of(&[3, 3], &square), npy_of(&[9], &square)] {
            assert_eq!(read_intrinsics(&bytes).unwrap().0, lens([None, None]));
        }
    }

    #[test]
    fn distortion_is_told() {
        let text =
            r#"{ "fx_px": 607.5, "fy_px": 608, "cx_px": 320.25, "cy_px": 241, "distortion_coefficients": [0.1] }"#;
        let (intrinsics, warning) = read_intrinsics(text.as_bytes()).unwrap();
        assert_eq!(intrinsics, lens([None, None]));
        assert!(warning.unwrap().contains("images must be rectified"));
    }

    #[test]
    fn what_is_no_lens_is_refused_with_what_it_is() {
        let cases = [
            ("", "a camera matrix must have 9 numbers, got 0"),
            ("P6 640 480", "numbers, got no TOML: "),
            (
                "height: 480\nwidth: 640\nk: [525, 0, 319.5]",
                ": the program of the Python package (pip install graspmill)",
            ),
            ("{ \"fx\": 525, \"ppx\": 2 }", "numbers, got the keys fx, ppx: the program of the Python package"),
            ("[\"a\"]", "numbers, got the keys a: the program"),
            ("{ \"fx_px\": 525,", "not JSON: EOF while parsing a value at line 1 column 15"),
            ("fx_px = 525,0", "numbers, got no TOML: "),
            ("fx_px = 525", "missing field `fy_px`"),
            ("{ \"fx_px\": \"525\" }", "invalid type: string \\\"525\\\", expected f64"),
            ("525 525 319.5 239.5", "a camera matrix must have 9 numbers, got 4"),
            ("525 1 319.5\n0 525 239.5\n0 0 1", "must be without skew, 0 beside fx and fy, got 1 0"),
            ("525 0 319.5\n0 525 239.5\n0 1 1", "last row must be 0 0 1, got 0 1 1"),
            ("525 0 0\n0 525 0\n319.5 239.5 1", "got 319.5 239.5 1: is it transposed? rows come first"),
            ("525 0 319.5 0\n0 525 239.5 0\n0 0 1 0", "a camera matrix must have 9 numbers, got 12"),
        ];
        for (text, expected) in cases {
            let said = message(text);
            assert!(said.contains(expected) && said.len() < 600, "{said}\n{text}");
        }
        assert!(message(&"0 ".repeat(600_000)).ends_with("at most 1048576 bytes, got 1200000"));
        assert!(read_intrinsics(b"\xff\xfe1\0").unwrap_err().to_string().contains("UTF-8"));
        assert!(message(&"[".repeat(1 << 20)).starts_with("a camera matrix must have 9 numbers, got 0"));
        for deep in [format!("[x{}", "[".repeat(1 << 19)), format!("a = {}", "[".repeat(1 << 19))] {
            assert!(message(&deep).contains("got no TOML"));
        }
        assert!(message(&format!("{{\"a\":{}", "[".repeat(1 << 19))).starts_with("not JSON"));
    }
}
