//! The shipped networks match their card, and run.

use std::fs;
use std::path::{Path, PathBuf};

use network::Architecture;
use network::judge::Screen;
use sha2::{Digest, Sha256};

use super::fixture::{check_fails, trainer, write_dataset};

fn models() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models");
    let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    files.filter(|path| path.extension().is_some_and(|extension| extension == "safetensors")).collect()
}

#[test]
fn each_has_its_checksum_in_the_card_and_can_be_evaluated() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    write_dataset(&data, 7, 1, 2, 6);
    let models = models();
    assert!(!models.is_empty());
    for model in models {
        let digest = Sha256::digest(fs::read(&model).unwrap());
        let digest: String = digest.iter().map(|byte| format!("{byte:02x}")).collect();
        let card = fs::read_to_string(model.with_extension("md")).unwrap();
        assert!(card.contains(&digest), "{digest} is not in the card: {}", model.display());
        if model.ends_with("screen.safetensors") {
            // It chooses for a judge, and is no network to evaluate.
            assert!(Screen::from_bytes(&fs::read(&model).unwrap()).is_ok());
            continue;
        }
        let checkpoint = network::checkpoint::read(&model).unwrap();
        assert!(checkpoint.dataset_id.split('+').all(|id| card.contains(id)), "the card must name the datasets");
        let (model, data) = (model.to_str().unwrap(), data.to_str().unwrap());
        let args = ["evaluate", "--model", model, "--data", data, "--split", "all", "--json"];
        if let Architecture::Judge(scope) = &checkpoint.architecture
            && scope.grippers.is_none()
        {
            let own = &scope.gripper.name;
            // The dataset's gripper has another palm, and opens further than an SO-101.
            let key = if own == "parallel_jaw_80" { "palm_width_m must be" } else { "opening_m_max must be" };
            check_fails(&args, 78, &[&format!("trained for the gripper {own}, not for synthetic_80"), key]);
        } else {
            let output = trainer(&args);
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        }
    }
}
