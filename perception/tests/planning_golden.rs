//! Planes and clusters against numpy's SVD and scikit-learn's DBSCAN (`lab/golden_planning.py`).
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};

use perception::{ClusterParams, PlaneParams, clusters, find_plane};
use schema::{Purpose, Stream, Vec3};
use serde_json::Value;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden")
}

fn golden() -> Value {
    serde_json::from_str(&std::fs::read_to_string(folder().join("perception.json")).unwrap()).unwrap()
}

/// A file's numbers.
fn numbers(case: &Value) -> Vec<i16> {
    let bytes = std::fs::read(folder().join(case["file"].as_str().unwrap())).unwrap();
    bytes.as_chunks::<2>().0.iter().map(|pair| i16::from_le_bytes(*pair)).collect()
}

fn points(numbers: &[i16]) -> Vec<Vec3> {
    numbers.as_chunks::<3>().0.iter().map(|xyz| Vec3::from_array(xyz.map(|x| f32::from(x) * 1e-4))).collect()
}

fn whole(value: &Value) -> usize {
    usize::try_from(value.as_u64().unwrap()).unwrap()
}

#[test]
fn clusters_are_scikit_learns() {
    let golden = golden();
    for case in golden["clusters"].as_array().unwrap() {
        let (numbers, count) = (numbers(case), whole(&case["points"]));
        let points = points(&numbers[..3 * count]);
        for (number, result) in case["results"].as_array().unwrap().iter().enumerate() {
            let expected: Vec<Option<usize>> =
                numbers[(3 + number) * count..][..count].iter().map(|label| usize::try_from(*label).ok()).collect();
            let params = ClusterParams {
                radius_m: result["eps_m"].as_f64().unwrap() as f32,
                points_min: whole(&result["min_points"]),
                cluster_points_min: 0,
            };
            assert_eq!(expected.iter().filter(|label| label.is_none()).count(), whole(&result["noise"]));
            assert!(clusters(&points, &params) == expected, "{} with {params:?}", case["name"]);
        }
    }
}

#[test]
fn planes_are_numpys() {
    let golden = golden();
    for case in golden["planes"].as_array().unwrap() {
        let points = points(&numbers(case));
        for seed in 0..10 {
            let params = PlaneParams { tilt_rad_max: 1.5, ..PlaneParams::PAPER };
            let found = find_plane(&points, &params, &mut Stream::new(seed, 0, Purpose::Plane, 0)).unwrap();
            assert_eq!(found.inliers.len(), whole(&case["inliers"]), "{}, seed {seed}", case["name"]);
            let expected: Vec<f32> =
                case["normal"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap() as f32).collect();
            // Upwards here, on the objects' side there; one cloud is in a camera's frame.
            let expected = Vec3::from_slice(&expected);
            let sign = expected.z.signum();
            let off = (found.plane.normal - expected * sign).length();
            assert!(off < 1e-6, "{}: the normal is off by {off}", case["name"]);
            let offset_m = sign * case["offset_m"].as_f64().unwrap() as f32;
            assert!((found.plane.offset_m - offset_m).abs() < 1e-7, "{}: {:?}", case["name"], found.plane);
        }
    }
}
