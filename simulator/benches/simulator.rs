//! Measures the stages of a scene: settling, rays, the gate, an attempt that holds.
//! `cargo bench -p graspmill-simulator`.

use divan::Bencher;
use schema::{Camera, Grid, Gripper, Intrinsics, Pose, Procedure, ShapeKind, Solid, Vec3, axis_angle};
use simulator::{AttemptWorld, Gate, Physics, Scene, SceneObject, SceneRays, SettleParams, settle};

fn main() {
    divan::main();
}

fn drops(count: usize) -> Vec<SceneObject> {
    (0..count)
        .map(|i| {
            let kind = ShapeKind::ALL[i % 4];
            let extents_m = match kind {
                ShapeKind::Cylinder => Vec3::new(0.04, 0.04, 0.06),
                ShapeKind::HalfCylinder => Vec3::new(0.05, 0.06, 0.03),
                _ => Vec3::new(0.04, 0.05, 0.06),
            };
            let at = Vec3::new(0.1 + 0.05 * (i % 3) as f32, 0.1 + 0.05 * (i / 3) as f32, 0.25);
            SceneObject {
                body: Solid::new(kind, extents_m).expect("a solid").into(),
                mass_kg: 0.1,
                friction: 1.0,
                workspace_from_object: Pose::from_parts(at, axis_angle(Vec3::X, 0.3 * i as f32)),
            }
        })
        .collect()
}

fn settled(count: usize) -> Scene {
    settle(&Physics::FAITHFUL, &SettleParams::STANDARD, &Grid::PAPER, &[], &drops(count))
        .expect("the pile comes to rest")
        .scene
}

fn gripper() -> Gripper {
    Gripper::from_toml(include_str!("../../configs/grippers/parallel_jaw_80.toml")).expect("the shipped gripper")
}

/// A grasp of the first object from straight above, closing across its shorter side.
fn grasp(scene: &Scene) -> Pose {
    let at = scene.objects[0].workspace_from_object.translation;
    Pose::from_parts(at, axis_angle(Vec3::X, core::f32::consts::PI))
}

#[divan::bench(args = [1, 3, 5])]
fn settle_a_scene(count: usize) -> Scene {
    settled(count)
}

#[divan::bench]
fn cast_ten_thousand_rays(bencher: Bencher) {
    let rays = SceneRays::new(&settled(5));
    let down = axis_angle(Vec3::X, core::f32::consts::PI);
    let camera = Camera {
        intrinsics: Intrinsics::VGN,
        workspace_from_camera: Pose::from_parts(Vec3::new(0.15, 0.15, 0.6), down),
    };
    bencher.bench_local(|| {
        let seen = rays.seen_from(divan::black_box(&camera));
        (0..10_000).filter_map(|i| seen.depth_at([6 * (i % 100), 4 * (i / 100)])).sum::<f32>()
    });
}

#[divan::bench]
fn judge_an_approach(bencher: Bencher) {
    let scene = settled(5);
    let gate = Gate::new(&scene, &gripper(), &Procedure::PAPER);
    let grasp = grasp(&scene);
    bencher.bench_local(|| gate.blocked(divan::black_box(&grasp), 0));
}

#[divan::bench(args = [1, 5])]
fn execute_a_grasp(bencher: Bencher, count: usize) {
    let (scene, gripper) = (settled(count), gripper());
    let world = AttemptWorld::new(&Physics::FAITHFUL, &gripper, &Procedure::PAPER, &scene);
    let grasp = grasp(&scene);
    bencher.bench_local(|| world.execute(divan::black_box(&grasp), 0));
}
