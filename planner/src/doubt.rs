//! What speaks against a grasp that may hold all the same: it is of no thing that one wants, or nobody knows where a
//! finger would stand.

use perception::{Cut, Joined};
use schema::{Gripper, Pose, Vec3};
use settings::words;

use crate::gripper_volume::{GripperVolume, TABLE_M};
use crate::observation::View;

/// Beside its border an image may have no depths, in this share of its side.
const BAND_SHARE: f32 = 0.05;
/// What is so near to the end of the region goes on beyond it, by the pitch of the surface for each of its points.
const END_M: f32 = 0.012;
const PITCH_M: f32 = 0.0025;

words! {
    /// What speaks against a grasp, the least first. Grasps of which nothing does come before others.
    #[derive(PartialOrd, Ord)]
    pub enum Doubt {
        /// A finger would stand where no image has a depth.
        NoDepth = "no_depth",
        /// It would hold the table, of which an end is bent up.
        BentTable = "bent_table",
        /// It would hold what the border of an image cuts: a robot's arm, a bin, a thing of which nobody knows how long
        /// it is.
        Cut = "cut_by_border",
        /// It would hold pixels that fly between a thing and what is behind it; no such grasp is given.
        Flying = "flying_points",
    }
}

/// What is no thing of its own in a scene.
pub(crate) struct Doubts {
    between_fingers: GripperVolume,
    /// Points of the surface off the table, sorted along x: of things, of a bent table, and of what is cut.
    points_m: [Vec<Vec3>; 3],
}

impl Doubts {
    /// `joined` says of each point of a surface what it is joined to; it is empty if none is.
    pub(crate) fn new(gripper: &Gripper, points_m: &[Vec3], joined: &[Option<Joined>], table_z_m: f32) -> Self {
        let of = |wanted: Option<Joined>| {
            let own = points_m.iter().zip(joined).filter(|(at, of)| at.z > table_z_m + TABLE_M && **of == wanted);
            let mut own_m: Vec<Vec3> = own.map(|(at, _)| *at).collect();
            own_m.sort_by(|a, b| a.x.total_cmp(&b.x));
            own_m
        };
        let points_m = [None, Some(Joined::Table), Some(Joined::Border)].map(of);
        Self { between_fingers: GripperVolume::between_fingers(gripper), points_m }
    }

    /// Whether there are things beside what is none.
    pub(crate) fn are_beside_things(&self) -> bool {
        !self.points_m[0].is_empty()
    }

    /// Whether most between the fingers is of no thing.
    pub(crate) fn of(&self, workspace_from_grasp: &Pose) -> Option<Doubt> {
        let count = |points_m: &Vec<Vec3>| self.between_fingers.points_inside_sorted(workspace_from_grasp, points_m);
        let [things, table, cut] = self.points_m.each_ref().map(count);
        let doubt = if cut > table { Doubt::Cut } else { Doubt::BentTable };
        (table + cut > things).then_some(doubt)
    }
}

/// Where images, and a region with these corners, end above the table, unless another image goes on.
pub(crate) fn cuts(views: &[View], points_m: &[Vec3], [low_m, high_m]: [Vec3; 2], table_z_m: f32) -> Vec<Cut> {
    let is_off_table = |cut: &Cut| cut.at_m.z > table_z_m + TABLE_M;
    let is_end = |at: &&Vec3| (**at - low_m).min(high_m - **at).truncate().min_element() < END_M;
    let ends = points_m.iter().filter(is_end).map(|at_m| Cut { at_m: *at_m, length_m: PITCH_M });
    let borders = views.iter().flat_map(border).filter(is_off_table);
    let borders = borders.filter(|cut| !views.iter().any(|view| looks_at(view, cut.at_m)));
    borders.chain(ends.filter(is_off_table)).collect()
}

/// What an image shows at its border, or first beside it.
pub(crate) fn border(View { image, camera, .. }: &View) -> Vec<Cut> {
    let of = |pixel: [usize; 2]| {
        let depth_m = image.at(pixel).filter(|depth_m| depth_m.is_finite())?;
        let at_m = camera.workspace_from_camera * (camera.intrinsics.ray(pixel) * depth_m);
        Some(Cut { at_m, length_m: depth_m / camera.intrinsics.fx_px })
    };
    let ([width, height], mut cuts) = ([image.width_px, image.height_px], Vec::new());
    for (side, v) in [0, width - 1].into_iter().flat_map(|side| (0..height).map(move |v| (side, v))) {
        cuts.extend((0..band_px(width)).find_map(|u| of([side.abs_diff(u), v])));
    }
    for (side, u) in [0, height - 1].into_iter().flat_map(|side| (0..width).map(move |u| (side, u))) {
        cuts.extend((0..band_px(height)).find_map(|v| of([u, side.abs_diff(v)])));
    }
    cuts
}

/// The pixels beside the border of a side in which an image may have no depths.
fn band_px(side_px: usize) -> usize {
    ((BAND_SHARE * side_px as f32) as usize).max(1)
}

/// Whether a point, and what is around it, is in a view's picture.
fn looks_at(View { camera, .. }: &View, at_m: Vec3) -> bool {
    let lens = camera.intrinsics;
    let is_inside = |at: usize, side_px: usize| at >= band_px(side_px) && at + band_px(side_px) < side_px;
    let pixel = lens.project(camera.workspace_from_camera.inverse() * at_m);
    pixel.is_some_and(|[u, v]| is_inside(u, lens.width_px) && is_inside(v, lens.height_px))
}

#[cfg(test)]
mod tests {
    use schema::{Camera, DepthImage, Intrinsics};

    use super::*;
    use crate::gripper_volume::WRIST_DOWN;

    /// The table at 0.05 m from 0.7 m, as a camera sees it that looks down.
    fn table() -> View {
        let workspace_from_camera = Pose::from_parts(Vec3::new(0.15, 0.15, 0.7), WRIST_DOWN);
        let image = DepthImage { width_px: 640, height_px: 480, depth_m: vec![0.65; 640 * 480] };
        View::new(image, Camera { intrinsics: Intrinsics::VGN, workspace_from_camera })
    }

    #[test]
    fn the_picture_ends_at_the_first_depths_beside_its_border_unless_another_goes_on() {
        // A bar of 100 pixels, 50 mm above the table, that begins 20 pixels from the border.
        let mut bar = table();
        for (at, depth_m) in bar.image.depth_m.iter_mut().enumerate() {
            let [v, u] = [at / 640, at % 640];
            let is_bar = (200..300).contains(&v) && u < 200;
            *depth_m = if u < 20 {
                0.0
            } else if is_bar {
                0.6
            } else {
                0.65
            };
        }
        let cut_m = |views: &[View]| -> f32 {
            let cuts = cuts(views, &[], [Vec3::ZERO, Vec3::ONE], 0.05);
            assert!(cuts.iter().all(|cut| (cut.at_m.z - 0.1).abs() < 1e-4), "{cuts:?}");
            cuts.iter().map(|cut| cut.length_m).sum()
        };
        let whole_m = cut_m(std::slice::from_ref(&bar));
        assert!((whole_m - 100.0 * 0.6 / 540.0).abs() < 0.002, "{whole_m}");
        // The other camera stands 0.2 m to the left and has its border there in its middle.
        let mut other = table();
        other.camera.workspace_from_camera.translation.x -= 0.2;
        assert_eq!(cut_m(&[bar, other]), 0.0);
        // The region ends at x of 0.1.
        let ends = cuts(
            &[],
            &[Vec3::new(0.095, 0.5, 0.1), Vec3::new(0.08, 0.5, 0.1)],
            [Vec3::ZERO, Vec3::splat(0.1).with_y(1.0)],
            0.05,
        );
        assert_eq!(ends.len(), 1, "{ends:?}");
    }
}
