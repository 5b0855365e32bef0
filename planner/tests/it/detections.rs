//! Detections against VGN's procedure in scipy (`lab/golden_planning.py`).

use std::path::{Path, PathBuf};

use planner::BuiltIn;
use planner::voxel::detect::{Side, detect};
use schema::Grid;
use serde_json::Value;

const VOXELS: usize = 64_000;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden")
}

fn real(value: &Value) -> f32 {
    value.as_f64().unwrap() as f32
}

fn whole(value: &Value) -> usize {
    usize::try_from(value.as_u64().unwrap()).unwrap()
}

/// FNV-1a over little-endian values, as the script has it.
fn hash(values: &[f32]) -> String {
    let bytes = values.iter().flat_map(|value| value.to_le_bytes());
    let sum = bytes.fold(0xcbf2_9ce4_8422_2325_u64, |h, byte| (h ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3));
    format!("{sum:016x}")
}

#[test]
fn detections_are_those_of_vgns_procedure_in_scipy() {
    let golden: Value =
        serde_json::from_str(&std::fs::read_to_string(folder().join("detections.json")).unwrap()).unwrap();
    let params = BuiltIn::Vgn.config().unwrap().detection;
    let volumes = golden["volumes"].as_array().unwrap();
    assert!(volumes.len() >= 6);
    for volume in volumes {
        let name = volume["name"].as_str().unwrap();
        let bytes = std::fs::read(folder().join(volume["file"].as_str().unwrap())).unwrap();
        let scaled = |part: usize, scale: &dyn Fn(f32) -> f32| -> Vec<f32> {
            bytes[part * VOXELS..][..VOXELS].iter().map(|byte| scale(f32::from(*byte))).collect()
        };
        let (divisor, width_step) = (real(&volume["divisor"]), real(&volume["width_step"]));
        let [quality, tsdf] = [0, 1].map(|part| scaled(part, &|byte| byte / divisor));
        let width = scaled(2, &|byte| byte * width_step);
        let detected = detect(&Grid::PAPER, &tsdf, &quality, &width, Side::Front, &params);
        for probe in volume["smooth_probes"].as_array().unwrap() {
            let (at, expected) = (whole(&probe[0]), real(&probe[1]));
            assert_eq!(detected.smoothed[at].to_bits(), expected.to_bits(), "{name}: smoothed voxel {at}");
        }
        assert_eq!(hash(&detected.smoothed), volume["smooth_fnv1a"].as_str().unwrap(), "{name}");
        assert_eq!(detected.near_surface, whole(&volume["near_surface"]), "{name}");
        assert_eq!(detected.quality_reached, whole(&volume["width_fits"]), "{name}");
        let found: Vec<([usize; 3], f32)> = detected.found.iter().map(|found| (found.voxel, found.quality)).collect();
        let expected: Vec<([usize; 3], f32)> = volume["detections"]
            .as_array()
            .unwrap()
            .iter()
            .map(|one| ([whole(&one[0]), whole(&one[1]), whole(&one[2])], real(&one[3])))
            .collect();
        assert!(found == expected, "{name}: {} detections, expected {}", found.len(), expected.len());
    }
}
