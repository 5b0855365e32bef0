//! Datasets with containers or with repeated attempts: what only they have comes back, and all other datasets stay as
//! they are.

use schema::{Container, ContainerKind, HitKind, Outcome};
use shards::{Dataset, DatasetInfo, Draft, Finalized, verify};

use crate::synthetic;

fn info() -> DatasetInfo {
    let mut info = synthetic::info(3, 2, 580, 60);
    info.grid.resolution = 8;
    info.config["container"] = serde_json::json!([{"kind": "bin", "share": 0.5}]);
    info.format_version = 4;
    info
}

#[test]
fn a_scene_says_what_its_objects_lie_in() {
    for several in [false, true] {
        let dir = tempfile::tempdir().unwrap();
        let mut info = info();
        if several {
            let other = schema::Gripper { name: "other".to_owned(), ..info.gripper.clone() };
            info.grippers = vec![info.gripper.clone(), other];
        }
        let rows = |scene: u64| {
            let mut rows = synthetic::scene_rows(scene, info.seed, &info);
            let has_container = rows.scene.container.is_some();
            let hit = rows.attempts.iter_mut().find(|a| a.hit == Some(HitKind::Table) && has_container);
            hit.into_iter().for_each(|attempt| attempt.hit = Some(HitKind::Container));
            rows
        };
        let draft = Draft::begin(dir.path(), &info).unwrap();
        for shard in 0..info.shard_count {
            let mut writer = draft.shard(shard).unwrap();
            info.scenes_of(shard).for_each(|scene| writer.push(&rows(scene)).unwrap());
            writer.commit().unwrap();
        }
        assert!(matches!(draft.finalize().unwrap(), Finalized::Complete(_)));
        let verified = verify(dir.path(), |_| ()).unwrap();
        assert!(verified.is_ok(), "{:?}", verified.problems);
        let dataset = Dataset::open(dir.path()).unwrap();
        assert_eq!(dataset.info().format_version, 4);
        let read: Vec<_> = (0..info.scene_count).map(|scene| dataset.read_scene(scene).unwrap()).collect();
        assert!(read.iter().zip(0..).all(|(read, scene)| *read == rows(scene)));
        let kinds: Vec<_> = read[..4].iter().map(|rows| rows.scene.container.map(|it| it.kind)).collect();
        assert_eq!(kinds, [Some(ContainerKind::Bin), Some(ContainerKind::Tray), Some(ContainerKind::Shelf), None]);
        assert!(read.iter().flat_map(|rows| &rows.attempts).any(|a| a.hit == Some(HitKind::Container)));
    }
}

/// Datasets whose attempts were repeated have one column more, and no other dataset has it.
#[test]
fn an_attempt_says_how_robust_it_was() {
    let dir = tempfile::tempdir().unwrap();
    let mut info = synthetic::info(3, 1, 120, 60);
    info.grid.resolution = 8;
    info.config["robustness"] = serde_json::json!({"share": 1.0});
    info.format_version = 5;
    let rows = |scene: u64| synthetic::scene_rows(scene, info.seed, &info);
    let draft = Draft::begin(dir.path(), &info).unwrap();
    let mut writer = draft.shard(0).unwrap();
    (0..info.scene_count).for_each(|scene| writer.push(&rows(scene)).unwrap());
    writer.commit().unwrap();
    assert!(matches!(draft.finalize().unwrap(), Finalized::Complete(_)));
    assert!(verify(dir.path(), |_| ()).unwrap().is_ok());
    let dataset = Dataset::open(dir.path()).unwrap();
    let read: Vec<_> = (0..info.scene_count).map(|scene| dataset.read_scene(scene).unwrap()).collect();
    assert!(read.iter().zip(0..).all(|(read, scene)| *read == rows(scene)));
    let robust = read.iter().flat_map(|rows| &rows.attempts).filter(|attempt| attempt.robustness.is_some());
    assert!(robust.count() > 10);
    // What did not hold was not repeated.
    let refused = |robustness: f32, label: u8| {
        let mut wrong = rows(0);
        let attempt = wrong.attempts.iter_mut().find(|attempt| attempt.label() == label).unwrap();
        attempt.robustness = Some(robustness);
        let other = tempfile::tempdir().unwrap();
        let draft = Draft::begin(other.path(), &info).unwrap();
        draft.shard(0).unwrap().push(&wrong).unwrap_err().to_string()
    };
    assert!(refused(0.5, 0).contains("robustness must be absent for "));
    assert!(refused(1.5, 1).contains("robustness must be between 0 and 1, got 1.5"));
}

#[test]
fn containers_that_cannot_be_are_refused() {
    let refused = |info: &DatasetInfo, container: Option<Container>, hit: Option<HitKind>| {
        let dir = tempfile::tempdir().unwrap();
        let mut rows = synthetic::scene_rows(0, info.seed, info);
        rows.scene.container = container;
        if let Some(attempt) = rows.attempts.iter_mut().find(|a| a.outcome == Outcome::PregraspCollision) {
            (attempt.hit, attempt.hit_object_id) = (hit, None);
        }
        Draft::begin(dir.path(), info).unwrap().shard(0).unwrap().push(&rows).unwrap_err().to_string()
    };
    let bin = synthetic::scene_rows(0, 3, &info()).scene.container.unwrap();
    let table = Some(HitKind::Table);
    let wide = Container { inner_m: [0.4, 0.2], ..bin };
    assert!(refused(&info(), Some(wide), table).contains("must fit into a workspace"));
    assert!(refused(&info(), Some(Container { height_m: f32::NAN, ..bin }), table).contains("height_m"));
    assert!(refused(&info(), None, Some(HitKind::Container)).contains("hit a container that is not there"));
    let plain = DatasetInfo { config: serde_json::json!({}), format_version: 1, ..info() };
    assert!(refused(&plain, Some(bin), table).contains("must have no container"));
    let mut old = info();
    old.format_version = 1;
    let told = DatasetInfo::from_json(old.to_json()).unwrap_err();
    assert!(told.contains("format_version must be 4, the lowest that"), "{told}");
}
