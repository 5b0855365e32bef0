//! What the objects of a scene lie in: its kind and its sizes are drawn before the objects, and stay for all tries.

use schema::{Container, ContainerKind, Grid, Purpose, Stream, View};
use serde::Serialize;
use settings::settings;

/// Cameras stand in front of a shelf, within this of its middle …
const FRONT_RAD_MAX: f32 = 0.6;
/// … and this far from the vertical, for its board hides it from above.
const FRONT_POLAR_RAD: [f32; 2] = [1.0, 1.4];

settings! {
    /// A kind of containers, such as bins of some size. They stand in the middle of the workspace; the table is their
    /// floor.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize)]
    pub struct ContainerParams {
        /// A bin and a tray have four walls; a shelf has a back, sides and a board, and is seen from its open front.
        pub kind: ContainerKind,
        /// Share of the scenes that have such a one.
        pub share: f32 where 0.0..=1.0,
        /// Inner lengths along x and y at the walls' upper edges, uniform.
        pub inner_m: [f32; 2] where 0.05..=2.5,
        /// Height of the walls above the table, uniform; a shelf's board lies on them.
        pub height_m: [f32; 2] where 0.005..=1.0,
        /// Thickness of walls and board, uniform.
        pub thickness_m: [f32; 2] where 0.001..=0.1,
        /// How far the walls lean outwards, uniform.
        pub slope_rad: [f32; 2] where 0.0..=0.6; or [0.0, 0.0],
    }
}

impl ContainerParams {
    /// Why the largest does not fit into the workspace, or the most leaning has no floor.
    fn fault(&self, grid: &Grid) -> Option<String> {
        if self.kind == ContainerKind::Shelf && self.slope_rad != [0.0, 0.0] {
            return Some("a shelf must have slope_rad = [0, 0], for a board lies on its walls".to_owned());
        }
        let of = |inner_m: f32| Container {
            kind: self.kind,
            inner_m: [inner_m; 2],
            height_m: self.height_m[1],
            thickness_m: self.thickness_m[1],
            slope_rad: self.slope_rad[1],
        };
        self.inner_m.into_iter().find_map(|inner_m| of(inner_m).check(grid).err())
    }
}

/// What is wrong with kinds of containers in a workspace.
#[must_use]
pub fn container_faults(kinds: &[ContainerParams], grid: &Grid) -> Vec<String> {
    let sum: f32 = kinds.iter().map(|kind| kind.share).sum();
    let sum = (sum > 1.0 + 1e-3).then(|| format!("shares must be 1 at most in all, got {sum}"));
    sum.into_iter().chain(kinds.iter().filter_map(|kind| kind.fault(grid))).collect()
}

/// The container of a scene, if it has one.
#[must_use]
pub fn draw_container(kinds: &[ContainerParams], seed: u64, scene_id: u64) -> Option<Container> {
    let mut stream = Stream::new(seed, scene_id, Purpose::Container, 0);
    let mut left = stream.uniform(0.0, 1.0);
    let params = kinds.iter().find(|params| {
        left -= params.share;
        left < 0.0
    })?;
    let mut draw = |[low, high]: [f32; 2]| stream.uniform(low, high);
    Some(Container {
        kind: params.kind,
        inner_m: [draw(params.inner_m), draw(params.inner_m)],
        height_m: draw(params.height_m),
        thickness_m: draw(params.thickness_m),
        slope_rad: draw(params.slope_rad),
    })
}

/// Sides of the rectangle in the middle of the workspace over which objects are released, in metres: without a
/// container those of a square.
#[must_use]
pub fn room_m(container: Option<&Container>, side_m: f32) -> [f32; 2] {
    container.map_or([side_m; 2], |container| container.inner_m)
}

/// Views of a scene as its cameras have them: those of a shelf are moved before its front, in the order of their
/// azimuths and with their distances.
pub(crate) fn in_front(container: Option<&Container>, views: Vec<View>) -> Vec<View> {
    if container.is_none_or(|container| container.kind != ContainerKind::Shelf) {
        return views;
    }
    let share = |angle_rad: f32, most_rad: f32| (angle_rad / most_rad).clamp(0.0, 1.0);
    let [least_rad, most_rad] = FRONT_POLAR_RAD;
    let moved = |view: View| View {
        azimuth_rad: core::f32::consts::PI * 1.5
            + FRONT_RAD_MAX * (2.0 * share(view.azimuth_rad, core::f32::consts::TAU) - 1.0),
        polar_rad: least_rad + (most_rad - least_rad) * share(view.polar_rad, core::f32::consts::FRAC_PI_2),
        ..view
    };
    views.into_iter().map(moved).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use schema::{HitKind, Outcome, Vec3};
    use settings::Document;
    use simulator::{AttemptWorld, Scene, SceneRays};

    use super::*;
    use crate::{Config, Overrides, make_scene};

    const JUDGE: &str = include_str!("../../configs/generate/judge.toml");

    fn config(text: &str) -> Result<Config, settings::Error> {
        Config::read(Document::parse(text, Path::new("judge.toml")).unwrap(), Overrides::default())
    }

    /// The config for judges with more containers.
    fn walled() -> Config {
        let shares = [("0.28", "0.6"), ("0.05", "0.12"), ("0.1", "0.15")];
        let more = |text: String, (from, to): (&str, &str)| {
            text.replacen(&format!("share = {from}\n"), &format!("share = {to}\n"), 1)
        };
        config(&shares.into_iter().fold(JUDGE.to_owned(), more)).unwrap()
    }

    #[test]
    fn kinds_come_by_their_shares_within_their_ranges() {
        let kinds = walled().container;
        let mut counts = [0; 4];
        for scene in 0..4_000 {
            let Some(drawn) = draw_container(&kinds, 3, scene) else {
                counts[3] += 1;
                continue;
            };
            let of = kinds.iter().find(|kind| kind.kind == drawn.kind).unwrap();
            drawn.check(&Grid::PAPER).unwrap();
            let [x_m, y_m] = drawn.inner_m;
            for (range, value) in [
                (of.inner_m, x_m),
                (of.inner_m, y_m),
                (of.height_m, drawn.height_m),
                (of.thickness_m, drawn.thickness_m),
                (of.slope_rad, drawn.slope_rad),
            ] {
                assert!((range[0]..=range[1]).contains(&value), "{drawn:?}");
            }
            counts[drawn.kind as usize] += 1;
        }
        assert!((2_250..2_550).contains(&counts[0]) && (400..560).contains(&counts[3]), "{counts:?}");
        assert_eq!(draw_container(&[], 3, 7), None);
    }

    #[test]
    fn containers_that_do_not_fit_are_refused_with_their_key() {
        let told = |from: &str, to: &str| config(&JUDGE.replacen(from, to, 1)).unwrap_err().to_string();
        let message = told("inner_m = [0.20, 0.28]", "inner_m = [0.20, 0.50]");
        assert!(message.contains("container") && message.contains("fit into a workspace of 0.48 m"), "{message}");
        let message = told("share = 0.28", "share = 0.9");
        assert!(message.contains("container") && message.contains("at most"), "{message}");
        let message = told("kind = \"tray\"", "kind = \"shelf\"");
        assert!(message.contains("a shelf must have slope_rad"), "{message}");
    }

    /// A judge would take the field's end for the sign of a wall.
    #[test]
    fn the_field_of_a_judges_data_reaches_beyond_all_walls_and_things() {
        let config = config(JUDGE).unwrap();
        let most_m = |container: &ContainerParams| 0.5 * container.inner_m[1] + container.thickness_m[1];
        let most_m = config.container.iter().map(most_m).fold(0.5 * config.objects.side_m(&config.grid), f32::max);
        assert!(most_m + 0.08 < 0.5 * config.grid.size_m, "{most_m}");
    }

    /// Scenes of all kinds: their rows alone give the attempts again; objects lie within; the shelf's cameras see the
    /// inside.
    #[test]
    fn rows_give_the_same_attempts_and_objects_lie_within() {
        let config = walled();
        let (mut kinds, mut hits) = ([0; 4], 0);
        for scene_id in 0..16 {
            let rows = make_scene(&config, scene_id, 24).unwrap();
            let scene =
                Scene::from_records(config.grid.table_z_m, rows.scene.fixtures(&config.grid), &rows.objects, &[]);
            let gripper = config.gripper.of_scene(scene_id);
            let world = AttemptWorld::new(&config.physics, gripper, &config.procedure, &scene);
            for attempt in &rows.attempts {
                let again = world.execute(&attempt.workspace_from_grasp, attempt.object_id as usize);
                assert_eq!((again.outcome, again.width_m), (attempt.outcome, attempt.width_m), "{attempt:?}");
                hits += usize::from(attempt.hit == Some(HitKind::Container));
            }
            let Some(container) = rows.scene.container else {
                kinds[3] += 1;
                continue;
            };
            kinds[container.kind as usize] += 1;
            let [_, top_m] = container.free_m(&config.grid);
            let (half_m, middle_m) = (container.inner_m.map(|inner_m| 0.5 * inner_m), 0.5 * config.grid.size_m);
            let within = rows.objects.iter().filter(|object| {
                let at = object.workspace_from_object.translation;
                (at.x - middle_m).abs() < half_m[0] && (at.y - middle_m).abs() < half_m[1] && at.z < top_m.z
            });
            // Some roll off a tray or out of a shelf.
            let is_bin = container.kind == ContainerKind::Bin;
            let least = if is_bin { rows.objects.len() } else { rows.objects.len() / 2 };
            assert!(within.count() >= least, "{scene_id}: {container:?}");
            if container.kind == ContainerKind::Shelf {
                let front_m = middle_m - 0.25 * container.inner_m[1];
                let floor_m = Vec3::new(middle_m, front_m, config.grid.table_z_m + 1e-3);
                let empty = SceneRays::new(&Scene { objects: Vec::new(), ..scene.clone() });
                for view in &rows.scene.views {
                    let camera = perception::camera_at(view, &config.grid, config.camera.intrinsics());
                    let seen = camera.workspace_from_camera.inverse_transform_point(floor_m);
                    let pixel = camera.intrinsics.project(seen).unwrap();
                    let depth_m = empty.seen_from(&camera).depth_at(pixel).unwrap();
                    assert!((depth_m - seen.z).abs() < 0.02, "{view:?}: {depth_m} {}", seen.z);
                }
            }
        }
        assert!(kinds.iter().all(|count| *count > 0) && hits > 20, "{kinds:?} {hits}");
    }

    /// Without the limit more would.
    #[test]
    fn at_most_half_of_the_proposals_close_on_a_wall() {
        let config = walled();
        let (mut all, mut on_walls) = (0, 0);
        for scene_id in 0..12 {
            let rows = make_scene(&config, scene_id, 60).unwrap();
            if rows.scene.container.is_none_or(|container| container.kind != ContainerKind::Bin) {
                continue;
            }
            let scene =
                Scene::from_records(config.grid.table_z_m, rows.scene.fixtures(&config.grid), &rows.objects, &[]);
            for attempt in rows.attempts.iter().filter(|a| a.rule.approach == schema::Approach::Proposal) {
                let closing_m = attempt.workspace_from_grasp.transform_point(Vec3::new(0.0, 0.0, -0.01));
                (all, on_walls) = (all + 1, on_walls + usize::from(scene.is_at_fixture(closing_m)));
            }
        }
        assert!(all > 60 && on_walls > 0 && on_walls * 5 <= all * 3, "{on_walls} of {all}");
    }

    #[test]
    fn walls_keep_their_place_in_the_order_of_decision() {
        let config = walled();
        let collides = |outcome: Outcome| {
            matches!(outcome, Outcome::PregraspCollision | Outcome::ApproachCollision | Outcome::HitOther)
        };
        for attempt in (0..8).flat_map(|scene_id| make_scene(&config, scene_id, 24).unwrap().attempts) {
            assert_eq!(attempt.hit.is_some(), collides(attempt.outcome), "{attempt:?}");
            assert!(attempt.hit != Some(HitKind::Container) || attempt.hit_object_id.is_none(), "{attempt:?}");
        }
    }
}
