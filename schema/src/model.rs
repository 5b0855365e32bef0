//! Objects that are no primitive: convex parts that move as one, as a dataset keeps them and its rows name them.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::{Polyhedron, ShapeKind, Solid, Surface, TriangleMesh, Vec3, bounds_m};

/// An object of convex parts. All that physics and cameras take from it stands here: a dataset needs no other file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Model {
    /// Its name, as rows have it; of a dataset's models no two share one.
    pub name: String,
    /// Mass in kilograms.
    pub mass_kg: f32,
    /// Coulomb friction coefficient.
    pub friction: f32,
    /// Full lengths of the bounding box along the object's axes, in metres. The object frame's origin is its centre.
    pub extents_m: Vec3,
    /// Volume of all parts in cubic metres.
    pub volume_m3: f32,
    /// The convex parts.
    pub parts: Vec<ModelPart>,
    /// The surface that cameras see in place of the parts, in the object's frame, if it is of a mesh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mesh: Option<Arc<TriangleMesh>>,
}

/// The convex hull of its corners.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelPart {
    /// The corners in the object's frame, in metres.
    pub corners_m: Vec<Vec3>,
}

/// What a name in a table's column `shape` means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Shape {
    /// One of the four primitive shapes.
    Primitive(ShapeKind),
    /// A model of the dataset, by its number.
    Model(u16),
}

impl From<ShapeKind> for Shape {
    fn from(kind: ShapeKind) -> Self {
        Self::Primitive(kind)
    }
}

impl Shape {
    /// The name in the shards of a dataset that has these models; of a model that is not among them, `model`.
    #[must_use]
    pub fn name(self, models: &[Arc<Model>]) -> &str {
        match self {
            Self::Primitive(kind) => kind.name(),
            Self::Model(number) => models.get(usize::from(number)).map_or("model", |model| &model.name),
        }
    }

    /// Its name where models are not distinguished: a primitive's, or `model`.
    #[must_use]
    pub fn kind_name(self) -> &'static str {
        match self {
            Self::Primitive(kind) => kind.name(),
            Self::Model(_) => "model",
        }
    }

    /// The shape with this name: in a dataset of models one of them, else a primitive.
    #[must_use]
    pub fn from_name(name: &str, models: &[Arc<Model>]) -> Option<Self> {
        if models.is_empty() {
            return ShapeKind::from_name(name).map(Self::Primitive);
        }
        let number = models.iter().position(|model| model.name == name)?;
        u16::try_from(number).ok().map(Self::Model)
    }

    /// All shapes of a dataset with these models, in the order of their numbers.
    #[must_use]
    pub fn all(models: &[Arc<Model>]) -> Vec<Self> {
        if models.is_empty() {
            return ShapeKind::ALL.map(Self::Primitive).to_vec();
        }
        (0..=u16::MAX).take(models.len()).map(Self::Model).collect()
    }
}

/// Shape and size of an object.
#[derive(Debug, Clone, PartialEq)]
pub enum ObjectShape {
    /// A primitive.
    Solid(Solid),
    /// A model of the dataset.
    Model {
        /// Its number among the dataset's models.
        number: u16,
        /// The model.
        model: Arc<Model>,
    },
}

impl From<Solid> for ObjectShape {
    fn from(solid: Solid) -> Self {
        Self::Solid(solid)
    }
}

impl ObjectShape {
    /// Its shape without the size.
    #[must_use]
    pub fn shape(&self) -> Shape {
        match self {
            Self::Solid(solid) => Shape::Primitive(solid.kind),
            Self::Model { number, .. } => Shape::Model(*number),
        }
    }

    /// The name in shards.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Solid(solid) => solid.kind.name(),
            Self::Model { model, .. } => &model.name,
        }
    }

    /// The solid, if it is one.
    #[must_use]
    pub fn as_solid(&self) -> Option<Solid> {
        match self {
            Self::Solid(solid) => Some(*solid),
            Self::Model { .. } => None,
        }
    }

    /// Its convex parts, in the object's frame. A part without a hull has no shape in physics either and is left out.
    #[must_use]
    pub fn parts(&self) -> Vec<Polyhedron> {
        match self {
            Self::Solid(solid) => vec![solid.into()],
            Self::Model { model, .. } => {
                model.parts.iter().flat_map(|part| Polyhedron::hull_of(&part.corners_m)).collect()
            }
        }
    }

    /// What is seen of it, in the object's frame.
    #[must_use]
    pub fn surface(&self) -> Surface {
        let mesh = if let Self::Model { model, .. } = self { model.mesh.as_deref() } else { None };
        Surface::of(mesh, &if mesh.is_some() { Vec::new() } else { self.parts() })
    }

    /// Full lengths of the bounding box along the object's axes, in metres.
    #[must_use]
    pub fn extents_m(&self) -> Vec3 {
        match self {
            Self::Solid(solid) => solid.extents_m,
            Self::Model { model, .. } => model.extents_m,
        }
    }

    /// Volume in cubic metres: of the faceted solid, or of all parts.
    #[must_use]
    pub fn volume_m3(&self) -> f32 {
        match self {
            Self::Solid(solid) => solid.volume_m3(),
            Self::Model { model, .. } => model.volume_m3,
        }
    }
}

/// Most models of a dataset.
pub const MODELS_MAX: usize = 1_000;
/// Most parts of a model.
pub const PARTS_MAX: usize = 1024;
/// Most corners of a part.
pub const CORNERS_MAX: usize = 256;
/// Longest name, in bytes.
pub const NAME_MAX: usize = 48;
/// Corners may lie outside the bounding box by this, and miss it by as much, in metres.
const BOUNDS_M: f32 = 1e-5;

impl Model {
    /// What is out of range, one message each.
    #[must_use]
    pub fn problems(&self) -> Vec<String> {
        let mut problems = Vec::new();
        let mut must = |holds: bool, message: String| {
            if !holds {
                problems.push(format!("model {}: {message}", self.name));
            }
        };
        let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
        must(
            (1..=NAME_MAX).contains(&self.name.len()) && self.name.chars().all(is_plain),
            format!("a name must have 1 to {NAME_MAX} letters, digits, _, - and ."),
        );
        for (key, value, low, high) in [("mass_kg", self.mass_kg, 1e-4, 1e4), ("friction", self.friction, 0.0, 100.0)] {
            must((low..=high).contains(&value), format!("{key} must be between {low} and {high}, got {value}"));
        }
        let corners = || self.parts.iter().flat_map(|part| &part.corners_m);
        let [low, high] = bounds_m(corners());
        let is_bounds = |a: Vec3, b: Vec3| (a - b).abs().max_element() <= BOUNDS_M;
        must(
            corners().all(|corner| corner.is_finite())
                && is_bounds(high - low, self.extents_m)
                && is_bounds(high, -low),
            format!("corners_m must lie in a box of extents_m {}, got {low} to {high}", self.extents_m),
        );
        let box_m3 = self.extents_m.x * self.extents_m.y * self.extents_m.z;
        must(
            self.extents_m.min_element() > 0.0 && self.extents_m.max_element() <= 10.0,
            format!("extents_m must be above 0 and at most 10, got {}", self.extents_m),
        );
        // Parts may overlap, but not all of them everywhere.
        let most_m3 = box_m3 * self.parts.len() as f32 * 1.001;
        must(
            self.volume_m3 > 0.0 && self.volume_m3 <= most_m3,
            format!("volume_m3 must be above 0 and at most {most_m3}, got {}", self.volume_m3),
        );
        must(
            (1..=PARTS_MAX).contains(&self.parts.len()),
            format!("it must have 1 to {PARTS_MAX} parts, got {}", self.parts.len()),
        );
        for (number, part) in self.parts.iter().enumerate() {
            let count = part.corners_m.len();
            must(
                (4..=CORNERS_MAX).contains(&count),
                format!("part {number} must have 4 to {CORNERS_MAX} corners, got {count}"),
            );
        }
        problems
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wedge() -> Model {
        let corners = [[-0.02, -0.03, -0.01], [0.02, -0.03, -0.01], [-0.02, 0.03, -0.01], [-0.02, -0.03, 0.01]];
        Model {
            name: "wedge".to_owned(),
            mass_kg: 0.1,
            friction: 0.8,
            extents_m: Vec3::new(0.04, 0.06, 0.02),
            volume_m3: 8e-6,
            parts: vec![ModelPart { corners_m: corners.map(Vec3::from_array).to_vec() }],
            mesh: None,
        }
    }

    #[test]
    fn names_lead_back_and_models_hide_the_primitives() {
        let models = [wedge(), Model { name: "cuboid".to_owned(), ..wedge() }].map(Arc::new);
        for shape in Shape::all(&models) {
            assert_eq!(Shape::from_name(shape.name(&models), &models), Some(shape));
        }
        for kind in ShapeKind::ALL {
            assert_eq!(Shape::from_name(kind.name(), &[]), Some(Shape::Primitive(kind)));
        }
        assert_eq!(Shape::from_name("cuboid", &models), Some(Shape::Model(1)));
        assert_eq!(Shape::from_name("cylinder", &models), None);
    }

    #[test]
    fn every_problem_of_a_model_is_named() {
        assert_eq!(wedge().problems(), [""; 0]);
        type Case = (fn(&mut Model), &'static str);
        let cases: [Case; 9] = [
            (|m| m.name = "tea cup".to_owned(), "a name must have"),
            (|m| m.mass_kg = f32::NAN, "mass_kg must be between"),
            (|m| m.friction = -0.1, "friction must be between"),
            (|m| m.extents_m.x = 0.05, "corners_m must lie in a box"),
            (|m| m.parts[0].corners_m.iter_mut().for_each(|c| c.z += 0.01), "corners_m must lie in a box"),
            (|m| m.parts[0].corners_m[2].y = f32::INFINITY, "corners_m must lie in a box"),
            (|m| m.volume_m3 = 1.0, "volume_m3 must be above 0"),
            (|m| m.parts.clear(), "1 to 1024 parts"),
            (|m| m.parts[0].corners_m.truncate(3), "4 to 256 corners"),
        ];
        for (change, expected) in cases {
            let mut model = wedge();
            change(&mut model);
            let problems = model.problems();
            assert!(problems.iter().any(|p| p.contains(expected)), "{expected}: {problems:?}");
        }
    }
}
