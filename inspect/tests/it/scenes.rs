//! Scenes for simulators: which are written, what is in their files, and equal bytes each time. Simulators themselves
//! read them in `tests/python/test_scene_exports.py`.

use std::fs;
use std::path::Path;

use inspect::{ExportFormat, Exported, SceneSelection, export};
use program::{ExitCode, Failure};
use shards::{Dataset, Location};

use crate::sample;

const FORMATS: [ExportFormat; 3] = [ExportFormat::Mjcf, ExportFormat::Urdf, ExportFormat::Usda];

/// 10 scenes in two shards; if asked, three of four have a container.
fn written(with_containers: bool) -> (tempfile::TempDir, Dataset) {
    let mut info = sample::info(7);
    if with_containers {
        info.config["container"] = serde_json::json!([{"kind": "bin", "share": 0.5}]);
        info.format_version = info.version();
    }
    let dir = tempfile::tempdir().unwrap();
    sample::write(dir.path(), &info);
    let dataset = Dataset::open(dir.path()).unwrap();
    (dir, dataset)
}

fn exported(dataset: &Dataset, format: ExportFormat, scenes: Option<&str>, out: &Path) -> Result<Exported, Failure> {
    let scenes: Option<SceneSelection> = scenes.map(|text| text.parse().unwrap());
    export(dataset, format, scenes.as_ref(), &Location::Path(out.to_owned()), |_| ())
}

fn numbers(value: &serde_json::Value) -> Vec<f32> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap() as f32).collect()
}

#[test]
fn a_scene_s_numbers_are_those_of_its_rows() {
    let (_dir, dataset) = written(true);
    let out = tempfile::tempdir().unwrap();
    let told = exported(&dataset, ExportFormat::Urdf, None, out.path()).unwrap();
    let info = dataset.info();
    assert_eq!((told.counts.scenes, told.counts.grasps), (info.scene_count, info.attempt_count));
    for rows in (0..2).flat_map(|shard| dataset.rows(shard).unwrap()) {
        let rows = rows.unwrap();
        let folder = out.path().join(format!("scene-{:09}", rows.scene.scene_id));
        let text = fs::read_to_string(folder.join("scene.json")).unwrap();
        let found: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(found["container"].is_null(), rows.scene.container.is_none());
        assert_eq!(folder.join("container.urdf").is_file(), rows.scene.container.is_some());
        assert_eq!(found["cameras"].as_array().unwrap().len(), rows.scene.views.len());
        assert_eq!(found["hand"]["name"], "synthetic_80");
        let objects = found["objects"].as_array().unwrap();
        assert_eq!(objects.len(), rows.objects.len());
        for (object, row) in objects.iter().zip(&rows.objects) {
            assert_eq!(object["shape"], row.shape.name());
            let pose = &row.workspace_from_object;
            let seven = [pose.translation.to_array().as_slice(), &pose.rotation.to_array()].concat();
            assert_eq!(numbers(&object["workspace_from_object"]), seven);
            assert_eq!(object["mass_kg"].as_f64().unwrap() as f32, row.mass_kg);
            assert!(folder.join(format!("{}.urdf", object["name"].as_str().unwrap())).is_file());
        }
        let attempts = found["attempts"].as_array().unwrap();
        assert_eq!(attempts.len(), rows.attempts.len());
        for (attempt, row) in attempts.iter().zip(&rows.attempts) {
            assert_eq!(attempt["outcome"], row.outcome.name());
            assert_eq!(attempt["object"], format!("object_{}", row.object_id));
        }
    }
}

#[test]
fn the_same_bytes_each_time_and_a_stopped_export_goes_on() {
    let (_dir, dataset) = written(true);
    for format in FORMATS {
        let (one, two) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let told = exported(&dataset, format, None, one.path()).unwrap();
        let files = sample::files(one.path());
        assert_eq!(exported(&dataset, format, None, one.path()).unwrap(), told, "a complete one is left as it is");
        exported(&dataset, format, None, two.path()).unwrap();
        assert_eq!(files, sample::files(two.path()));

        // As if it had been killed in the middle of scene 4.
        let origin = serde_json::to_vec_pretty(&told.origin).unwrap();
        fs::write(two.path().join("export-begun.json"), origin).unwrap();
        for name in ["export.json", "README.md"] {
            fs::remove_file(two.path().join(name)).unwrap();
        }
        fs::rename(two.path().join("scene-000000004"), two.path().join("scene-000000004.part")).unwrap();
        fs::write(two.path().join("scene-000000004.part/left.xml"), "half").unwrap();
        assert_eq!(exported(&dataset, format, None, two.path()).unwrap(), told);
        assert_eq!(files, sample::files(two.path()));
    }
}

#[test]
fn some_scenes_are_as_among_all() {
    let (_dir, dataset) = written(true);
    let (all, some) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    exported(&dataset, ExportFormat::Usda, None, all.path()).unwrap();
    let told = exported(&dataset, ExportFormat::Usda, Some("8,1-2"), some.path()).unwrap();
    assert_eq!((told.counts.scenes, told.origin.scenes.as_deref()), (3, Some("1-2,8")));
    let of_scenes = |path: &Path| -> Vec<_> {
        let files = sample::files(path).into_iter();
        files.filter(|(name, _)| ["1/", "2/", "8/"].iter().any(|n| name.to_string_lossy().contains(n))).collect()
    };
    assert_eq!(of_scenes(some.path()), of_scenes(all.path()));
    assert_eq!(of_scenes(some.path()).len() + 2, sample::files(some.path()).len(), "and README.md and export.json");
    let other = exported(&dataset, ExportFormat::Usda, Some("1-3"), some.path()).unwrap_err();
    assert_eq!(other.exit_code(), ExitCode::Config);
    assert!(other.to_string().contains("it holds an export as usda of scenes 1-2,8 of dataset"), "{other}");
}

#[test]
fn what_is_not_there_or_has_no_scenes_is_refused() {
    let (_dir, dataset) = written(false);
    let out = tempfile::tempdir().unwrap();
    for (format, scenes, told) in [
        (ExportFormat::Mjcf, "3-10", "scenes must be below the number of scenes, 10, got 10"),
        (ExportFormat::Parquet, "3", "scenes may be selected of mjcf, urdf and usda, got parquet"),
    ] {
        let refused = exported(&dataset, format, Some(scenes), out.path()).unwrap_err();
        assert_eq!((refused.exit_code(), refused.to_string().as_str()), (ExitCode::Config, told));
    }
    assert_eq!(sample::files(out.path()), []);
}
