//! Packed scenes: upright objects, taller than wide, side by side on the table, like VGN's second kind of scene.
//!
//! Only geometry and draws; the caller lets the result come to rest. An object that collides keeps its shape and gets
//! another position, up to [`TRIES_MAX`] times. (VGN draws another object at each try, which favours small ones, and
//! stops after twelve tries in all, so some of its scenes have too few objects.)

use schema::{Container, Grid, Pose, Quat, ShapeKind, Solid, Stream, Vec3, axis_angle};
use simulator::{Body, SceneObject};

use crate::config::{ObjectParams, PackedParams};
use crate::objects::{draw_spanned, middle_width_m};

/// Height above the table at which an object is released.
const DROP_M: f32 = 0.0005;

/// Maximum number of positions to try for an object.
const TRIES_MAX: u32 = 1_000;
/// Objects have their centres at least this far inside the workspace: as in VGN, in [0.08, 0.22] m of 0.30 m.
const MARGIN_M: f32 = 0.08;

/// Draws `count` objects of a packed scene and their positions within the container, if there is one; fewer if some
/// found none in many tries. A gripper that spans `span_m` can grasp each, if there are such objects.
#[must_use]
pub fn draw_packed(
    objects: &ObjectParams,
    params: &PackedParams,
    grid: &Grid,
    container: Option<&Container>,
    span_m: f32,
    count: usize,
    stream: &mut Stream,
) -> Vec<SceneObject> {
    let mut placed = Vec::with_capacity(count);
    let mut taken: Vec<Footprint> = Vec::with_capacity(count);
    for _ in 0..count {
        let Some((body, mass_kg, friction, stance)) = draw_upright(objects, params, span_m, stream) else { continue };
        let place = find_place(params.gap_m, grid, container, objects.side_m(grid), &stance, &taken, stream);
        if let Some((workspace_from_object, footprint)) = place {
            placed.push(SceneObject { body, mass_kg, friction, workspace_from_object });
            taken.push(footprint);
        }
    }
    placed
}

/// A primitive, or an object of the catalogue that has these sizes, with its mass, its friction and how it stands; none
/// if the catalogue has no such object.
fn draw_upright(
    objects: &ObjectParams,
    params: &PackedParams,
    span_m: f32,
    stream: &mut Stream,
) -> Option<(Body, f32, f32, Stance)> {
    let models = &objects.catalogue;
    if models.is_empty() {
        let draw = || draw_solid(objects, params, stream);
        let solid = draw_spanned(span_m, draw, |solid| middle_width_m(&(*solid).into()));
        let density_kg_m3 = stream.uniform(objects.density_kg_m3[0], objects.density_kg_m3[1]);
        let friction = stream.uniform(objects.friction[0], objects.friction[1]);
        return Some((solid.into(), density_kg_m3 * solid.volume_m3(), friction, Stance::of(&solid)));
    }
    let fitting: Vec<usize> =
        (0..models.stored().len()).filter(|n| params.fits(models.stored()[*n].extents_m)).collect();
    let draw = || fitting.get(stream.index(fitting.len().max(1))).copied();
    let number = draw_spanned(span_m, draw, |number| number.map_or(0.0, |n| middle_width_m(&models.bodies()[n])))?;
    let model = &models.stored()[number];
    Some((models.bodies()[number].clone(), model.mass_kg, model.friction, Stance::upright(model.extents_m)))
}

/// A shape with uniform free extents. Every shape makes the same number of draws.
fn draw_solid(objects: &ObjectParams, params: &PackedParams, stream: &mut Stream) -> Solid {
    let kind = objects.shapes[stream.index(objects.shapes.len())];
    let [a, b] = [(); 2].map(|()| stream.uniform(params.width_m[0], params.width_m[1]));
    let height = stream.uniform(params.height_m[0], params.height_m[1]);
    let extents_m = match kind {
        ShapeKind::Cuboid => Vec3::new(a, b, height),
        ShapeKind::Cylinder => Vec3::new(a, a, height),
        ShapeKind::TriPrism => Vec3::new(height, a, b),
        ShapeKind::HalfCylinder => Vec3::new(height, a, 0.5 * a),
    };
    Solid::new(kind, extents_m).expect("the widths and heights are above 0")
}

/// The first of at most [`TRIES_MAX`] positions at which the object hits nothing.
fn find_place(
    gap_m: f32,
    grid: &Grid,
    container: Option<&Container>,
    side_m: f32,
    stance: &Stance,
    taken: &[Footprint],
    stream: &mut Stream,
) -> Option<(Pose, Footprint)> {
    let whole = [Vec3::ZERO, Vec3::new(grid.size_m, grid.size_m, f32::INFINITY)];
    let free_m = container.map_or(whole, |container| container.free_m(grid));
    let z_m = grid.table_z_m + DROP_M + 0.5 * stance.height_m;
    let margin_m = MARGIN_M + 0.5 * (grid.size_m - side_m);
    let [low, high] = [margin_m, grid.size_m - margin_m];
    if z_m + 0.5 * stance.height_m > free_m[1].z {
        return None;
    }
    (0..TRIES_MAX).find_map(|_| {
        let at = Vec3::new(stream.uniform(low, high), stream.uniform(low, high), z_m);
        let yaw = axis_angle(Vec3::Z, stream.uniform(0.0, core::f32::consts::TAU));
        let footprint = stance.footprint(at, yaw);
        let is_free = footprint.is_inside(free_m) && taken.iter().all(|other| footprint.is_apart(other, gap_m));
        is_free.then(|| (Pose::from_parts(at, yaw * stance.upright_from_object), footprint))
    })
}

/// The upright pose of a shape: cuboid, cylinder and a catalogue's object along z, shapes extruded along x on their
/// end.
struct Stance {
    upright_from_object: Quat,
    /// Half sides of the footprint along x and y, before any yaw.
    half_m: [f32; 2],
    height_m: f32,
}

impl Stance {
    fn of(solid: &Solid) -> Self {
        let e = solid.extents_m;
        match solid.kind {
            ShapeKind::Cuboid | ShapeKind::Cylinder => Self::upright(e),
            // A quarter turn back about y: x points up, z along −x.
            ShapeKind::TriPrism | ShapeKind::HalfCylinder => {
                let half = core::f32::consts::FRAC_1_SQRT_2;
                let upright_from_object = Quat::from_xyzw(0.0, -half, 0.0, half);
                Self { upright_from_object, half_m: [0.5 * e.z, 0.5 * e.y], height_m: e.x }
            }
        }
    }

    fn upright(extents_m: Vec3) -> Self {
        let half_m = [0.5 * extents_m.x, 0.5 * extents_m.y];
        Self { upright_from_object: Quat::IDENTITY, half_m, height_m: extents_m.z }
    }

    fn footprint(&self, at: Vec3, yaw: Quat) -> Footprint {
        Footprint { centre_m: at, half_m: [yaw * Vec3::X * self.half_m[0], yaw * Vec3::Y * self.half_m[1]] }
    }
}

/// The bounding rectangle of an object's footprint on the table.
struct Footprint {
    centre_m: Vec3,
    /// Half of each side, as a vector along it. The test is in the plane; heights do not matter.
    half_m: [Vec3; 2],
}

impl Footprint {
    fn reach_m(&self, axis: Vec3) -> f32 {
        self.half_m.iter().map(|half| half.dot(axis).abs()).sum()
    }

    /// Separating axes: two rectangles are apart if they are apart along a side of one of them.
    fn is_apart(&self, other: &Self, gap_m: f32) -> bool {
        let between = other.centre_m - self.centre_m;
        self.half_m.iter().chain(&other.half_m).any(|side| {
            let axis = side.normalize();
            between.dot(axis).abs() > self.reach_m(axis) + other.reach_m(axis) + gap_m
        })
    }

    fn is_inside(&self, [least_m, most_m]: [Vec3; 2]) -> bool {
        [Vec3::X, Vec3::Y].into_iter().zip([0, 1]).all(|(axis, number)| {
            let (middle, reach) = (self.centre_m.dot(axis), self.reach_m(axis));
            middle - reach >= least_m[number] && middle + reach <= most_m[number]
        })
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use schema::Purpose;
    use settings::Document;

    use super::*;
    use crate::config::{Config, OF_PRIMITIVES, Overrides};

    const HOUSEHOLD: PackedParams = PackedParams::HOUSEHOLD;

    fn drawn(params: &PackedParams, stream: &mut Stream) -> Vec<SceneObject> {
        let config = Config::load(None, Overrides::default()).unwrap();
        draw_packed(&config.objects, params, &Grid::PAPER, None, f32::INFINITY, 5, stream)
    }

    fn scene(number: u64) -> Vec<SceneObject> {
        drawn(&HOUSEHOLD, &mut Stream::new(3, number, Purpose::Objects, 0))
    }

    fn solid_of(object: &SceneObject) -> Solid {
        object.body.as_solid().unwrap()
    }

    fn corners_m(object: &SceneObject) -> Vec<Vec3> {
        object.body.vertices_m().into_iter().map(|v| object.workspace_from_object.transform_point(v)).collect()
    }

    /// Whether a point of the workspace lies in the solid, independently of rectangles and yaw.
    fn holds(object: &SceneObject, point: Vec3) -> bool {
        let local = object.workspace_from_object.inverse().transform_point(point);
        solid_of(object).planes().iter().all(|plane| plane.normal.dot(local) <= plane.offset_m)
    }

    /// Number of 2 mm × 2 mm × 10 mm samples inside no object, one object, and more.
    fn samples(objects: &[SceneObject]) -> [usize; 3] {
        let mut counts = [0; 3];
        for cell in 0..150 * 150 * 3 {
            let [i, j, k] = [cell % 150, cell / 150 % 150, cell / 22_500].map(|n| n as f32);
            let point = Vec3::new(0.001 + 0.002 * i, 0.001 + 0.002 * j, 0.055 + 0.01 * k);
            counts[objects.iter().filter(|o| holds(o, point)).count().min(2)] += 1;
        }
        counts
    }

    #[test]
    fn nothing_overlaps_and_the_sampling_would_see_it() {
        for number in 0..25 {
            let mut objects = scene(number);
            let [_, one, more] = samples(&objects);
            assert!(one > 500 && more == 0, "scene {number}: {one} in one object, {more} in several");
            let at = objects[0].workspace_from_object.translation;
            objects[1].workspace_from_object.translation.x = at.x;
            objects[1].workspace_from_object.translation.y = at.y;
            assert!(samples(&objects)[2] > 0, "scene {number}: two objects in one place go unseen");
        }
    }

    #[test]
    fn all_stand_upright_on_the_table_and_inside_the_workspace() {
        let mut kinds = [0; 4];
        for object in (0..100).flat_map(scene) {
            let corners = corners_m(&object);
            let low = corners.iter().copied().reduce(Vec3::min).unwrap();
            let high = corners.iter().copied().reduce(Vec3::max).unwrap();
            assert!((low.z - 0.0505).abs() < 1e-6, "{object:?} stands at {}", low.z);
            assert!(low.min_element() >= -1e-6 && high.max_element() <= 0.30 + 1e-6, "{object:?}: {low} {high}");
            let at = object.workspace_from_object.translation;
            assert!([at.x, at.y].iter().all(|c| (0.08..=0.22).contains(c)), "{object:?}");
            // Every corner is at the bottom or at the top, and the height is that of the parameters.
            let (height, rise) = (high.z - low.z, |c: &Vec3| c.z - low.z);
            assert!((0.06 - 1e-6..=0.14 + 1e-6).contains(&height), "{object:?} is {height} m high");
            assert!(corners.iter().all(|c| rise(c) < 1e-6 || height - rise(c) < 1e-6), "{object:?} leans");
            kinds[ShapeKind::ALL.iter().position(|kind| *kind == solid_of(&object).kind).unwrap()] += 1;
        }
        assert!(kinds.iter().all(|count| *count > 80), "{kinds:?}");
    }

    #[test]
    fn objects_of_a_catalogue_stand_with_z_up_if_they_have_the_sizes() {
        let judge =
            Document::parse(include_str!("../../configs/generate/judge.toml"), Path::new("judge.toml")).unwrap();
        let read = |low_m: &str| {
            let mut own = judge.clone();
            let objects = own.table_mut()["objects"].as_table_mut().unwrap();
            OF_PRIMITIVES.iter().for_each(|key| drop(objects.remove(*key)));
            objects.insert("catalogue".to_owned(), "household-train".to_owned().into());
            let set = [("shares.rules", "0.0"), ("shares.proposals", "0.45"), ("packed.height_m", low_m)];
            let set = set.map(|(key, value)| (key.to_owned(), value.to_owned()));
            Config::read(own, Overrides { set: &set, ..Overrides::default() })
        };
        let config = read("[0.04, 0.2]").unwrap();
        let params = config.packed.unwrap();
        let mut names = std::collections::BTreeSet::new();
        for number in 0..40 {
            let mut stream = Stream::new(3, number, Purpose::Objects, 0);
            let placed = draw_packed(&config.objects, &params, &Grid::PAPER, None, f32::INFINITY, 4, &mut stream);
            for object in &placed {
                let corners = corners_m(object);
                let [low, high] = schema::bounds_m(&corners);
                let height_m = high.z - low.z;
                assert!((low.z - 0.0505).abs() < 1e-5 && (0.04..=0.2).contains(&height_m), "{object:?}");
                let up = object.workspace_from_object.rotation * Vec3::Z;
                assert!(up.z > 0.9999, "{object:?}");
                names.insert(object.body.name().to_owned());
            }
        }
        assert!(names.len() > 20, "{names:?}");
        assert!(!names.iter().any(|name| name.starts_with("saucer")), "flat things: {names:?}");
        let refused = read("[0.249, 0.25]").unwrap_err().to_string();
        assert!(refused.contains("packed must have sizes"), "{refused}");
    }

    #[test]
    fn the_default_law_reaches_its_count() {
        let full = (0..2_000).filter(|number| scene(*number).len() == 5).count();
        assert!(full > 1_980, "{full} of 2000");
    }

    #[test]
    fn objects_without_a_place_are_given_up_after_tries_max() {
        // No position is a metre from the first object: 6 draws for each of 5 objects, 3 for the first one's position,
        // 3 for each try of the 4 others.
        let params = PackedParams { gap_m: 1.0, ..HOUSEHOLD };
        let mut stream = Stream::new(3, 0, Purpose::Objects, 0);
        assert_eq!(drawn(&params, &mut stream).len(), 1);
        let mut fresh = Stream::new(3, 0, Purpose::Objects, 0);
        for _ in 0..6 * 5 + 3 + 3 * TRIES_MAX * 4 {
            fresh.bits();
        }
        assert_eq!(stream.bits(), fresh.bits());
    }

    #[test]
    fn the_same_stream_gives_the_same_scene() {
        assert_eq!(scene(5), scene(5));
        assert_ne!(scene(5), scene(6));
    }
}
