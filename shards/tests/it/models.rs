//! Datasets of models: written data are read, and inconsistent infos and rows are refused.

use std::path::Path;
use std::sync::Arc;

use schema::{
    Approach, AttemptRecord, Model, ModelPart, ObjectShape, Rule, SceneRows, TriangleMesh, Vec3, along_normal,
};
use shards::{Dataset, DatasetInfo, Draft, Finalized, verify};

use crate::synthetic;

/// A wedge and a box, the latter of two parts.
fn models() -> Vec<Arc<Model>> {
    let wedge = [[-0.02, -0.03, -0.01], [0.02, -0.03, -0.01], [-0.02, 0.03, -0.01], [-0.02, -0.03, 0.01]];
    let half = |low: f32, high: f32| -> Vec<Vec3> {
        let corner = |c: usize| Vec3::new(if c & 1 == 0 { low } else { high }, side(c, 1), side(c, 2));
        (0..8).map(corner).collect()
    };
    let wedge = Model {
        name: "wedge".to_owned(),
        mass_kg: 0.1,
        friction: 0.8,
        extents_m: Vec3::new(0.04, 0.06, 0.02),
        volume_m3: 8e-6,
        parts: vec![ModelPart { corners_m: wedge.map(Vec3::from_array).to_vec() }],
        mesh: None,
    };
    let halves = Model {
        name: "halves".to_owned(),
        mass_kg: 0.2,
        friction: 0.7,
        extents_m: Vec3::new(0.06, 0.04, 0.04),
        volume_m3: 0.06 * 0.04 * 0.04,
        parts: [half(-0.03, 0.01), half(0.01, 0.03)].map(|corners_m| ModelPart { corners_m }).into(),
        mesh: None,
    };
    vec![Arc::new(wedge), Arc::new(halves)]
}

fn side(corner: usize, bit: usize) -> f32 {
    if corner >> bit & 1 == 0 { -0.02 } else { 0.02 }
}

fn info() -> DatasetInfo {
    let mut info = synthetic::info(3, 2, 58, 6);
    info.grid.resolution = 8;
    info.models = models();
    info.format_version = 2;
    info
}

/// Synthetic rows, with a model in place of every primitive.
fn rows(info: &DatasetInfo, scene: u64) -> SceneRows {
    let mut rows = synthetic::scene_rows(scene, info.seed, info);
    for object in &mut rows.objects {
        let number = (scene + u64::from(object.object_id)) as u16 % 2;
        let model = info.models[usize::from(number)].clone();
        (object.mass_kg, object.friction) = (model.mass_kg, model.friction);
        object.shape = ObjectShape::Model { number, model };
    }
    for attempt in &mut rows.attempts {
        let ObjectShape::Model { number, .. } = rows.objects[attempt.object_id as usize].shape else {
            panic!("a model")
        };
        (attempt.rule, attempt.closing) =
            (Rule { shape: schema::Shape::Model(number), approach: Approach::Normal }, None);
        (attempt.tilt_rad, attempt.slide_m) = (0.0, 0.0);
        let grasp = &mut attempt.workspace_from_grasp;
        grasp.rotation = along_normal(grasp.rotation * Vec3::NEG_Z, attempt.turn_rad);
    }
    rows
}

fn write(dir: &Path, info: &DatasetInfo) {
    let draft = Draft::begin(dir, info).unwrap();
    for shard in 0..info.shard_count {
        let mut writer = draft.shard(shard).unwrap();
        for scene in info.scenes_of(shard) {
            writer.push(&rows(info, scene)).unwrap();
        }
        writer.commit().unwrap();
    }
    assert!(matches!(draft.finalize().unwrap(), Finalized::Complete(_)));
}

#[test]
fn rows_and_models_come_back_as_they_were() {
    let dir = tempfile::tempdir().unwrap();
    let info = info();
    write(dir.path(), &info);
    assert!(verify(dir.path(), |_| ()).unwrap().is_ok());
    let dataset = Dataset::open(dir.path()).unwrap();
    assert_eq!(dataset.info(), &info);
    assert_eq!(dataset.info().format_version, 2);
    for shard in 0..info.shard_count {
        let written: Vec<SceneRows> = info.scenes_of(shard).map(|scene| rows(&info, scene)).collect();
        assert!(dataset.rows(shard, true).unwrap().map(Result::unwrap).eq(written.iter().cloned()));
        for rows in written {
            assert_eq!(dataset.read_scene(rows.scene.scene_id).unwrap(), rows);
        }
    }
}

/// Older programs would show cameras the parts.
#[test]
fn a_mesh_comes_back_and_needs_a_version_of_its_own() {
    let mut info = info();
    let corners = [[-0.02, -0.03, -0.01], [0.020_000_1, 0.03, -0.01], [0.0, 0.0, 0.012_345_6]];
    let mesh = TriangleMesh::new(&corners.map(Vec3::from_array), vec![[0, 1, 2]]).unwrap();
    Arc::make_mut(&mut info.models[0]).mesh = Some(Arc::new(mesh));
    let told = DatasetInfo::from_json(info.to_json()).unwrap_err();
    assert!(told.contains("format_version must be 6, the lowest that describes the dataset, got 2"), "{told}");
    info.format_version = 6;
    let dir = tempfile::tempdir().unwrap();
    write(dir.path(), &info);
    assert!(verify(dir.path(), |_| ()).unwrap().is_ok());
    assert_eq!(Dataset::open(dir.path()).unwrap().info(), &info);
    let mut other = info.clone();
    let mesh = TriangleMesh::new(&corners.map(|x_m| Vec3::from_array(x_m) * 0.5), vec![[0, 1, 2]]).unwrap();
    Arc::make_mut(&mut other.models[0]).mesh = Some(Arc::new(mesh));
    let told = Draft::begin(dir.path(), &other).unwrap_err().to_string();
    assert!(told.contains("differs in models[0].mesh.corners_100nm: "), "{told}");
    let text = info.to_json();
    let broken = text.replace("\"triangles\": \"0 1 2\"", "\"triangles\": \"0 1 3\"");
    assert!(text.contains("\"corners_100nm\": \"-200000 -300000 -100000 200001 ") && broken != text, "{text}");
    let told = DatasetInfo::from_json(broken).unwrap_err();
    assert!(told.contains("a mesh's triangles must name its 3 corners from 0, got 3"), "{told}");
}

#[test]
fn an_info_whose_models_cannot_be_is_refused() {
    type Case = (fn(&mut DatasetInfo), &'static str);
    let cases: [Case; 5] = [
        (|info| info.format_version = 1, "format_version must be 2, the lowest that describes the dataset, got 1"),
        (|info| info.models.clear(), "format_version must be 1, the lowest that describes the dataset, got 2"),
        (|info| info.models[1] = info.models[0].clone(), "there is another model wedge"),
        (|info| Arc::make_mut(&mut info.models[0]).mass_kg = 0.0, "model wedge: mass_kg must be between"),
        (|info| Arc::make_mut(&mut info.models[1]).parts[0].corners_m[0].x = -0.04, "corners_m must lie in a box"),
    ];
    for (change, expected) in cases {
        let mut info = info();
        change(&mut info);
        let message = DatasetInfo::from_json(info.to_json()).unwrap_err().to_string();
        assert!(message.contains(expected), "{expected}: {message}");
        let dir = tempfile::tempdir().unwrap();
        assert!(Draft::begin(dir.path(), &info).unwrap_err().to_string().contains(expected));
    }
}

#[test]
fn rows_that_do_not_fit_the_models_are_not_written() {
    type Change = fn(&mut SceneRows);
    let other: Change = |rows| {
        let ObjectShape::Model { number, .. } = &mut rows.objects[0].shape else { panic!("a model") };
        *number = 1 - *number;
        rows.attempts.retain(|a| a.object_id != 0);
        rows.scene.attempt_count = rows.attempts.len() as u32;
    };
    let primitive: Change = |rows| {
        let kind = schema::ShapeKind::Cuboid;
        rows.objects[0].shape = schema::Solid::new(kind, Vec3::splat(0.04)).unwrap().into();
    };
    let by_axis: Change = |rows| {
        let set = |attempt: &mut AttemptRecord| {
            attempt.rule.approach = Approach::Axis(schema::Axis::X);
            attempt.closing = Some(schema::Axis::Y);
        };
        rows.attempts.iter_mut().for_each(set);
    };
    for change in [other, primitive, by_axis] {
        let dir = tempfile::tempdir().unwrap();
        let info = info();
        let mut writer = Draft::begin(dir.path(), &info).unwrap().shard(0).unwrap();
        let mut rows = rows(&info, 0);
        change(&mut rows);
        assert!(writer.push(&rows).is_err());
    }
}

/// The error for a writer that continues a dataset of other models: the first difference, not the whole list.
#[test]
fn another_catalogue_is_another_dataset_and_the_difference_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let info = info();
    Draft::begin(dir.path(), &info).unwrap();
    let mut other = info.clone();
    Arc::make_mut(&mut other.models[1]).mass_kg = 0.3;
    let message = Draft::begin(dir.path(), &other).unwrap_err().to_string();
    assert!(message.contains("models[1].mass_kg (0.2 there, 0.3 asked for)"), "{message}");
    other.models.pop();
    let message = Draft::begin(dir.path(), &other).unwrap_err().to_string();
    assert!(message.contains("models (2 of them there, 1 asked for)"), "{message}");
}
