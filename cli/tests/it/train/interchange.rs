//! Weights of other programs through the program: evaluated, or refused with what to do.

use std::fs;
use std::path::Path;

use network::checkpoint::{self, Checkpoint, Progress};
use network::layers::{initial_vector, parameter_slots};
use network::upsampling::Upsampling;
use network::{Architecture, VoxelParams};
use safetensors::Dtype;
use safetensors::tensor::TensorView;

use super::fixture::{check_fails, trainer, write_dataset};

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A checkpoint as `graspmill.torch` writes it.
#[test]
fn weights_of_others_are_evaluated_on_all_samples_and_nothing_is_held_out() {
    let dir = tempfile::tempdir().unwrap();
    let (model, data) = (dir.path().join("net.safetensors"), dir.path().join("data"));
    let made = Checkpoint {
        vector: initial_vector(1),
        architecture: Architecture::Voxel(VoxelParams::at_tips(Upsampling::Linear)),
        config: "# Trained with PyTorch.\n".to_owned(),
        dataset_id: "unknown (imported weights)".to_owned(),
        progress: Progress::default(),
        moments: None,
    };
    checkpoint::save(&made, &model).unwrap();
    write_dataset(&data, 1, 2, 4, 6);
    let args = ["evaluate", "--model", text(&model), "--data", text(&data)];
    let output = trainer(&[&args[..], &["--split", "all"]].concat());
    let report = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(report.contains("epoch 0, step 0") && report.contains("all: 24 samples"), "{report}");
    for split in ["test-attempts", "test-scenes"] {
        let args = [&args[..], &["--split", split]].concat();
        check_fails(&args, 78, &["another dataset, unknown (imported weights)", "--split all"]);
    }
}

#[test]
fn a_state_dict_is_no_checkpoint_and_what_makes_one_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let (model, zeros) = (dir.path().join("weights.safetensors"), vec![0; 1 << 20]);
    let slots = parameter_slots();
    let tensors = slots
        .iter()
        .map(|slot| (&slot.name, TensorView::new(Dtype::F32, slot.shape.clone(), &zeros[..4 * slot.len]).unwrap()));
    fs::write(&model, safetensors::serialize(tensors, None).unwrap()).unwrap();
    let args = ["evaluate", "--model", text(&model), "--data", text(dir.path())];
    check_fails(&args, 65, &["not a checkpoint of trainer", "graspmill.torch.VoxelNetwork.load(FILE).save(NEW)"]);
}

#[test]
fn export_says_who_does_it() {
    for words in [&["export", "net.safetensors", "--format", "onnx", "--out", "x"][..], &["export", "--help"]] {
        check_fails(words, 2, &["the program of the Python package writes ONNX", "pip install graspmill[onnx]"]);
    }
}
