//! A TSDF only where surfaces were seen: memory and time follow what is there, not the size of the workspace.

use schema::{Lattice, Vec3, VoxelGrid};

/// Cells along a side of a block.
pub(crate) const CELLS: usize = 8;
/// Voxels along it: neighbouring blocks share a face, so that each cell has its corners in one block.
pub(crate) const VOXELS: usize = CELLS + 1;
/// Values of a block.
pub(crate) const VALUES: usize = VOXELS.pow(3);
/// The place of a block without values.
const NONE: u32 = u32::MAX;
/// Of a point whose surroundings were observed to less than this share nothing is known.
const SHARE_MIN: f32 = 1e-3;

/// A TSDF whose cells, each between eight voxels, can be asked for.
pub trait Field: Sync {
    /// Where the voxels are.
    fn lattice(&self) -> &Lattice;

    /// VGN's values at the corners of a cell, by its lowest voxel, x slowest; 0 where nothing was observed.
    fn cell(&self, voxel: [usize; 3]) -> [f32; 8];
}

impl Field for VoxelGrid {
    fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    fn cell(&self, voxel: [usize; 3]) -> [f32; 8] {
        corners(&self.values, self.lattice.counts, voxel)
    }
}

/// The corner values of a cell, x slowest.
#[inline]
pub(crate) fn corners(values: &[f32], [_, ny, nz]: [usize; 3], [i, j, k]: [usize; 3]) -> [f32; 8] {
    let first = (i * ny + j) * nz + k;
    let mut corners = [0.0; 8];
    let rows = [first, first + nz, first + ny * nz, first + ny * nz + nz];
    for (pair, row) in corners.as_chunks_mut::<2>().0.iter_mut().zip(rows) {
        *pair = [values[row], values[row + 1]];
    }
    corners
}

/// A point of the workspace in voxels from the centre of a lattice's first one.
#[inline]
pub(crate) fn in_voxels(lattice: &Lattice, point_m: Vec3) -> Vec3 {
    (point_m - lattice.low_m) / lattice.voxel_size_m - Vec3::splat(0.5)
}

/// The cell around a point, which is given in voxels: its corners' values, and the point's shares of the way along x, y
/// and z; `None` outside.
#[inline(always)]
fn cell_at<F: Field>(field: &F, at: Vec3) -> Option<([f32; 8], [f32; 3])> {
    // False for NaN.
    if !at.cmpge(Vec3::ZERO).all() {
        return None;
    }
    // Of numbers that are not negative rounding to zero is rounding down.
    let voxel = at.to_array().map(|along| along as u32 as usize);
    let is_inside = (0..3).all(|axis| voxel[axis] + 1 < field.lattice().counts[axis]);
    is_inside.then(|| (field.cell(voxel), [0, 1, 2].map(|axis| at[axis] - voxel[axis] as f32)))
}

/// The weight of a corner along an axis, whose bit in the corner's number this is.
#[inline(always)]
fn along(corner: usize, bit: usize, share: f32) -> f32 {
    if corner >> bit & 1 == 1 { share } else { 1.0 - share }
}

/// The trilinear value at a point, which is given in voxels; `None` if one of the eight around it was not observed.
pub(crate) fn trilinear<F: Field>(field: &F, at: Vec3) -> Option<f32> {
    let (corners, [x, y, z]) = cell_at(field, at)?;
    let term = |(number, value): (usize, f32)| {
        (value > 0.0).then_some(value * along(number, 2, x) * along(number, 1, y) * along(number, 0, z))
    };
    corners.into_iter().enumerate().map(term).sum()
}

/// Mean of the observed distances at the eight voxels around a point of the workspace, by their weights, in [−1, 1] of
/// the truncation, and the share of the eight that was observed; 0 and 0 where none was.
#[must_use]
pub fn mean_distance<F: Field>(field: &F, point_m: Vec3) -> (f32, f32) {
    let Some((corners, [x, y, z])) = cell_at(field, in_voxels(field.lattice(), point_m)) else { return (0.0, 0.0) };
    // As inside of things.
    if corners == [0.0; 8] {
        return (0.0, 0.0);
    }
    let (mut share, mut sum) = (0.0, 0.0);
    for (number, value) in corners.into_iter().enumerate() {
        let weight = along(number, 2, x) * along(number, 1, y) * along(number, 0, z);
        share += if value > 0.0 { weight } else { 0.0 };
        sum += value * weight;
    }
    if share > SHARE_MIN { (2.0 * sum / share - 1.0, share) } else { (0.0, 0.0) }
}

/// A TSDF in blocks of 8³ cells, of which only those near something seen have values.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceBlocks {
    lattice: Lattice,
    /// Blocks along x, y and z.
    counts: [usize; 3],
    /// Of each block its place among those with values.
    places: Vec<u32>,
    /// The blocks with values, in order.
    numbers: Vec<usize>,
    values: Vec<f32>,
}

impl SurfaceBlocks {
    /// Blocks over a lattice; those for which `is_needed` is true have values, all 0.
    pub(crate) fn new(lattice: Lattice, is_needed: &[bool]) -> Self {
        let counts = block_counts(&lattice);
        let numbers: Vec<usize> = (0..is_needed.len()).filter(|number| is_needed[*number]).collect();
        let mut places = vec![NONE; is_needed.len()];
        for (place, number) in (0..).zip(&numbers) {
            places[*number] = place;
        }
        Self { lattice, counts, places, values: vec![0.0; numbers.len() * VALUES], numbers }
    }

    /// Each block with values: its own lattice, and the values.
    pub(crate) fn parts(&self) -> impl Iterator<Item = (Lattice, &[f32])> {
        self.numbers.iter().map(|number| self.lattice_of(*number)).zip(self.values.chunks_exact(VALUES))
    }

    /// The lattices of the blocks with values, in order, and all of their values.
    pub(crate) fn parts_mut(&mut self) -> (Vec<Lattice>, &mut [f32]) {
        (self.numbers.iter().map(|number| self.lattice_of(*number)).collect(), &mut self.values)
    }

    /// Whether the block around a point of the workspace has values.
    #[must_use]
    pub fn has(&self, point_m: Vec3) -> bool {
        let at = in_voxels(&self.lattice, point_m) / CELLS as f32;
        let last = Vec3::from_array(self.counts.map(|count| count as f32));
        let is_inside = at.cmpge(Vec3::ZERO).all() && at.cmplt(last).all();
        let [x, y, z] = at.to_array().map(|along| along as usize);
        is_inside && self.places[(x * self.counts[1] + y) * self.counts[2] + z] != NONE
    }

    fn lattice_of(&self, number: usize) -> Lattice {
        let [_, y, z] = self.counts;
        let first = [number / (y * z), number / z % y, number % z].map(|block| (CELLS * block) as f32);
        let low_m = self.lattice.low_m + Vec3::from_array(first) * self.lattice.voxel_size_m;
        Lattice { low_m, counts: [VOXELS; 3], ..self.lattice }
    }
}

/// Blocks along x, y and z of a lattice.
pub(crate) fn block_counts(lattice: &Lattice) -> [usize; 3] {
    lattice.counts.map(|count| count.saturating_sub(1).div_ceil(CELLS))
}

impl From<&VoxelGrid> for SurfaceBlocks {
    fn from(field: &VoxelGrid) -> Self {
        let mut blocks = Self::new(field.lattice, &vec![true; block_counts(&field.lattice).iter().product()]);
        let (lattices, values) = blocks.parts_mut();
        for (lattice, values) in lattices.iter().zip(values.chunks_exact_mut(VALUES)) {
            for (flat, value) in values.iter_mut().enumerate() {
                let at = field.lattice.voxel_at(lattice.centre_m(lattice.voxel(flat)));
                *value = at.map_or(0.0, |at| field.values[field.lattice.flat(at)]);
            }
        }
        blocks
    }
}

impl Field for SurfaceBlocks {
    fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    #[inline]
    fn cell(&self, voxel: [usize; 3]) -> [f32; 8] {
        let [x, y, z] = voxel.map(|at| at / CELLS);
        let place = self.places[(x * self.counts[1] + y) * self.counts[2] + z];
        if place == NONE {
            return [0.0; 8];
        }
        let values = &self.values[place as usize * VALUES..][..VALUES];
        corners(values, [VOXELS; 3], voxel.map(|at| at % CELLS))
    }
}
