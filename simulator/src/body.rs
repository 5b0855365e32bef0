//! The shape of an object: one of the four solids, or several rigidly joined convex parts.
//!
//! Objects that are not convex, such as a bottle with a nozzle, a ring of tape or a cup, consist of convex parts.
//! Physics, rays and collision tests use the same parts, so an object has one shape.

use std::sync::Arc;

use schema::{Model, ModelPart, Plane, Polyhedron, Pose, Solid, Vec3, bounds_m};

use crate::convex_hull::convex_hull;

/// A part's frame is not moved by less than this, so that rounding does not move it.
const SHIFT_M_MIN: f32 = 1e-7;

/// The shape of an object.
#[derive(Debug, Clone, PartialEq)]
pub enum Body {
    /// One of the four primitive shapes.
    Solid(Solid),
    /// Several convex parts.
    Compound(Arc<Compound>),
}

/// Rigidly joined convex parts with a name. The origin of the object frame is the centre of the bounding box.
#[derive(Debug, Clone, PartialEq)]
pub struct Compound {
    name: String,
    parts: Vec<Part>,
    /// The parts again, in the object's frame.
    polyhedra: Vec<Polyhedron>,
    extents_m: Vec3,
}

/// A part of a compound. Parts should not overlap: overlaps count twice in the mass.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// Its shape.
    pub shape: PartShape,
    /// Its pose.
    pub object_from_part: Pose,
}

/// The shape of a part.
#[derive(Debug, Clone, PartialEq)]
pub enum PartShape {
    /// One of the four primitive shapes.
    Solid(Solid),
    /// The convex hull of some points.
    Hull(Polyhedron),
}

/// Why parts are refused as a compound.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum CompoundError {
    /// The name is empty.
    #[error("a compound must have a name")]
    NoName,
    /// There are no parts.
    #[error("a compound must have at least one part")]
    NoParts,
    /// The pose of a part (by its index, from 0) is not finite, or its rotation does not have length 1.
    #[error("the pose of part {0} must be finite, with a rotation of length 1")]
    Pose(usize),
}

impl PartShape {
    fn polyhedron(&self) -> Polyhedron {
        match self {
            Self::Solid(solid) => solid.into(),
            Self::Hull(hull) => hull.clone(),
        }
    }

    fn volume_m3(&self) -> f32 {
        match self {
            Self::Solid(solid) => solid.volume_m3(),
            Self::Hull(hull) => hull.volume_m3(),
        }
    }
}

impl Compound {
    /// A compound of `parts`, whose poses are in a common frame. The object's frame has the same axes and its origin at
    /// the centre of the bounding box, like that of a [`Solid`].
    ///
    /// # Errors
    /// [`CompoundError`].
    pub fn new(name: impl Into<String>, mut parts: Vec<Part>) -> Result<Self, CompoundError> {
        let name = name.into();
        if name.is_empty() {
            return Err(CompoundError::NoName);
        }
        if parts.is_empty() {
            return Err(CompoundError::NoParts);
        }
        let is_pose =
            |p: &Part| p.object_from_part.translation.is_finite() && p.object_from_part.rotation.is_normalized();
        if let Some(part) = parts.iter().position(|part| !is_pose(part)) {
            return Err(CompoundError::Pose(part));
        }
        let polyhedra = |parts: &[Part]| -> Vec<Polyhedron> {
            parts.iter().map(|p| p.shape.polyhedron().moved(&p.object_from_part)).collect()
        };
        let placed = polyhedra(&parts);
        let [low, high] = bounds_m(corners_m(&placed));
        let centre_m = 0.5 * (low + high);
        if centre_m.length() > SHIFT_M_MIN {
            for part in &mut parts {
                part.object_from_part.translation -= centre_m;
            }
        }
        Ok(Self { name, polyhedra: polyhedra(&parts), parts, extents_m: high - low })
    }

    /// The parts, in the object's frame.
    #[must_use]
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }
}

impl Body {
    /// The name of the compound, or of the solid's kind.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Solid(solid) => solid.kind.name(),
            Self::Compound(compound) => &compound.name,
        }
    }

    /// The solid, if it is one.
    #[must_use]
    pub fn as_solid(&self) -> Option<Solid> {
        match self {
            Self::Solid(solid) => Some(*solid),
            Self::Compound(_) => None,
        }
    }

    /// Its convex parts, in the object's frame.
    #[must_use]
    pub fn polyhedra(&self) -> Vec<Polyhedron> {
        match self {
            Self::Solid(solid) => vec![solid.into()],
            Self::Compound(compound) => compound.polyhedra.clone(),
        }
    }

    /// The corners of all parts, in the object's frame, in metres.
    #[must_use]
    pub fn vertices_m(&self) -> Vec<Vec3> {
        match self {
            Self::Solid(solid) => solid.vertices_m(),
            Self::Compound(compound) => corners_m(&compound.polyhedra).copied().collect(),
        }
    }

    /// Full lengths of the bounding box along the object's axes, in metres.
    #[must_use]
    pub fn extents_m(&self) -> Vec3 {
        match self {
            Self::Solid(solid) => solid.extents_m,
            Self::Compound(compound) => compound.extents_m,
        }
    }

    /// Volume in cubic metres: the sum over the parts.
    #[must_use]
    pub fn volume_m3(&self) -> f32 {
        match self {
            Self::Solid(solid) => solid.volume_m3(),
            Self::Compound(compound) => compound.parts.iter().map(|part| part.shape.volume_m3()).sum(),
        }
    }

    /// Radius of a bounding ball about the object frame's origin, in metres.
    #[must_use]
    pub fn bounding_radius_m(&self) -> f32 {
        match self {
            Self::Solid(solid) => solid.bounding_radius_m(),
            Self::Compound(compound) => corners_m(&compound.polyhedra).map(|c| c.length()).fold(0.0, f32::max),
        }
    }

    /// Signed distance in metres of a point to the nearest part, where the distance to a part is that to its farthest
    /// face: 0 on the surface, negative inside. Beside an edge this is less than the distance to the edge.
    #[must_use]
    pub fn distance_outside_m(&self, point_m: Vec3) -> f32 {
        let above = |plane: Plane| plane.normal.dot(point_m) - plane.offset_m;
        match self {
            Self::Solid(solid) => solid.planes().into_iter().map(above).fold(f32::NEG_INFINITY, f32::max),
            Self::Compound(compound) => {
                let outside = |part: &Polyhedron| part.planes().map(above).fold(f32::NEG_INFINITY, f32::max);
                compound.polyhedra.iter().map(outside).fold(f32::INFINITY, f32::min)
            }
        }
    }
}

/// Why a dataset's model is refused as a body.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct ModelError(String);

impl Body {
    /// The body of a dataset's model: the hulls of its parts' corners.
    ///
    /// # Errors
    /// [`ModelError`] if a part has no hull.
    pub fn of_model(model: &Model) -> Result<Self, ModelError> {
        let name = &model.name;
        let part = |(part, ModelPart { corners_m }): (usize, &ModelPart)| {
            let hull = convex_hull(corners_m).map_err(|e| ModelError(format!("model {name}, part {part}: {e}")))?;
            Ok(Part { shape: PartShape::Hull(hull), object_from_part: Pose::IDENTITY })
        };
        let parts = model.parts.iter().enumerate().map(part).collect::<Result<Vec<_>, _>>()?;
        let compound = Compound::new(name, parts).map_err(|e| ModelError(format!("model {name}: {e}")))?;
        Ok(compound.into())
    }

    /// The model that a dataset stores for a catalogue's body, and from which [`Self::of_model`] makes the body again.
    ///
    /// # Errors
    /// [`ModelError`] if a part's corners have no hull in the object's frame.
    pub fn to_model(&self, mass_kg: f32, friction: f32) -> Result<Model, ModelError> {
        let mut model = Model {
            name: self.name().to_owned(),
            mass_kg,
            friction,
            extents_m: self.extents_m(),
            volume_m3: self.volume_m3(),
            parts: self.polyhedra().iter().map(|part| ModelPart { corners_m: part.corners_m().to_vec() }).collect(),
        };
        // From the stored values, not from the original ones: the last digits may differ.
        let again = Self::of_model(&model)?;
        model.extents_m = again.extents_m();
        model.volume_m3 = again.volume_m3();
        Ok(model)
    }
}

/// The bodies of a dataset's models, in their order.
///
/// # Errors
/// [`ModelError`] for the first without a body.
pub fn bodies_of(models: &[Arc<Model>]) -> Result<Vec<Body>, ModelError> {
    models.iter().map(|model| Body::of_model(model)).collect()
}

impl From<Solid> for Body {
    fn from(solid: Solid) -> Self {
        Self::Solid(solid)
    }
}

impl From<Compound> for Body {
    fn from(compound: Compound) -> Self {
        Self::Compound(Arc::new(compound))
    }
}

fn corners_m(parts: &[Polyhedron]) -> impl Iterator<Item = &Vec3> {
    parts.iter().flat_map(Polyhedron::corners_m)
}
