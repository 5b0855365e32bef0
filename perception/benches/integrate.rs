//! 640 × 480 views onto voxels: `cargo bench -p graspmill-perception`.

use perception::{NoiseKind, TRUNCATION_VOXELS, Tsdf, add_depth_noise, camera_at, fuse_images};
use schema::{Camera, DepthImage, Grid, Intrinsics, Purpose, Stream, Vec3, View};

fn main() {
    divan::main();
}

/// An oblique look at a bare table.
fn table_view() -> (Camera, DepthImage) {
    let view = View { radius_m: 0.6, polar_rad: 0.5, azimuth_rad: 0.7 };
    let camera = camera_at(&view, &Grid::PAPER, Intrinsics::VGN);
    let pose = camera.workspace_from_camera;
    let depth_m = (0..480 * 640)
        .map(|p| {
            let fall = (pose.rotation * camera.intrinsics.ray([p % 640, p / 640])).dot(Vec3::Z);
            (Grid::PAPER.table_z_m - pose.translation.z) / fall
        })
        .collect();
    (camera, DepthImage { width_px: 640, height_px: 480, depth_m })
}

#[divan::bench]
fn integrate_one_view(bencher: divan::Bencher<'_, '_>) {
    let (camera, image) = table_view();
    let mut tsdf = Tsdf::new(Grid::PAPER, TRUNCATION_VOXELS);
    bencher.bench_local(|| tsdf.integrate(divan::black_box(&camera), |pixel| image.at(pixel)));
}

/// Three such views, as a plan fuses them, for the judge and for its grasp candidates.
#[divan::bench(args = [40, 120])]
fn fuse_three_images(bencher: divan::Bencher<'_, '_>, resolution: usize) {
    let (camera, image) = table_view();
    let views = [(camera, &image); 3];
    bencher
        .bench_local(|| fuse_images(Grid { resolution, ..Grid::PAPER }, TRUNCATION_VOXELS, divan::black_box(&views)));
}

#[divan::bench]
fn to_voxels(bencher: divan::Bencher<'_, '_>) {
    let (camera, image) = table_view();
    let mut tsdf = Tsdf::new(Grid::PAPER, TRUNCATION_VOXELS);
    tsdf.integrate(&camera, |pixel| image.at(pixel));
    bencher.bench_local(|| tsdf.to_voxels());
}

#[divan::bench(args = NoiseKind::ALL.map(NoiseKind::name))]
fn noise(bencher: divan::Bencher<'_, '_>, kind: &str) {
    let (camera, clean) = table_view();
    let noise = NoiseKind::from_name(kind).unwrap_or(NoiseKind::None).noise(0.005, camera.intrinsics.fx_px);
    let mut stream = Stream::new(0, 0, Purpose::DepthNoise, 0);
    bencher.with_inputs(|| clean.clone()).bench_local_values(|mut image| {
        add_depth_noise(&mut image, &noise, &mut stream);
        image
    });
}
