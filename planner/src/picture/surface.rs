//! The cloud as a surface: splats that close it, and light on them.
//!
//! First each point covers a disc and the nearest depth wins. Then all points near that depth give a weighted mean of depth
//! and colour: the mean is smooth, so its slope can be shaded, which single splats' steps could not.

use schema::{Grid, Vec3};

use super::eye::{Eye, Seen};
use super::layer::Layer;
use super::tints::{INK, Rgb, lit, mixed, of_label};
use crate::plan::SegmentedCloud;

/// Radius of a splat in voxels. Points lie about a third of a voxel apart, and neighbours must overlap well.
const SPLAT_VOXELS: f32 = 0.5;
/// Points of the same surface lie within this many voxels in depth: steep ones, too.
const SAME_SURFACE_VOXELS: f32 = 0.7;
/// How far to either side slopes are taken, in splats' radii.
const SLOPE_SPLATS: f32 = 1.2;
/// From the surface towards the light, and the shares of light that come from everywhere and from there; a level surface
/// gets 1 in all.
const TOWARDS_LIGHT: Vec3 = Vec3::new(-0.30, -0.42, 0.86);
const AMBIENT: f32 = 0.50;
/// How dark the outline of what stands before something else is.
const OUTLINE: f32 = 0.45;

/// What the points at a pixel add up to.
#[derive(Debug, Clone, Copy, Default)]
struct Heap {
    weight: f32,
    depth_m: f32,
    colour: [f32; 3],
}

/// Paints the cloud on an empty layer.
pub(super) fn paint(layer: &mut Layer, eye: &Eye, cloud: &SegmentedCloud, grid: &Grid) {
    let splat_m = SPLAT_VOXELS * grid.voxel_size_m();
    let same_m = SAME_SURFACE_VOXELS * grid.voxel_size_m();
    let points = cloud.points_m.iter().zip(&cloud.labels);
    let splats: Vec<(Seen, f32, Rgb)> = points
        .filter_map(|(point_m, label)| eye.see(*point_m).map(|seen| (seen, of_label(*label))))
        .map(|(seen, colour)| (seen, eye.pixels(splat_m, seen.depth_m), colour))
        .collect();
    for (seen, radius_px, colour) in &splats {
        layer.disc(*seen, *radius_px, *colour);
    }
    let mut heaps = vec![Heap::default(); layer.colour.len()];
    for (seen, radius_px, colour) in &splats {
        heap_up(&mut heaps, layer, *seen, *radius_px, *colour, same_m);
    }
    for ((depth_m, colour), heap) in layer.depth_m.iter_mut().zip(&mut layer.colour).zip(&heaps) {
        if heap.weight > 0.0 {
            *depth_m = heap.depth_m / heap.weight;
            *colour = heap.colour.map(|sum| (sum / heap.weight + 0.5) as u8);
        }
    }
    shade(layer, eye, grid.voxel_size_m());
}

/// Adds a splat to the pixels where it is not behind another surface.
fn heap_up(heaps: &mut [Heap], layer: &Layer, seen: Seen, radius_px: f32, colour: Rgb, same_m: f32) {
    let [columns, rows] =
        layer.within([seen.x - radius_px, seen.y - radius_px], [seen.x + radius_px, seen.y + radius_px]);
    for y in rows {
        for x in columns.clone() {
            let (dx, dy) = (x as f32 - seen.x, y as f32 - seen.y);
            let share = 1.0 - (dx * dx + dy * dy) / (radius_px * radius_px);
            let at = y * layer.width + x;
            if share > 0.0 && seen.depth_m <= layer.depth_m[at] + same_m {
                let weight = share * share;
                let heap = &mut heaps[at];
                heap.weight += weight;
                heap.depth_m += weight * seen.depth_m;
                for (sum, value) in heap.colour.iter_mut().zip(colour) {
                    *sum += weight * f32::from(value);
                }
            }
        }
    }
}

/// Lights every pixel by its surface's slope and draws outlines where depth jumps.
fn shade(layer: &mut Layer, eye: &Eye, voxel_m: f32) {
    let to_light = TOWARDS_LIGHT.normalize_or_zero();
    let mut shaded = layer.colour.clone();
    for y in 0..layer.height {
        for x in 0..layer.width {
            let at = y * layer.width + x;
            let depth_m = layer.depth_m[at];
            if depth_m == f32::INFINITY {
                continue;
            }
            let reach = (eye.pixels(SLOPE_SPLATS * SPLAT_VOXELS * voxel_m, depth_m) as usize).max(1);
            let light = normal(layer, eye, [x, y], reach, voxel_m).map_or(1.0, |normal| {
                let direct = normal.dot(to_light).max(0.0) / to_light.z;
                AMBIENT + (1.0 - AMBIENT) * direct
            });
            shaded[at] = lit(layer.colour[at], light.min(1.12));
            if stands_before(layer, [x, y], voxel_m) {
                shaded[at] = mixed(shaded[at], INK, OUTLINE);
            }
        }
    }
    layer.colour = shaded;
}

/// Depths of two pixels `reach` away on either side, or of one and the pixel itself, whatever lies on one surface.
fn sides(layer: &Layer, [x, y]: [usize; 2], [dx, dy]: [usize; 2], voxel_m: f32) -> Option<[Seen; 2]> {
    let seen = |x: usize, y: usize| {
        let depth_m = layer.depth_m[y * layer.width + x];
        Seen { x: x as f32, y: y as f32, depth_m }
    };
    let here = seen(x, y);
    let near = |other: &Seen| (other.depth_m - here.depth_m).abs() < voxel_m;
    let before = (x >= dx && y >= dy).then(|| seen(x - dx, y - dy)).filter(near);
    let after = (x + dx < layer.width && y + dy < layer.height).then(|| seen(x + dx, y + dy)).filter(near);
    (before.is_some() || after.is_some()).then(|| [before.unwrap_or(here), after.unwrap_or(here)])
}

/// The surface's unit normal, towards the eye.
fn normal(layer: &Layer, eye: &Eye, pixel: [usize; 2], reach: usize, voxel_m: f32) -> Option<Vec3> {
    let along = |step: [usize; 2]| {
        let [before, after] = sides(layer, pixel, step, voxel_m)?;
        Some(eye.point_m(after) - eye.point_m(before))
    };
    // The picture's y runs downwards, so down × right points at the eye.
    along([0, reach])?.cross(along([reach, 0])?).try_normalize()
}

/// Whether what is seen beside the pixel lies much deeper, or nothing is there.
fn stands_before(layer: &Layer, [x, y]: [usize; 2], voxel_m: f32) -> bool {
    let limit_m = layer.depth_m[y * layer.width + x] + 2.0 * voxel_m;
    let [columns, rows] = layer.within([x as f32 - 2.0, y as f32 - 2.0], [x as f32 + 2.0, y as f32 + 2.0]);
    [columns.start, columns.end - 1].into_iter().any(|u| layer.depth_m[y * layer.width + u] > limit_m)
        || [rows.start, rows.end - 1].into_iter().any(|v| layer.depth_m[v * layer.width + x] > limit_m)
}

#[cfg(test)]
mod tests {
    use super::super::eye::Outlook;
    use super::*;
    use crate::plan::PointLabel;

    const ABOVE: Outlook = Outlook { towards_eye: Vec3::Z, up: Vec3::Y, sides_away: 8.0 };

    fn painted(height: impl Fn(f32, f32) -> f32, label: PointLabel) -> (Layer, Eye) {
        let steps = (0..=120).flat_map(|i| (0..=120).map(move |j| (0.0025 * i as f32, 0.0025 * j as f32)));
        let points_m: Vec<Vec3> = steps.map(|(x, y)| Vec3::new(x, y, height(x, y))).collect();
        let cloud = SegmentedCloud { labels: vec![label; points_m.len()], points_m, plane: None };
        let mut layer = Layer::new(300, 300);
        let eye = Eye::new(&Grid::PAPER, ABOVE, 300, 300);
        paint(&mut layer, &eye, &cloud, &Grid::PAPER);
        (layer, eye)
    }

    #[test]
    fn a_level_sheet_has_no_holes_and_its_own_colour() {
        let (layer, eye) = painted(|_, _| 0.05, PointLabel::Plane);
        let tint = of_label(PointLabel::Plane);
        for point in [Vec3::new(0.03, 0.03, 0.05), Vec3::new(0.15, 0.2, 0.05), Vec3::new(0.27, 0.1, 0.05)] {
            let seen = eye.see(point).unwrap();
            let at = seen.y as usize * 300 + seen.x as usize;
            assert!((layer.depth_m[at] - seen.depth_m).abs() < 1e-4);
            assert!(layer.colour[at].iter().zip(tint).all(|(got, want)| got.abs_diff(want) <= 2));
        }
        let (low, high) =
            (eye.see(Vec3::new(0.01, 0.29, 0.05)).unwrap(), eye.see(Vec3::new(0.29, 0.01, 0.05)).unwrap());
        let [columns, rows] = layer.within([low.x, low.y], [high.x, high.y]);
        assert!(rows.flat_map(|y| columns.clone().map(move |x| y * 300 + x)).all(|at| layer.depth_m[at].is_finite()));
    }

    #[test]
    fn a_slope_is_lit_by_where_it_faces() {
        let bright = |slope_x: f32| {
            let (layer, eye) = painted(|x, _| 0.12 + slope_x * (x - 0.15), PointLabel::Object(0));
            let seen = eye.see(Vec3::new(0.15, 0.15, 0.12)).unwrap();
            let tint = of_label(PointLabel::Object(0));
            f32::from(layer.colour[seen.y as usize * 300 + seen.x as usize][1]) / f32::from(tint[1])
        };
        // By hand: the normal of z = s x is (-s, 0, 1) / √(1 + s²).
        for slope in [-0.5_f32, 0.0, 0.4] {
            let light = TOWARDS_LIGHT.normalize_or_zero();
            let direct = (-slope * light.x + light.z) / (1.0 + slope * slope).sqrt() / light.z;
            let want = (AMBIENT + (1.0 - AMBIENT) * direct.max(0.0)).min(1.12);
            assert!((bright(slope) - want).abs() < 0.03, "{slope}: {} {want}", bright(slope));
        }
    }

    #[test]
    fn an_empty_cloud_leaves_the_sheet_white() {
        let mut layer = Layer::new(50, 50);
        let eye = Eye::new(&Grid::PAPER, ABOVE, 50, 50);
        let cloud = SegmentedCloud { points_m: Vec::new(), labels: Vec::new(), plane: None };
        paint(&mut layer, &eye, &cloud, &Grid::PAPER);
        assert!(layer.colour.iter().all(|pixel| *pixel == [255; 3]));
    }
}
