//! Draws the objects of a scene and their release poses (paper 2.3: random models, "arbitrarily scaled and rotated").

use schema::{Grid, Pose, Purpose, ShapeKind, Solid, Stream, Vec3};
use simulator::{Body, SceneObject};

use crate::config::ObjectParams;

/// Draws the objects of a scene and the pose at which each is released. `attempt` counts the tries at this scene, from
/// 0.
#[must_use]
pub fn draw_drops(params: &ObjectParams, grid: &Grid, seed: u64, scene_id: u64, attempt: u32) -> Vec<SceneObject> {
    let mut objects = Stream::new(seed, scene_id, Purpose::Objects, attempt);
    let mut drops = Stream::new(seed, scene_id, Purpose::Drops, attempt);
    let count = *objects.weighted(&params.counts, &params.count_weights);
    (0..count)
        .map(|_| {
            let (body, mass_kg, friction) = draw_body(params, &mut objects);
            let workspace_from_object = draw_release(params, grid, body.bounding_radius_m(), &mut drops);
            SceneObject { body, mass_kg, friction, workspace_from_object }
        })
        .collect()
}

/// A body, its mass and its friction: a primitive, or a uniformly drawn object of the catalogue.
fn draw_body(params: &ObjectParams, stream: &mut Stream) -> (Body, f32, f32) {
    let models = &params.catalogue;
    if models.is_empty() {
        let solid = draw_solid(params, stream);
        let density_kg_m3 = stream.uniform(params.density_kg_m3[0], params.density_kg_m3[1]);
        let friction = stream.uniform(params.friction[0], params.friction[1]);
        return (solid.into(), density_kg_m3 * solid.volume_m3(), friction);
    }
    let number = stream.index(models.bodies().len());
    let model = &models.stored()[number];
    (models.bodies()[number].clone(), model.mass_kg, model.friction)
}

/// A shape with uniform free extents. Every shape makes the same number of draws.
fn draw_solid(params: &ObjectParams, stream: &mut Stream) -> Solid {
    let kind = params.shapes[stream.index(params.shapes.len())];
    let size = stream.point(Vec3::splat(params.size_m[0]), Vec3::splat(params.size_m[1]));
    let extents_m = match kind {
        ShapeKind::Cuboid | ShapeKind::TriPrism => size,
        ShapeKind::Cylinder => Vec3::new(size.x, size.x, size.z),
        ShapeKind::HalfCylinder => Vec3::new(size.x, size.y, 0.5 * size.y),
    };
    Solid::new(kind, extents_m).expect("the config's sizes are above 0")
}

/// A uniform position over the workspace at which the object's bounding ball clears the walls, in a uniform
/// orientation.
#[must_use]
pub fn draw_release(params: &ObjectParams, grid: &Grid, radius_m: f32, stream: &mut Stream) -> Pose {
    let middle = 0.5 * grid.size_m;
    let reach = (middle - radius_m).max(0.0);
    let at = Vec3::new(
        middle + stream.uniform(-reach, reach),
        middle + stream.uniform(-reach, reach),
        grid.table_z_m + params.drop_height_m,
    );
    Pose::from_parts(at, stream.rotation())
}
