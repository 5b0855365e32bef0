//! A thousand grasp candidates of a scene: a box on a table.

use divan::Bencher;
use grasps::CandidateSampler;
use schema::{Grid, Gripper, Purpose, Stream, Vec3, VoxelGrid};

fn main() {
    divan::main();
}

#[divan::bench]
fn a_thousand_candidates(bencher: Bencher<'_, '_>) {
    let Ok(gripper) = Gripper::from_toml(Gripper::BUILT_IN[0].1) else { return };
    let value = |index: usize| {
        let at_m = Grid::PAPER.centre_m([index / 1600, index / 40 % 40, index % 40]);
        let off = (at_m - Vec3::new(0.15, 0.15, 0.08)).abs() - Vec3::new(0.02, 0.025, 0.03);
        let to_box = off.max(Vec3::ZERO).length() + off.max_element().min(0.0);
        let tsdf = (to_box.min(at_m.z - 0.05) / 0.03).clamp(-1.0, 1.0);
        if tsdf.abs() < 0.98 { 0.5 * (tsdf + 1.0) } else { 0.0 }
    };
    let Ok(field) = VoxelGrid::new(Grid::PAPER, (0..64_000).map(value).collect()) else { return };
    let sampler = CandidateSampler::new(&gripper, 0.05);
    bencher.bench(|| sampler.sample(&field, 1000, &mut Stream::new(1, 0, Purpose::Proposals, 0)));
}
