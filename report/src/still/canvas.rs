//! A camera's image with lines and boxes.

use schema::{HandBox, Intrinsics, Pose, Vec3};

use super::layer::{Layer, MEAN_OF, Opacity, Rgb, lit, means};
use crate::eye::{Eye, Seen};
use crate::view::shapes::{BOX_FACES, box_corners_m};

const WHITE: Rgb = [255; 3];

/// Where boxes are light, in the optical frame: at the lens's side, and above.
const SKY: Vec3 = Vec3::new(-0.3, -0.8, -0.52);
/// Width of the white edges of dark lines.
const HALO_PX: f32 = 3.0;

/// What a camera sees. All lengths in pixels refer to the large picture, before it is
/// averaged down.
#[derive(Debug)]
pub(super) struct Canvas {
    sheet: Layer,
    /// Drawn since the last [`Self::lay`].
    scratch: Layer,
    eye: Eye,
    /// Scale of the lines' widths.
    pen: f32,
}

impl Canvas {
    /// A camera's image of the lens's size, to draw over it in the camera's optical frame. Widths of lines are in
    /// multiples of `pen`.
    pub(super) fn over(image: &[Rgb], lens: &Intrinsics, pen: f32) -> Self {
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
    pub(super) fn image(&self) -> Vec<u8> {
        means(self.sheet.colour.as_flattened(), self.sheet.width)
    }

    /// Merges everything drawn since the last call into the picture. Depths remain those of the surface.
    pub(super) fn lay(&mut self, opacity: Opacity) {
        self.sheet.lay(&mut self.scratch, opacity);
    }

    /// A line from point to point.
    pub(super) fn line(&mut self, points_m: &[Vec3], radius_px: f32, colour: Rgb) {
        for ends in points_m.windows(2) {
            if let [from, to, ..] = self.eye.see_ring(ends)[..] {
                self.scratch.line(from, to, radius_px * self.pen, colour);
            }
        }
    }

    /// A line with a white edge.
    pub(super) fn haloed_line(&mut self, points_m: &[Vec3], radius_px: f32, colour: Rgb) {
        // Far behind: what one sees there is often the back of a hand.
        let halo: Vec<Vec3> = points_m.iter().map(|point| 2.0 * *point).collect();
        self.line(&halo, radius_px + HALO_PX, WHITE);
        self.line(points_m, radius_px, colour);
    }

    /// The head of an arrow, as wide as it is long.
    pub(super) fn arrow_head(&mut self, neck_m: Vec3, tip_m: Vec3, colour: Rgb) {
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
    pub(super) fn block(&mut self, part: &HandBox, workspace_from_part: &Pose, colour: Rgb) {
        let corners: Vec<Vec3> = box_corners_m(part).map(|c| workspace_from_part.transform_point(c)).collect();
        for [a, b, c, d] in BOX_FACES.map(|face| face.map(|corner| corners[corner])) {
            let face = lit(colour, 0.92 + 0.22 * (b - a).cross(c - b).normalize_or_zero().dot(SKY));
            let seen = self.eye.see_ring(&[a, b, c, d]);
            for at in 2..seen.len() {
                self.scratch.triangle([seen[0], seen[at - 1], seen[at]], face);
            }
            let nearer = [a, b, c, d, a].map(|corner| corner + self.eye.towards() * 0.001);
            self.line(&nearer, 1.3, lit(colour, 0.45));
        }
    }
}
