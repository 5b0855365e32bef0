//! Files of PyTorch's `torch.save` (`scripts/state_dicts_torch.py`) hold the values that the script put there.

use half::f16;
use network::checkpoint;
use network::interchange::{GivenParams, IMPORTED, Imported, Source, Target, export, import};
use network::layers::parameter_slots;
use network::upsampling::Upsampling;
use network::{Architecture, GraspOrigin, VoxelParams};

use crate::formula::noise;

const NUMBERS: usize = 2048;
const OFFSET: usize = 11;

fn imported(name: &str, folder: &std::path::Path) -> Imported {
    let file = format!("{}/../network/tests/state_dicts/{name}.pth", env!("CARGO_MANIFEST_DIR"));
    import(file.as_ref(), &folder.join(name), GivenParams::default(), false).unwrap()
}

/// The script's tensors: strided windows of the storages of weights and biases.
fn expected(weights: &[f32], biases: &[f32]) -> Vec<f32> {
    let mut values = Vec::new();
    for (number, slot) in parameter_slots().into_iter().enumerate() {
        let (storage, strides) = match slot.shape.len() {
            5 => (weights, &[13, 5, 3, 2, 1][..]),
            _ => (biases, &[29][..]),
        };
        for flat in 0..slot.len {
            let (mut rest, mut at) = (flat, OFFSET * number);
            for (len, stride) in slot.shape.iter().zip(strides).rev() {
                at += rest % len * stride;
                rest /= len;
            }
            values.push(storage[at]);
        }
    }
    values
}

fn storage(seed: u32) -> Vec<f32> {
    noise(NUMBERS, seed).into_iter().map(|draw| (draw - 0.5) as f32).collect()
}

#[test]
fn new_and_old_files_hold_the_same_values() {
    let folder = tempfile::tempdir().unwrap();
    let expected = expected(&storage(700), &storage(700));
    for (name, source) in [("zip", Source::TorchZip), ("legacy", Source::TorchLegacy)] {
        let imported = imported(name, folder.path());
        assert_eq!((imported.source, imported.prefix.as_str()), (source, ""));
        assert!(imported.converted_from.is_empty());
        assert!(imported.checkpoint.vector == expected, "{name}");
        let read = checkpoint::read(&folder.path().join(name)).unwrap();
        assert!(read.vector == expected, "{name}");
        assert_eq!(
            (read.dataset_id.as_str(), &read.architecture),
            (IMPORTED, &Architecture::Voxel(VoxelParams { upsampling: Upsampling::Nearest, origin: GraspOrigin::VGN }))
        );
        assert!(read.config.contains(&format!("file = \"{name}.pth\"")), "{}", read.config);
        assert!(read.config.parse::<toml::Table>().unwrap().contains_key("imported"));
    }
}

#[test]
fn a_training_scripts_file_of_other_numbers_is_found_and_converted() {
    let folder = tempfile::tempdir().unwrap();
    let imported = imported("nested", folder.path());
    assert_eq!((imported.source, imported.prefix.as_str()), (Source::TorchZip, "module."));
    assert_eq!(imported.converted_from, ["float16", "float64"]);
    let halves: Vec<f32> = storage(702).into_iter().map(|value| f16::from_f32(value).to_f32()).collect();
    assert!(imported.checkpoint.vector == expected(&storage(701), &halves));
}

#[test]
fn an_exported_checkpoint_is_one_without_moments() {
    let folder = tempfile::tempdir().unwrap();
    let imported = imported("zip", folder.path());
    let out = folder.path().join("deeper/plain.safetensors");
    export(&folder.path().join("zip"), &out, Target::Safetensors, false).unwrap();
    let read = checkpoint::read(&out).unwrap();
    assert!(read.vector == imported.checkpoint.vector);
    assert!(read.moments.is_none());
    let bytes = std::fs::read(&out).unwrap();
    let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let (mut names, mut slots) = (file.names(), parameter_slots());
    names.sort_unstable();
    slots.sort_by(|a, b| a.name.cmp(&b.name));
    assert!(names.into_iter().eq(slots.iter().map(|slot| slot.name.as_str())));
}
