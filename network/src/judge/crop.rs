//! What the judge sees of a grasp: the TSDF around the gripper, in the grasp's frame.
//!
//! A box of points spans the open gripper, the way that it sweeps from pre-grasp to grasp, and some space beyond its
//! tips; it scales with the gripper. At each point stand the mean of the *observed* distances around it, the share of
//! them that was observed, the height over the table, and the distance to the swept gripper itself, so that one network
//! can serve grippers of other dimensions. A wider and coarser box about the tips shows what the gripper would hold as
//! a whole, and what lies around it: whether it is gripped beside its middle, and what else would move.

use schema::{Grid, Gripper, GripperBox, Mat3, Pose, Vec3, VoxelGrid};

use crate::kernels::conv::Extent;

/// Points along x, y and z of the grasp frame.
pub const BOX: [usize; 3] = [8, 20, 28];
/// Values of a point: distance, observed share, height over the table, distance to the gripper.
pub const CHANNELS: usize = 4;
/// Points of the surroundings along x, y and z of the grasp frame.
pub const WIDE_BOX: [usize; 3] = [12, 8, 8];
/// Values of a point of the surroundings: distance, observed share, height over the table.
pub const WIDE_CHANNELS: usize = 3;
/// Values of a grasp besides its crop.
pub const FACTS: usize = 16;

/// The boxes in memory, with the zeros that the first convolutions pad with.
pub(super) const PADDED: Extent = Extent { n: BOX, padding: 1 };
pub(super) const WIDE_PADDED: Extent = Extent { n: WIDE_BOX, padding: 1 };
/// Places along x, y and z of the crop of the few points that a [`super::Screen`] looks at …
const FEW: [&[usize]; 3] = [&[0, 2, 5, 7], &[1, 5, 9, 10, 14, 18], &[3, 7, 11, 15, 17, 19, 21, 23, 25, 27]];
/// … and of the surroundings.
const WIDE_FEW: [&[usize]; 3] = [&[1, 4, 7, 10], &[1, 3, 4, 6], &[1, 3, 4, 6]];

const fn len_of([x, y, z]: [&[usize]; 3]) -> usize {
    x.len() * y.len() * z.len()
}

/// How far the surroundings reach from the tips along x, y and z.
const WIDE_M: Vec3 = Vec3::new(0.088, 0.06, 0.06);
/// Distances are clipped here, and divided by it.
const CLIP_M: f32 = 0.03;
/// How far the box reaches beyond the tips.
const BEYOND_M: f32 = 0.02;
/// Of a point whose surroundings were observed to less than this share nothing is known.
const SHARE_MIN: f32 = 1e-3;
/// Lengths are facts in units of this.
const UNIT_M: f32 = 0.1;
/// Closing forces are facts in units of this, less 1: judges of one gripper were trained without this fact, at 0.
const UNIT_N: f32 = 20.0;
/// Numbers of views are facts in units of this.
const UNIT_VIEWS: f32 = 6.0;

/// A TSDF with a border of voxels that nobody observed.
#[derive(Debug, Clone)]
pub struct PaddedGrid {
    low_m: Vec3,
    /// Voxels along y and z, with the border, and the last place along x, y and z to look up.
    sides: [usize; 2],
    last: Vec3,
    /// Of each voxel whether it was observed, 1 or 0, and VGN's value, which is 0 where nothing was observed.
    values: Vec<[f32; 2]>,
    /// Whether one of the eight voxels of a cell was observed, by its lowest voxel: above things none was, and there is
    /// nothing to look up.
    is_observed: Vec<bool>,
}

impl PaddedGrid {
    /// From the values of a TSDF, x slowest, on a lattice with this lower corner and so many voxels along x, y and z.
    #[must_use]
    pub fn new(low_m: Vec3, counts: [usize; 3], values: &[f32]) -> Self {
        let extent = Extent { n: counts, padding: 1 };
        let mut padded = vec![[0.0; 2]; extent.len()];
        for (line, values) in values.chunks_exact(counts[2]).enumerate() {
            let line = &mut padded[extent.place([line / counts[1], line % counts[1], 0])..][..counts[2]];
            for (voxel, value) in line.iter_mut().zip(values) {
                *voxel = [if *value > 0.0 { 1.0 } else { 0.0 }, *value];
            }
        }
        let last = Vec3::from_array(counts.map(|count| (count + 1) as f32 - 1e-4));
        let sides = [counts[1] + 2, counts[2] + 2];
        let mut is_observed: Vec<bool> = padded.iter().map(|[share, _]| *share > 0.0).collect();
        for stride in [1, sides[1], sides[0] * sides[1]] {
            for low in 0..is_observed.len() - stride {
                is_observed[low] |= is_observed[low + stride];
            }
        }
        Self { low_m, sides, last, values: padded, is_observed }
    }

    /// Mean of the observed distances at the eight voxels around a point, by their weights, in [−1, 1] of the
    /// truncation, and the share of the eight that was observed; 0 and 0 where none was. `at` is in voxels from the
    /// centre of the border's first one; beyond the border nothing is observed.
    #[inline(always)]
    #[must_use]
    pub fn at(&self, at: Vec3) -> (f32, f32) {
        let [(x, high_x), (y, high_y), (z, high_z)] = [0, 1, 2].map(|axis| {
            let at = at[axis].max(0.0).min(self.last[axis]);
            let low = at as i32;
            (low as usize, at - low as f32)
        });
        let [width, height] = self.sides;
        let lowest = (x * width + y) * height + z;
        if !self.is_observed[lowest] {
            return (0.0, 0.0);
        }
        let lines = &self.values.as_flattened()[2 * lowest..];
        // Two voxels along z lie side by side: four numbers.
        let mut pair = [0.0; 4];
        for (wx, line) in [(1.0 - high_x, 0), (high_x, width)] {
            for (wy, line) in [(1.0 - high_y, line), (high_y, line + 1)] {
                let Some(values) = lines.get(2 * line * height..).and_then(|line| line.first_chunk::<4>()) else {
                    continue;
                };
                for (sum, value) in pair.iter_mut().zip(values) {
                    *sum += wx * wy * value;
                }
            }
        }
        let [share, sum] = [0, 1].map(|part| (1.0 - high_z) * pair[part] + high_z * pair[2 + part]);
        if share > SHARE_MIN { (2.0 * sum / share - 1.0, share) } else { (0.0, 0.0) }
    }
}

impl From<&VoxelGrid> for PaddedGrid {
    fn from(VoxelGrid { lattice, values }: &VoxelGrid) -> Self {
        Self::new(lattice.low_m, lattice.counts, values)
    }
}

/// A box of points in the grasp frame.
#[derive(Debug, Clone, Copy)]
struct Lattice {
    padded: Extent,
    /// The first point and the steps between points.
    low_m: Vec3,
    step_m: Vec3,
}

impl Lattice {
    fn new(padded: Extent, low_m: Vec3, high_m: Vec3) -> Self {
        let [nx, ny, nz] = padded.n.map(|n| n as f32 - 1.0);
        Self { padded, low_m, step_m: (high_m - low_m) / Vec3::new(nx, ny, nz) }
    }

    fn point_m(&self, [x, y, z]: [usize; 3]) -> Vec3 {
        self.low_m + self.step_m * Vec3::new(x as f32, y as f32, z as f32)
    }

    /// Its points at some places along each axis, x slowest.
    fn points_m(&self, [xs, ys, zs]: [&[usize]; 3]) -> Vec<Vec3> {
        let lines = xs.iter().flat_map(|x| ys.iter().map(move |y| (x, y)));
        lines.flat_map(|(x, y)| zs.iter().map(move |z| self.point_m([*x, *y, *z]))).collect()
    }
}

/// How the judge sees the grasps of a gripper in a grid.
#[derive(Debug, Clone)]
pub struct Crop {
    narrow: Lattice,
    wide: Lattice,
    /// A padded box with the distances to the swept gripper, and zeros for what is seen.
    template: Vec<f32>,
    /// The points of both boxes that a [`super::Screen`] looks at, in the grasp frame.
    few_m: Vec<Vec3>,
    /// What the gripper sweeps, with its clearance.
    swept: Vec<GripperBox>,
    /// The gripper's own facts.
    dimensions: [f32; 10],
    /// Whether one jaw is fixed: mirrored in y it is another gripper.
    pub(super) is_one_sided: bool,
    table_z_m: f32,
    voxel_size_m: f32,
}

impl Crop {
    /// Values of a crop with its padding.
    pub const LEN: usize = PADDED.len() * CHANNELS;
    /// Number of the few points of both boxes.
    pub(super) const FEW: usize = len_of(FEW) + len_of(WIDE_FEW);
    /// Values of the surroundings with their padding.
    pub const WIDE_LEN: usize = WIDE_PADDED.len() * WIDE_CHANNELS;

    /// How a judge sees this gripper, which starts `pregrasp_distance_m` behind its grasp, in this grid.
    #[must_use]
    pub fn new(gripper: &Gripper, pregrasp_distance_m: f32, grid: &Grid) -> Self {
        // Judges know grippers of three boxes, with fingers that are as thick at their tips and slide alike.
        let open = Gripper { finger_tip: None, jaws: Vec::new(), ..gripper.clone() }.open_gripper();
        let sweep: Vec<GripperBox> = open.iter().map(|b| b.swept_back(pregrasp_distance_m)).collect();
        let low = sweep.iter().fold(Vec3::INFINITY, |low, b| low.min(b.centre_m - b.half_m));
        let high = sweep.iter().fold(Vec3::NEG_INFINITY, |high, b| high.max(b.centre_m + b.half_m));
        let high = high + Vec3::new(0.0, 0.0, BEYOND_M);
        let mut crop = Self {
            narrow: Lattice::new(PADDED, low, high),
            wide: Lattice::new(WIDE_PADDED, -WIDE_M, WIDE_M),
            template: vec![0.0; Self::LEN],
            few_m: Vec::new(),
            swept: sweep.iter().map(|b| b.grown(gripper.clearance_m)).collect(),
            dimensions: dimensions(gripper, pregrasp_distance_m),
            is_one_sided: gripper.fixed_side().is_some(),
            table_z_m: grid.table_z_m,
            voxel_size_m: grid.voxel_size_m(),
        };
        for at in PADDED.positions() {
            let distance_m = sweep.iter().map(|b| distance_m(b, crop.narrow.point_m(at))).fold(f32::INFINITY, f32::min);
            crop.template[PADDED.place(at) * CHANNELS + 3] = clipped(distance_m);
        }
        crop.few_m = [crop.narrow.points_m(FEW), crop.wide.points_m(WIDE_FEW)].concat();
        crop
    }

    /// Whether the gripper, on its way to the grasp, comes nearer to the table than its clearance: then the attempt
    /// fails for certain.
    #[must_use]
    pub fn hits_table(&self, workspace_from_grasp: &Pose) -> bool {
        let lowest_m = self.swept.iter().map(|b| b.lowest_z_m(workspace_from_grasp));
        lowest_m.fold(f32::INFINITY, f32::min) < self.table_z_m
    }

    /// Appends the crop of a grasp, `[10, 22, 30, CHANNELS]`, mirrored in the grasp's x and y or not.
    pub(super) fn see(&self, grid: &PaddedGrid, workspace_from_grasp: &Pose, mirrored: [bool; 2], to: &mut Vec<f32>) {
        let start = to.len();
        to.extend_from_slice(&self.template);
        self.look::<CHANNELS>(self.narrow, grid, workspace_from_grasp, mirrored, &mut to[start..]);
    }

    /// Appends the surroundings of a grasp, `[14, 10, 10, WIDE_CHANNELS]`.
    pub(super) fn see_wide(
        &self,
        grid: &PaddedGrid,
        workspace_from_grasp: &Pose,
        mirrored: [bool; 2],
        to: &mut Vec<f32>,
    ) {
        let start = to.len();
        to.resize(start + Self::WIDE_LEN, 0.0);
        self.look::<WIDE_CHANNELS>(self.wide, grid, workspace_from_grasp, mirrored, &mut to[start..]);
    }

    /// Appends distance and observed share at the few points of both boxes.
    pub(super) fn see_few(&self, grid: &PaddedGrid, workspace_from_grasp: &Pose, to: &mut Vec<f32>) {
        let per_m = 1.0 / self.voxel_size_m;
        let turn = Mat3::from_quat(workspace_from_grasp.rotation) * per_m;
        let tips = (workspace_from_grasp.translation - grid.low_m) * per_m + Vec3::splat(0.5);
        for point_m in &self.few_m {
            let (distance, share) = grid.at(tips + turn * *point_m);
            to.extend_from_slice(&[distance, share]);
        }
    }

    /// Sets the first three values of each point.
    fn look<const VALUES: usize>(
        &self,
        lattice: Lattice,
        grid: &PaddedGrid,
        workspace_from_grasp: &Pose,
        mirrored: [bool; 2],
        to: &mut [f32],
    ) {
        let step_m = workspace_from_grasp.rotation * Vec3::new(0.0, 0.0, lattice.step_m.z);
        // In voxels from the centre of the border's first one.
        let (per_m, offset) = (1.0 / self.voxel_size_m, Vec3::splat(0.5));
        let [nx, ny, nz] = lattice.padded.n;
        for x in 0..nx {
            for y in 0..ny {
                let first_m = workspace_from_grasp.transform_point(lattice.point_m([x, y, 0]));
                let at = [if mirrored[0] { nx - 1 - x } else { x }, if mirrored[1] { ny - 1 - y } else { y }, 0];
                let line = &mut to[lattice.padded.place(at) * VALUES..][..nz * VALUES];
                for (z, point) in line.as_chunks_mut::<VALUES>().0.iter_mut().enumerate() {
                    let at_m = first_m + step_m * z as f32;
                    let (distance, share) = grid.at((at_m - grid.low_m) * per_m + offset);
                    [point[0], point[1], point[2]] = [distance, share, clipped(at_m.z - self.table_z_m)];
                }
            }
        }
    }

    /// What is known of a grasp besides its crop: where down is for it, the height of its tips, the number of views,
    /// the gripper's dimensions.
    pub(super) fn facts(&self, workspace_from_grasp: &Pose, views: usize, mirrored: [bool; 2]) -> [f32; FACTS] {
        let mut facts = [0.0; FACTS];
        let up = workspace_from_grasp.rotation.inverse() * Vec3::Z;
        let [x, y] = mirrored.map(|is_mirrored| if is_mirrored { -1.0 } else { 1.0 });
        let height_m = workspace_from_grasp.translation.z - self.table_z_m;
        facts[..5].copy_from_slice(&[x * up.x, y * up.y, up.z, height_m / UNIT_M, views as f32 / UNIT_VIEWS]);
        facts[5..][..self.dimensions.len()].copy_from_slice(&self.dimensions);
        facts
    }
}

/// The values of boxes that are padded in memory, without the padding.
pub(super) fn bare<const VALUES: usize>(padded: Extent, values: &[f32]) -> Vec<f32> {
    let boxes = values.chunks_exact(padded.len() * VALUES);
    let point =
        |of: &[f32], at| -> [f32; VALUES] { std::array::from_fn(|value| of[padded.place(at) * VALUES + value]) };
    boxes.flat_map(|of| padded.positions().flat_map(move |at| point(of, at))).collect()
}

fn dimensions(gripper: &Gripper, pregrasp_distance_m: f32) -> [f32; 10] {
    let lengths_m = [
        gripper.opening_m_max,
        gripper.finger_length_m,
        gripper.finger_width_m,
        gripper.finger_thickness_m,
        gripper.palm_length_m,
        gripper.palm_width_m,
        gripper.palm_breadth_m,
        pregrasp_distance_m,
    ];
    let mut facts = [0.0; 10];
    facts[..8].copy_from_slice(&lengths_m.map(|m| m / UNIT_M));
    facts[8] = gripper.friction;
    facts[9] = gripper.finger_force_n / UNIT_N - 1.0;
    facts
}

fn clipped(distance_m: f32) -> f32 {
    (distance_m / CLIP_M).clamp(-1.0, 1.0)
}

/// Signed distance to a box.
fn distance_m(gripper_box: &GripperBox, point_m: Vec3) -> f32 {
    let outside = (point_m - gripper_box.centre_m).abs() - gripper_box.half_m;
    outside.max(Vec3::ZERO).length() + outside.max_element().min(0.0)
}

#[cfg(test)]
mod tests {
    use schema::{Procedure, Purpose, Stream, axis_angle};

    use super::*;

    fn view() -> Crop {
        let gripper = Gripper::from_toml(Gripper::BUILT_IN[0].1).unwrap();
        Crop::new(&gripper, Procedure::PAPER.pregrasp_distance_m, &Grid::PAPER)
    }

    /// Distance along a slanted plane, in VGN's values.
    fn slanted() -> (VoxelGrid, impl Fn(Vec3) -> f32) {
        let value = |at: Vec3| 0.5 + 0.4 * (at - Vec3::splat(0.15)).dot(Vec3::new(0.6, -1.0, 0.8)) / 0.15;
        let values = Extent::cube(40, 0).positions().map(|index| value(Grid::PAPER.centre_m(index)).max(0.0));
        (VoxelGrid::new(Grid::PAPER, values.collect()).unwrap(), value)
    }

    fn down_at(x_m: f32, y_m: f32, z_m: f32) -> Pose {
        Pose::from_parts(Vec3::new(x_m, y_m, z_m), axis_angle(Vec3::X, core::f32::consts::PI))
    }

    fn seen(grid: &VoxelGrid, pose: &Pose, mirrored: [bool; 2]) -> Vec<f32> {
        let mut crop = Vec::new();
        view().see(&grid.into(), pose, mirrored, &mut crop);
        assert_eq!(crop.len(), Crop::LEN);
        crop
    }

    #[test]
    fn a_linear_field_is_seen_as_it_is_wherever_it_was_observed() {
        let (grid, value) = slanted();
        let mut stream = Stream::new(2, 0, Purpose::Views, 0);
        let mut inside = 0;
        for _ in 0..20 {
            let pose = Pose::from_parts(stream.point(Vec3::splat(0.1), Vec3::splat(0.2)), stream.rotation());
            let crop = seen(&grid, &pose, [false; 2]);
            for at in PADDED.positions() {
                let [distance, share, height, _] =
                    *crop[PADDED.place(at) * CHANNELS..].first_chunk::<CHANNELS>().unwrap();
                let point = pose.transform_point(view().narrow.point_m(at));
                assert!((height - ((point.z - 0.05) / 0.03).clamp(-1.0, 1.0)).abs() < 1e-4);
                if share > 0.999 {
                    assert!((distance - (2.0 * value(point) - 1.0)).abs() < 1e-3, "{at:?}: {distance}");
                    inside += 1;
                }
                let is_far_out = point.min_element() < -0.004 || point.max_element() > 0.304;
                assert!(!is_far_out || share == 0.0, "{point}: {share}");
            }
        }
        assert!(inside > 10_000, "{inside}");
    }

    /// The few points are some of the crop's, and then some of the surroundings'.
    #[test]
    fn a_quick_look_sees_what_the_crop_has_there() {
        let (grid, pose) = (slanted().0, down_at(0.14, 0.16, 0.12));
        let (crop, mut few, mut wide) = (seen(&grid, &pose, [false; 2]), Vec::new(), Vec::new());
        view().see_few(&(&grid).into(), &pose, &mut few);
        view().see_wide(&(&grid).into(), &pose, [false; 2], &mut wide);
        let pairs = few.as_chunks::<2>().0;
        assert_eq!(pairs.len(), Crop::FEW);
        let expected = |padded: Extent, values: usize, places: [&[usize]; 3], of: &[f32]| -> Vec<[f32; 2]> {
            let [xs, ys, zs] = places;
            let all = xs.iter().flat_map(|x| ys.iter().flat_map(move |y| zs.iter().map(move |z| [*x, *y, *z])));
            all.map(|at| *of[padded.place(at) * values..].first_chunk::<2>().unwrap()).collect()
        };
        let there =
            [expected(PADDED, CHANNELS, FEW, &crop), expected(WIDE_PADDED, WIDE_CHANNELS, WIDE_FEW, &wide)].concat();
        assert!(pairs.iter().zip(there).all(|(one, other)| (0..2).all(|at| (one[at] - other[at]).abs() < 1e-4)));
    }

    #[test]
    fn what_nobody_observed_counts_for_nothing() {
        let (mut grid, _) = slanted();
        for (at, value) in grid.values.iter_mut().enumerate() {
            *value = if at % 2 == 0 { 0.25 } else { 0.0 };
        }
        let crop = seen(&grid, &down_at(0.15, 0.15, 0.12), [false; 2]);
        for at in PADDED.positions() {
            let [distance, share, ..] = *crop[PADDED.place(at) * CHANNELS..].first_chunk::<CHANNELS>().unwrap();
            assert!((share == 0.0 && distance == 0.0) || (distance + 0.5).abs() < 1e-5, "{distance} {share}");
        }
    }

    /// A single voxel is seen from everywhere within a voxel of it, by its weight, and from nowhere else.
    #[test]
    fn one_observed_voxel_is_seen_from_all_sides() {
        let mut values = vec![0.0; 5 * 4 * 3];
        values[(2 * 4 + 1) * 3 + 2] = 0.75;
        let grid = PaddedGrid::new(Vec3::ZERO, [5, 4, 3], &values);
        // With the border.
        let voxel = Vec3::new(3.0, 2.0, 3.0);
        let mut stream = Stream::new(5, 0, Purpose::Views, 0);
        for at in (0..2000).map(|_| stream.point(Vec3::splat(-0.5), Vec3::new(6.5, 5.5, 4.5))) {
            let within = at.max(Vec3::ZERO).min(Vec3::new(6.0, 5.0, 4.0));
            let weight: f32 = (Vec3::ONE - (within - voxel).abs()).max(Vec3::ZERO).to_array().iter().product();
            let (distance, share) = grid.at(at);
            assert!((share - weight).abs() < 1e-3, "{at}: {share} for {weight}");
            assert!(distance == 0.0 && share == 0.0 || (distance - 0.5).abs() < 1e-4, "{at}: {distance}");
        }
    }

    /// Mirrored in y, a gripper with one fixed jaw would be another one.
    #[test]
    fn a_gripper_with_a_fixed_jaw_is_not_mirrored_in_y() {
        let (grid, pose) = (slanted().0, down_at(0.14, 0.16, 0.12));
        for (name, is_mirrored) in [("parallel_jaw_80", true), ("so_101", false)] {
            let (_, text) = Gripper::BUILT_IN.into_iter().find(|(built_in, _)| *built_in == name).unwrap();
            let crop = Crop::new(&Gripper::from_toml(text).unwrap(), 0.05, &Grid::PAPER);
            let [plain, x, y] = [[false; 2], [true, false], [false, true]].map(|mirrored| {
                let mut inputs = super::super::JudgeInputs::with_capacity(1);
                inputs.push(&crop, &(&grid).into(), &pose, 1, mirrored);
                inputs.crops
            });
            assert!(plain != x && (plain != y) == is_mirrored, "{name}");
        }
    }

    /// The crop of a grasp in a mirrored scene is the mirrored crop.
    #[test]
    fn mirrored_scenes_give_mirrored_crops() {
        let (grid, _) = slanted();
        let mut mirrored = grid.clone();
        for [x, y, z] in Extent::cube(40, 0).positions() {
            mirrored.values[Grid::PAPER.flat([39 - x, y, z])] = grid.values[Grid::PAPER.flat([x, y, z])];
        }
        // This grasp's x is the workspace's.
        let (here, there) = (down_at(0.12, 0.16, 0.12), down_at(0.18, 0.16, 0.12));
        let (one, other) = (seen(&grid, &here, [true, false]), seen(&mirrored, &there, [false; 2]));
        assert!(one.iter().zip(&other).all(|(a, b)| (a - b).abs() < 1e-4));
        assert!(seen(&grid, &here, [false; 2]).iter().zip(&other).any(|(a, b)| (a - b).abs() > 0.1));
        let crop = view();
        let tilted = Pose::from_parts(Vec3::splat(0.1), axis_angle(Vec3::Y, 0.5));
        let [plain, mirrored] = [[false; 2], [true, false]].map(|by| crop.facts(&tilted, 3, by));
        assert_eq!((plain[0], plain[4]), (-mirrored[0], 0.5));
        assert!(plain[0] != 0.0 && plain[1..] == mirrored[1..]);
    }

    #[test]
    fn only_grippers_that_reach_the_table_hit_it() {
        let crop = view();
        assert!(!crop.hits_table(&down_at(0.15, 0.15, 0.0512)));
        assert!(crop.hits_table(&down_at(0.15, 0.15, 0.0508)), "the clearance is 1 mm");
        let level = Pose::from_parts(Vec3::new(0.15, 0.15, 0.08), axis_angle(Vec3::Y, core::f32::consts::FRAC_PI_2));
        assert!(!crop.hits_table(&level));
    }
}
