//! Compares the field with a slow, obvious implementation: f64, voxel by voxel, explicit matrices, no shared code.

use perception::{
    COLUMNS_PX, DepthNoise, DexNoise, Field as _, ScaledView, Sights, TRUNCATION_VOXELS, Tsdf, add_depth_noise,
    camera_at, draw_views, fuse_images, seen_above, surface_cloud, surface_of_blocks,
};
use proptest::prelude::*;
use schema::{Camera, DepthImage, Grid, Intrinsics, Lattice, Purpose, Stream, Vec3, ViewParams};

/// An irregular scene with holes, as a whole image.
fn lumpy_image(lens: &Intrinsics, seed: u64) -> DepthImage {
    let mut stream = Stream::new(seed, 0, Purpose::DepthNoise, 7);
    let depth_m = (0..lens.width_px * lens.height_px)
        .map(|p| {
            let (u, v) = ((p % lens.width_px) as f64, (p / lens.width_px) as f64);
            let lumps = 0.55 + 0.08 * libm::sin(u / 31.0) * libm::cos(v / 23.0);
            if stream.index(50) == 0 { 0.0 } else { lumps as f32 }
        })
        .collect();
    DepthImage { width_px: lens.width_px, height_px: lens.height_px, depth_m }
}

/// Mean and count of a voxel's observations, or `None` where the result depends on rounding in the last bits.
fn obvious(views: &[(Camera, DepthImage)], centre_m: [f64; 3], truncation_m: f64) -> Option<(f64, u32)> {
    let (mut sum, mut count) = (0.0, 0);
    for (camera, image) in views {
        let q = camera.workspace_from_camera.rotation;
        let [x, y, z, w] = [q.x, q.y, q.z, q.w].map(f64::from);
        let columns = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)],
            [2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)],
            [2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)],
        ];
        let eye = camera.workspace_from_camera.translation.to_array().map(f64::from);
        let from_eye = [centre_m[0] - eye[0], centre_m[1] - eye[1], centre_m[2] - eye[2]];
        let seen = columns.map(|c| c[0] * from_eye[0] + c[1] * from_eye[1] + c[2] * from_eye[2]);
        if seen[2] <= 0.0 {
            continue;
        }
        let lens = camera.intrinsics;
        let [fx, fy, cx, cy] = [lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px].map(f64::from);
        let (u, v) = (seen[0] / seen[2] * fx + cx, seen[1] / seen[2] * fy + cy);
        let unsure = |c: f64| (c + 0.5 - (c + 0.5).round()).abs() < 1e-3;
        if unsure(u) || unsure(v) {
            return None;
        }
        let (u, v) = (u.round(), v.round());
        if u < 0.0 || v < 0.0 || u >= lens.width_px as f64 || v >= lens.height_px as f64 {
            continue;
        }
        let depth = f64::from(image.depth_m[v as usize * image.width_px + u as usize]);
        if depth <= 0.0 {
            continue;
        }
        let (across, down) = ((u - cx) / fx, (v - cy) / fy);
        let distance_m = (depth - seen[2]) * (across * across + down * down + 1.0).sqrt();
        if (distance_m + truncation_m).abs() < 1e-6 {
            return None;
        }
        if distance_m > -truncation_m {
            sum += (distance_m / truncation_m).min(1.0);
            count += 1;
        }
    }
    Some((if count > 0 { sum / f64::from(count) } else { 0.0 }, count))
}

/// Returns the number of voxels that depend on rounding, and of observed voxels.
fn check_against_obvious(grid: Grid, params: &ViewParams, truncation_voxels: f32, seed: u64) -> (usize, usize) {
    let views: Vec<_> = draw_views(params, &grid, &mut Stream::new(seed, 0, Purpose::Views, 0))
        .iter()
        .enumerate()
        .map(|(n, view)| (camera_at(view, &grid, Intrinsics::VGN), lumpy_image(&Intrinsics::VGN, seed + n as u64)))
        .collect();
    let mut tsdf = Tsdf::new(grid, truncation_voxels);
    for (camera, image) in &views {
        tsdf.integrate(camera, |pixel| image.at(pixel));
    }
    let stored = tsdf.to_voxels();
    let voxel_m = f64::from(grid.size_m) / grid.resolution as f64;
    let (mut unsure, mut observed, side) = (0, 0, grid.resolution);
    for voxel in (0..side.pow(3)).map(|n| [n / (side * side), n / side % side, n % side]) {
        let centre_m = voxel.map(|n| (n as f64 + 0.5) * voxel_m);
        let Some((mean, count)) = obvious(&views, centre_m, f64::from(truncation_voxels) * voxel_m) else {
            unsure += 1;
            continue;
        };
        let value = tsdf.at(voxel);
        assert_eq!(value.is_some(), count > 0, "{voxel:?} seen by {count}");
        observed += usize::from(count > 0);
        if let Some(value) = value {
            assert!((f64::from(value) - mean).abs() < 1e-4, "{voxel:?}: {value} against {mean}");
        }
        let expected = if count > 0 && mean.abs() < 0.98 { 0.5 * (mean + 1.0) } else { 0.0 };
        let off = (f64::from(stored.values[grid.flat(voxel)]) - expected).abs();
        assert!(off < 1e-4 || (mean.abs() - 0.98).abs() < 1e-4, "{voxel:?} stored off by {off}");
    }
    (unsure, observed)
}

#[test]
fn the_papers_grid_agrees_with_the_obvious_implementation() {
    let params = ViewParams { counts: [4, 6], ..ViewParams::VGN };
    let (unsure, observed) = check_against_obvious(Grid::PAPER, &params, TRUNCATION_VOXELS, 11);
    assert!(unsure < 2_000, "{unsure} voxels hang on a rounding");
    assert!(observed > 30_000, "only {observed} voxels observed");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_grid_agrees_with_the_obvious_implementation(
        resolution in 2_usize..24, size_m in 0.2_f32..0.5, truncation_voxels in 0.5_f32..8.0, seed in 0_u64..1_000,
    ) {
        let grid = Grid { resolution, size_m, table_z_m: 0.05 };
        let params = ViewParams { counts: [1, 3], polar_rad: [0.0, 1.4], ..ViewParams::VGN };
        check_against_obvious(grid, &params, truncation_voxels, seed);
    }

    #[test]
    fn images_on_all_threads_give_the_bits_of_rays_cast_as_asked(
        seed in 0_u64..1_000, resolution in prop::sample::select(vec![3_usize, 40, 90]), kind in 0_u8..3,
    ) {
        let (grid, lens) = (Grid { resolution, ..Grid::PAPER }, Intrinsics::VGN);
        // Level, in waves, or as rough as no surface is; in places nothing.
        let sensor = |[u, v]: [usize; 2]| {
            let depth = match kind {
                0 => 0.45,
                1 => 0.45 + 0.05 * libm::sinf(u as f32 / 17.0) * libm::sinf(v as f32 / 29.0),
                _ => 0.5 + 0.3 * libm::sinf((u * u + 7 * v) as f32),
            };
            (!(u + v).is_multiple_of(13)).then_some(depth)
        };
        let depth_m = (0..640 * 480).map(|p| sensor([p % 640, p / 640]).unwrap_or(0.0)).collect();
        let image = DepthImage { width_px: 640, height_px: 480, depth_m };
        // Over a level table and from straight above the voxels with values reach furthest from what was seen.
        let params = ViewParams { counts: [1, 2], polar_rad: [0.0, 0.5 * f32::from(kind)], ..ViewParams::VGN };
        let views = draw_views(&params, &grid, &mut Stream::new(seed, 0, Purpose::Views, 0));
        let views: Vec<(Camera, &DepthImage)> = views.iter().map(|view| (camera_at(view, &grid, lens), &image)).collect();
        let mut of_rays = Tsdf::new(grid, TRUNCATION_VOXELS);
        views.iter().for_each(|(camera, _)| of_rays.integrate(camera, sensor));
        prop_assert_eq!(fuse_images(grid, TRUNCATION_VOXELS, &views), of_rays.to_voxels());
    }

    #[test]
    fn the_pixels_asked_for_are_those_onto_which_the_lens_projects(seed in 0_u64..1_000) {
        let grid = Grid::PAPER;
        let params = ViewParams { polar_rad: [0.0, 1.5], radius_sizes: [0.3, 2.4], ..ViewParams::VGN };
        for view in draw_views(&params, &grid, &mut Stream::new(seed, 1, Purpose::Views, 0)) {
            let camera = camera_at(&view, &grid, Intrinsics::VGN);
            let mut asked = Vec::new();
            Tsdf::new(grid, 4.0).integrate(&camera, |pixel| {
                asked.push(pixel);
                None
            });
            let camera_from_workspace = camera.workspace_from_camera.inverse();
            let projected = (0..grid.len()).filter_map(|n| {
                let centre_m = camera_from_workspace * grid.centre_m([n / 1600, n / 40 % 40, n % 40]);
                camera.intrinsics.project(centre_m)
            });
            // The two compute a voxel's centre by different sums, so one pixel in some thousands differs.
            let projected: Vec<_> = projected.collect();
            prop_assert!(asked.len().abs_diff(projected.len()) < 20, "{} and {}", asked.len(), projected.len());
            if asked.len() == projected.len() {
                let differing = asked.iter().zip(&projected).filter(|(a, b)| a != b).count();
                prop_assert!(differing < 200, "{} of {}", differing, asked.len());
            }
        }
    }
}

/// The blocks have every voxel that differs from 0, wherever the lattice begins, and the same surface.
#[test]
fn blocks_are_the_field_where_it_has_values() {
    let (grid, lens) = (Grid::PAPER, Intrinsics::VGN);
    let low_m = Vec3::new(-0.05, 0.02, -0.01);
    let lattice = Lattice { low_m, counts: [105, 65, 81], voxel_size_m: 0.0025, table_z_m: 0.05 };
    let images = [lumpy_image(&lens, 4), lumpy_image(&lens, 5)];
    for seed in 0..4 {
        let params = ViewParams { counts: [2, 2], polar_rad: [0.0, 1.4], ..ViewParams::VGN };
        let views = draw_views(&params, &grid, &mut Stream::new(seed, 2, Purpose::Views, 0));
        let views: Vec<(Camera, &DepthImage)> =
            views.iter().zip(&images).map(|(view, image)| (camera_at(view, &grid, lens), image)).collect();
        let dense = fuse_images(lattice, TRUNCATION_VOXELS, &views);
        let views: Vec<ScaledView<'_>> = views.iter().map(|(camera, image)| (*camera, *image, 1.0)).collect();
        let seen: Vec<_> = views.iter().map(|view| seen_above(view, COLUMNS_PX, f32::NEG_INFINITY)).collect();
        let blocks = Sights::new(&views).fuse_near(&lattice, TRUNCATION_VOXELS, &seen);
        let mut off = 0;
        for flat in 0..lattice.len() {
            let voxel = lattice.voxel(flat);
            if (0..3).all(|axis| voxel[axis] + 1 < lattice.counts[axis]) {
                // A voxel's centre is summed up differently, so a pixel at its border may be the next one.
                let (a, b) = (dense.cell(voxel), blocks.cell(voxel));
                off += usize::from(a.iter().zip(b).any(|(a, b)| (a - b).abs() > 1e-3));
            }
        }
        let seen = dense.values.iter().filter(|value| **value > 0.0).count();
        assert!(seen > 20_000 && off * 500 < seen, "{off} of {seen} cells differ");
        let [all, own] = [surface_cloud(&dense, 0.0025).len(), surface_of_blocks(&blocks, 0.0025).len()];
        assert!(all > 3_000 && all.abs_diff(own) * 200 < all, "{all} points, {own} of blocks");
    }
}

#[test]
fn the_order_of_two_views_does_not_matter_and_a_view_twice_changes_nothing() {
    let grid = Grid::PAPER;
    let cameras: Vec<_> =
        draw_views(&ViewParams { counts: [2, 6], ..ViewParams::VGN }, &grid, &mut Stream::new(2, 0, Purpose::Views, 0))
            .iter()
            .map(|view| camera_at(view, &grid, Intrinsics::VGN))
            .collect();
    let images = [lumpy_image(&Intrinsics::VGN, 1), lumpy_image(&Intrinsics::VGN, 2)];
    let fuse = |order: &[usize]| {
        let mut tsdf = Tsdf::new(grid, TRUNCATION_VOXELS);
        for n in order {
            tsdf.integrate(&cameras[*n], |pixel| images[*n].at(pixel));
        }
        tsdf.to_voxels()
    };
    assert_eq!(fuse(&[0, 1]), fuse(&[1, 0]));
    assert_eq!(fuse(&[0]), fuse(&[0, 0]));
}

#[test]
fn a_noisy_sensor_still_sees_the_scene() {
    let (grid, lens) = (Grid::PAPER, Intrinsics::VGN);
    let camera = camera_at(&schema::View { radius_m: 0.6, polar_rad: 0.4, azimuth_rad: 1.0 }, &grid, lens);
    let fuse = |noise: &DepthNoise| {
        let mut image = lumpy_image(&lens, 3);
        add_depth_noise(&mut image, noise, &mut Stream::new(5, 0, Purpose::DepthNoise, 0));
        let mut tsdf = Tsdf::new(grid, TRUNCATION_VOXELS);
        tsdf.integrate(&camera, |pixel| image.at(pixel));
        tsdf
    };
    let clean = fuse(&DepthNoise::None);
    for noise in [DepthNoise::Gaussian { std_m: 0.003 }, DepthNoise::Dex(DexNoise::GIGA)] {
        let noisy = fuse(&noise);
        let differences: Vec<f32> = (0..grid.len())
            .map(|n| [n / 1600, n / 40 % 40, n % 40])
            .filter_map(|voxel| Some((noisy.at(voxel)? - clean.at(voxel)?).abs()))
            .collect();
        let mean = differences.iter().sum::<f32>() / differences.len() as f32;
        assert!(mean > 0.0 && mean < 0.5, "{noise:?} moves the field by {mean} truncations");
    }
}
