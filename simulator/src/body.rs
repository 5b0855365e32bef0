//! The shape of an object: one of the four solids, or several rigidly joined convex parts.
//!
//! Objects that are not convex, such as a bottle with a nozzle, a ring of tape or a cup, consist of convex parts.
//! Physics and collision tests use the same parts. Rays do, too, unless the object is of a mesh: then they meet the
//! mesh, which the parts were made of.

use core::fmt::{self, Debug, Formatter};
use std::sync::Arc;

use schema::{Model, ModelPart, Polyhedron, Pose, Solid, TriangleMesh, Vec3, bounds_m};

use crate::convex_hull::convex_hull;

/// A part's frame is not moved by less than this, so that rounding does not move it.
const SHIFT_M_MIN: f32 = 1e-7;

/// The shape of an object: a solid, or convex parts that are rigidly joined. The origin of its frame is the centre of
/// its bounding box.
#[derive(Clone, PartialEq)]
pub struct Body {
    shape: Arc<Shape>,
    /// What cameras see in place of the parts.
    mesh: Option<Arc<TriangleMesh>>,
}

/// Without the mesh, which is long, and no part of what happens to a body.
impl Debug for Body {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Body").field(&self.shape).finish()
    }
}

#[derive(Debug, PartialEq)]
struct Shape {
    name: String,
    /// If it is one of the four.
    solid: Option<Solid>,
    parts: Vec<Part>,
    /// The parts again, in the object's frame.
    polyhedra: Vec<Polyhedron>,
    extents_m: Vec3,
    radius_m: f32,
}

/// A part of a body. Parts should not overlap: overlaps count twice in the mass.
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

/// Why something is refused as a body.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct BodyError(String);

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

impl Body {
    /// A compound of `parts`, whose poses are in a common frame. The object's frame has the same axes and its origin at
    /// the centre of the bounding box, like that of a [`Solid`].
    ///
    /// # Errors
    /// [`BodyError`] if the name is empty, if there are no parts, or if a pose is not finite or no rotation.
    pub fn of_parts(name: impl Into<String>, mut parts: Vec<Part>) -> Result<Self, BodyError> {
        let name = name.into();
        let refused = |why: &str| Err(BodyError(why.to_owned()));
        if name.is_empty() {
            return refused("a compound must have a name");
        }
        if parts.is_empty() {
            return refused("a compound must have at least one part");
        }
        let is_pose =
            |p: &Part| p.object_from_part.translation.is_finite() && p.object_from_part.rotation.is_normalized();
        if let Some(part) = parts.iter().position(|part| !is_pose(part)) {
            return refused(&format!("the pose of part {part} must be finite, with a rotation of length 1"));
        }
        let polyhedra = |parts: &[Part]| -> Vec<Polyhedron> {
            parts.iter().map(|p| p.shape.polyhedron().moved(&p.object_from_part)).collect()
        };
        let [low, high] = bounds_m(corners_m(&polyhedra(&parts)));
        let centre_m = 0.5 * (low + high);
        if centre_m.length() > SHIFT_M_MIN {
            for part in &mut parts {
                part.object_from_part.translation -= centre_m;
            }
        }
        let polyhedra = polyhedra(&parts);
        let radius_m = corners_m(&polyhedra).map(|c| c.length()).fold(0.0, f32::max);
        let shape = Shape { name, solid: None, parts, polyhedra, extents_m: high - low, radius_m };
        Ok(Self { shape: Arc::new(shape), mesh: None })
    }

    /// The body with a surface, in its frame, that cameras see in place of its parts.
    #[must_use]
    pub fn with_mesh(self, mesh: Option<Arc<TriangleMesh>>) -> Self {
        Self { mesh, ..self }
    }

    /// The surface that cameras see in place of its parts, in the object's frame, if it has one.
    #[must_use]
    pub fn mesh(&self) -> Option<&Arc<TriangleMesh>> {
        self.mesh.as_ref()
    }

    /// The parts, in the object's frame.
    #[must_use]
    pub fn parts(&self) -> &[Part] {
        &self.shape.parts
    }

    /// The name of the compound, or of the solid's kind.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.shape.name
    }

    /// The solid, if it is one.
    #[must_use]
    pub fn as_solid(&self) -> Option<Solid> {
        self.shape.solid
    }

    /// Its convex parts, in the object's frame.
    #[must_use]
    pub fn polyhedra(&self) -> &[Polyhedron] {
        &self.shape.polyhedra
    }

    /// The corners of all parts, in the object's frame, in metres.
    #[must_use]
    pub fn vertices_m(&self) -> Vec<Vec3> {
        corners_m(&self.shape.polyhedra).copied().collect()
    }

    /// Full lengths of the bounding box along the object's axes, in metres.
    #[must_use]
    pub fn extents_m(&self) -> Vec3 {
        self.shape.extents_m
    }

    /// Volume in cubic metres: the sum over the parts.
    #[must_use]
    pub fn volume_m3(&self) -> f32 {
        self.shape.parts.iter().map(|part| part.shape.volume_m3()).sum()
    }

    /// Radius of a bounding ball about the object frame's origin, in metres.
    #[must_use]
    pub fn bounding_radius_m(&self) -> f32 {
        self.shape.radius_m
    }

    /// Signed distance in metres of a point to the nearest part, where the distance to a part is that to its farthest
    /// face: 0 on the surface, negative inside. Beside an edge this is less than the distance to the edge.
    #[must_use]
    pub fn distance_outside_m(&self, point_m: Vec3) -> f32 {
        self.shape.polyhedra.iter().map(|part| outside_m(part, point_m)).fold(f32::INFINITY, f32::min)
    }
}

/// Signed distance in metres of a point to a polyhedron's farthest face.
pub(crate) fn outside_m(part: &Polyhedron, point_m: Vec3) -> f32 {
    part.planes().map(|plane| plane.normal.dot(point_m) - plane.offset_m).fold(f32::NEG_INFINITY, f32::max)
}

impl Body {
    /// The body of a dataset's model: the hulls of its parts' corners.
    ///
    /// # Errors
    /// [`BodyError`] if a part has no hull.
    pub fn of_model(model: &Model) -> Result<Self, BodyError> {
        let name = &model.name;
        let part = |(part, ModelPart { corners_m }): (usize, &ModelPart)| {
            let hull = convex_hull(corners_m).map_err(|e| BodyError(format!("model {name}, part {part}: {e}")))?;
            Ok(Part { shape: PartShape::Hull(hull), object_from_part: Pose::IDENTITY })
        };
        let parts = model.parts.iter().enumerate().map(part).collect::<Result<Vec<_>, _>>()?;
        let body = Self::of_parts(name, parts).map_err(|e| BodyError(format!("model {name}: {e}")))?;
        let shift_m = body.parts()[0].object_from_part.translation;
        Ok(body.with_mesh(model.mesh.as_ref().map(|mesh| Arc::new(mesh.moved(shift_m)))))
    }

    /// The model that a dataset stores for a catalogue's body, and from which [`Self::of_model`] makes the body again.
    ///
    /// # Errors
    /// [`BodyError`] if a part's corners have no hull in the object's frame.
    pub fn to_model(&self, mass_kg: f32, friction: f32) -> Result<Model, BodyError> {
        let mut model = Model {
            name: self.name().to_owned(),
            mass_kg,
            friction,
            extents_m: self.extents_m(),
            volume_m3: self.volume_m3(),
            parts: self.polyhedra().iter().map(|part| ModelPart { corners_m: part.corners_m().to_vec() }).collect(),
            mesh: self.mesh.clone(),
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
/// [`BodyError`] for the first without a body.
pub fn bodies_of(models: &[Arc<Model>]) -> Result<Vec<Body>, BodyError> {
    models.iter().map(|model| Body::of_model(model)).collect()
}

impl From<Solid> for Body {
    fn from(solid: Solid) -> Self {
        let shape = Shape {
            name: solid.kind.name().to_owned(),
            solid: Some(solid),
            parts: vec![Part { shape: PartShape::Solid(solid), object_from_part: Pose::IDENTITY }],
            polyhedra: vec![Polyhedron::from(&solid)],
            extents_m: solid.extents_m,
            radius_m: solid.bounding_radius_m(),
        };
        Self { shape: Arc::new(shape), mesh: None }
    }
}

fn corners_m(parts: &[Polyhedron]) -> impl Iterator<Item = &Vec3> {
    parts.iter().flat_map(Polyhedron::corners_m)
}
