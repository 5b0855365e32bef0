//! What a camera saw: the points of its depth image.

use rayon::prelude::*;
use schema::{Camera, DepthImage, Mat3, Vec3};

/// A point that was seen, in the frame of its view's pose, and its depth, in metres.
pub type SeenPoint = (Vec3, f32);

/// A camera, its image, and the factor by which the image's depths are too long.
pub type ScaledView<'a> = (Camera, &'a DepthImage, f32);

/// Rows of pixels that are looked at together.
const ROWS: usize = 32;

/// Every so many pixels, about `columns_px` of them lie along an image's width.
pub(crate) fn stride_px(image: &DepthImage, columns_px: usize) -> usize {
    image.width_px.div_ceil(columns_px).max(1)
}

/// The points that a view saw no lower than `above_m`, in the frame of its pose, and their depths, which are divided by
/// the view's factor, on all threads: of about `columns_px` pixels along the image's width and of rows as far apart.
/// Pixels without a depth have none.
#[must_use]
pub fn seen_above((camera, image, factor): &ScaledView<'_>, columns_px: usize, above_m: f32) -> Vec<SeenPoint> {
    let (stride, lens, eye_m) =
        (stride_px(image, columns_px), camera.intrinsics, camera.workspace_from_camera.translation);
    let turn = Mat3::from_quat(camera.workspace_from_camera.rotation);
    let rays_x: Vec<f32> = (0..image.width_px).step_by(stride).map(|u| lens.ray([u, 0]).x).collect();
    let rows: Vec<usize> = (0..image.height_px).step_by(stride).collect();
    let of_rows = |rows: &[usize]| {
        let (mut seen, mut depths_m) = (Vec::new(), Vec::with_capacity(rays_x.len()));
        for v in rows {
            let row = &image.depth_m[v * image.width_px..(v + 1) * image.width_px];
            depths_m.clear();
            depths_m.extend(row.iter().step_by(stride).map(|depth_m| depth_m / factor));
            let along = turn.y_axis * lens.ray([0, *v]).y;
            let at_m = |ray_x: f32, depth_m: f32| eye_m + (turn.x_axis * ray_x + along + turn.z_axis) * depth_m;
            let is_above = |ray_x: f32, depth_m: f32| {
                // False for NaN.
                (depth_m > 0.0) & (depth_m < f32::INFINITY) & (at_m(ray_x, depth_m).z >= above_m)
            };
            let mut add = |rays_x: &[f32], depths_m: &[f32]| {
                let pixels = rays_x.iter().copied().zip(depths_m.iter().copied());
                let above = pixels.filter(|(ray_x, depth_m)| is_above(*ray_x, *depth_m));
                seen.extend(above.map(|(ray_x, depth_m)| (at_m(ray_x, depth_m), depth_m)));
            };
            // Eight pixels at a time and without branches, which the compiler vectorises: most show the table.
            let ((rays_x, rest_x), (depths_m, rest_m)) = (rays_x.as_chunks::<8>(), depths_m.as_chunks::<8>());
            for (rays_x, depths_m) in rays_x.iter().zip(depths_m) {
                let mut above = [false; 8];
                (0..8).for_each(|lane| above[lane] = is_above(rays_x[lane], depths_m[lane]));
                if above.contains(&true) {
                    add(rays_x, depths_m);
                }
            }
            add(rest_x, rest_m);
        }
        seen
    };
    rows.par_chunks(ROWS).map(of_rows).collect::<Vec<_>>().concat()
}
