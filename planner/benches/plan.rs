//! Plans of the demo and their parts: `cargo bench -p planner`.

use perception::{clusters, find_plane, surface_cloud};
use planner::config::{BuiltIn, Config};
use planner::segment::segment;
use planner::volume::{Volume, Workspace, fuse};
use planner::voxel::detect::{Side, detect};
use planner::{Observation, PlanOptions, Planner, demo, input};
use schema::{Grid, Purpose, Stream, Vec3, VoxelGrid};

fn main() {
    divan::main();
}

fn views() -> Vec<planner::View> {
    match input::assemble(&demo::request().expect("what comes with the program is sound"), None, Grid::PAPER)
        .expect("sound")
        .observation
    {
        Observation::Views(views) => views,
        _ => Vec::new(),
    }
}

fn volume(observation: &Observation) -> Volume {
    let workspace = Workspace::cube(Grid::PAPER);
    fuse(observation, &workspace, config().cloud).expect("what comes with the program is sound")
}

fn field() -> VoxelGrid {
    volume(&Observation::Views(views())).grid
}

fn config() -> Config {
    BuiltIn::Paper.config().expect("what comes with the program is sound")
}

#[divan::bench]
fn tsdf_of_three_views(bencher: divan::Bencher<'_, '_>) {
    let views = Observation::Views(views());
    bencher.bench_local(|| volume(divan::black_box(&views)));
}

#[divan::bench]
fn cloud_of_tsdf(bencher: divan::Bencher<'_, '_>) {
    let field = field();
    bencher.bench_local(|| surface_cloud(divan::black_box(&field), 0.0025));
}

#[divan::bench]
fn plane_of_cloud(bencher: divan::Bencher<'_, '_>) {
    let (points, params) = (surface_cloud(&field(), 0.0025), config().plane);
    bencher.bench_local(|| find_plane(&points, &params, &mut Stream::new(1, 0, Purpose::Plane, 0)));
}

#[divan::bench]
fn clusters_of_what_is_left(bencher: divan::Bencher<'_, '_>) {
    let points: Vec<Vec3> = surface_cloud(&field(), 0.0025).into_iter().filter(|p| p.z > 0.06).collect();
    let params = config().clusters;
    bencher.bench_local(|| clusters(divan::black_box(&points), &params));
}

#[divan::bench]
fn plane_and_clusters(bencher: divan::Bencher<'_, '_>) {
    let (points, config) = (surface_cloud(&field(), 0.0025), config());
    bencher.with_inputs(|| points.clone()).bench_local_values(|points| segment(points, &config));
}

#[divan::bench]
fn detections_of_volumes(bencher: divan::Bencher<'_, '_>) {
    let (field, params) = (field(), config().detection);
    let (quality, width): (Vec<f32>, Vec<f32>) = field.values.iter().map(|value| (0.5 + 0.5 * value, 5.0)).unzip();
    bencher.bench_local(|| detect(&Grid::PAPER, &field.values, &quality, &width, Side::Front, &params));
}

#[divan::bench]
fn whole_plan_of_tsdf(bencher: divan::Bencher<'_, '_>) {
    let (planner, observation) =
        (Planner::built_in(config()).expect("what comes with the program is sound"), Observation::Tsdf(field()));
    bencher.bench_local(|| planner.plan(&observation, &PlanOptions::default()));
}

#[divan::bench(args = [BuiltIn::Judge, BuiltIn::Paper])]
fn whole_plan_of_three_views(bencher: divan::Bencher<'_, '_>, settings: BuiltIn) {
    let config = settings.config().expect("what comes with the program is sound");
    let planner = Planner::built_in(config).expect("what comes with the program is sound");
    let observation = Observation::Views(views());
    bencher.bench_local(|| planner.plan(&observation, &PlanOptions::default()));
}
