//! A workspace from one side, its points as a lit surface, or a camera's image; with lines, dots and boxes.

use schema::{HandBox, Intrinsics, Pose, Vec3};

use super::layer::{Layer, MEAN_OF, Opacity, Rgb, lit, means, mixed};
use crate::eye::{Eye, Outlook, Seen};
use crate::view::shapes::{BOX_FACES, box_corners_m};

/// Dark grey, for text and outlines.
pub const INK: Rgb = [34; 3];
pub(super) const WHITE: Rgb = [255; 3];

/// Radius of a point's disc in voxels. Points are about a third of a voxel apart, and neighbours must overlap well.
const DISC_VOXELS: f32 = 0.5;
/// Points of the same surface are within this many voxels in depth, also on steep surfaces.
const SAME_SURFACE_VOXELS: f32 = 0.7;
/// Half width of the slope's difference quotient, in voxels.
const SLOPE_VOXELS: f32 = 0.6;
/// Direction to the light, and the share of ambient light; a level surface gets 1 in total.
const TOWARDS_LIGHT: Vec3 = Vec3::new(-0.30, -0.42, 0.86);
const AMBIENT: f32 = 0.50;
/// Darkness of outlines at depth jumps.
const OUTLINE: f32 = 0.45;
/// Width of the white edges of dark lines.
const HALO_PX: f32 = 3.0;

/// A workspace from one side, or what a camera sees. All lengths in pixels refer to the large picture, before it is
/// averaged down.
#[derive(Debug)]
pub struct Canvas {
    pub(super) sheet: Layer,
    /// Drawn since the last [`Self::lay`].
    scratch: Layer,
    eye: Eye,
    /// Scale of the lines' widths.
    pen: f32,
}

impl Canvas {
    /// An empty picture of a box, given by its lower and its upper corner.
    #[must_use]
    pub fn new(corners_m: [Vec3; 2], outlook: Outlook, size_px: [usize; 2]) -> Self {
        let eye = Eye::on_box(corners_m, outlook, size_px);
        Self { sheet: Layer::new(size_px), scratch: Layer::new(size_px), eye, pen: 1.0 }
    }

    /// A camera's image of the lens's size, to draw over it in the camera's optical frame. Lines are `pen` times as
    /// wide as in other pictures.
    #[must_use]
    pub fn over(image: &[Rgb], lens: &Intrinsics, pen: f32) -> Self {
        let size_px = [lens.width_px, lens.height_px].map(|side| side * MEAN_OF);
        let mut sheet = Layer::new(size_px);
        for (at, colour) in sheet.colour.iter_mut().enumerate() {
            let [x, y] = [at % size_px[0], at / size_px[0]].map(|large| large / MEAN_OF);
            *colour = image[y * lens.width_px + x];
        }
        let large = MEAN_OF as f32;
        let [fx_px, fy_px] = [lens.fx_px, lens.fy_px].map(|focal_px| focal_px * large);
        let [cx_px, cy_px] = [lens.cx_px, lens.cy_px].map(|centre_px| (centre_px + 0.5) * large - 0.5);
        let eye = Eye::through(&Intrinsics { fx_px, fy_px, cx_px, cy_px, ..*lens });
        Self { sheet, scratch: Layer::new(size_px), eye, pen: pen * large }
    }

    /// The picture, averaged down.
    #[must_use]
    pub fn image(&self) -> Vec<u8> {
        means(self.sheet.colour.as_flattened(), self.sheet.width)
    }

    /// The projection of a point; `None` if it is behind the eye or not finite.
    #[must_use]
    pub fn see(&self, point_m: Vec3) -> Option<[f32; 2]> {
        self.eye.see(point_m).map(|seen| [seen.x, seen.y])
    }

    /// Merges everything drawn since the last call into the picture. Depths remain those of the surface.
    pub fn lay(&mut self, opacity: Opacity) {
        self.sheet.lay(&mut self.scratch, opacity);
    }

    /// A dot that faces the viewer, drawn `nearer_m` nearer than it is.
    pub fn dot(&mut self, at_m: Vec3, nearer_m: f32, radius_px: f32, colour: Rgb) {
        if let Some(seen) = self.eye.see(at_m) {
            self.scratch.disc(Seen { depth_m: seen.depth_m - nearer_m, ..seen }, radius_px, colour);
        }
    }

    /// A line from point to point.
    pub fn line(&mut self, points_m: &[Vec3], radius_px: f32, colour: Rgb) {
        for ends in points_m.windows(2) {
            if let [from, to, ..] = self.eye.see_ring(ends)[..] {
                self.scratch.line(from, to, radius_px * self.pen, colour);
            }
        }
    }

    /// A line with a white edge.
    pub fn haloed_line(&mut self, points_m: &[Vec3], radius_px: f32, colour: Rgb) {
        let halo: Vec<Vec3> = points_m.iter().map(|point| self.eye.behind(*point)).collect();
        self.line(&halo, radius_px + HALO_PX, WHITE);
        self.line(points_m, radius_px, colour);
    }

    /// The head of an arrow, as wide as it is long.
    pub fn arrow_head(&mut self, neck_m: Vec3, tip_m: Vec3, colour: Rgb) {
        if let (Some(neck), Some(tip)) = (self.eye.see(neck_m), self.eye.see(tip_m)) {
            let across = |share: f32| Seen {
                x: neck.x + share * (tip.y - neck.y),
                y: neck.y - share * (tip.x - neck.x),
                depth_m: neck.depth_m,
            };
            self.scratch.triangle([across(-0.5), across(0.5), tip], colour);
        }
    }

    /// A box with its edges.
    pub fn block(&mut self, part: &HandBox, workspace_from_part: &Pose, colour: Rgb) {
        let corners: Vec<Vec3> = box_corners_m(part).map(|c| workspace_from_part.transform_point(c)).collect();
        for [a, b, c, d] in BOX_FACES.map(|face| face.map(|corner| corners[corner])) {
            let face = lit(colour, 0.92 + 0.22 * (b - a).cross(c - b).normalize_or_zero().dot(self.eye.sky()));
            let seen = self.eye.see_ring(&[a, b, c, d]);
            for at in 2..seen.len() {
                self.scratch.triangle([seen[0], seen[at - 1], seen[at]], face);
            }
            let nearer = [a, b, c, d, a].map(|corner| corner + self.eye.towards() * 0.001);
            self.line(&nearer, 1.3, lit(colour, 0.45));
        }
    }

    /// Paints points as a surface, on an empty picture.
    ///
    /// First each point covers a disc and the nearest depth wins. Then all points near that depth give a weighted mean
    /// of depth and colour. The mean is smooth, so its slope can be lit, in contrast to the steps of single discs.
    pub fn surface(&mut self, points: impl IntoIterator<Item = (Vec3, Rgb)>, voxel_m: f32) {
        let see = |(point_m, colour)| self.eye.see(point_m).map(|seen| (seen, colour));
        let points: Vec<(Seen, Rgb)> = points.into_iter().filter_map(see).collect();
        let radius_px = |seen: &Seen| self.eye.pixels(DISC_VOXELS * voxel_m, seen.depth_m);
        for (seen, colour) in &points {
            self.sheet.disc(*seen, radius_px(seen), *colour);
        }
        // Weight, and weighted depth, red, green and blue.
        let mut sums = vec![[0.0_f32; 5]; self.sheet.colour.len()];
        for (seen, colour) in &points {
            for (x, y, left) in self.sheet.pixels(*seen, radius_px(seen)) {
                let at = y * self.sheet.width + x;
                if seen.depth_m <= self.sheet.depth_m[at] + SAME_SURFACE_VOXELS * voxel_m {
                    let [red, green, blue] = colour.map(f32::from);
                    let values = [1.0, seen.depth_m, red, green, blue];
                    sums[at].iter_mut().zip(values).for_each(|(sum, value)| *sum += left * left * value);
                }
            }
        }
        for (at, [weight, depth_m, colour @ ..]) in sums.into_iter().enumerate().filter(|(_, sums)| sums[0] > 0.0) {
            self.sheet.depth_m[at] = depth_m / weight;
            self.sheet.colour[at] = colour.map(|sum| (sum / weight + 0.5) as u8);
        }
        let pixels = (0..self.sheet.height).flat_map(|y| (0..self.sheet.width).map(move |x| [x, y]));
        self.sheet.colour = pixels.map(|pixel| self.shaded(pixel, voxel_m)).collect();
    }

    /// A pixel's colour, lit by its surface's slope, with an outline where depth jumps.
    fn shaded(&self, [x, y]: [usize; 2], voxel_m: f32) -> Rgb {
        let here = self.seen([x, y]);
        let colour = self.sheet.colour[y * self.sheet.width + x];
        if here.depth_m == f32::INFINITY {
            return colour;
        }
        let reach = (self.eye.pixels(SLOPE_VOXELS * voxel_m, here.depth_m) as usize).max(1);
        // From one side to the other; if one is on another surface, from or to the centre.
        let slope = |[dx, dy]: [usize; 2]| {
            let is_near = |other: &Seen| (other.depth_m - here.depth_m).abs() < voxel_m;
            let before = (x >= dx && y >= dy).then(|| self.seen([x - dx, y - dy])).filter(is_near);
            let is_within = x + dx < self.sheet.width && y + dy < self.sheet.height;
            let after = is_within.then(|| self.seen([x + dx, y + dy])).filter(is_near);
            let [from, to] = [before.unwrap_or(here), after.unwrap_or(here)].map(|seen| self.eye.point_m(seen));
            to - from
        };
        // The picture's y points down, so down × right points at the viewer.
        let light = slope([0, reach]).cross(slope([reach, 0])).try_normalize().map_or(1.0, |normal| {
            let to_light = TOWARDS_LIGHT.normalize_or_zero();
            AMBIENT + (1.0 - AMBIENT) * normal.dot(to_light).max(0.0) / to_light.z
        });
        let lit = lit(colour, light.min(1.12));
        let (right, below) = ((x + 2).min(self.sheet.width - 1), (y + 2).min(self.sheet.height - 1));
        let beside = [[x.saturating_sub(2), y], [right, y], [x, y.saturating_sub(2)], [x, below]];
        let stands_before = beside.iter().any(|pixel| self.seen(*pixel).depth_m > here.depth_m + 2.0 * voxel_m);
        if stands_before { mixed(lit, INK, OUTLINE) } else { lit }
    }

    fn seen(&self, [x, y]: [usize; 2]) -> Seen {
        Seen { x: x as f32, y: y as f32, depth_m: self.sheet.depth_m[y * self.sheet.width + x] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GREY: Rgb = [226; 3];
    const BLUE: Rgb = [86, 180, 233];

    fn canvas(size_px: usize) -> Canvas {
        Canvas::new(
            [Vec3::ZERO, Vec3::splat(0.30)],
            Outlook { towards_eye: Vec3::Z, up: Vec3::Y, sides_away: 8.0 },
            [size_px; 2],
        )
    }

    fn painted(height: impl Fn(f32, f32) -> f32, colour: Rgb) -> Canvas {
        let steps = (0..=120).flat_map(|i| (0..=120).map(move |j| (0.0025 * i as f32, 0.0025 * j as f32)));
        let mut canvas = canvas(300);
        canvas.surface(steps.map(|(x, y)| (Vec3::new(x, y, height(x, y)), colour)), 0.0075);
        canvas
    }

    #[test]
    fn a_level_sheet_has_no_holes_and_its_own_colour() {
        let canvas = painted(|_, _| 0.05, GREY);
        let (layer, eye) = (&canvas.sheet, &canvas.eye);
        for point in [Vec3::new(0.03, 0.03, 0.05), Vec3::new(0.15, 0.2, 0.05), Vec3::new(0.27, 0.1, 0.05)] {
            let seen = eye.see(point).unwrap();
            let at = seen.y as usize * 300 + seen.x as usize;
            assert!((layer.depth_m[at] - seen.depth_m).abs() < 1e-4);
            assert!(layer.colour[at].iter().zip(GREY).all(|(got, want)| got.abs_diff(want) <= 2));
        }
        let corner = |x, y| eye.see(Vec3::new(x, y, 0.05)).unwrap();
        let (low, high) = (corner(0.01, 0.29), corner(0.29, 0.01));
        let pixels = (low.y as usize + 1..high.y as usize)
            .flat_map(|y| (low.x as usize + 1..high.x as usize).map(move |x| y * 300 + x));
        assert!(pixels.into_iter().all(|at| layer.depth_m[at].is_finite()));
    }

    #[test]
    fn a_slope_is_lit_by_where_it_faces() {
        let bright = |slope_x: f32| {
            let canvas = painted(|x, _| 0.12 + slope_x * (x - 0.15), BLUE);
            let seen = canvas.eye.see(Vec3::new(0.15, 0.15, 0.12)).unwrap();
            f32::from(canvas.sheet.colour[seen.y as usize * 300 + seen.x as usize][1]) / f32::from(BLUE[1])
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
        let mut canvas = canvas(50);
        canvas.surface([], 0.0075);
        assert!(canvas.sheet.colour.iter().all(|pixel| *pixel == WHITE));
    }
}
