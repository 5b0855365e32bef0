//! Whether an object comes to rest: it is dropped alone some times, as a scene would drop it.

use schema::{Purpose, Stream};
use serde::Serialize;
use simulator::{Body, SceneObject, Unsettled, settle};

use crate::config::Config;
use crate::objects::draw_release;

/// The seed of the test drops; every object falls in the same ways.
const SEED: u64 = 1;

/// How some test drops of an object ended.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct TestDrops {
    /// It came to rest in the workspace.
    pub rested: u32,
    /// It moved on until the time limit, or the engine lost it.
    pub moved_on: u32,
    /// It came to rest outside the workspace.
    pub left: u32,
}

impl TestDrops {
    /// All drops.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.rested + self.moved_on + self.left
    }

    /// Drops an object `count` times; `None` if scenes of `config` cannot drop it.
    pub(super) fn of(body: &Body, mass_kg: f32, friction: f32, config: &Config, count: u32) -> Option<Self> {
        let Config { objects, grid, physics, settle: params, .. } = config;
        let radius_m = body.bounding_radius_m();
        if count == 0 || radius_m > objects.drop_height_m || 2.0 * radius_m > grid.size_m {
            return None;
        }
        let mut drops = Self::default();
        for number in 0..count {
            let mut stream = Stream::new(SEED, u64::from(number), Purpose::TestDrops, 0);
            let workspace_from_object = draw_release(objects, grid, [grid.size_m; 2], radius_m, &mut stream);
            let object = SceneObject { body: body.clone(), mass_kg, friction, workspace_from_object };
            match settle(physics, params, grid, &[], &[object]) {
                Ok(_) => drops.rested += 1,
                Err(Unsettled::Empty) => drops.left += 1,
                Err(Unsettled::Moving { .. } | Unsettled::Unstable) => drops.moved_on += 1,
            }
        }
        Some(drops)
    }
}

#[cfg(test)]
mod tests {
    use schema::{ShapeKind, Solid, Vec3};

    use super::*;
    use crate::config::Overrides;

    #[test]
    fn a_block_comes_to_rest_and_what_is_too_large_is_not_dropped() {
        let config = Config::load(None, Overrides::default()).unwrap();
        let block = |side_m| Solid::new(ShapeKind::Cuboid, Vec3::splat(side_m)).unwrap().into();
        let drops = |side_m| TestDrops::of(&block(side_m), 0.1, 0.8, &config, 20);
        assert_eq!(drops(0.04), Some(TestDrops { rested: 20, ..TestDrops::default() }));
        assert_eq!(drops(0.25), None);
    }

    #[test]
    fn what_has_no_time_to_rest_moves_on() {
        let mut config = Config::load(None, Overrides::default()).unwrap();
        config.settle.time_s_max = 0.5 * config.settle.rest_time_s;
        let block = Solid::new(ShapeKind::Cuboid, Vec3::splat(0.04)).unwrap().into();
        let drops = TestDrops::of(&block, 0.1, 0.8, &config, 3).unwrap();
        assert_eq!((drops.rested, drops.moved_on, drops.count()), (0, 3, 3));
    }
}
