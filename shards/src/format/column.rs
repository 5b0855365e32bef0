//! The columns of the three tables. This is the only definition of a column's name, type, unit and meaning: the Arrow
//! schema and the reference in the docs are made from it.

use std::sync::Arc;

use arrow_schema::{DataType, Field, Fields, Metadata, Schema, SchemaRef};
use settings::words;

words! {
    /// The three tables of a dataset, the default one first.
    #[derive(PartialOrd, Ord)]
    pub enum Table {
        /// One row per attempt.
        Attempts = "attempts",
        /// One row per scene.
        Scenes = "scenes",
        /// One row per object.
        Objects = "objects",
    }
}

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// 64-bit integer.
    I64,
    /// 32-bit integer.
    I32,
    /// Unsigned 8-bit integer.
    U8,
    /// Single precision.
    F32,
    /// One of a few names, dictionary-encoded.
    Name,
    /// List of (`radius_m`, `polar_rad`, `azimuth_rad`).
    Views,
    /// `resolution`³ single-precision values as nested lists of fixed size: `[x][y][z]`.
    Voxels,
}

/// One column.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Column {
    /// Its name; carries the unit.
    pub(crate) name: &'static str,
    /// What it holds.
    pub(crate) kind: Kind,
    /// Whether values may be absent.
    pub(crate) nullable: bool,
    /// What it means, in one line.
    pub(crate) doc: &'static str,
}

const fn column(name: &'static str, kind: Kind, doc: &'static str) -> Column {
    Column { name, kind, nullable: false, doc }
}

const fn nullable(name: &'static str, kind: Kind, doc: &'static str) -> Column {
    Column { name, kind, nullable: true, doc }
}

const ATTEMPTS: &[Column] = &[
    column("scene_id", Kind::I64, "The scene, by its number in the dataset; key into `scenes`"),
    column("attempt_id", Kind::I32, "Number of the attempt in its scene, from 0"),
    column("object_id", Kind::I32, "The target; with `scene_id` the key into `objects`"),
    column("shape", Kind::Name, "Shape of the target"),
    column("rule", Kind::Name, "Row of the paper's Appendix A that drew the grasp: shape and approach axis"),
    column("approach_axis", Kind::Name, "Object axis of the approach: x, y or z"),
    column("closing_axis", Kind::Name, "Object axis along which the hand closes, before the turn: x, y or z"),
    column("tilt_rad", Kind::F32, "Drawn rotation about the grasp's y axis (r_y)"),
    column("turn_rad", Kind::F32, "Drawn rotation about the grasp's x axis (r_x); 0 for rules without"),
    column("depth_m", Kind::F32, "Drawn offset along the grasp's z axis from the object's centre (d_z)"),
    column("slide_m", Kind::F32, "Drawn offset along the grasp's x axis (d_x); 0 for rules without"),
    column("x_m", Kind::F32, "Grasp origin (midway between the finger tips) in the workspace, x"),
    column("y_m", Kind::F32, "Grasp origin in the workspace, y"),
    column("z_m", Kind::F32, "Grasp origin in the workspace, z"),
    column(
        "qx",
        Kind::F32,
        "Unit quaternion workspace_from_grasp, x; the grasp approaches along its +z, closes along y",
    ),
    column("qy", Kind::F32, "Unit quaternion workspace_from_grasp, y"),
    column("qz", Kind::F32, "Unit quaternion workspace_from_grasp, z"),
    column("qw", Kind::F32, "Unit quaternion workspace_from_grasp, w"),
    column("outcome", Kind::Name, "How the attempt ended"),
    nullable("hit", Kind::Name, "What was hit: target, other or table; null unless the outcome hit something"),
    nullable("hit_object_id", Kind::I32, "Which object was hit; null unless it was an object"),
    nullable(
        "width_m",
        Kind::F32,
        "Opening between the fingers: when held, at the end of the hold, else when closing stopped; null if never closed",
    ),
    column("label", Kind::U8, "1 if the object was held, else 0"),
];

const SCENES: &[Column] = &[
    column("scene_id", Kind::I64, "Number of the scene in the dataset, from 0"),
    column("dropped_count", Kind::I32, "Objects dropped"),
    column("object_count", Kind::I32, "Objects in the settled scene"),
    column("attempt_count", Kind::I32, "Attempts executed"),
    column("settle_time_s", Kind::F32, "Simulated time until the scene came to rest"),
    column("rejected_unsettled", Kind::I32, "Scenes thrown away before this one: did not come to rest in time"),
    column("rejected_empty", Kind::I32, "Scenes thrown away before this one: every object fell off"),
    column("rejected_unstable", Kind::I32, "Scenes thrown away before this one: the physics broke down"),
    column(
        "views",
        Kind::Views,
        "Cameras of the TSDF: on a sphere about the middle of the workspace's floor, looking at it",
    ),
    column(
        "tsdf",
        Kind::Voxels,
        "Truncated signed distance as tsdf[x][y][z]: (tsdf + 1) / 2 where observed and |tsdf| < 0.98, else 0",
    ),
];

// What follows are the last columns of their table, so that tables without them are the others.
/// Columns of `scenes` that are there only where a dataset has several grippers.
const OF_GRIPPERS: &[Column] =
    &[column(GRIPPER, Kind::Name, "The hand of the scene's attempts; its dimensions: `grippers` of `meta/info.json`")];

pub(crate) const GRIPPER: &str = "gripper";

/// Columns of `scenes` that are there only where a dataset has containers.
const OF_CONTAINERS: &[Column] = &[
    nullable(
        CONTAINER,
        Kind::Name,
        "What the objects lie in: bin, tray or shelf; null for the bare table. It may also be a `hit`",
    ),
    nullable(CONTAINER_SIZES[0], Kind::F32, "Length along x between the upper edges of its walls"),
    nullable(CONTAINER_SIZES[1], Kind::F32, "Length along y between the upper edges of its walls"),
    nullable(CONTAINER_SIZES[2], Kind::F32, "Height of its walls above the table; a shelf's board lies on them"),
    nullable(CONTAINER_SIZES[3], Kind::F32, "Thickness of its walls and board"),
    nullable(CONTAINER_SIZES[4], Kind::F32, "How far its walls lean outwards, from the vertical"),
];

/// Columns of `attempts` that are there only where attempts were repeated.
const OF_REPEATS: &[Column] = &[nullable(
    ROBUSTNESS,
    Kind::F32,
    "Of its repeats with other masses, other friction and slightly moved grasps, the share that held as well; null \
     unless it held and was repeated",
)];

pub(crate) const ROBUSTNESS: &str = "robustness";
pub(crate) const CONTAINER: &str = "container";
pub(crate) const CONTAINER_SIZES: [&str; 5] =
    ["container_x_m", "container_y_m", "container_height_m", "container_thickness_m", "container_slope_rad"];

/// What the columns of a dataset's tables depend on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Form {
    /// Voxels of a TSDF along a side.
    pub resolution: usize,
    /// Whether there are several grippers.
    pub has_grippers: bool,
    /// Whether there may be containers.
    pub has_containers: bool,
    /// Whether attempts were repeated.
    pub has_repeats: bool,
}

const OBJECTS: &[Column] = &[
    column("scene_id", Kind::I64, "The scene; key into `scenes`"),
    column("object_id", Kind::I32, "Number of the object in its scene, from 0"),
    column("shape", Kind::Name, "One of the four primitive shapes"),
    column("size_x_m", Kind::F32, "Full length of the bounding box along the object's x"),
    column("size_y_m", Kind::F32, "Full length of the bounding box along the object's y"),
    column("size_z_m", Kind::F32, "Full length of the bounding box along the object's z"),
    column("volume_m3", Kind::F32, "Volume of the faceted solid"),
    column("mass_kg", Kind::F32, "Mass"),
    column("friction", Kind::F32, "Coulomb friction coefficient"),
    column("x_m", Kind::F32, "Object origin (centre of the bounding box) at rest in the workspace, x"),
    column("y_m", Kind::F32, "Object origin at rest in the workspace, y"),
    column("z_m", Kind::F32, "Object origin at rest in the workspace, z"),
    column("qx", Kind::F32, "Unit quaternion workspace_from_object, x"),
    column("qy", Kind::F32, "Unit quaternion workspace_from_object, y"),
    column("qz", Kind::F32, "Unit quaternion workspace_from_object, z"),
    column("qw", Kind::F32, "Unit quaternion workspace_from_object, w"),
];

/// Name of a list's element in every nested column, as the Parquet specification requires.
const ELEMENT: &str = "element";

impl Table {
    /// Its columns, in the order on disk.
    pub(crate) fn columns(self, form: Form) -> Vec<&'static Column> {
        let parts: &[(&[Column], bool)] = match self {
            Self::Attempts => &[(ATTEMPTS, true), (OF_REPEATS, form.has_repeats)],
            Self::Scenes => &[(SCENES, true), (OF_GRIPPERS, form.has_grippers), (OF_CONTAINERS, form.has_containers)],
            Self::Objects => &[(OBJECTS, true)],
        };
        parts.iter().filter(|(_, is_there)| *is_there).flat_map(|(columns, _)| *columns).collect()
    }

    /// Its Arrow schema, each field with its meaning as metadata.
    pub(crate) fn arrow_schema(self, form: Form) -> SchemaRef {
        let fields: Vec<Field> = self
            .columns(form)
            .iter()
            .map(|column| {
                Field::new(column.name, column.kind.data_type(form.resolution), column.nullable)
                    .with_metadata(Metadata::from_iter([("description".to_owned(), column.doc.to_owned())]))
            })
            .collect();
        Arc::new(Schema::new(fields))
    }

    /// Its columns as a table of Markdown, for the reference.
    #[must_use]
    pub fn described(self, form: Form) -> String {
        let rows = self.columns(form).into_iter().map(|column| {
            let null = if column.nullable { ", nullable" } else { "" };
            format!("| `{}` | {}{null} | {} |\n", column.name, column.kind.describe(form.resolution), column.doc)
        });
        format!("| column | type | meaning |\n|---|---|---|\n{}", rows.collect::<String>())
    }
}

impl Kind {
    /// The Arrow type.
    fn data_type(self, resolution: usize) -> DataType {
        match self {
            Self::I64 => DataType::Int64,
            Self::I32 => DataType::Int32,
            Self::U8 => DataType::UInt8,
            Self::F32 => DataType::Float32,
            Self::Name => DataType::Dictionary(Box::new(DataType::Int32), Box::new(DataType::Utf8)),
            Self::Views => DataType::List(element(DataType::Struct(view_fields()))),
            Self::Voxels => voxel_type(resolution, 3),
        }
    }

    /// The type as text, for the docs.
    fn describe(self, resolution: usize) -> String {
        match self {
            Self::I64 => "int64".to_owned(),
            Self::I32 => "int32".to_owned(),
            Self::U8 => "uint8".to_owned(),
            Self::F32 => "float32".to_owned(),
            Self::Name => "string (dictionary)".to_owned(),
            Self::Views => "list of {radius_m, polar_rad, azimuth_rad}".to_owned(),
            Self::Voxels => format!("float32[{resolution}][{resolution}][{resolution}]"),
        }
    }
}

/// A list's element: never null.
pub(crate) fn element(data_type: DataType) -> Arc<Field> {
    Arc::new(Field::new(ELEMENT, data_type, false))
}

/// The fields of a view.
pub(crate) fn view_fields() -> Fields {
    ["radius_m", "polar_rad", "azimuth_rad"].map(|name| Field::new(name, DataType::Float32, false)).to_vec().into()
}

/// `depth` nested lists of `resolution` single-precision values.
pub(crate) fn voxel_type(resolution: usize, depth: usize) -> DataType {
    let length = i32::try_from(resolution).unwrap_or(i32::MAX);
    (0..depth).fold(DataType::Float32, |inner, _| DataType::FixedSizeList(element(inner), length))
}

#[cfg(test)]
mod tests {
    use super::*;

    const FORM: Form = Form { resolution: 40, has_grippers: true, has_containers: true, has_repeats: true };

    #[test]
    fn names_are_snake_case_and_unique_within_a_table() {
        for table in Table::ALL {
            let mut names: Vec<&str> = table.columns(FORM).iter().map(|c| c.name).collect();
            for name in &names {
                assert!(name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_'), "{name}");
            }
            names.sort_unstable();
            names.dedup();
            assert_eq!(names.len(), table.columns(FORM).len());
        }
    }

    #[test]
    fn the_markdown_has_every_column() {
        for table in Table::ALL {
            let text = table.described(FORM);
            assert!(
                table.columns(FORM).iter().all(|column| text.contains(&format!("| `{}` |", column.name))),
                "{text}"
            );
            assert_eq!(text.matches("\n| `").count(), table.columns(FORM).len());
        }
    }
}
