//! The start of a round: objects are drawn, released and come to rest.

use generator::{draw_container, draw_drops, draw_packed, draw_release, room_m};
use schema::{Container, Polyhedron, Purpose, Stream, Vec3};
use simulator::{Scene, SceneObject, Settled, settle, settle_again};

use crate::catalogue::CatalogueObject;
use crate::config::{Config, Objects};

/// Most scenes of a round with an object that the gripper cannot span: 100 rounds of five objects for one that opens
/// 50 mm met 23 of them a round, and 108 in one.
pub(crate) const UNVIABLE_MAX: u32 = 10_000;

/// The scene at the beginning of a round.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// The objects, at rest.
    pub scene: Scene,
    /// What they lie in.
    pub container: Option<Container>,
    /// Kind of the scene: "pile", "packed", or the catalogue's name of the set.
    pub group: String,
    /// Number of rejected scenes with an object that the gripper cannot span.
    pub unviable_count: u32,
}

/// The scene of round `scene_id` of a seed, or `None` if all tries were rejected: a pure function of its arguments.
#[must_use]
pub fn start(config: &Config, seed: u64, scene_id: u64) -> Option<Start> {
    let (mut unviable_count, mut rejected_count) = (0, 0);
    let group = config.objects.group(scene_id);
    let container = draw_container(&config.scene.container, seed, scene_id);
    while rejected_count < config.scene.settle.tries_max && unviable_count < UNVIABLE_MAX {
        let settled = settled(config, container.as_ref(), seed, scene_id, rejected_count + unviable_count);
        let whole = settled.filter(|it| it.scene.objects.len() >= config.objects.count_min(scene_id));
        let Some(Settled { scene, .. }) = whole else {
            rejected_count += 1;
            continue;
        };
        if config.keys.objects.viable_only && !scene.objects.iter().all(|object| is_viable(config, object)) {
            unviable_count += 1;
            continue;
        }
        return Some(Start { scene, container, group, unviable_count });
    }
    None
}

fn settled(config: &Config, container: Option<&Container>, seed: u64, scene_id: u64, tries: u32) -> Option<Settled> {
    let generator::Config { physics, settle: params, grid, objects, .. } = &config.scene;
    let fixtures = container.map_or_else(Vec::new, |container| container.parts(grid));
    let room_m = room_m(container, objects.side_m(grid));
    let settled = match &config.objects {
        Objects::Pile { count } => {
            let objects = generator::ObjectParams { counts: vec![*count], count_weights: vec![1.0], ..objects.clone() };
            let drops = draw_drops(&objects, grid, room_m, f32::INFINITY, seed, scene_id, tries);
            settle(physics, params, grid, &fixtures, &drops)
        }
        Objects::Packed { count, params: packed } => {
            let mut stream = Stream::new(seed, scene_id, Purpose::Drops, tries);
            let placed = draw_packed(objects, packed, grid, container, f32::INFINITY, *count, &mut stream);
            settle_again(physics, params, grid, &fixtures, &placed)
        }
        Objects::Things(groups) => {
            let mut stream = Stream::new(seed, scene_id, Purpose::Drops, tries);
            let (_, things) = &groups[scene_id as usize % groups.len()];
            let release = |thing: &CatalogueObject| SceneObject {
                body: thing.body.clone(),
                mass_kg: thing.mass_kg,
                friction: thing.friction,
                workspace_from_object: draw_release(objects, grid, room_m, thing.body.bounding_radius_m(), &mut stream),
            };
            let mut drops: Vec<SceneObject> = things.iter().map(release).collect();
            stream.shuffle(&mut drops);
            settle(physics, params, grid, &fixtures, &drops)
        }
    };
    settled.ok()
}

/// Whether a gripper from above can span some part of the object along some horizontal direction.
fn is_viable(config: &Config, object: &SceneObject) -> bool {
    let gripper = &config.plan.gripper;
    let width_m = |part: &Polyhedron, degrees: u16| {
        let (sin, cos) = libm::sincosf(f32::from(degrees).to_radians());
        let along = part.corners_m().iter().map(|corner| corner.dot(Vec3::new(cos, sin, 0.0)));
        let [low, high] = along.fold([f32::INFINITY, f32::NEG_INFINITY], |[l, h], x| [l.min(x), h.max(x)]);
        high - low
    };
    let fits = |part: &Polyhedron| (0..180).any(|degrees| width_m(part, degrees) <= gripper.span_m());
    object.body.polyhedra().iter().any(|part| fits(&part.moved(&object.workspace_from_object)))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use settings::Document;

    use super::*;

    fn config(objects: &str) -> Config {
        let text = include_str!("../../configs/experiment/table1.toml");
        let start = text.find("names = ").unwrap();
        let end = start + text[start..].find('\n').unwrap();
        let text = format!("{}names = {objects}{}", &text[..start], &text[end..]);
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/experiment/table1.toml");
        Config::resolve(Document::parse(&text, &path).unwrap(), &[]).unwrap()
    }

    /// Table 1's cuboid is 85 x 50 x 100 mm: flat on its largest face both sides are wider than 80 mm, on any other
    /// face one is 50 mm.
    #[test]
    fn a_cuboid_that_lies_flat_is_drawn_anew_and_counted() {
        let config = config("[\"cuboid\"]");
        let (mut unviable, mut starts) = (0, 0);
        for scene_id in 0..40 {
            let start = start(&config, 5, scene_id).unwrap();
            let up = start.scene.objects[0].workspace_from_object.rotation.inverse() * Vec3::Z;
            assert!(up.y.abs() < 0.1, "it lies flat: up is {up}");
            unviable += start.unviable_count;
            starts += 1;
        }
        assert!(unviable > starts / 4, "{unviable}");
    }

    /// Scenes that the gripper cannot span are no fault of the physics, so there may be many more of them.
    #[test]
    fn a_small_gripper_finds_a_pile_that_it_spans() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/experiment/pile.toml");
        let document = Document::parse(include_str!("../../configs/experiment/pile.toml"), &path).unwrap();
        let set = [("objects.viable_only", "true"), ("plan.gripper", "slim_jaw_50")];
        let set = set.map(|(key, value)| (key.to_owned(), value.to_owned()));
        let mut config = Config::resolve(document, &set).unwrap();
        config.scene.settle.tries_max = 10;
        let starts: Vec<Start> = (0..6).map(|scene_id| start(&config, 5, scene_id).unwrap()).collect();
        assert!(starts.iter().any(|start| start.unviable_count > 10), "{:?}", starts.len());
        assert!(starts.iter().all(|start| start.scene.objects.iter().all(|object| is_viable(&config, object))));
    }

    #[test]
    fn names_are_taken_in_turn_and_a_set_has_all_its_objects() {
        let config = config("[\"scene_1\", \"duck_toy\"]");
        let starts: Vec<Start> = (0..4).map(|scene_id| start(&config, 5, scene_id).unwrap()).collect();
        let told: Vec<(&str, usize)> = starts.iter().map(|s| (s.group.as_str(), s.scene.objects.len())).collect();
        assert_eq!(told, [("scene_1", 3), ("duck_toy", 1), ("scene_1", 3), ("duck_toy", 1)]);
        assert_ne!(starts[1].scene, starts[3].scene);
    }
}
