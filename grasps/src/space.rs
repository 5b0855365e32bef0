//! What was seen of a scene, for questions about single points and about all points of a gripper.

use std::sync::OnceLock;

use network::judge::PaddedGrid;
use perception::{
    Field as _, SurfaceBlocks, TRUNCATION_VOXELS, mean_distance, normals, surface_cloud, surface_of_blocks,
};
use schema::{GripperBox, Mat3, Quat, Vec3, VoxelGrid};

/// Distance between the points of the surface that candidates touch.
const PITCH_M: f32 = 0.005;
/// Points nearer to the table than this belong to the table.
const TABLE_M: f32 = 0.004;
/// A finger closes along a normal only if the normal rises or falls by less than this sine.
const CLOSING_RISE_MAX: f32 = 0.85;
/// Step of the walk through an object to its side.
const WALK_M: f32 = 0.002;
/// A gripper is in the way of what was seen where the field is below this, in truncations: 6 mm deep in the paper's
/// grid, because the field is coarse.
const INSIDE: f32 = -0.2;
/// Where a finer field is given, it is asked too, about points that are nearer than this to a surface, in truncations …
const NEAR: f32 = 0.3;
/// … and a gripper is in the way of what it shows where that is deeper than this.
const INSIDE_FINE_M: f32 = 0.001;
/// Distance between the points of the swept gripper at which the field is looked up.
const LOOK_M: f32 = 0.0075;
/// So many points of a gripper along each side of a cube are looked up together: where nothing is near its middle, not
/// at all.
const TOGETHER: usize = 3;

/// Points of a gripper that are near each other, in the grasp frame.
#[derive(Debug, Clone)]
pub(crate) struct Looks {
    pub(crate) middle_m: Vec3,
    pub(crate) points_m: Vec<Vec3>,
}

/// Points of a box on a lattice of [`LOOK_M`], its faces included, in groups.
pub(crate) fn looks_of(b: &GripperBox) -> Vec<Looks> {
    let counts = b.half_m.to_array().map(|half_m| libm::ceilf(2.0 * half_m / LOOK_M) as usize + 1);
    let along = |axis: usize, at: usize| b.half_m[axis] * (2.0 * at as f32 / (counts[axis] - 1) as f32 - 1.0);
    let groups = counts.map(|count| count.div_ceil(TOGETHER));
    let of_group = |flat: usize| {
        let group = [flat / (groups[1] * groups[2]), flat / groups[2] % groups[1], flat % groups[2]];
        let [xs, ys, zs] = [0, 1, 2].map(|axis| {
            let first = group[axis] * TOGETHER;
            first..(first + TOGETHER).min(counts[axis])
        });
        let lines = xs.flat_map(|x| ys.clone().map(move |y| (x, y)));
        let points = lines.flat_map(|(x, y)| zs.clone().map(move |z| [x, y, z]));
        let point_m = |at: [usize; 3]| b.centre_m + Vec3::from_array([0, 1, 2].map(|axis| along(axis, at[axis])));
        let points_m: Vec<Vec3> = points.map(point_m).collect();
        let middle_m = 0.5 * (points_m[0] + points_m[points_m.len() - 1]);
        Looks { middle_m, points_m }
    };
    (0..groups.iter().product()).map(of_group).collect()
}

/// Of each voxel, whether what a gripper may touch lies in a voxel so near that points about the same middle may be in
/// it.
fn around(field: &VoxelGrid) -> Vec<bool> {
    let [_, width, height] = field.lattice.counts;
    let mut is_around: Vec<bool> = field.values.iter().map(|value| is_near(*value)).collect();
    // From the middle of a cube to its corner, and as a point lies anywhere in its voxel.
    let radius_m = 0.5 * (TOGETHER - 1) as f32 * LOOK_M * 3.0_f32.sqrt();
    let most = (radius_m / field.lattice.voxel_size_m) as usize + 1;
    for stride in [width * height, height, 1] {
        let mut done = 0;
        while done < most {
            // What is set is `2 · done + 1` wide.
            let step = (most - done).min(2 * done + 1);
            spread(&mut is_around, step * stride);
            done += step;
        }
    }
    is_around
}

/// Sets what is `reach` places before or after what is set. (Over the ends of lines, too: then a gripper is looked at
/// more closely for nothing.)
fn spread(is_set: &mut [bool], reach: usize) {
    let before = is_set.to_vec();
    let both = |set: &mut [bool], near: &[bool]| set.iter_mut().zip(near).for_each(|(set, near)| *set |= *near);
    if let Some(later) = before.get(reach..) {
        both(is_set, later);
        both(&mut is_set[reach..], &before);
    }
}

/// Whether something is so near a voxel with this value that a gripper there may be in its way; nothing was observed
/// at 0.
#[inline]
fn is_near(value: f32) -> bool {
    value > 0.0 && 2.0 * value - 1.0 < NEAR
}

/// What was seen of a scene, for many questions about single points.
pub(crate) struct Space<'a> {
    pub(crate) field: &'a VoxelGrid,
    pub(crate) padded: PaddedGrid,
    /// The finer field.
    fine: Option<&'a SurfaceBlocks>,
    /// Points of the surface of things with their normals: all, and those on which a finger can close.
    pub(crate) surfaces: [Vec<(Vec3, Vec3)>; 2],
    /// Of each of the latter how far the thing was found to reach behind it, once a candidate closes there.
    pub(crate) behind_m: Vec<OnceLock<Option<f32>>>,
    /// Of each voxel, whether something may be in the way of a group of looks about it.
    is_around: Vec<bool>,
    /// Voxels in a metre, and along x, y and z.
    per_m: f32,
    sides: Vec3,
}

impl<'a> Space<'a> {
    pub(crate) fn new(field: &'a VoxelGrid, fine: Option<&'a SurfaceBlocks>, [low_m, high_m]: [Vec3; 2]) -> Self {
        let above_m = field.lattice.table_z_m + TABLE_M;
        let mut things_m = fine.map_or_else(|| surface_cloud(field, PITCH_M), |fine| surface_of_blocks(fine, PITCH_M));
        things_m.retain(|at| at.z > above_m && at.cmpge(low_m).all() && at.cmple(high_m).all());
        let normals = fine.map_or_else(|| normals(field, &things_m), |fine| normals(fine, &things_m));
        let has_normal = |(_, normal): &(Vec3, Vec3)| *normal != Vec3::ZERO;
        let all: Vec<(Vec3, Vec3)> = things_m.into_iter().zip(normals).filter(has_normal).collect();
        let sides: Vec<(Vec3, Vec3)> =
            all.iter().copied().filter(|(_, normal)| normal.z.abs() <= CLOSING_RISE_MAX).collect();
        Self {
            field,
            padded: PaddedGrid::from(field),
            fine,
            behind_m: vec![OnceLock::new(); sides.len()],
            surfaces: [all, sides],
            is_around: around(field),
            per_m: 1.0 / field.lattice.voxel_size_m,
            sides: Vec3::from_array(field.lattice.counts.map(|count| count as f32)),
        }
    }

    /// The points of the surfaces that are nearer than `near_m` to one of some places.
    pub(crate) fn near(&self, places_m: &[Vec3], near_m: f32) -> [Vec<usize>; 2] {
        let is_near = |at: Vec3| places_m.iter().any(|place| (at - *place).length_squared() < near_m * near_m);
        let near = |surface: &Vec<(Vec3, Vec3)>| (0..surface.len()).filter(|n| is_near(surface[*n].0)).collect();
        self.surfaces.each_ref().map(near)
    }

    /// The voxel around a point, which is given in voxels.
    #[inline]
    fn voxel(&self, at: Vec3) -> Option<[usize; 3]> {
        // The coordinates are not negative, so rounding to zero is rounding down.
        (at.cmpge(Vec3::ZERO).all() && at.cmplt(self.sides).all()).then(|| at.to_array().map(|at| at as u32 as usize))
    }

    /// Whether something may be in the way about a point, which is given in voxels; of one outside as of the nearest
    /// inside.
    #[inline]
    fn is_around(&self, at: Vec3) -> bool {
        let index = at.clamp(Vec3::ZERO, self.sides - 0.5).to_array().map(|along| along as u32 as usize);
        self.is_around[self.field.lattice.flat(index)]
    }

    /// Whether points of a gripper at a pose are in the way of something.
    pub(crate) fn is_in_the_way(&self, rotation: Quat, tips_m: Vec3, looks: &[Looks]) -> bool {
        let (tips, turn) = ((tips_m - self.field.lattice.low_m) * self.per_m, Mat3::from_quat(rotation) * self.per_m);
        looks.iter().filter(|looks| self.is_around(tips + turn * looks.middle_m)).any(|looks| {
            looks.points_m.iter().any(|point_m| {
                let voxel = self.voxel(tips + turn * *point_m);
                let value = voxel.map_or(0.0, |voxel| self.field.values[self.field.lattice.flat(voxel)]);
                is_near(value) && (2.0 * value - 1.0 <= INSIDE || self.is_inside(tips_m + rotation * *point_m))
            })
        })
    }

    /// Whether a point is in something, as the finer field has it.
    fn is_inside(&self, point_m: Vec3) -> bool {
        self.fine.is_some_and(|fine| {
            let (distance, share) = mean_distance(fine, point_m);
            share > 0.0 && distance * TRUNCATION_VOXELS * fine.lattice().voxel_size_m <= -INSIDE_FINE_M
        })
    }

    /// The way out of a thing from a point in it: to where the field becomes positive, if that was seen within `most_m`
    /// or the step beyond.
    pub(crate) fn way_out_m(&self, point_m: Vec3, along: Vec3, most_m: f32) -> Option<f32> {
        let steps = (most_m / WALK_M).ceil() as usize;
        // The padded grid begins half a voxel before the workspace.
        let (start, step) = ((point_m - self.field.lattice.low_m) * self.per_m + 0.5, along * (WALK_M * self.per_m));
        let field = |number: usize| match self.fine {
            Some(fine) => mean_distance(fine, point_m + along * (WALK_M * number as f32)),
            None => self.padded.at(start + step * number as f32),
        };
        let mut last = field(0).0;
        for number in 1..=steps {
            let (here, share) = field(number);
            // What comes after the first point outside is another thing.
            if here >= 0.0 && share > 0.0 {
                return (last < 0.0).then(|| ((number - 1) as f32 + last / (last - here)) * WALK_M);
            }
            last = here;
        }
        None
    }
}
