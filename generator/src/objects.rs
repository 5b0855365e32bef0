//! Draws the objects of a scene and their release poses (paper 2.3: random models, "arbitrarily scaled and rotated").

use schema::{Grid, Pose, Purpose, ShapeKind, Solid, Stream, Vec3};
use simulator::Drop;

use crate::config::ObjectLaw;
use crate::models::Models;

/// Draws the objects of a scene and the pose at which each is released. `attempt` counts the tries at this scene, from
/// 0.
#[must_use]
pub fn draw_drops(law: &ObjectLaw, models: &Models, grid: &Grid, seed: u64, scene_id: u64, attempt: u32) -> Vec<Drop> {
    let mut objects = Stream::new(seed, scene_id, Purpose::Objects, attempt);
    let mut drops = Stream::new(seed, scene_id, Purpose::Drops, attempt);
    let count = draw_count(law, &mut objects);
    (0..count)
        .map(|_| {
            if !models.is_empty() {
                return draw_model(models, law, grid, &mut objects, &mut drops);
            }
            let solid = draw_solid(law, &mut objects);
            let density_kg_m3 = objects.uniform(law.density_kg_m3[0], law.density_kg_m3[1]);
            Drop {
                body: solid.into(),
                mass_kg: density_kg_m3 * solid.volume_m3(),
                friction: objects.uniform(law.friction[0], law.friction[1]),
                workspace_from_object: draw_release(law, grid, solid.bounding_radius_m(), &mut drops),
            }
        })
        .collect()
}

/// A uniformly drawn object of the catalogue, with its own size, mass and friction.
fn draw_model(models: &Models, law: &ObjectLaw, grid: &Grid, objects: &mut Stream, drops: &mut Stream) -> Drop {
    let number = objects.index(models.bodies().len());
    let (body, model) = (&models.bodies()[number], &models.stored()[number]);
    Drop {
        body: body.clone(),
        mass_kg: model.mass_kg,
        friction: model.friction,
        workspace_from_object: draw_release(law, grid, body.bounding_radius_m(), drops),
    }
}

fn draw_count(law: &ObjectLaw, stream: &mut Stream) -> usize {
    let total: f64 = law.counts.iter().map(|(_, weight)| f64::from(*weight)).sum();
    let mut left = stream.unit() * total;
    for (count, weight) in &law.counts {
        left -= f64::from(*weight);
        if left < 0.0 {
            return *count;
        }
    }
    law.counts.last().map_or(1, |(count, _)| *count)
}

/// A shape with uniform free extents. Every shape makes the same number of draws.
fn draw_solid(law: &ObjectLaw, stream: &mut Stream) -> Solid {
    let kind = law.shapes[stream.index(law.shapes.len())];
    let size = stream.point(Vec3::splat(law.size_m[0]), Vec3::splat(law.size_m[1]));
    let extents_m = match kind {
        ShapeKind::Cuboid | ShapeKind::TriPrism => size,
        ShapeKind::Cylinder => Vec3::new(size.x, size.x, size.z),
        ShapeKind::HalfCylinder => Vec3::new(size.x, size.y, 0.5 * size.y),
    };
    Solid::new(kind, extents_m).expect("the config's sizes are above 0")
}

/// A uniform position over the workspace at which the object's bounding ball clears the walls, in a uniform
/// orientation.
fn draw_release(law: &ObjectLaw, grid: &Grid, radius_m: f32, stream: &mut Stream) -> Pose {
    let middle = 0.5 * grid.size_m;
    let reach = (middle - radius_m).max(0.0);
    let at = Vec3::new(
        middle + stream.uniform(-reach, reach),
        middle + stream.uniform(-reach, reach),
        grid.table_z_m + law.drop_height_m,
    );
    Pose::from_parts(at, stream.rotation())
}
