//! What a camera saw: the points of its depth image.

use schema::{Camera, DepthImage, Mat3, Vec3};

/// Every so many pixels, about `columns_px` of them lie along an image's width.
pub(crate) fn stride_px(image: &DepthImage, columns_px: usize) -> usize {
    image.width_px.div_ceil(columns_px).max(1)
}

/// The points that a view saw, in the frame of its pose in metres, and their depths: of about `columns_px` pixels along
/// the image's width and of rows as far apart. Pixels without a depth have none.
pub fn seen_points<'a>(
    camera: &Camera,
    image: &'a DepthImage,
    columns_px: usize,
) -> impl Iterator<Item = (Vec3, f32)> + use<'a> {
    let (stride, lens, eye_m) =
        (stride_px(image, columns_px), camera.intrinsics, camera.workspace_from_camera.translation);
    let turn = Mat3::from_quat(camera.workspace_from_camera.rotation);
    let rows = (0..image.height_px).step_by(stride);
    let pixels = rows.flat_map(move |v| (0..image.width_px).step_by(stride).map(move |u| [u, v]));
    pixels.filter_map(move |pixel| {
        let depth_m = image.at(pixel).filter(|depth_m| depth_m.is_finite())?;
        Some((eye_m + turn * lens.ray(pixel) * depth_m, depth_m))
    })
}
