//! Rows to Arrow columns. Columns are pushed in the order of [`Table::columns`]; Arrow itself refuses a batch whose
//! columns do not match the schema.

use std::sync::Arc;

use arrow::types::Int32Type;
use arrow::{
    ArrayRef, DictionaryArray, FixedSizeListArray, Float32Array, Int32Array, Int64Array, ListArray, RecordBatch,
    StringArray, StructArray, UInt8Array,
};
use arrow_buffer::OffsetBuffer;
use arrow_schema::ArrowError;
use schema::{
    Approach, AttemptRecord, Axis, ContainerKind, HitKind, Model, ObjectRecord, Outcome, Pose, Rule, SceneRecord,
    SceneRows, Shape, View,
};

use crate::format::column::{element, view_fields, voxel_type};
use crate::{DatasetInfo, Table};

type Encoded<T> = Result<T, ArrowError>;

/// The rows that some scenes have in a table.
pub(crate) fn batch(table: Table, rows: &[SceneRows], info: &DatasetInfo) -> Encoded<RecordBatch> {
    let columns = match table {
        Table::Attempts => attempts(&rows.iter().flat_map(|r| &r.attempts).collect::<Vec<_>>(), info),
        Table::Scenes => scenes(&rows.iter().map(|r| &r.scene).collect::<Vec<_>>(), info),
        Table::Objects => objects(&rows.iter().flat_map(|r| &r.objects).collect::<Vec<_>>(), &info.models),
    };
    RecordBatch::try_new(table.arrow_schema(info.form()), columns?)
}

fn attempts(rows: &[&AttemptRecord], info: &DatasetInfo) -> Encoded<Vec<ArrayRef>> {
    let models = &info.models;
    // Names of what goes beyond Appendix A are only in the dictionaries of such datasets, so others keep their bytes.
    let last = rows.iter().map(|r| r.rule.approach.index()).max().unwrap_or_default().max(Axis::Z as usize);
    let vocabulary = Approach::ALL[..=last].iter().map(|approach| approach.name()).collect::<Vec<_>>();
    let approach = |of: fn(&AttemptRecord) -> Approach| names(&vocabulary, rows.iter().map(|r| Some(of(r).index())));
    // The models' name of the last approach is there only where there are models.
    let rule_count = 12 + 5 * (last - Axis::Z as usize) - usize::from(last > Axis::Z as usize && models.is_empty());
    let rule_names: Vec<&str> = Rule::all().take(rule_count).map(Rule::name).collect();
    let mut hits: Vec<HitKind> = HitKind::ALL.into();
    hits.retain(|hit| *hit != HitKind::Container || info.form().has_containers);
    let hits: Vec<&str> = hits.into_iter().map(HitKind::name).collect();
    let mut columns = vec![
        i64s(rows.iter().map(|r| r.scene_id))?,
        i32s(rows.iter().map(|r| r.attempt_id))?,
        i32s(rows.iter().map(|r| r.object_id))?,
        shapes(models, rows.iter().map(|r| r.rule.shape))?,
        names(&rule_names, rows.iter().map(|r| Some(r.rule.index())))?,
        approach(|r| r.rule.approach)?,
        // Where no axis of the object decides, the column says what does.
        approach(|r| r.closing.map_or(r.rule.approach, Approach::Axis))?,
        f32s(rows.iter().map(|r| r.tilt_rad)),
        f32s(rows.iter().map(|r| r.turn_rad)),
        f32s(rows.iter().map(|r| r.depth_m)),
        f32s(rows.iter().map(|r| r.slide_m)),
    ];
    columns.extend(pose(&rows.iter().map(|r| &r.workspace_from_grasp).collect::<Vec<_>>()));
    columns.extend([
        names(&Outcome::ALL.map(Outcome::name), rows.iter().map(|r| Some(r.outcome as usize)))?,
        names(&hits, rows.iter().map(|r| r.hit.map(|hit| hit as usize)))?,
        Arc::new(Int32Array::from(
            rows.iter().map(|r| r.hit_object_id.map(to_i32).transpose()).collect::<Encoded<Vec<_>>>()?,
        )),
        Arc::new(Float32Array::from_iter(rows.iter().map(|r| r.width_m))),
        Arc::new(UInt8Array::from_iter_values(rows.iter().map(|r| r.label()))),
    ]);
    if info.form().has_repeats {
        columns.push(Arc::new(Float32Array::from_iter(rows.iter().map(|r| r.robustness))));
    }
    Ok(columns)
}

fn objects(rows: &[&ObjectRecord], models: &[Arc<Model>]) -> Encoded<Vec<ArrayRef>> {
    let mut columns = vec![
        i64s(rows.iter().map(|r| r.scene_id))?,
        i32s(rows.iter().map(|r| r.object_id))?,
        shapes(models, rows.iter().map(|r| r.shape.shape()))?,
        f32s(rows.iter().map(|r| r.shape.extents_m().x)),
        f32s(rows.iter().map(|r| r.shape.extents_m().y)),
        f32s(rows.iter().map(|r| r.shape.extents_m().z)),
        f32s(rows.iter().map(|r| r.shape.volume_m3())),
        f32s(rows.iter().map(|r| r.mass_kg)),
        f32s(rows.iter().map(|r| r.friction)),
    ];
    columns.extend(pose(&rows.iter().map(|r| &r.workspace_from_object).collect::<Vec<_>>()));
    Ok(columns)
}

fn scenes(rows: &[&SceneRecord], info: &DatasetInfo) -> Encoded<Vec<ArrayRef>> {
    let form = info.form();
    let mut columns = vec![
        i64s(rows.iter().map(|r| r.scene_id))?,
        i32s(rows.iter().map(|r| r.dropped_count))?,
        i32s(rows.iter().map(|r| r.object_count))?,
        i32s(rows.iter().map(|r| r.attempt_count))?,
        f32s(rows.iter().map(|r| r.settle_time_s)),
        i32s(rows.iter().map(|r| r.rejections.unsettled))?,
        i32s(rows.iter().map(|r| r.rejections.empty))?,
        i32s(rows.iter().map(|r| r.rejections.unstable))?,
        views(rows)?,
        voxels(rows, form.resolution)?,
    ];
    if form.has_grippers {
        let grippers = info.grippers();
        let vocabulary: Vec<&str> = grippers.iter().map(|gripper| gripper.name.as_str()).collect();
        let of_scene = |row: &SceneRecord| (row.scene_id % grippers.len() as u64) as usize;
        columns.push(names(&vocabulary, rows.iter().map(|row| Some(of_scene(row))))?);
    }
    if form.has_containers {
        let containers = || rows.iter().map(|row| row.container);
        let kinds = containers().map(|container| container.map(|it| it.kind as usize));
        columns.push(names(&ContainerKind::ALL.map(ContainerKind::name), kinds)?);
        columns.extend((0..5).map(|size| -> ArrayRef {
            let sizes = containers().map(|container| container.map(|it| it.sizes()[size]));
            Arc::new(Float32Array::from_iter(sizes))
        }));
    }
    Ok(columns)
}

/// The columns of some poses: x, y, z and a quaternion.
fn pose(poses: &[&Pose]) -> impl Iterator<Item = ArrayRef> {
    let positions = (0..3).map(move |at| f32s(poses.iter().map(|pose| pose.translation[at])));
    positions.chain((0..4).map(move |at| f32s(poses.iter().map(|pose| pose.rotation.to_array()[at]))))
}

fn views(rows: &[&SceneRecord]) -> Encoded<ArrayRef> {
    let all: Vec<&View> = rows.iter().flat_map(|r| &r.views).collect();
    let columns = vec![
        f32s(all.iter().map(|v| v.radius_m)),
        f32s(all.iter().map(|v| v.polar_rad)),
        f32s(all.iter().map(|v| v.azimuth_rad)),
    ];
    let values = StructArray::try_new(view_fields(), columns, None)?;
    let offsets = OffsetBuffer::from_lengths(rows.iter().map(|r| r.views.len()));
    let field = element(arrow_schema::DataType::Struct(view_fields()));
    Ok(Arc::new(ListArray::try_new(field, offsets, Arc::new(values), None)?))
}

fn voxels(rows: &[&SceneRecord], resolution: usize) -> Encoded<ArrayRef> {
    let mut values = Vec::with_capacity(rows.len() * resolution.pow(3));
    for row in rows {
        values.extend_from_slice(&row.tsdf);
    }
    let length = to_i32(resolution)?;
    let mut array: ArrayRef = Arc::new(Float32Array::from(values));
    for depth in 0..3 {
        array = Arc::new(FixedSizeListArray::try_new(element(voxel_type(resolution, depth)), length, array, None)?);
    }
    Ok(array)
}

fn shapes(models: &[Arc<Model>], rows: impl Iterator<Item = Shape>) -> Encoded<ArrayRef> {
    let vocabulary: Vec<&str> = Shape::all(models).into_iter().map(|shape| shape.name(models)).collect();
    let number = |shape| match shape {
        Shape::Primitive(kind) => kind as usize,
        Shape::Model(number) => usize::from(number),
    };
    names(&vocabulary, rows.map(|shape| Some(number(shape))))
}

fn names(vocabulary: &[&str], indices: impl Iterator<Item = Option<usize>>) -> Encoded<ArrayRef> {
    let keys = indices.map(|index| index.map(to_i32).transpose()).collect::<Encoded<Vec<_>>>()?;
    let values = StringArray::from_iter_values(vocabulary);
    Ok(Arc::new(DictionaryArray::<Int32Type>::try_new(Int32Array::from(keys), Arc::new(values))?))
}

fn f32s(values: impl Iterator<Item = f32>) -> ArrayRef {
    Arc::new(Float32Array::from_iter_values(values))
}

fn i32s(values: impl Iterator<Item = u32>) -> Encoded<ArrayRef> {
    Ok(Arc::new(Int32Array::from(values.map(to_i32).collect::<Encoded<Vec<_>>>()?)))
}

fn i64s(values: impl Iterator<Item = u64>) -> Encoded<ArrayRef> {
    let to_i64 = |v| i64::try_from(v).map_err(|_| ArrowError::CastError(format!("{v} must fit into an int64")));
    Ok(Arc::new(Int64Array::from(values.map(to_i64).collect::<Encoded<Vec<_>>>()?)))
}

fn to_i32<N: TryInto<i32> + Copy + std::fmt::Display>(value: N) -> Encoded<i32> {
    value.try_into().map_err(|_| ArrowError::CastError(format!("{value} must fit into an int32")))
}
