//! Heaps that our stepper lets come to rest against those of rapier, in distribution.

use generator::draw_drops;
use schema::{Engine, Physics, Vec3};
use simulator::{SettleParams, Settled, settle};

use super::small;

/// What is compared: a sample of all objects each.
#[derive(Default)]
struct Heaps {
    /// Height of the centre over the table, in metres.
    heights: Vec<f32>,
    /// How steep the object's own z stands: 0 if it lies, 50 if it stands, in whole numbers.
    tilts: Vec<f32>,
    /// Distance from the middle of the workspace, in metres.
    places: Vec<f32>,
    /// Height of the lowest corner over the table, in metres; what lies on it counts as 1 mm.
    bottoms: Vec<f32>,
    rejected: usize,
}

impl Heaps {
    fn of(engine: Engine, scenes: u64) -> Self {
        let config = small();
        let physics = Physics { engine, ..config.physics };
        let solver_iterations = if engine == Engine::Rapier { 8 } else { config.settle.solver_iterations };
        let params = SettleParams { solver_iterations, ..config.settle };
        let mut heaps = Self::default();
        for scene_id in 0..scenes {
            let drops =
                draw_drops(&config.objects, &config.grid, [config.grid.size_m; 2], f32::INFINITY, 9810, scene_id, 0);
            match settle(&physics, &params, &config.grid, &[], &drops) {
                Ok(settled) => heaps.add(&settled),
                Err(_) => heaps.rejected += 1,
            }
        }
        heaps
    }

    fn add(&mut self, settled: &Settled) {
        let table_z_m = settled.scene.table_z_m;
        for object in &settled.scene.objects {
            let pose = object.workspace_from_object;
            self.heights.push(pose.translation.z - table_z_m);
            self.tilts.push((50.0 * (pose.rotation * Vec3::Z).z.abs()).round());
            self.places.push((pose.translation - Vec3::splat(0.15)).truncate().length());
            let corners = object.body.vertices_m().into_iter().map(|corner| pose.transform_point(corner).z);
            self.bottoms.push((corners.fold(f32::INFINITY, f32::min) - table_z_m).max(0.001));
        }
    }
}

/// Kolmogorov's and Smirnov's distance of two samples, as a multiple of what it exceeds by chance once in a thousand.
fn distance(a: &[f32], b: &[f32]) -> f32 {
    let sorted = |sample: &[f32]| {
        let mut sample = sample.to_vec();
        sample.sort_by(f32::total_cmp);
        sample
    };
    let (a, b) = (sorted(a), sorted(b));
    let share = |sample: &[f32], x: f32| sample.partition_point(|y| *y <= x) as f32 / sample.len() as f32;
    let widest = a.iter().chain(&b).map(|x| (share(&a, *x) - share(&b, *x)).abs()).fold(0.0, f32::max);
    let (n, m) = (a.len() as f32, b.len() as f32);
    widest / (1.949 * ((n + m) / (n * m)).sqrt())
}

#[test]
fn heaps_are_rapier_s_in_distribution() {
    let [ours, theirs] = Engine::ALL.map(|engine| Heaps::of(engine, 200));
    for (what, a, b) in [
        ("height", &ours.heights, &theirs.heights),
        ("tilt", &ours.tilts, &theirs.tilts),
        ("place", &ours.places, &theirs.places),
        ("bottom", &ours.bottoms, &theirs.bottoms),
    ] {
        assert!(a.len() > 500 && distance(a, b) < 1.0, "{what}: {}", distance(a, b));
    }
    // The drops are the same, but a heap forgets them.
    let moved = ours.places.iter().zip(&theirs.places).filter(|(a, b)| (**a - **b).abs() > 0.001).count();
    assert!(moved > 100, "only {moved} objects rest elsewhere: is it the same engine?");
    assert!(ours.rejected <= theirs.rejected + 3, "{} and {} heaps never rest", ours.rejected, theirs.rejected);
}
