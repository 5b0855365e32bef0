//! Weights of other programs through the program: imported, evaluated, exported, refused.

use std::fs;
use std::path::{Path, PathBuf};

use safetensors::Dtype;
use safetensors::tensor::TensorView;

use super::fixture::{check_fails, trainer, write_dataset};

/// A safetensors file of every parameter, all of them `value`.
fn state_dict(dir: &Path, value: f32) -> String {
    let path = dir.join(format!("all-{value}.safetensors"));
    fs::write(&path, weights("", Dtype::F32, &value.to_le_bytes())).unwrap();
    text(&path).to_owned()
}

/// The bytes of such a file, of another number type, with names under a prefix.
fn weights(prefix: &str, dtype: Dtype, value: &[u8]) -> Vec<u8> {
    let data = value.repeat(1 << 18);
    let slots = network::layers::parameter_slots();
    let tensors = slots.iter().map(|slot| {
        let own = &data[..value.len() * slot.len];
        (format!("{prefix}{}", slot.name), TensorView::new(dtype, slot.shape.clone(), own).unwrap())
    });
    safetensors::serialize(tensors, None).unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn succeeds(args: &[&str]) -> String {
    let output = trainer(args);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn imported(dir: &Path) -> PathBuf {
    let path = dir.join("run/best.safetensors");
    let origin = ["--origin-behind-tips-m", "0", "--voxel-offset", "0.5"];
    succeeds(&[&["import", &state_dict(dir, 0.01), "--out", text(&path)], &origin[..]].concat());
    path
}

#[test]
fn imported_weights_are_evaluated_on_all_samples_and_nothing_is_held_out() {
    let dir = tempfile::tempdir().unwrap();
    imported(dir.path());
    let (run, data) = (dir.path().join("run"), dir.path().join("data"));
    write_dataset(&data, 1, 2, 4, 6);
    let args = ["evaluate", "--run", text(&run), "--data", text(&data)];
    let report = succeeds(&[&args[..], &["--split", "all"]].concat());
    assert!(report.contains("epoch 0, step 0") && report.contains("all: 24 samples"), "{report}");
    for split in ["test-attempts", "test-scenes"] {
        let args = [&args[..], &["--split", split]].concat();
        check_fails(&args, 78, &["another dataset, unknown (imported weights)", "--split all"]);
    }
}

#[test]
fn the_program_says_what_it_did() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("checkpoint");
    let said = succeeds(&["import", &state_dict(dir.path(), 0.01), "--upsampling", "linear", "--out", text(&out)]);
    assert!(said.contains("all-0.01.safetensors") && said.contains("upsampling  linear"), "{said}");
    let wrapped = dir.path().join("wrapped");
    fs::write(&wrapped, weights("module.", Dtype::F64, &0.01_f64.to_le_bytes())).unwrap();
    let said = succeeds(&["import", text(&wrapped), "--out", text(&out), "--force"]);
    assert!(said.contains("prefix \"module.\" removed") && said.contains("float64 converted to float32"), "{said}");
    let plain = dir.path().join("vgn.safetensors");
    let said = succeeds(&["export", text(&out), "--format", "safetensors", "--out", text(&plain)]);
    assert!(said.contains("upsampling  nearest"), "{said}");
    let bytes = fs::read(&plain).unwrap();
    succeeds(&["export", text(&out), "--format", "safetensors", "--out", text(&plain), "--force"]);
    assert!(fs::read(&plain).unwrap() == bytes, "the same checkpoint makes the same file");
    assert!(!String::from_utf8_lossy(&bytes).contains(text(dir.path())), "a file must not tell where it was made");
    let onnx = ["export", text(&out), "--format", "onnx", "--out", "vgn.onnx"];
    check_fails(&onnx, 2, &["the program of the Python package writes ONNX"]);
}

#[test]
fn a_file_that_is_there_stays_unless_forced() {
    let dir = tempfile::tempdir().unwrap();
    let checkpoint = imported(dir.path());
    let before = fs::read(&checkpoint).unwrap();
    let file = state_dict(dir.path(), 0.02);
    let args = ["import", &file, "--out", text(&checkpoint)];
    check_fails(&args, 78, &["there is a file already", "--force", "best.safetensors"]);
    let there = dir.path().join("thesis.tex");
    fs::write(&there, "\\section{Results}").unwrap();
    check_fails(&["export", text(&checkpoint), "--format", "safetensors", "--out", text(&there)], 78, &["thesis.tex"]);
    assert_eq!(fs::read(&there).unwrap(), b"\\section{Results}");
    assert!(fs::read(&checkpoint).unwrap() == before);
    succeeds(&[&args[..], &["--force"]].concat());
    assert!(fs::read(&checkpoint).unwrap() != before);
}

#[test]
fn what_is_no_state_dict_of_this_network_is_told_and_nothing_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let (out, file) = (dir.path().join("out/checkpoint"), dir.path().join("file"));
    let refused = |code, texts: &[&str]| {
        check_fails(&["import", text(&file), "--out", text(&out)], code, texts);
        assert!(!out.exists() && !dir.path().join("out").exists());
    };
    refused(78, &["no file here"]);
    fs::write(&file, "weights").unwrap();
    refused(78, &["it is no safetensors file"]);
    for of_pytorch in ["PK\x03\x04 a zip".as_bytes(), b"\x80\x02\x8a\nl\xfc"] {
        fs::write(&file, of_pytorch).unwrap();
        refused(78, &["graspmill.torch.VoxelNetwork.load(FILE)"]);
    }
    let whole = fs::read(state_dict(dir.path(), 0.01)).unwrap();
    fs::write(&file, &whole[..whole.len() - 100]).unwrap();
    refused(65, &["damaged weights"]);
    fs::write(&file, fs::read(state_dict(dir.path(), f32::NAN)).unwrap()).unwrap();
    refused(78, &["not finite in float32", "and 12 more"]);
    fs::File::create(&file).unwrap().set_len((64 << 20) + 1).unwrap();
    refused(78, &["more than 64 MiB"]);
    let view = |shape: Vec<usize>, data: &'static [u8]| TensorView::new(Dtype::F32, shape, data).unwrap();
    let tensors = [("encoder.conv1.bias", view(vec![1], &[0; 4])), ("mlp.weight", view(vec![2], &[0; 8]))];
    fs::write(&file, safetensors::serialize(tensors, None).unwrap()).unwrap();
    refused(78, &["another architecture", "encoder.conv1.bias must be F32 of shape [16], got F32 of shape [1]"]);
    let checkpoint = imported(dir.path());
    check_fails(&["import", text(&checkpoint), "--out", text(&out)], 78, &["a checkpoint of trainer already"]);
}

#[test]
fn only_a_checkpoint_is_exported() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let export = |file: &str, code, texts: &[&str]| {
        check_fails(&["export", file, "--format", "safetensors", "--out", text(&out)], code, texts);
        assert!(!out.exists());
    };
    export("/none.safetensors", 78, &["no checkpoint here"]);
    export(&state_dict(dir.path(), 0.01), 65, &["not a checkpoint of trainer"]);
    export(concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml"), 65, &["damaged checkpoint"]);
    check_fails(&["export", "x", "--out", "y"], 2, &["--format"]);
}
