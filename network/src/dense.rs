//! The network on a whole volume, for inference.

use std::ops::Range;

use rayon::prelude::*;

use crate::head::{Answer, Head};
use crate::kernels::conv::{Conv, Extent, padded_grids, taps};
use crate::kernels::doubling::Doubling;
use crate::kernels::folded::{FoldedHeads, KERNEL, PHASES};
use crate::kernels::parameters::{HEADS, Parameters, voxel_layout};
use crate::kernels::tile::{self, Forward};
use crate::layers::LAYERS;
use crate::receptive_field::{COARSEST, RESOLUTION};
use crate::upsampling::Upsampling;

/// The network, prepared for inference. It is several times as fast as the same network in Burn and equals it to 1e-5
/// of the largest value (quaternions from four outputs near 0: to 1e-3). Construction takes about as long as one
/// evaluation.
#[derive(Debug, Clone)]
pub struct DenseNetwork {
    head: Head,
    parameters: Parameters,
    convs: [Conv; HEADS],
    doublings: [Doubling; 2],
    heads: FoldedHeads,
    /// Offsets of the runs of the heads' kernel (x, y) from a cell's inputs.
    head_taps: Vec<usize>,
    groups: Vec<Group>,
}

/// The network's output at every voxel of a grid, x slowest.
#[derive(Debug, Clone, PartialEq)]
pub struct DenseGrids {
    /// Logit of the grasp quality, `[40, 40, 40]`; the quality is its sigmoid.
    pub quality_logit: Vec<f32>,
    /// Unit quaternion xyzw, `[4, 40, 40, 40]`.
    pub rotation: Vec<f32>,
    /// Opening width in voxels, `[40, 40, 40]`.
    pub width_voxels: Vec<f32>,
    /// The point between the tips as seen from the centre of the voxel, in voxels, `[3, 40, 40, 40]`; empty where the
    /// head does not say it.
    pub tips_voxels: Vec<f32>,
}

/// Coarse cells of a plane that share their weights.
#[derive(Debug, Clone)]
struct Group {
    /// Classes of y and z.
    classes: [usize; 2],
    /// The start of their inputs in the plane's inputs, and their numbers in the plane.
    rows: Vec<usize>,
    cells: Vec<usize>,
}

/// The level at which the heads are evaluated.
const LAST: Extent = Extent::cube(LAST_SIDE, LAYERS[HEADS].padding());
const LAST_SIDE: usize = RESOLUTION / 2;

impl DenseNetwork {
    /// `vector` as [`crate::layers::slots_of`] lays out the layers of a head.
    ///
    /// # Panics
    /// If it has another length.
    #[must_use]
    pub fn new(vector: &[f32], mode: Upsampling, head: Head) -> Self {
        let conv = |number: usize, n: usize, output_padding: usize| {
            Conv::new(LAYERS[number], Extent::cube(n, LAYERS[number].padding()), output_padding)
        };
        let [n5, n10, n20] = [COARSEST, 2 * COARSEST, 4 * COARSEST];
        let parameters = Parameters::from_vector(voxel_layout(head), vector);
        let (weights, bias) = parameters.stage(HEADS);
        Self {
            head,
            heads: FoldedHeads::new(weights, bias, head.outputs(), LAST_SIDE, mode),
            convs: [conv(0, RESOLUTION, 1), conv(1, n20, 1), conv(2, n10, 1), conv(3, n5, 0), conv(4, n10, 0), {
                conv(5, n20, LAST.padding)
            }],
            doublings: [(n5, 4), (n10, 5)].map(|(n, next)| Doubling::of_volume(n, LAYERS[next].padding(), mode)),
            head_taps: taps(KERNEL, LAST, LAYERS[HEADS].channels_in),
            groups: groups(),
            parameters,
        }
    }

    /// One grid of 40³ values (TSDF in VGN's values), x slowest.
    ///
    /// # Panics
    /// If it has another number of values.
    #[must_use]
    pub fn infer(&self, grid: &[f32]) -> DenseGrids {
        assert_eq!(grid.len(), RESOLUTION.pow(3), "one value a voxel");
        let conv = |number: usize, input: &[f32]| {
            let (weights, bias) = self.parameters.stage(number);
            self.convs[number].forward_by_planes(weights, bias, input)
        };
        let x = conv(0, &padded_grids(&[grid]));
        let x = conv(3, &conv(2, &conv(1, &x)));
        let x = conv(4, &self.doublings[0].double(LAYERS[3].channels_out, &x));
        let mut x = conv(5, &self.doublings[1].double(LAYERS[4].channels_out, &x));
        hold_border(&mut x, LAST, LAYERS[HEADS].channels_in);
        let answers_of = |plane| self.answers_of_plane(&self.heads_of_plane(&x, plane));
        let planes: Vec<Vec<Answer>> = (0..LAST_SIDE).into_par_iter().map(answers_of).collect();
        assembled(self.head, &planes.concat())
    }

    /// The heads of the coarse cells with x = `plane`: `[y, z, columns]`.
    fn heads_of_plane(&self, inputs: &[f32], plane: usize) -> Vec<f32> {
        let columns = self.heads.bias().len();
        let (channels, taps) = (LAYERS[HEADS].channels_in, &self.head_taps[..]);
        let run = KERNEL * channels;
        let inputs = &inputs[plane * LAST.whole()[1].pow(2) * channels..];
        let mut outputs = vec![0.0; LAST_SIDE.pow(2) * columns];
        for Group { classes: [y, z], rows, cells } in &self.groups {
            let places = &cells.iter().map(|cell| cell * columns).collect::<Vec<_>>()[..];
            let weights = self.heads.weights([FoldedHeads::class(plane, LAST_SIDE), *y, *z]);
            let (start, outputs) = (self.heads.bias(), &mut outputs[..]);
            tile::run(Forward { inputs, rows, taps, run, weights, start, relu: false, places, outputs });
        }
        outputs
    }

    /// The answers of the voxels of the coarse cells with one x, `[2, 40, 40]`, from their columns.
    fn answers_of_plane(&self, columns: &[f32]) -> Vec<Answer> {
        let (outputs, columns_of_cell) = (self.head.outputs(), self.heads.bias().len());
        let voxel = |at: usize| {
            let [x, y, z] = [at / RESOLUTION.pow(2), at / RESOLUTION % RESOLUTION, at % RESOLUTION];
            let (cell, phase) = (y / 2 * LAST_SIDE + z / 2, 4 * x + 2 * (y % 2) + z % 2);
            self.head.answer(&columns[cell * columns_of_cell + phase * outputs..][..outputs])
        };
        (0..PHASES * LAST_SIDE.pow(2)).map(voxel).collect()
    }
}

/// Writes the outermost values of a cube to the first positions outside, where linear upsampling repeats the last
/// position. Then only cells at the faces, with some fine neighbours outside the volume, differ from inner ones.
fn hold_border(cube: &mut [f32], side: Extent, channels: usize) {
    let (whole, [low, high]) = (side.whole()[0], [side.padding, side.padding + side.n[0] - 1]);
    for axis in 0..3 {
        let step = whole.pow(2 - axis) * channels; // from one position of the axis to the next
        for outer in cube.chunks_exact_mut(step * whole) {
            outer.copy_within(low * step..(low + 1) * step, (low - 1) * step);
            outer.copy_within(high * step..(high + 1) * step, (high + 1) * step);
        }
    }
}

/// The cells of a plane by the classes of their y and z.
fn groups() -> Vec<Group> {
    let (n, channels) = (LAST_SIDE, LAYERS[HEADS].channels_in);
    let ranges: [Range<usize>; 3] = [0..1, 1..n - 1, n - 1..n];
    let pairs = ranges.iter().flat_map(|ys| ranges.iter().map(move |zs| (ys, zs)));
    let group = |(ys, zs): (&Range<usize>, &Range<usize>)| {
        let cells: Vec<(usize, usize)> = ys.clone().flat_map(|y| zs.clone().map(move |z| (y, z))).collect();
        Group {
            classes: [FoldedHeads::class(ys.start, n), FoldedHeads::class(zs.start, n)],
            rows: cells.iter().map(|(y, z)| (y * LAST.whole()[2] + z) * channels).collect(),
            cells: cells.iter().map(|(y, z)| y * n + z).collect(),
        }
    };
    pairs.map(group).collect()
}

/// From voxels, x slowest, to volumes.
fn assembled(head: Head, answers: &[Answer]) -> DenseGrids {
    let parts = |count: usize, part: &dyn Fn(&Answer, usize) -> f32| -> Vec<f32> {
        (0..count).flat_map(|number| answers.iter().map(move |answer| part(answer, number))).collect()
    };
    let tips = if head == Head::Closings { 3 } else { 0 };
    DenseGrids {
        quality_logit: parts(1, &|answer, _| answer.quality_logit),
        rotation: parts(4, &|answer, axis| answer.rotation[axis]),
        width_voxels: parts(1, &|answer, _| answer.width_voxels),
        tips_voxels: parts(tips, &|answer, axis| answer.tips_voxels.map_or(0.0, |tips| tips[axis])),
    }
}
