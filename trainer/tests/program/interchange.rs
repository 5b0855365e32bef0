//! Weights of other programs through the program: imported, evaluated, exported, refused.

use std::fs;
use std::path::{Path, PathBuf};

use crate::fixture::{check_fails, trainer, write_dataset};

fn state_dict(name: &str) -> String {
    format!("{}/../network/tests/state_dicts/{name}.pth", env!("CARGO_MANIFEST_DIR"))
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
    succeeds(&[&["import", &state_dict("legacy"), "--out", text(&path)], &origin[..]].concat());
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
    assert!(report.contains("epoch 0, step 0") && report.contains("all samples: 24 samples"), "{report}");
    for split in ["test-attempts", "test-scenes"] {
        let args = [&args[..], &["--split", split]].concat();
        check_fails(&args, 78, &["another dataset, unknown (imported weights)", "--split all"]);
    }
}

#[test]
fn the_program_says_what_it_did() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("checkpoint");
    let said = succeeds(&["import", &state_dict("nested"), "--upsampling", "linear", "--out", text(&out)]);
    for words in ["PyTorch (zip)", "\"module.\"", "float16 and float64 converted to float32", "upsampling  linear"] {
        assert!(said.contains(words), "{words:?} is not in {said:?}");
    }
    let onnx = dir.path().join("vgn.onnx");
    let said = succeeds(&["export", text(&out), "--format", "onnx", "--out", text(&onnx)]);
    assert!(said.contains("upsampling  linear"), "{said}");
    let bytes = fs::read(&onnx).unwrap();
    succeeds(&["export", text(&out), "--format", "onnx", "--out", text(&onnx), "--force"]);
    assert!(fs::read(&onnx).unwrap() == bytes, "the same checkpoint makes the same file");
    assert!(!String::from_utf8_lossy(&bytes).contains(text(dir.path())), "a file must not tell where it was made");
}

#[test]
fn a_file_that_is_there_stays_unless_forced() {
    let dir = tempfile::tempdir().unwrap();
    let checkpoint = imported(dir.path());
    let before = fs::read(&checkpoint).unwrap();
    let file = state_dict("zip");
    let args = ["import", &file, "--out", text(&checkpoint)];
    check_fails(&args, 78, &["there is a file already", "--force", "best.safetensors"]);
    let there = dir.path().join("thesis.tex");
    fs::write(&there, "\\section{Results}").unwrap();
    check_fails(&["export", text(&checkpoint), "--format", "onnx", "--out", text(&there)], 78, &["thesis.tex"]);
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
    refused(78, &["neither torch.save nor safetensors"]);
    fs::copy(state_dict("whole_model"), &file).unwrap();
    refused(78, &["torch.nn.modules.conv.Conv3d", "torch.save(model.state_dict(), FILE)"]);
    let legacy = fs::read(state_dict("legacy")).unwrap();
    fs::write(&file, &legacy[..legacy.len() - 100]).unwrap();
    refused(65, &["damaged weights", "it ends at byte"]);
    fs::File::create(&file).unwrap().set_len((64 << 20) + 1).unwrap();
    refused(78, &["more than 64 MiB"]);
    let view = |shape: Vec<usize>, data: &'static [u8]| {
        safetensors::tensor::TensorView::new(safetensors::Dtype::F32, shape, data).unwrap()
    };
    let tensors = [("encoder.conv1.bias", view(vec![1], &[0; 4])), ("mlp.weight", view(vec![2], &[0; 8]))];
    fs::write(&file, safetensors::serialize(tensors, None).unwrap()).unwrap();
    refused(
        78,
        &["another architecture", "encoder.conv1.bias must be float32 of shape [16], got float32 of shape [1]"],
    );
    let checkpoint = imported(dir.path());
    check_fails(&["import", text(&checkpoint), "--out", text(&out)], 78, &["a checkpoint of trainer already"]);
}

#[test]
fn only_a_checkpoint_is_exported() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let export = |file: &str, code, texts: &[&str]| {
        check_fails(&["export", file, "--format", "onnx", "--out", text(&out)], code, texts);
        assert!(!out.exists());
    };
    export("/none.safetensors", 78, &["no checkpoint here"]);
    export(&state_dict("zip"), 65, &["damaged checkpoint"]);
    check_fails(&["export", "x", "--out", "y"], 2, &["--format"]);
}
