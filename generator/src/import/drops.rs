//! Whether an object comes to rest: it is dropped alone some times, as a scene would drop it.

use schema::{Purpose, Stream};
use simulator::{Body, SceneObject, settle};

use crate::config::Config;
use crate::objects::draw_release;

/// The seed of the test drops; every object falls in the same ways.
const SEED: u64 = 1;

/// After how many of `count` drops an object comes to rest in the workspace; `None` if scenes of `config` cannot drop
/// it.
pub(super) fn rested(body: &Body, mass_kg: f32, friction: f32, config: &Config, count: u32) -> Option<u32> {
    let Config { objects, grid, physics, settle: params, .. } = config;
    let radius_m = body.bounding_radius_m();
    if count == 0 || radius_m > objects.drop_height_m || 2.0 * radius_m > grid.size_m {
        return None;
    }
    let rests = |number: &u32| {
        let mut stream = Stream::new(SEED, u64::from(*number), Purpose::TestDrops, 0);
        let workspace_from_object = draw_release(objects, grid, [grid.size_m; 2], radius_m, &mut stream);
        let object = SceneObject { body: body.clone(), mass_kg, friction, workspace_from_object };
        settle(physics, params, grid, &[], &[object]).is_ok()
    };
    Some((0..count).filter(rests).count() as u32)
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
        let rested = |side_m| rested(&block(side_m), 0.1, 0.8, &config, 20);
        assert_eq!(rested(0.04), Some(20));
        assert_eq!(rested(0.25), None);
    }

    #[test]
    fn what_has_no_time_to_rest_moves_on() {
        let mut config = Config::load(None, Overrides::default()).unwrap();
        config.settle.time_s_max = 0.5 * config.settle.rest_time_s;
        let block = Solid::new(ShapeKind::Cuboid, Vec3::splat(0.04)).unwrap().into();
        assert_eq!(rested(&block, 0.1, 0.8, &config, 3), Some(0));
    }
}
