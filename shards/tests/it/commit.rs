//! When a shard exists, what may be written where, and what a writer refuses.

use std::fs;

use program::ExitCode;
use schema::{HitKind, Outcome, Quat, SceneRows, pose_from_parts};
use shards::{Dataset, Draft, Finalized, layout};

use crate::sample;

#[test]
fn a_shard_counts_when_its_marker_and_files_are_there() {
    let dir = tempfile::tempdir().unwrap();
    let info = sample::info(1);
    let draft = Draft::begin(dir.path(), &info).unwrap();
    assert!(!draft.is_committed(1).unwrap());
    sample::write_shard(&draft, 1);
    assert!(draft.is_committed(1).unwrap());
    assert_eq!(draft.finalize().unwrap(), Finalized::Incomplete { missing: vec![0] });
    let error = Dataset::open(dir.path()).unwrap_err();
    assert_eq!(error.exit_code(), ExitCode::Incomplete, "{error}");
    assert!(Draft::begin(dir.path(), &sample::info(2)).is_err(), "another seed is another dataset");

    let file = dir.path().join(layout::table_file(shards::Table::Objects, 1, 2));
    let whole = fs::read(&file).unwrap();
    fs::write(&file, &whole[1..]).unwrap();
    assert!(!draft.is_committed(1).unwrap(), "a file of another size does not count");
    sample::write_shard(&draft, 1);
    assert_eq!(fs::read(&file).unwrap(), whole, "writing it again mends it");

    fs::write(dir.path().join(layout::marker(1)), "{").unwrap();
    assert!(!draft.is_committed(1).unwrap());
    sample::write_shard(&draft, 1);
    assert!(draft.is_committed(1).unwrap(), "a broken marker is replaced");
}

#[test]
fn a_shard_that_comes_out_differently_is_refused_and_the_first_one_kept() {
    let dir = tempfile::tempdir().unwrap();
    let info = sample::info(1);
    let draft = Draft::begin(dir.path(), &info).unwrap();
    sample::write_shard(&draft, 0);
    let before = sample::files(dir.path());
    let mut writer = draft.shard(0).unwrap();
    for mut rows in sample::rows(&info, 0) {
        rows.scene.settle_time_s += 1e-3;
        writer.push(&rows).unwrap();
    }
    let error = writer.commit().unwrap_err();
    assert_eq!(error.exit_code(), ExitCode::Data);
    assert!(error.to_string().starts_with("shard 0 came out differently"), "{error}");
    assert_eq!(sample::files(dir.path()), before);
}

#[test]
fn completing_again_keeps_what_is_there_and_mends_what_is_damaged() {
    let dir = tempfile::tempdir().unwrap();
    let info = sample::info(1);
    sample::write(dir.path(), &info);
    let before = sample::files(dir.path());
    let draft = Draft::open(dir.path()).unwrap();
    let path = |name: &str| dir.path().join(name);
    for name in [layout::MANIFEST, layout::CARD, layout::SUCCESS] {
        fs::remove_file(path(name)).unwrap();
    }
    draft.finalize().unwrap();
    assert_eq!(sample::files(dir.path()), before);
    fs::write(path(layout::MANIFEST), "{").unwrap();
    draft.finalize().unwrap();
    assert_eq!(sample::files(dir.path()), before, "a damaged manifest is written again");

    fs::write(path(layout::CARD), "my own words").unwrap();
    draft.finalize().unwrap();
    assert_eq!(fs::read_to_string(path(layout::CARD)).unwrap(), "my own words");

    let other = tempfile::tempdir().unwrap();
    sample::write(other.path(), &sample::info(2));
    fs::copy(other.path().join(layout::MANIFEST), path(layout::MANIFEST)).unwrap();
    let error = draft.finalize().unwrap_err();
    assert!(error.to_string().contains("not what the markers make it"), "{error}");
    assert_eq!(error.exit_code(), ExitCode::Data);
}

#[test]
fn what_is_missing_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let info = sample::sized(1, 4, 60, 6);
    let draft = Draft::begin(dir.path(), &info).unwrap();
    for shard in [1, 3] {
        sample::write_shard(&draft, shard);
    }
    assert_eq!((draft.missing().unwrap(), draft.unmarked().unwrap()), (vec![0, 2], vec![0, 2]));
    fs::write(dir.path().join(layout::table_file(shards::Table::Scenes, 3, 4)), "short").unwrap();
    assert_eq!((draft.missing().unwrap(), draft.unmarked().unwrap()), (vec![0, 2, 3], vec![0, 2]));
}

#[test]
fn a_writer_whose_dataset_was_replaced_leaves_the_new_one_alone() {
    let dir = tempfile::tempdir().unwrap();
    let old = Draft::begin(dir.path(), &sample::info(1)).unwrap();
    let mut writer = old.shard(0).unwrap();
    for rows in sample::rows(old.info(), 0) {
        writer.push(&rows).unwrap();
    }
    for name in ["attempts", "scenes", "objects", "meta"] {
        fs::remove_dir_all(dir.path().join(name)).unwrap();
    }
    Draft::begin(dir.path(), &sample::info(2)).unwrap();
    let before = sample::files(dir.path());
    let error = writer.commit().unwrap_err();
    assert_eq!(error.exit_code(), ExitCode::Config, "{error}");
    assert_eq!(sample::files(dir.path()), before);
}

#[test]
fn a_shard_that_is_there_is_not_written_again() {
    let dir = tempfile::tempdir().unwrap();
    let draft = Draft::begin(dir.path(), &sample::info(1)).unwrap();
    sample::write_shard(&draft, 0);
    let time = |table| fs::metadata(dir.path().join(layout::table_file(table, 0, 2))).unwrap().modified().unwrap();
    let damaged = dir.path().join(layout::table_file(shards::Table::Objects, 0, 2));
    let (whole, before) = (fs::read(&damaged).unwrap(), time(shards::Table::Attempts));
    fs::write(&damaged, "damaged").unwrap();
    sample::write_shard(&draft, 0);
    assert_eq!(fs::read(&damaged).unwrap(), whole, "what is damaged is mended");
    assert_eq!(time(shards::Table::Attempts), before, "what is right stays");
}

#[test]
fn a_damaged_info_is_damage_and_no_other_dataset() {
    let dir = tempfile::tempdir().unwrap();
    Draft::begin(dir.path(), &sample::info(1)).unwrap();
    fs::write(dir.path().join(layout::INFO), "{").unwrap();
    assert_eq!(Draft::begin(dir.path(), &sample::info(1)).unwrap_err().exit_code(), ExitCode::Data);
    assert_eq!(Draft::open(dir.path()).unwrap_err().exit_code(), ExitCode::Data);
}

#[test]
fn a_writer_that_stops_leaves_nothing_that_counts() {
    let dir = tempfile::tempdir().unwrap();
    let info = sample::info(1);
    let draft = Draft::begin(dir.path(), &info).unwrap();
    let before = sample::files(dir.path());
    let mut writer = draft.shard(0).unwrap();
    writer.push(&sample::rows(&info, 0)[0]).unwrap();
    let error = writer.commit().unwrap_err();
    assert_eq!(error.to_string(), "shard 0 must go on with scene 1 of 0..5, got the end");
    assert_eq!(sample::files(dir.path()), before);
}

#[test]
fn scenes_out_of_order_and_shards_out_of_range_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let info = sample::info(1);
    let draft = Draft::begin(dir.path(), &info).unwrap();
    let error = draft.shard(2).unwrap_err();
    assert_eq!((error.to_string().as_str(), error.exit_code()), ("shard must be below 2, got 2", ExitCode::Config));
    let mut writer = draft.shard(1).unwrap();
    let rows = sample::rows(&info, 1);
    let error = writer.push(&rows[1]).unwrap_err();
    assert_eq!(error.to_string(), "shard 1 must go on with scene 5 of 5..10, got scene 6");
    writer.push(&rows[0]).unwrap();
    assert!(writer.push(&rows[0]).is_err(), "a scene comes once");
}

/// Breaks one thing in a scene; the writer must refuse it and name the rule.
fn check_refused(edit: impl FnOnce(&mut SceneRows), rule: &str) {
    let dir = tempfile::tempdir().unwrap();
    let info = sample::info(1);
    let draft = Draft::begin(dir.path(), &info).unwrap();
    let mut rows = sample::rows(&info, 0).remove(0);
    edit(&mut rows);
    let error = draft.shard(0).unwrap().push(&rows).unwrap_err();
    assert_eq!(error.exit_code(), ExitCode::Internal);
    let message = error.to_string();
    assert!(message.starts_with("shard 0, scene 0: ") && message.contains(rule), "{message} does not name {rule}");
}

#[test]
fn rows_that_break_a_rule_are_refused_before_they_are_written() {
    check_refused(
        |r| r.attempts[2].workspace_from_grasp.rotation = Quat::from_xyzw(0.0, 0.0, 0.0, 1.01),
        "attempt 2 quaternion must have length 1",
    );
    check_refused(|r| r.attempts[0].tilt_rad = f32::NAN, "tilt_rad must be between");
    check_refused(|r| r.attempts[1].attempt_id = 7, "attempt ids must count up");
    check_refused(|r| r.attempts[1].object_id = 99, "attempt 1 has no target");
    check_refused(|r| r.attempts[1].closing = r.attempts[1].rule.approach.axis(), "must close across its approach");
    check_refused(
        |r| {
            r.attempts[0].outcome = Outcome::Held;
            r.attempts[0].hit = Some(HitKind::Table);
            r.attempts[0].width_m = Some(0.03);
        },
        "hit must be absent for held",
    );
    check_refused(
        |r| {
            r.attempts[0].outcome = Outcome::Held;
            r.attempts[0].width_m = Some(0.5);
        },
        "width_m must be between",
    );
    check_refused(|r| r.objects[0].mass_kg = 0.0, "mass_kg must be between");
    check_refused(
        |r| {
            let turned = Quat::from_xyzw(1.0, 1.0, 0.0, 0.0);
            let place = r.objects[0].workspace_from_object.translation;
            r.objects[0].workspace_from_object = pose_from_parts(turned, place);
        },
        "object 0 quaternion",
    );
    check_refused(|r| r.scene.tsdf[3] = 1.5, "tsdf must be 0 or between 0.0099 and 0.9901, got 1.5 at value 3");
    check_refused(|r| r.scene.tsdf.truncate(5), "tsdf must have 512 values, got 5");
    check_refused(|r| r.scene.object_count += 1, "object_count must be");
    check_refused(|r| r.scene.views.clear(), "between 1 and 256 views");
    check_refused(
        |r| {
            r.attempts.pop();
        },
        "attempt_count must be",
    );
}
