//! Draws the objects of a scene and their release poses (paper 2.3: random models, "arbitrarily scaled and rotated").

use schema::{Grid, Polyhedron, Pose, Purpose, ShapeKind, Solid, Stream, Vec3, bounds_m};
use simulator::{Body, SceneObject};

use crate::config::ObjectParams;

/// How often an object is drawn that is too wide; a catalogue may have no other.
const DRAWS_MAX: usize = 1_000;

/// Draws the objects of a scene and the pose at which each is released. A gripper that spans `span_m` can grasp each
/// in any pose, if there are such objects. They are released over a rectangle with sides `room_m`. `attempt` counts the
/// tries at this scene, from 0.
#[must_use]
pub fn draw_drops(
    params: &ObjectParams,
    grid: &Grid,
    room_m: [f32; 2],
    span_m: f32,
    seed: u64,
    scene_id: u64,
    attempt: u32,
) -> Vec<SceneObject> {
    let mut objects = Stream::new(seed, scene_id, Purpose::Objects, attempt);
    let mut drops = Stream::new(seed, scene_id, Purpose::Drops, attempt);
    let count = *objects.weighted(&params.counts, &params.count_weights);
    (0..count)
        .map(|_| {
            let drawn = draw_spanned(span_m, || draw_body(params, &mut objects), |(body, ..)| middle_width_m(body));
            let (body, mass_kg, friction) = drawn;
            let workspace_from_object = draw_release(params, grid, room_m, body.bounding_radius_m(), &mut drops);
            SceneObject { body, mass_kg, friction, workspace_from_object }
        })
        .collect()
}

/// The first of at most [`DRAWS_MAX`] objects that is not wider than `span_m`, or the last.
pub(crate) fn draw_spanned<T>(span_m: f32, mut draw: impl FnMut() -> T, width_m: impl Fn(&T) -> f32) -> T {
    let mut drawn = draw();
    for _ in 1..DRAWS_MAX {
        if span_m == f32::INFINITY || width_m(&drawn) <= span_m {
            break;
        }
        drawn = draw();
    }
    drawn
}

/// The second longest side of the part of which it is shortest, in metres: whichever way that part lies, a gripper from
/// above can span it if it opens wider.
pub(crate) fn middle_width_m(body: &Body) -> f32 {
    let width_m = |part: &Polyhedron| {
        let [low, high] = bounds_m(part.corners_m());
        let mut sides_m = (high - low).to_array();
        sides_m.sort_by(f32::total_cmp);
        sides_m[1]
    };
    body.polyhedra().iter().map(width_m).fold(f32::INFINITY, f32::min)
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

/// A uniform position over a rectangle with sides `room_m` in the middle of the workspace, at which the object's
/// bounding ball clears the walls, in a uniform orientation.
#[must_use]
pub fn draw_release(params: &ObjectParams, grid: &Grid, room_m: [f32; 2], radius_m: f32, stream: &mut Stream) -> Pose {
    let middle = 0.5 * grid.size_m;
    let [reach_x, reach_y] = room_m.map(|side_m| (0.5 * side_m - radius_m).max(0.0));
    let at = Vec3::new(
        middle + stream.uniform(-reach_x, reach_x),
        middle + stream.uniform(-reach_y, reach_y),
        grid.table_z_m + params.drop_height_m,
    );
    Pose::from_parts(at, stream.rotation())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use settings::Document;

    use crate::config::{Sampler, Shares};
    use crate::{Config, Overrides, make_scene};

    /// Of how many of 40 scenes a gripper that opens 50 mm spans two sides of every object.
    fn spanned(spanned_share: f32) -> usize {
        let judge =
            Document::parse(include_str!("../../configs/generate/judge.toml"), Path::new("judge.toml")).unwrap();
        let set = [("gripper".to_owned(), "slim_jaw_50".to_owned())];
        let read = Config::read(judge, Overrides { set: &set, ..Overrides::default() }).unwrap();
        // The rules are the quickest.
        let config = Config { spanned_share, sampler: Sampler::Rules, shares: Shares::NONE, ..read };
        let fits = |shape: &schema::ObjectShape| {
            let wide = shape.extents_m().to_array().into_iter().filter(|side_m| *side_m > 0.048 + 1e-6);
            wide.count() < 2
        };
        let all = |scene_id: &u64| {
            let rows = make_scene(&config, *scene_id, 1).unwrap();
            rows.objects.iter().all(|object| fits(&object.shape))
        };
        (0..40).filter(all).count()
    }

    #[test]
    fn a_share_of_the_scenes_has_only_what_the_gripper_spans() {
        let [none, half, all] = [0.0, 0.5, 1.0].map(spanned);
        assert!(none < 8 && (14..=28).contains(&half) && all == 40, "{none}, {half}, {all}");
    }
}
