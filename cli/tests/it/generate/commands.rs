//! `repeat`.

use std::path::Path;
use std::process::Command;

use generator::{Config, make_scene};
use schema::{Outcome, SceneRows};

use super::{check_ok, run, small, small_config, workshop};

pub(crate) fn program(arguments: &[&str], dir: &Path) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_generator")).current_dir(dir).args(arguments).output().unwrap()
}

/// A dataset of which `lie` changes every scene's rows before they are written.
pub(crate) fn lying_dataset(config: &Config, at: &Path, mut lie: impl FnMut(&mut SceneRows)) {
    let info = config.dataset_info();
    let draft = shards::Draft::begin(at, &info).unwrap();
    for shard in 0..info.shard_count {
        let mut writer = draft.shard(shard).unwrap();
        for scene_id in info.scenes_of(shard) {
            let mut rows = make_scene(config, scene_id, info.attempts_of_scene(scene_id)).unwrap();
            lie(&mut rows);
            writer.push(&rows).unwrap();
        }
        writer.commit().unwrap();
    }
    draft.finalize().unwrap();
}

#[test]
fn attempts_executed_again_end_as_stored_and_a_lie_is_found() {
    let dir = workshop(&small_config());
    check_ok(&run(&dir, "ds", &[]));
    assert!(check_ok(&program(&["repeat", "ds"], dir.path())).starts_with("70 attempts executed again"));
    let by_rapier = check_ok(&program(&["repeat", "ds", "--engine", "rapier"], dir.path()));
    assert!(by_rapier.starts_with("70 attempts executed again"), "{by_rapier}");
    assert!(check_ok(&program(&["repeat", "ds", "--scenes", "2"], dir.path())).starts_with("24 attempts"));
    let missing = program(&["repeat", "nowhere"], dir.path());
    assert_eq!(missing.status.code(), Some(78), "{missing:?}");
    assert!(String::from_utf8_lossy(&missing.stderr).contains("no dataset here"));

    // A dataset in which one held attempt is stored as slipped.
    let config = small();
    let mut has_lied = false;
    lying_dataset(&config, &dir.path().join("lying"), |rows| {
        if let Some(held) = rows.attempts.iter_mut().find(|a| !has_lied && a.outcome == Outcome::Held) {
            held.outcome = Outcome::Slipped;
            has_lied = true;
        }
    });
    let found = program(&["repeat", "lying"], dir.path());
    assert_eq!(found.status.code(), Some(65), "{found:?}");
    let text = String::from_utf8_lossy(&found.stdout);
    assert!(text.contains("1 end otherwise than stored") && text.contains("stored slipped, now held"), "{text}");
    let browse = ["dataset", "browse", "lying", "--out", "pages"];
    let browsed = Command::new(env!("CARGO_BIN_EXE_graspmill")).current_dir(dir.path()).args(browse).output().unwrap();
    let said = String::from_utf8_lossy(&browsed.stderr);
    assert!(said.starts_with("1 of 70 replayed attempts end otherwise than stored: another version"), "{said}");
}
