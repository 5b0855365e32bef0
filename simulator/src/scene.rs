//! A scene at rest.

use schema::{ObjectRecord, ObjectShape, Polyhedron, Pose, Vec3};

use crate::Body;
use crate::body::outside_m;

/// An object in the workspace.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneObject {
    /// Shape and size.
    pub body: Body,
    /// Mass in kilograms.
    pub mass_kg: f32,
    /// Coulomb friction coefficient.
    pub friction: f32,
    /// Where it rests or, for [`crate::settle`], is released.
    pub workspace_from_object: Pose,
}

/// Objects on a table, at rest.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Height of the table's top, in metres.
    pub table_z_m: f32,
    /// What stands on the table and never moves, such as the walls of a bin: convex parts in the workspace, with the
    /// friction of the table. They may be touched and seen, and are never a target.
    pub fixtures: Vec<Polyhedron>,
    /// The objects.
    pub objects: Vec<SceneObject>,
}

impl Scene {
    /// The scene that a dataset's rows describe, so that stored attempts can be executed again. `fixtures` are the
    /// parts of its container, `bodies` those of the dataset's models, in their order ([`crate::bodies_of`]).
    ///
    /// # Panics
    /// If a row names a model without a body.
    #[must_use]
    pub fn from_records(table_z_m: f32, fixtures: Vec<Polyhedron>, records: &[ObjectRecord], bodies: &[Body]) -> Self {
        let body = |shape: &ObjectShape| match shape {
            ObjectShape::Solid(solid) => (*solid).into(),
            ObjectShape::Model { number, .. } => bodies[usize::from(*number)].clone(),
        };
        let objects = records
            .iter()
            .map(|r| SceneObject {
                body: body(&r.shape),
                mass_kg: r.mass_kg,
                friction: r.friction,
                workspace_from_object: r.workspace_from_object,
            })
            .collect();
        Self { table_z_m, fixtures, objects }
    }

    /// Whether a fixture is nearer to a point of the workspace than any object.
    #[must_use]
    pub fn is_at_fixture(&self, point_m: Vec3) -> bool {
        let nearest = self.nearest(point_m).map_or(f32::INFINITY, |id| self.distance_outside_m(id, point_m));
        self.fixtures.iter().any(|fixture| outside_m(fixture, point_m) < nearest)
    }

    fn distance_outside_m(&self, object_id: usize, point_m: Vec3) -> f32 {
        let object = &self.objects[object_id];
        object.body.distance_outside_m(object.workspace_from_object.inverse_transform_point(point_m))
    }

    /// The object whose surface is nearest to a point of the workspace, or that contains it: the target of a grasp with
    /// its tips there. `None` without objects.
    #[must_use]
    pub fn nearest(&self, point_m: Vec3) -> Option<usize> {
        let distances = (0..self.objects.len()).map(|id| (id, self.distance_outside_m(id, point_m)));
        distances.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(id, _)| id)
    }
}
