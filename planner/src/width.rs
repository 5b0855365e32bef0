//! How wide is what a gripper closes on: measured on what was seen between its fingers, or unknown.

use core::ops::Range;

use rayon::prelude::*;
use schema::{Grasp, Gripper, GripperBox, Intrinsics, Mat3, Pose, Vec3, bounds_m};

use crate::doubt::Doubt;
use crate::limits::corners;
use crate::observation::View;
use crate::plan::RankedGrasp;

/// Points no higher than this over the table belong to it.
const TABLE_M: f32 = 0.006;
/// Fewest points on which a width is measured.
const POINTS_MIN: usize = 10;
/// Fewest points of a row.
const ROW_MIN: usize = 3;
/// This share of the points at either end may be noise.
const NOISE_SHARE: f32 = 0.005;
/// Points of one height, along the fingers.
const ROW_M: f32 = 0.005;
/// The end of a row ends the whole if it is as far out but for this.
const END_M: f32 = 0.004;
/// Beyond an end that was seen, the first pixel with a depth shows free space. Beside edges sensors often see
/// nothing, so pixels are looked at this far out, step by step; what is behind them is at least so far behind.
const BEYOND_M: [f32; 7] = [0.006, 0.01, 0.014, 0.018, 0.022, 0.026, 0.03];
const BEHIND_M: f32 = 0.004;
/// A pixel flies if it is so far behind the pixel on one side of it and before the one on the other, beside so many
/// times what a pixel shows: sensors mix a thing's edge with what is behind it.
const FLIES_M: f32 = 0.003;
const FLIES_PX: f32 = 5.0;
/// So much of a finger, from its tip, closes on something.
const TIP_M: f32 = 0.02;
/// Least room to either side of what is between open fingers.
const ROOM_M: f32 = 0.008;

/// Images, for measuring widths.
pub(crate) struct Widths<'a> {
    views: &'a [View],
    /// The workspace in their cameras' frames.
    cameras: Vec<Pose>,
    /// The rays' x of their images' columns.
    rays_x: Vec<Vec<f32>>,
    table_z_m: f32,
    gripper: &'a Gripper,
}

/// What a gripper has between its fingers.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Between {
    /// From the lower to the upper end along the closing direction, from the gripper's middle.
    ends_m: [f32; 2],
    /// Whether the ends were seen as such.
    are_seen: [bool; 2],
    /// Share of the ends at all heights that were seen.
    seen_share: f32,
    /// Whether most of its points fly.
    flies: bool,
}

impl<'a> Widths<'a> {
    pub(crate) fn new(views: &'a [View], table_z_m: f32, gripper: &'a Gripper) -> Self {
        let cameras = views.iter().map(|view| view.camera.workspace_from_camera.inverse()).collect();
        let of_view =
            |View { image, camera, .. }: &View| (0..image.width_px).map(|u| camera.intrinsics.ray([u, 0]).x).collect();
        Self { views, cameras, rays_x: views.iter().map(of_view).collect(), table_z_m, gripper }
    }

    /// The grasp with what it closes on in its middle, or beside its fixed jaw, if both ends of that were seen.
    pub(crate) fn centred(&self, grasp: &Grasp) -> Option<Grasp> {
        let between = self.between(&grasp.workspace_from_grasp).filter(|between| between.are_seen == [true; 2])?;
        let aside_m = self.gripper.aside_m(between.width_m());
        let off = Vec3::new(0.0, 0.5 * between.ends_m.iter().sum::<f32>() + aside_m, 0.0);
        let mut workspace_from_grasp = grasp.workspace_from_grasp;
        workspace_from_grasp.translation += workspace_from_grasp.rotation * off;
        Some(Grasp { workspace_from_grasp, ..*grasp })
    }

    /// Two places at the end of each finger, in the workspace.
    fn tips_m(&self, workspace_from_grasp: &Pose, opening_m: f32) -> [[Vec3; 2]; 2] {
        self.gripper.fingers(opening_m).map(|finger| {
            let tip_z_m = finger.centre_m.z + finger.half_m.z;
            [0.0, TIP_M].map(|up_m| *workspace_from_grasp * finger.centre_m.with_z(tip_z_m - up_m))
        })
    }

    /// The depths, if there are any, at the pixels onto which a place falls, in metres.
    fn shown_m(&self, at_m: Vec3) -> impl Iterator<Item = Option<f32>> {
        self.views.iter().zip(&self.cameras).filter_map(move |(view, camera)| {
            let pixel = view.camera.intrinsics.project(*camera * at_m)?;
            Some(view.image.at(pixel).filter(|depth_m| depth_m.is_finite()))
        })
    }

    /// Whether the fingers would close where no camera looks.
    pub(crate) fn is_out_of_sight(&self, workspace_from_grasp: &Pose) -> bool {
        let tips_m = self.tips_m(workspace_from_grasp, self.gripper.opening_m_max);
        !self.views.is_empty() && tips_m.as_flattened().iter().any(|at_m| self.shown_m(*at_m).next().is_none())
    }

    /// Whether a finger would stand where no image has a depth.
    fn is_blind(&self, grasp: &RankedGrasp) -> bool {
        let has_none = |tip_m: &[Vec3; 2]| tip_m.iter().all(|at_m| self.shown_m(*at_m).flatten().next().is_none());
        let tips_m = self.tips_m(&grasp.workspace_from_grasp, grasp.opening_m);
        !self.views.is_empty() && tips_m.iter().any(has_none)
    }

    /// Sets how wide things between the fingers are and how far to open these, measures what no network answered, and
    /// says what speaks against it.
    pub(crate) fn measure(&self, grasps: &mut [RankedGrasp]) {
        let gripper = self.gripper;
        grasps.par_iter_mut().for_each(|grasp| {
            if let Some(width_m) = grasp.width_m {
                let aside_m = gripper.aside_m(width_m);
                grasp.opening_m = opening_m(gripper, [-0.5, 0.5].map(|side| side * width_m - aside_m));
            } else {
                let between = self.between(&grasp.workspace_from_grasp);
                grasp.width_m =
                    between.filter(|between| between.are_seen == [true; 2]).map(|between| between.width_m());
                grasp.width_seen_share = between.map(|between| between.seen_share);
                grasp.opening_m = between.map_or(gripper.opening_m_max, |between| between.opening_m(gripper));
                grasp.doubt = between.filter(|between| between.flies).map(|_| Doubt::Flying);
            }
            grasp.joint_position = gripper.joint_position(grasp.opening_m);
            grasp.doubt = grasp.doubt.or(self.is_blind(grasp).then_some(Doubt::NoDepth));
        });
    }

    fn between(&self, workspace_from_grasp: &Pose) -> Option<Between> {
        let (points_m, flying) = self.points_between(workspace_from_grasp);
        let flies = 2 * flying > points_m.len();
        let mut ends_m = ends(points_m.iter().map(|at| at.y), POINTS_MIN)?;
        let mut rows: Vec<Vec<Vec3>> = Vec::new();
        for at_m in points_m {
            let row = (-at_m.z / ROW_M) as usize;
            if rows.len() <= row {
                rows.resize_with(row + 1, Vec::new);
            }
            rows[row].push(at_m);
        }
        let (mut are_seen, mut seen, mut count) = ([false; 2], 0, 0);
        for points in &rows {
            let Some(own_m) = ends(points.iter().map(|at| at.y), ROW_MIN) else { continue };
            for end in 0..2 {
                let outwards = Vec3::new(0.0, [-1.0, 1.0][end], 0.0);
                // The middle of the end: beside it the gripper may reach beyond a corner of the thing.
                let last = points.iter().filter(|at| (at.y - own_m[end]).abs() <= END_M);
                let (sum, last) = last.fold((Vec3::ZERO, 0), |(sum, count), at| (sum + *at, count + 1));
                let at_m = (sum / last.max(1) as f32).with_y(own_m[end]);
                let beyond = BEYOND_M.map(|m| *workspace_from_grasp * (at_m + outwards * m));
                let is_free = self.views.iter().zip(&self.cameras).any(|(view, camera)| is_free(view, camera, &beyond));
                are_seen[end] |= is_free && (ends_m[end] - own_m[end]).abs() <= END_M;
                seen += usize::from(is_free);
                count += 1;
            }
        }
        // A point is the middle of its pixel.
        let tips_m = workspace_from_grasp.translation;
        let pixels_m = self.views.iter().zip(&self.cameras);
        let pixels_m = pixels_m.map(|(view, camera)| (*camera * tips_m).z.abs() / view.camera.intrinsics.fx_px);
        let half_m = 0.5 * pixels_m.fold(f32::INFINITY, f32::min);
        ends_m = [ends_m[0] - half_m, ends_m[1] + half_m];
        (count > 0).then(|| Between { ends_m, are_seen, seen_share: seen as f32 / count as f32, flies })
    }

    /// The images' points of things between the fingers of the open gripper, in the grasp frame, and how many fly.
    fn points_between(&self, workspace_from_grasp: &Pose) -> (Vec<Vec3>, usize) {
        let gripper = self.gripper;
        let half_m = 0.5 * Vec3::new(gripper.finger_width_m, gripper.opening_m_max, gripper.finger_length_m);
        let between = GripperBox { centre_m: Vec3::new(0.0, 0.0, -half_m.z), half_m };
        let (mut points_m, mut flying) = (Vec::new(), 0);
        for ((view, camera_from_workspace), rays_x) in self.views.iter().zip(&self.cameras).zip(&self.rays_x) {
            let lens = view.camera.intrinsics;
            let camera_from_grasp = *camera_from_workspace * *workspace_from_grasp;
            let corners_m: Vec<Vec3> = corners(&between).map(|corner_m| camera_from_grasp * corner_m).collect();
            let [low_m, high_m] = bounds_m(&corners_m);
            if low_m.z <= 0.0 {
                continue;
            }
            let grasp_from_camera = workspace_from_grasp.inverse() * view.camera.workspace_from_camera;
            let box_in_image = Sought {
                turn: Mat3::from_quat(grasp_from_camera.rotation),
                from_m: grasp_from_camera.translation,
                turn_up: Mat3::from_quat(view.camera.workspace_from_camera.rotation),
                eye_z_m: view.camera.workspace_from_camera.translation.z,
                depth_m: [low_m.z, high_m.z],
                half_m,
                above_m: self.table_z_m + TABLE_M,
            };
            for (v, columns) in shadow(&corners_m, &lens, [view.image.width_px, view.image.height_px]) {
                flying += box_in_image.add_row(view, v, columns, rays_x, &mut points_m);
            }
        }
        (points_m, flying)
    }
}

/// The rows of an image onto which a box falls, by its corners in the camera's frame, all before it, and of each row
/// the columns.
fn shadow(
    corners_m: &[Vec3],
    lens: &Intrinsics,
    [width_px, height_px]: [usize; 2],
) -> impl Iterator<Item = (usize, Range<usize>)> + use<> {
    let at_px: Vec<[f32; 2]> = corners_m
        .iter()
        .map(|at_m| [at_m.x * lens.fx_px / at_m.z + lens.cx_px, at_m.y * lens.fy_px / at_m.z + lens.cy_px])
        .collect();
    let ends = |axis: usize| at_px.iter().fold(NOWHERE, |[low, high], px| [low.min(px[axis]), high.max(px[axis])]);
    let inside = |px: f32, size_px: usize| px.clamp(0.0, size_px as f32) as usize;
    let ([left, right], [top, bottom]) = (ends(0), ends(1));
    let rows = inside(top, height_px)..inside(bottom + 1.0, height_px);
    let mut spans = vec![NOWHERE; rows.len()];
    // The outline consists of edges, whose corners differ in one bit.
    for (from, to) in (0..8).flat_map(|from| [1, 2, 4].map(|bit| (from, from | bit))).filter(|(from, to)| from < to) {
        let ([from_u, from_v], [to_u, to_v]) = (at_px[from], at_px[to]);
        let (low_v, high_v, slope) = (from_v.min(to_v), from_v.max(to_v), (to_u - from_u) / (to_v - from_v));
        for v in inside(low_v - 1.0, height_px).max(rows.start)..inside(high_v + 2.0, height_px).min(rows.end) {
            // Where it is a pixel above and below the middle of the row, but no further than it goes.
            let along = |v: f32| from_u + (v.clamp(low_v, high_v) - from_v) * slope;
            let ends = if low_v < high_v { [-1.0, 1.0].map(|off| along(v as f32 + off)) } else { [from_u, to_u] };
            let span = &mut spans[v - rows.start];
            *span = [span[0].min(ends[0].min(ends[1])), span[1].max(ends[0].max(ends[1]))];
        }
    }
    rows.zip(spans).map(move |(v, [low, high])| {
        let first = inside(low.max(left) - 1.0, width_px);
        (v, first..inside(high.min(right) + 2.0, width_px).max(first))
    })
}

/// The range of nothing.
const NOWHERE: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

/// What is looked for in the pixels onto which the box between the fingers falls.
struct Sought {
    /// From the camera's frame to the grasp frame.
    turn: Mat3,
    from_m: Vec3,
    /// To the workspace's, of which the height counts.
    turn_up: Mat3,
    eye_z_m: f32,
    /// The nearest and the farthest depth of the box.
    depth_m: [f32; 2],
    /// Half of its sides; in the grasp frame it ends at the tips.
    half_m: Vec3,
    /// Lower than this is the table.
    above_m: f32,
}

impl Sought {
    /// Adds the points of a part of a row of the image, and counts those that fly. Pixels are held against the box
    /// eight at a time and without branches, which the compiler vectorises: few of them are in it.
    fn add_row(&self, view: &View, v: usize, columns: Range<usize>, rays_x: &[f32], points_m: &mut Vec<Vec3>) -> usize {
        let Self { turn, from_m, turn_up, eye_z_m, depth_m: [near_m, far_m], half_m, above_m } = *self;
        let View { image, camera, .. } = view;
        let (first, row) = (columns.start, v * image.width_px);
        let depths_m = &image.depth_m[row + columns.start..row + columns.end];
        let rays_x = &rays_x[columns];
        let ray = Vec3::new(0.0, camera.intrinsics.ray([0, v]).y, 1.0);
        let (along, rise_x, rise) = (turn * ray, turn_up.x_axis.z, (turn_up * ray).z);
        let point_m = |ray_x: f32, depth_m: f32| from_m + (turn.x_axis * ray_x + along) * depth_m;
        let is_sought = |ray_x: f32, depth_m: f32| {
            let at_m = point_m(ray_x, depth_m);
            let z_m = eye_z_m + (rise_x * ray_x + rise) * depth_m;
            // Most of what is seen around is further away. (False for what is not finite.)
            (depth_m >= near_m)
                & (depth_m <= far_m)
                & (at_m.x.abs() <= half_m.x)
                & (at_m.y.abs() <= half_m.y)
                & ((at_m.z + half_m.z).abs() <= half_m.z)
                & (z_m > above_m)
        };
        let mut flying = 0;
        let mut add = |start: usize, sought: &[bool]| {
            for (at, _) in (start..).zip(sought).filter(|(_, is_sought)| **is_sought) {
                points_m.push(point_m(rays_x[at], depths_m[at]));
                flying += usize::from(flies(view, [first + at, v]));
            }
        };
        let ((wide_x, rest_x), (wide_m, rest_m)) = (rays_x.as_chunks::<8>(), depths_m.as_chunks::<8>());
        let is_any_near =
            |depths_m: &[f32; 8]| depths_m.iter().fold(false, |any, m| any | ((*m >= near_m) & (*m <= far_m)));
        for (place, (rays_x, depths_m)) in wide_x.iter().zip(wide_m).enumerate() {
            if !is_any_near(depths_m) {
                continue;
            }
            let mut sought = [false; 8];
            (0..8).for_each(|lane| sought[lane] = is_sought(rays_x[lane], depths_m[lane]));
            if sought.contains(&true) {
                add(8 * place, &sought);
            }
        }
        let sought: Vec<bool> = rest_x.iter().zip(rest_m).map(|(ray_x, depth_m)| is_sought(*ray_x, *depth_m)).collect();
        add(8 * wide_x.len(), &sought);
        flying
    }
}

/// Whether a pixel lies between those beside it, in its row or its column, and far from both.
fn flies(View { image, camera, .. }: &View, [u, v]: [usize; 2]) -> bool {
    let own_m = image.depth_m[v * image.width_px + u];
    let apart_m = FLIES_M + FLIES_PX * own_m / camera.intrinsics.fx_px;
    let is_between = |pixels: [[usize; 2]; 2]| {
        let [before_m, after_m] = pixels.map(|pixel| image.at(pixel).filter(|m| m.is_finite()).unwrap_or(own_m));
        before_m.min(after_m) < own_m - apart_m && before_m.max(after_m) > own_m + apart_m
    };
    (u > 0 && u + 1 < image.width_px && is_between([[u - 1, v], [u + 1, v]]))
        || (v > 0 && v + 1 < image.height_px && is_between([[u, v - 1], [u, v + 1]]))
}

/// Whether the first two of these points of the workspace about which a view knows anything are free.
fn is_free(view: &View, camera_from_workspace: &Pose, points_m: &[Vec3]) -> bool {
    let behind_m = points_m.iter().filter_map(|point_m| {
        let at_m = *camera_from_workspace * *point_m;
        let depth_m = view.camera.intrinsics.project(at_m).and_then(|pixel| view.image.at(pixel))?;
        depth_m.is_finite().then_some(depth_m - at_m.z)
    });
    // One pixel may be beside the edge by its rounding.
    let first: Vec<f32> = behind_m.take(2).collect();
    !first.is_empty() && first.iter().all(|behind_m| *behind_m > BEHIND_M)
}

fn room_m(gripper: &Gripper) -> f32 {
    ROOM_M.max(gripper.clearance_m)
}

/// The lower and the upper end of values, without the noise.
fn ends(along_m: impl Iterator<Item = f32>, least: usize) -> Option<[f32; 2]> {
    // Integers in the order of the values, among which places are found in half the time. The way back is the same.
    let in_order = |bits: i32| bits ^ ((bits >> 31) as u32 >> 1) as i32;
    let mut along: Vec<i32> = along_m.map(|m| in_order(m.to_bits() as i32)).collect();
    let noise = (NOISE_SHARE * along.len() as f32) as usize;
    let places = [noise, (along.len().max(1) - 1) - noise];
    let count = along.len();
    let value = |place: usize| f32::from_bits(in_order(*along.select_nth_unstable(place).1) as u32);
    (count >= least).then(|| places.map(value))
}

impl Between {
    fn width_m(&self) -> f32 {
        self.ends_m[1] - self.ends_m[0]
    }

    /// How far the gripper must open about it; all the way where an end was not seen.
    fn opening_m(&self, gripper: &Gripper) -> f32 {
        if self.are_seen == [true; 2] { opening_m(gripper, self.ends_m) } else { gripper.opening_m_max }
    }
}

/// How far a gripper must open about what has these ends along y.
fn opening_m(gripper: &Gripper, [low_m, high_m]: [f32; 2]) -> f32 {
    let needed_m = match gripper.fixed_side() {
        None => 2.0 * (low_m.abs().max(high_m.abs()) + room_m(gripper)),
        // The other jaw alone makes room.
        Some(side) => 0.5 * gripper.opening_m_max + [high_m, -low_m][side] + room_m(gripper),
    };
    needed_m.min(gripper.opening_m_max)
}

#[cfg(test)]
mod tests {
    use schema::{Camera, DepthImage, Quat, pose_from_parts};

    use super::*;
    use crate::BuiltIn;
    use crate::gripper_volume::WRIST_DOWN;

    const LOW_M: Vec3 = Vec3::new(0.12, 0.1, 0.05);
    const HIGH_M: Vec3 = Vec3::new(0.18, 0.2, 0.13);

    /// A box of 60 x 100 x 80 mm on the table, as a camera sees it that looks at its top from `eye_m`.
    fn view(eye_m: Vec3) -> View {
        let forward = (Vec3::new(0.15, 0.15, 0.1) - eye_m).normalize();
        let right = forward.cross(Vec3::Z).try_normalize().unwrap_or(Vec3::X);
        let rotation = Quat::from_mat3(&Mat3::from_cols(right, forward.cross(right), forward)).normalize();
        let camera = Camera { intrinsics: Intrinsics::VGN, workspace_from_camera: pose_from_parts(rotation, eye_m) };
        let depth = |pixel: usize| {
            let ray = rotation * camera.intrinsics.ray([pixel % 640, pixel / 640]);
            let table = (0.05 - eye_m.z) / ray.z;
            let [near, far] = [(LOW_M - eye_m) / ray, (HIGH_M - eye_m) / ray];
            let (enter, leave) = (near.min(far).max_element(), near.max(far).min_element());
            if enter < leave { enter } else { table }
        };
        let image = DepthImage { width_px: 640, height_px: 480, depth_m: (0..640 * 480).map(depth).collect() };
        View::new(image, camera)
    }

    /// A grasp from above over the box, its tips 30 mm deep, that closes along x or along y.
    fn down(along_y: bool, off_m: f32) -> Pose {
        let turn = schema::axis_angle(Vec3::Z, if along_y { 0.0 } else { core::f32::consts::FRAC_PI_2 });
        let rotation = WRIST_DOWN * turn;
        pose_from_parts(rotation, Vec3::new(0.15, 0.15, 0.1) + rotation * Vec3::Y * off_m)
    }

    fn measured(views: &[View], pose: Pose) -> RankedGrasp {
        let gripper = BuiltIn::Judge.config().unwrap().gripper;
        let mut grasps = [RankedGrasp::new(pose, None, 0.9, None)];
        Widths::new(views, 0.05, &gripper).measure(&mut grasps);
        let [grasp] = grasps;
        grasp
    }

    #[test]
    fn a_width_is_told_where_both_of_its_ends_were_seen_and_is_unknown_elsewhere() {
        let gripper = BuiltIn::Judge.config().unwrap().gripper;
        for eye_m in [Vec3::new(0.15, 0.15, 0.7), Vec3::new(0.15, -0.3, 0.5)] {
            let across = measured(&[view(eye_m)], down(false, 0.004));
            assert!((across.width_m.unwrap() - 0.06).abs() < 0.002, "{eye_m}: {across:?}");
            // Open about what is 4 mm beside the gripper's middle.
            let room_m = across.opening_m - (0.06 + 2.0 * 0.004);
            assert!((0.005..0.016).contains(&room_m) && across.width_seen_share > Some(0.2), "{across:?}");
        }
        // Longer than the gripper opens: neither end is between the fingers, so nothing is known.
        let along = measured(&[view(Vec3::new(0.15, 0.15, 0.7))], down(true, 0.0));
        assert_eq!((along.width_m, along.opening_m), (None, gripper.opening_m_max), "{along:?}");
        // From the side, low: the far face is hidden by the near one.
        let beside = measured(&[view(Vec3::new(-0.4, 0.15, 0.11))], down(false, 0.0));
        assert_eq!((beside.width_m, beside.opening_m), (None, gripper.opening_m_max), "{beside:?}");
        let both = measured(&[view(Vec3::new(-0.4, 0.15, 0.11)), view(Vec3::new(0.7, 0.15, 0.11))], down(false, 0.0));
        assert!((both.width_m.unwrap() - 0.06).abs() < 0.002, "{both:?}");
        let nowhere = measured(&[], down(false, 0.0));
        assert_eq!((nowhere.width_m, nowhere.width_seen_share, nowhere.opening_m), (None, None, gripper.opening_m_max));
    }

    #[test]
    fn a_hand_is_centred_on_what_was_seen_of_both_sides() {
        let gripper = BuiltIn::Judge.config().unwrap().gripper;
        let views = [view(Vec3::new(0.15, -0.3, 0.5))];
        let widths = Widths::new(&views, 0.05, &gripper);
        let off = Grasp { workspace_from_grasp: down(false, 0.007), width_m: 0.05 };
        let centred = widths.centred(&off).unwrap().workspace_from_grasp;
        assert!((centred.translation.x - 0.15).abs() < 0.001, "{centred:?}");
        assert!((centred.translation - off.workspace_from_grasp.translation).length() < 0.0085, "{centred:?}");
        assert_eq!(widths.centred(&Grasp { workspace_from_grasp: down(true, 0.0), width_m: 0.05 }), None);
    }

    /// Three columns of pixels beside the box, each 20 mm deeper than the one before, from its top to the table.
    #[test]
    fn pixels_between_a_top_and_the_table_fly() {
        let mut mixed = view(Vec3::new(0.15, 0.15, 0.7));
        for (pixel, depth_m) in mixed.image.depth_m.iter_mut().enumerate() {
            let [v, u] = [pixel / 640, pixel % 640];
            if (200..280).contains(&v) && (349..352).contains(&u) {
                *depth_m = 0.59 + 0.02 * (u - 349) as f32;
            }
        }
        let beside = pose_from_parts(down(false, 0.0).rotation, Vec3::new(0.2215, 0.15, 0.06));
        assert_eq!(measured(std::slice::from_ref(&mixed), beside).doubt, Some(Doubt::Flying));
        assert_eq!(measured(&[mixed], down(false, 0.0)).doubt, None);
        assert_eq!(measured(&[view(Vec3::new(0.15, 0.15, 0.7))], beside).doubt, None);
    }

    #[test]
    fn a_finger_that_stands_where_no_image_has_a_depth_is_doubted() {
        let whole = view(Vec3::new(0.15, 0.15, 0.7));
        let mut half = whole.clone();
        half.image.depth_m.iter_mut().enumerate().filter(|(at, _)| at % 640 > 349).for_each(|(_, m)| *m = 0.0);
        let doubt = |views: &[View], along_y: bool| measured(views, down(along_y, 0.0)).doubt;
        assert_eq!(doubt(std::slice::from_ref(&half), false), Some(Doubt::NoDepth));
        assert_eq!(doubt(std::slice::from_ref(&half), true), None);
        assert_eq!(doubt(&[half, whole], false), None, "another image saw it");
        assert_eq!(doubt(&[], false), None, "there are no images");
    }

    #[test]
    fn fingers_beside_the_images_are_out_of_sight() {
        let gripper = BuiltIn::Judge.config().unwrap().gripper;
        let mut near = view(Vec3::new(0.15, 0.15, 0.7));
        let all = [near.clone()];
        let pose = down(false, 0.0);
        assert!(!Widths::new(&all, 0.05, &gripper).is_out_of_sight(&pose));
        // Only the left half of the image.
        near.camera.intrinsics.width_px = 330;
        assert!(Widths::new(&[near.clone()], 0.05, &gripper).is_out_of_sight(&pose));
        assert!(!Widths::new(&[near, all[0].clone()], 0.05, &gripper).is_out_of_sight(&pose), "another camera looks");
        assert!(!Widths::new(&[], 0.05, &gripper).is_out_of_sight(&pose), "unknown");
    }

    /// Its left jaw is fixed.
    #[test]
    fn a_fixed_jaw_is_put_beside_a_thing_and_the_other_makes_room() {
        let text = include_str!("../../configs/grippers/parallel_jaw_80.toml");
        let jaws = "jaws = [{}, { slide_m = [0, -0.08, 0] }]\njoint = { open = 1.6, closed = 0 }";
        let gripper = Gripper::from_toml(&format!("{text}\n{jaws}")).unwrap();
        let views = [view(Vec3::new(0.15, 0.15, 0.7))];
        let widths = Widths::new(&views, 0.05, &gripper);
        let over = Grasp { workspace_from_grasp: down(false, 0.004), width_m: 0.0 };
        let beside = widths.centred(&over).unwrap().workspace_from_grasp;
        // The jaw's face, 40 mm left of the middle, is 3 mm beside the thing of 60 mm.
        let middle_m = beside.inverse_transform_point(Vec3::new(0.15, 0.15, 0.1)).y;
        assert!((middle_m + 0.007).abs() < 0.0015, "{middle_m}");
        let mut grasps = [RankedGrasp::new(beside, None, 0.9, None), RankedGrasp::new(beside, Some(0.06), 0.9, None)];
        widths.measure(&mut grasps);
        for RankedGrasp { opening_m, joint_position, .. } in grasps {
            assert!((opening_m - (0.04 + 0.023 + ROOM_M)).abs() < 0.003, "{opening_m}");
            assert!((joint_position.unwrap() - 20.0 * opening_m).abs() < 1e-4, "{joint_position:?}");
        }
    }
}
