//! Arrow columns to rows. The schema was compared before. Every value is parsed into its domain type; a value outside
//! the domain is an error.

use std::sync::Arc;

use arrow::cast::AsArray;
use arrow::types::{Float32Type, Int32Type, Int64Type, UInt8Type};
use arrow::{Array, ArrayRef, ArrowPrimitiveType, PrimitiveArray, RecordBatch, StringArray};
use schema::{
    Approach, AttemptRecord, Container, ContainerKind, HitKind, Model, ObjectRecord, ObjectShape, Outcome, Pose, Quat,
    Rule, SceneRecord, SceneRejections, Shape, Solid, Vec3, View, pose_from_parts,
};

use crate::DatasetInfo;
use crate::format::check::is_volume;
use crate::format::column::{CONTAINER, CONTAINER_SIZES, GRIPPER, ROBUSTNESS};

type Decoded<T> = Result<T, String>;

/// The rows of an `attempts` batch.
pub(crate) fn attempts(batch: &RecordBatch, info: &DatasetInfo) -> Decoded<Vec<AttemptRecord>> {
    let (columns, models) = (Columns(batch), &info.models);
    let (scene, attempt, object) = (columns.i64s("scene_id")?, columns.i32s("attempt_id")?, columns.i32s("object_id")?);
    let shape = columns.names("shape", |name| Shape::from_name(name, models))?;
    let rule = columns.names("rule", Rule::from_name)?;
    let [approach, closing] = ["approach_axis", "closing_axis"].map(|name| columns.names(name, Approach::from_name));
    let (approach, closing) = (approach?, closing?);
    let (tilt, turn) = (columns.f32s("tilt_rad")?, columns.f32s("turn_rad")?);
    let (depth, slide) = (columns.f32s("depth_m")?, columns.f32s("slide_m")?);
    let poses = columns.poses()?;
    let outcome = columns.names("outcome", Outcome::from_name)?;
    let hit = columns.names_or_null("hit", HitKind::from_name)?;
    let hit_object = columns.numbers::<Int32Type>("hit_object_id")?;
    let width = columns.numbers::<Float32Type>("width_m")?;
    let label = columns.numbers::<UInt8Type>("label")?;
    let robustness = info.form().has_repeats.then(|| columns.numbers::<Float32Type>(ROBUSTNESS)).transpose()?;
    (0..batch.num_rows())
        .map(|row| {
            let named = rule[row];
            // A model's rule does not name the model; the shape does.
            let found = Rule { shape: shape[row], approach: approach[row] };
            if found.named() != named {
                return Err(format!("rule {} does not fit shape and approach_axis, row {row}", named.name()));
            }
            if closing[row].axis().is_none() && closing[row] != found.approach {
                let (closing, approach) = (closing[row].name(), found.approach.name());
                return Err(format!("closing_axis {closing} does not fit approach_axis {approach}, row {row}"));
            }
            let record = AttemptRecord {
                scene_id: scene[row],
                attempt_id: attempt[row],
                object_id: object[row],
                rule: found,
                closing: closing[row].axis(),
                tilt_rad: tilt[row],
                turn_rad: turn[row],
                depth_m: depth[row],
                slide_m: slide[row],
                workspace_from_grasp: poses[row],
                outcome: outcome[row],
                hit: hit[row],
                hit_object_id: if hit_object.is_null(row) { None } else { Some(unsigned(hit_object.value(row))?) },
                width_m: width.is_valid(row).then(|| width.value(row)),
                robustness: robustness.and_then(|values| values.is_valid(row).then(|| values.value(row))),
            };
            if label.value(row) != record.label() {
                let outcome = record.outcome.name();
                return Err(format!("label must be {} for {outcome}, got {}", record.label(), label.value(row)));
            }
            Ok(record)
        })
        .collect()
}

/// The rows of an `objects` batch of a dataset with these models.
pub(crate) fn objects(batch: &RecordBatch, models: &[Arc<Model>]) -> Decoded<Vec<ObjectRecord>> {
    let columns = Columns(batch);
    let (scene, object) = (columns.i64s("scene_id")?, columns.i32s("object_id")?);
    let shape = columns.names("shape", |name| Shape::from_name(name, models))?;
    let (x, y, z) = (columns.f32s("size_x_m")?, columns.f32s("size_y_m")?, columns.f32s("size_z_m")?);
    let (volume, mass, friction) = (columns.f32s("volume_m3")?, columns.f32s("mass_kg")?, columns.f32s("friction")?);
    let poses = columns.poses()?;
    (0..batch.num_rows())
        .map(|row| {
            let shape = object_shape(shape[row], Vec3::new(x[row], y[row], z[row]), models)
                .map_err(|e| format!("{e}, row {row}"))?;
            let record = ObjectRecord {
                scene_id: scene[row],
                object_id: object[row],
                shape,
                mass_kg: mass[row],
                friction: friction[row],
                workspace_from_object: poses[row],
            };
            if is_volume(volume[row], &record) {
                return Ok(record);
            }
            Err(format!("volume_m3 must be {}, got {}, row {row}", record.shape.volume_m3(), volume[row]))
        })
        .collect()
}

/// A shape with its size. A model has one size.
fn object_shape(shape: Shape, extents_m: Vec3, models: &[Arc<Model>]) -> Result<ObjectShape, String> {
    match shape {
        Shape::Primitive(kind) => Solid::new(kind, extents_m).map(Into::into),
        Shape::Model(number) => {
            let model = models.get(usize::from(number)).ok_or("there is no such model")?;
            if model.extents_m != extents_m {
                return Err(format!("the size of model {} must be {}, got {extents_m}", model.name, model.extents_m));
            }
            Ok(ObjectShape::Model { number, model: model.clone() })
        }
    }
}

/// The rows of a `scenes` batch of a dataset; without the column `tsdf` the grids stay empty.
pub(crate) fn scenes(batch: &RecordBatch, info: &DatasetInfo) -> Decoded<Vec<SceneRecord>> {
    let columns = Columns(batch);
    let (scene, dropped) = (columns.i64s("scene_id")?, columns.i32s("dropped_count")?);
    let (objects, attempts) = (columns.i32s("object_count")?, columns.i32s("attempt_count")?);
    let settle = columns.f32s("settle_time_s")?;
    let (unsettled, empty) = (columns.i32s("rejected_unsettled")?, columns.i32s("rejected_empty")?);
    let unstable = columns.i32s("rejected_unstable")?;
    let views = columns.get("views")?.as_list_opt::<i32>().ok_or_else(|| wrong("views"))?;
    let has_tsdf = batch.column_by_name("tsdf").is_some();
    if info.form().has_grippers {
        let number = |name: &str| info.grippers().iter().position(|gripper| gripper.name == name);
        for (scene, number) in scene.iter().zip(columns.names(GRIPPER, number)?) {
            let (expected, got) = (&info.gripper_of(*scene).name, &info.grippers()[number].name);
            if got != expected {
                return Err(format!("scene {scene} must have the gripper {expected}, got {got}"));
            }
        }
    }
    let containers = if info.form().has_containers { columns.containers()? } else { vec![None; batch.num_rows()] };
    (0..batch.num_rows())
        .map(|row| {
            Ok(SceneRecord {
                scene_id: scene[row],
                dropped_count: dropped[row],
                object_count: objects[row],
                attempt_count: attempts[row],
                settle_time_s: settle[row],
                rejections: SceneRejections { unsettled: unsettled[row], empty: empty[row], unstable: unstable[row] },
                views: view_list(&views.value(row))?,
                tsdf: if has_tsdf { columns.voxels("tsdf", row)? } else { Vec::new() },
                container: containers[row],
            })
        })
        .collect()
}

fn view_list(list: &ArrayRef) -> Decoded<Vec<View>> {
    let parts = list.as_struct_opt().ok_or_else(|| wrong("views"))?;
    let part = |name: &str| parts.column_by_name(name).ok_or_else(|| wrong("views")).and_then(|c| floats("views", c));
    let (radius, polar, azimuth) = (part("radius_m")?, part("polar_rad")?, part("azimuth_rad")?);
    Ok((0..parts.len()).map(|i| View { radius_m: radius[i], polar_rad: polar[i], azimuth_rad: azimuth[i] }).collect())
}

/// The columns of a batch, by name.
struct Columns<'a>(&'a RecordBatch);

impl<'a> Columns<'a> {
    fn get(&self, name: &str) -> Decoded<&'a ArrayRef> {
        self.0.column_by_name(name).ok_or_else(|| format!("column {name} is missing"))
    }

    fn f32s(&self, name: &str) -> Decoded<&'a [f32]> {
        floats(name, self.get(name)?)
    }

    fn numbers<T: ArrowPrimitiveType>(&self, name: &str) -> Decoded<&'a PrimitiveArray<T>> {
        self.get(name)?.as_primitive_opt().ok_or_else(|| wrong(name))
    }

    fn i32s(&self, name: &str) -> Decoded<Vec<u32>> {
        let column = self.numbers::<Int32Type>(name)?;
        not_null(name, column)?;
        column.values().iter().map(|v| unsigned(*v)).collect()
    }

    fn i64s(&self, name: &str) -> Decoded<Vec<u64>> {
        let column = self.numbers::<Int64Type>(name)?;
        not_null(name, column)?;
        let unsigned = |v: &i64| u64::try_from(*v).map_err(|_| format!("{name} must be at least 0, got {v}"));
        column.values().iter().map(unsigned).collect()
    }

    /// A column of names, each parsed once per dictionary entry.
    fn names<T: Copy>(&self, name: &str, parse: impl Fn(&str) -> Option<T>) -> Decoded<Vec<T>> {
        let names = self.names_or_null(name, parse)?.into_iter().collect::<Option<_>>();
        names.ok_or_else(|| format!("{name} must not be null"))
    }

    fn names_or_null<T: Copy>(&self, name: &str, parse: impl Fn(&str) -> Option<T>) -> Decoded<Vec<Option<T>>> {
        let column = self.get(name)?.as_dictionary_opt::<Int32Type>().ok_or_else(|| wrong(name))?;
        let values: &StringArray = column.values().as_string_opt().ok_or_else(|| wrong(name))?;
        let parsed: Vec<Option<T>> = values.iter().map(|v| v.and_then(&parse)).collect();
        let known = |key: i32| {
            let index = unsigned(key)? as usize;
            parsed.get(index).copied().flatten().ok_or_else(|| {
                let text = if index < values.len() { values.value(index) } else { "nothing" };
                format!("{name} must be one of the known names, got {text:?}")
            })
        };
        column.keys().iter().map(|key| key.map(known).transpose()).collect()
    }

    fn poses(&self) -> Decoded<Vec<Pose>> {
        let (x, y, z) = (self.f32s("x_m")?, self.f32s("y_m")?, self.f32s("z_m")?);
        let (qx, qy, qz, qw) = (self.f32s("qx")?, self.f32s("qy")?, self.f32s("qz")?, self.f32s("qw")?);
        let pose = |i: usize| pose_from_parts(Quat::from_xyzw(qx[i], qy[i], qz[i], qw[i]), Vec3::new(x[i], y[i], z[i]));
        Ok((0..self.0.num_rows()).map(pose).collect())
    }

    fn containers(&self) -> Decoded<Vec<Option<Container>>> {
        let kinds = self.names_or_null(CONTAINER, ContainerKind::from_name)?;
        let sizes = CONTAINER_SIZES.map(|name| self.numbers::<Float32Type>(name));
        let sizes: Vec<&PrimitiveArray<Float32Type>> = sizes.into_iter().collect::<Decoded<_>>()?;
        let container = |(row, kind): (usize, &Option<ContainerKind>)| {
            if sizes.iter().any(|column| column.is_valid(row) != kind.is_some()) {
                return Err(format!("the sizes of a container must be there if and only if it is, row {row}"));
            }
            Ok(kind.map(|kind| Container::of_sizes(kind, core::array::from_fn(|size| sizes[size].value(row)))))
        };
        kinds.iter().enumerate().map(container).collect()
    }

    fn voxels(&self, name: &str, row: usize) -> Decoded<Vec<f32>> {
        let mut slice = self.get(name)?.slice(row, 1);
        while let Some(list) = slice.as_fixed_size_list_opt() {
            let length = usize::try_from(list.value_length()).map_err(|_| wrong(name))?;
            let start = list.value_offset_at(0);
            slice = list.values().slice(start, length * list.len());
        }
        Ok(floats(name, &slice)?.to_vec())
    }
}

fn floats<'a>(name: &str, column: &'a ArrayRef) -> Decoded<&'a [f32]> {
    let column = column.as_primitive_opt::<Float32Type>().ok_or_else(|| wrong(name))?;
    not_null(name, column)?;
    Ok(column.values())
}

fn not_null(name: &str, column: &dyn Array) -> Decoded<()> {
    if column.null_count() == 0 { Ok(()) } else { Err(format!("{name} must not be null")) }
}

fn unsigned(value: i32) -> Decoded<u32> {
    u32::try_from(value).map_err(|_| format!("a number or count must be at least 0, got {value}"))
}

fn wrong(name: &str) -> String {
    format!("column {name} has the wrong type")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::encode;
    use crate::{Table, synthetic};

    #[test]
    fn a_scene_of_another_gripper_is_damaged() {
        let mut info = synthetic::info(3, 1, 12, 6);
        info.grid.resolution = 2;
        let other = schema::Gripper { name: "other".to_owned(), ..info.gripper.clone() };
        info.grippers = vec![info.gripper.clone(), other];
        let rows = [0, 1].map(|scene| synthetic::scene_rows(scene, info.seed, &info));
        let batch = encode::batch(Table::Scenes, &rows, &info).unwrap();
        assert_eq!(scenes(&batch, &info).unwrap(), rows.map(|rows| rows.scene));
        info.grippers.swap(0, 1);
        let told = scenes(&batch, &info).unwrap_err();
        assert_eq!(told, "scene 0 must have the gripper other, got synthetic_80");
    }
}
