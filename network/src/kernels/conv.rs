//! A convolution over boxes of positions, as the places in memory that its three products need.
//!
//! A box of `n` positions along an axis holds the channels of each position, x slowest, channels fastest, in
//! `n + 2 · padding` positions of which the outer ones are zero. Those zeros are the convolution's padding; gradients
//! that come to lie there are never looked at.

use rayon::prelude::*;

use super::tile::{self, Backward, Forward, LANES, Weights};
use crate::layers::{LAYERS, LayerShape};
use crate::receptive_field::RESOLUTION;

/// Sides and padding of a box in memory.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Extent {
    /// Positions along x, y and z that hold values.
    pub n: [usize; 3],
    /// Zeros before and after them.
    pub padding: usize,
}

impl Extent {
    /// A cube of side `n`.
    pub(crate) const fn cube(n: usize, padding: usize) -> Self {
        Self { n: [n; 3], padding }
    }

    /// Positions along each side in memory.
    pub(crate) const fn whole(self) -> [usize; 3] {
        let ([x, y, z], padding) = (self.n, 2 * self.padding);
        [x + padding, y + padding, z + padding]
    }

    /// Positions in memory.
    pub(crate) const fn len(self) -> usize {
        let [x, y, z] = self.whole();
        x * y * z
    }

    /// Where position (x, y, z) of the values lies, in positions.
    pub(crate) const fn place(self, [x, y, z]: [usize; 3]) -> usize {
        let ([_, whole_y, whole_z], padding) = (self.whole(), self.padding);
        ((x + padding) * whole_y + y + padding) * whole_z + z + padding
    }

    /// The positions that hold values, x slowest.
    pub(crate) fn positions(self) -> impl Iterator<Item = [usize; 3]> {
        let [x, y, z] = self.n;
        (0..x * y * z).map(move |at| [at / (y * z), at / z % y, at % z])
    }
}

/// One layer's convolution, from a box to a box.
#[derive(Debug, Clone)]
pub(crate) struct Conv {
    /// Values of an input box, and of an output box.
    inputs_len: usize,
    outputs_len: usize,
    /// Columns of the products: channels out, padded to a multiple of [`LANES`].
    columns: usize,
    /// For each output position, where its inputs begin and where its columns go.
    rows: Vec<usize>,
    places: Vec<usize>,
    /// Where the runs of kernel (x, y) lie from a row's beginning, and how long they are.
    taps: Vec<usize>,
    run: usize,
    plane: Plane,
}

/// The outputs of one x: how many they are, and how far those of the next x read and write.
#[derive(Debug, Clone, Copy)]
struct Plane {
    rows: usize,
    row_step: usize,
    place_step: usize,
}

/// Rows that are multiplied with all weights before the next ones, so that what they read and write stays in a fast
/// cache: with all 1,000 of the second convolution its three products take half as long again. A constant, because sums
/// over rows are made in this order.
const ROWS_AT_ONCE: usize = 96;

impl Conv {
    /// The convolution of a layer whose input, padding and all, is `input`. It has an output wherever the kernel fits;
    /// `output_padding` zeros are left around them.
    pub(crate) fn new(layer: LayerShape, input: Extent, output_padding: usize) -> Self {
        let (channels, [_, side_y, side_z]) = (layer.channels_in, input.whole());
        let output = output_of(layer, input, output_padding);
        let columns = layer.channels_out.next_multiple_of(LANES);
        let positions: Vec<[usize; 3]> = output.positions().collect();
        let row = |[x, y, z]: &[usize; 3]| ((x * side_y + y) * side_z + z) * layer.stride * channels;
        Self {
            inputs_len: input.len() * channels,
            outputs_len: output.len() * columns,
            columns,
            rows: positions.iter().map(row).collect(),
            places: positions.iter().map(|position| output.place(*position) * columns).collect(),
            taps: taps(layer.kernel, input, channels),
            run: layer.kernel * channels,
            plane: Plane {
                rows: output.n[1] * output.n[2],
                row_step: side_y * side_z * layer.stride * channels,
                place_step: output.whole()[1] * output.whole()[2] * columns,
            },
        }
    }

    /// A product of `count` rows that lie one after the other, as they are.
    pub(crate) fn of_rows(count: usize, run: usize, columns: usize) -> Self {
        Self {
            inputs_len: count * run,
            outputs_len: count * columns,
            columns,
            rows: (0..count).map(|row| row * run).collect(),
            places: (0..count).map(|row| row * columns).collect(),
            taps: vec![0],
            run,
            plane: Plane { rows: 1, row_step: run, place_step: columns },
        }
    }

    /// Output boxes, one for each input box. `weights` are `[taps, run, columns]`, `bias` is `[columns]`.
    pub(crate) fn forward(&self, weights: &[f32], bias: &[f32], relu: bool, inputs: &[f32]) -> Vec<f32> {
        let mut outputs = vec![0.0; inputs.len() / self.inputs_len * self.outputs_len];
        for (inputs, outputs) in inputs.chunks_exact(self.inputs_len).zip(outputs.chunks_exact_mut(self.outputs_len)) {
            let (taps, run) = (&self.taps, self.run);
            for (rows, places) in self.rows.chunks(ROWS_AT_ONCE).zip(self.places.chunks(ROWS_AT_ONCE)) {
                tile::run(Forward { inputs, rows, taps, run, weights, start: bias, relu, places, outputs });
            }
        }
        outputs
    }

    /// As [`Self::forward`] with ReLU, for one box and on all threads: each does whole planes of outputs.
    pub(crate) fn forward_by_planes(&self, weights: &[f32], bias: &[f32], input: &[f32]) -> Vec<f32> {
        let mut output = vec![0.0; self.outputs_len];
        let Plane { rows, row_step, place_step } = self.plane;
        // What a plane reads and writes lies as in the first one, but for an offset.
        let first = self.places[0] / place_step * place_step;
        let places: Vec<usize> = self.places[..rows].iter().map(|place| place - first).collect();
        let planes = output[first..].par_chunks_exact_mut(place_step).take(self.rows.len() / rows);
        planes.enumerate().for_each(|(x, outputs)| {
            let (inputs, taps, run) = (&input[x * row_step..], &self.taps, self.run);
            let (rows, places) = (&self.rows[..rows], &places);
            tile::run(Forward { inputs, rows, taps, run, weights, start: bias, relu: true, places, outputs });
        });
        output
    }

    /// From gradients as output boxes hold them to `[rows, columns]`; 0 where ReLU cut the output off.
    pub(crate) fn through_relu(&self, outputs: &[f32], d_outputs: &[f32]) -> Vec<f32> {
        let mut gradients = Vec::with_capacity(outputs.len() / self.outputs_len * self.rows.len() * self.columns);
        for (outputs, d_outputs) in outputs.chunks_exact(self.outputs_len).zip(d_outputs.chunks_exact(self.outputs_len))
        {
            for place in &self.places {
                let (output, gradient) = (&outputs[*place..][..self.columns], &d_outputs[*place..][..self.columns]);
                gradients.extend(output.iter().zip(gradient).map(|(o, d)| if *o > 0.0 { *d } else { 0.0 }));
            }
        }
        gradients
    }

    /// Adds the gradients of weights, `[taps, run, columns]`, and bias; `gradients` are `[boxes · rows, columns]`.
    pub(crate) fn add_parameters(&self, inputs: &[f32], gradients: &[f32], d_weights: &mut [f32], d_bias: &mut [f32]) {
        for row in gradients.chunks_exact(self.columns) {
            for (sum, gradient) in d_bias.iter_mut().zip(row) {
                *sum += gradient;
            }
        }
        let of_boxes = gradients.chunks_exact(self.rows.len() * self.columns);
        for (inputs, gradients) in inputs.chunks_exact(self.inputs_len).zip(of_boxes) {
            for (rows, gradients) in self.with_gradients(gradients) {
                tile::run(Weights { inputs, rows, taps: &self.taps, run: self.run, gradients, d_weights });
            }
        }
    }

    /// The gradient of the input boxes; `weights` are `[taps, columns, run]`. A run must fill whole vectors, which
    /// those of the first layer, whose inputs' gradient nobody wants, do not.
    pub(crate) fn d_inputs(&self, weights: &[f32], gradients: &[f32]) -> Vec<f32> {
        debug_assert!(self.run.is_multiple_of(LANES), "a run of {}", self.run);
        let boxes = gradients.len() / (self.rows.len() * self.columns);
        let mut d_inputs = vec![0.0; boxes * self.inputs_len];
        let of_boxes = gradients.chunks_exact(self.rows.len() * self.columns);
        for (d_inputs, gradients) in d_inputs.chunks_exact_mut(self.inputs_len).zip(of_boxes) {
            for (rows, gradients) in self.with_gradients(gradients) {
                tile::run(Backward { gradients, rows, taps: &self.taps, run: self.run, weights, d_inputs });
            }
        }
        d_inputs
    }

    /// The rows of a box in parts, with their gradients.
    fn with_gradients<'a>(&'a self, gradients: &'a [f32]) -> impl Iterator<Item = (&'a [usize], &'a [f32])> {
        self.rows.chunks(ROWS_AT_ONCE).zip(gradients.chunks(ROWS_AT_ONCE * self.columns))
    }

    /// The same at some of the output positions only, given by their numbers; the other outputs are 0.
    pub(crate) fn at(&self, positions: &[usize]) -> Self {
        let of = |all: &[usize]| positions.iter().map(|position| all[*position]).collect();
        Self { rows: of(&self.rows), places: of(&self.places), taps: self.taps.clone(), ..*self }
    }
}

/// The box of a layer's outputs: there is one wherever the kernel fits.
pub(crate) fn output_of(layer: LayerShape, input: Extent, padding: usize) -> Extent {
    Extent { n: input.whole().map(|whole| (whole - layer.kernel) / layer.stride + 1), padding }
}

/// How far the run of each tap (kernel x, y) lies from the first one's, in values.
pub(crate) fn taps(kernel: usize, input: Extent, channels: usize) -> Vec<usize> {
    let [_, side_y, side_z] = input.whole();
    (0..kernel.pow(2)).map(|tap| (tap / kernel * side_y + tap % kernel) * side_z * channels).collect()
}

/// Rows of `count` values in the layout of a product's columns, in which a row has a multiple of [`LANES`].
pub(crate) fn to_lanes(rows: &[f32], count: usize) -> Vec<f32> {
    let columns = count.next_multiple_of(LANES);
    let mut lanes = vec![0.0; rows.len() / count * columns];
    for (lanes, row) in lanes.chunks_exact_mut(columns).zip(rows.chunks_exact(count)) {
        lanes[..count].copy_from_slice(row);
    }
    lanes
}

/// The rows of `count` values in a product's columns.
pub(crate) fn from_lanes(lanes: &[f32], count: usize) -> impl Iterator<Item = &[f32]> {
    lanes.chunks_exact(count.next_multiple_of(LANES)).map(move |row| &row[..count])
}

/// Grids with the zeros that the first convolution pads with.
pub(crate) fn padded_grids(grids: &[&[f32]]) -> Vec<f32> {
    let side = Extent::cube(RESOLUTION, LAYERS[0].padding());
    let len = side.len();
    let mut padded = vec![0.0; grids.len() * len];
    for (grid, padded) in grids.iter().zip(padded.chunks_exact_mut(len)) {
        for (line, values) in grid.chunks_exact(RESOLUTION).enumerate() {
            let place = side.place([line / RESOLUTION, line % RESOLUTION, 0]);
            padded[place..][..RESOLUTION].copy_from_slice(values);
        }
    }
    padded
}

#[cfg(test)]
mod tests {
    use schema::{Purpose, Stream};

    use super::*;

    struct Case {
        layer: LayerShape,
        input: Extent,
        output_padding: usize,
    }

    fn cases() -> impl Iterator<Item = Case> {
        let case = |[channels_in, channels_out, kernel, stride]: [usize; 4],
                    n: [usize; 3],
                    [padding, output_padding]: [usize; 2]| {
            let layer = LayerShape { name: "", channels_in, channels_out, kernel, stride };
            Case { layer, input: Extent { n, padding }, output_padding }
        };
        [
            case([1, 16, 5, 2], [8; 3], [2, 1]),
            case([16, 32, 3, 2], [6; 3], [1, 0]),
            case([32, 64, 3, 1], [4; 3], [1, 2]),
            case([16, 48, 3, 1], [5; 3], [0, 0]),
            case([32, 16, 5, 1], [7; 3], [0, 0]),
            case([64, 80, 3, 1], [3; 3], [0, 1]),
            case([4, 16, 3, 2], [4, 6, 8], [1, 1]),
            case([16, 32, 3, 1], [2, 5, 3], [1, 0]),
            case([32, 16, 1, 1], [2, 3, 5], [0, 0]),
        ]
        .into_iter()
    }

    /// Every product of an input, a weight and an output's gradient, from the definition of a convolution: calls
    /// `visit` with the three places.
    fn for_products(case: &Case, mut visit: impl FnMut(usize, usize, usize)) {
        let Case { layer, input, output_padding } = case;
        let ([_, side_y, side_z], channels) = (input.whole(), layer.channels_in);
        let output = output_of(*layer, *input, *output_padding);
        for at in output.positions() {
            for (tap, place) in crate::layers::positions(layer.kernel).enumerate() {
                let [x, y, z] = [0, 1, 2].map(|axis| at[axis] * layer.stride + place[axis]);
                for channel in 0..channels {
                    let from = ((x * side_y + y) * side_z + z) * channels + channel;
                    for column in 0..layer.channels_out {
                        let weight = (tap * channels + channel) * layer.channels_out + column;
                        visit(from, weight, output.place(at) * layer.channels_out + column);
                    }
                }
            }
        }
    }

    fn assert_close(ours: &[f32], slow: &[f64], what: &str) {
        assert_eq!(ours.len(), slow.len());
        for (at, (ours, slow)) in ours.iter().zip(slow).enumerate() {
            assert!((f64::from(*ours) - slow).abs() < 1e-4, "{what} {at}: {ours} against {slow}");
        }
    }

    #[test]
    fn the_three_products_are_those_of_a_convolution() {
        let mut stream = Stream::new(6, 0, Purpose::Views, 0);
        for case in cases() {
            let conv = Conv::new(case.layer, case.input, case.output_padding);
            let mut draw = |count: usize| -> Vec<f32> { (0..count).map(|_| stream.uniform(-0.5, 0.5)).collect() };
            let inputs = draw(2 * conv.inputs_len);
            let (weights, bias) = (draw(case.layer.weight_count()), draw(case.layer.channels_out));
            let outputs = conv.forward(&weights, &bias, true, &inputs);
            assert_eq!(
                conv.forward_by_planes(&weights, &bias, &inputs[..conv.inputs_len]),
                outputs[..conv.outputs_len]
            );
            let d_outputs = draw(outputs.len());
            let gradients = conv.through_relu(&outputs, &d_outputs);
            let transposed: Vec<f32> = (0..weights.len())
                .map(|at| {
                    let (run, columns) = (conv.run, conv.columns);
                    let (tap, column, place) = (at / (run * columns), at / run % columns, at % run);
                    weights[(tap * run + place) * columns + column]
                })
                .collect();
            let (mut d_weights, mut d_bias) = (vec![0.0; weights.len()], vec![0.0; bias.len()]);
            conv.add_parameters(&inputs, &gradients, &mut d_weights, &mut d_bias);

            let mut slow_outputs = vec![0.0; outputs.len()];
            for number in 0..2 {
                for place in &conv.places {
                    let sums = &mut slow_outputs[number * conv.outputs_len + place..][..conv.columns];
                    sums.iter_mut().zip(&bias).for_each(|(sum, bias)| *sum = f64::from(*bias));
                }
                for_products(&case, |from, weight, to| {
                    let input = inputs[number * conv.inputs_len + from];
                    slow_outputs[number * conv.outputs_len + to] += f64::from(input) * f64::from(weights[weight]);
                });
            }
            let masked: Vec<f64> =
                slow_outputs.iter().zip(&d_outputs).map(|(o, d)| if *o > 0.0 { f64::from(*d) } else { 0.0 }).collect();
            slow_outputs.iter_mut().for_each(|output| *output = output.max(0.0));
            assert_close(&outputs, &slow_outputs, "output");
            let (mut slow_weights, mut slow_inputs) = (vec![0.0; weights.len()], vec![0.0; inputs.len()]);
            for number in 0..2 {
                for_products(&case, |from, weight, to| {
                    let gradient = masked[number * conv.outputs_len + to];
                    slow_weights[weight] += gradient * f64::from(inputs[number * conv.inputs_len + from]);
                    slow_inputs[number * conv.inputs_len + from] += gradient * f64::from(weights[weight]);
                });
            }
            let slow_bias: Vec<f64> =
                (0..bias.len()).map(|column| masked.iter().skip(column).step_by(conv.columns).sum()).collect();
            assert_close(&d_weights, &slow_weights, "weight");
            assert_close(&d_bias, &slow_bias, "bias");
            if conv.run.is_multiple_of(LANES) {
                assert_close(&conv.d_inputs(&transposed, &gradients), &slow_inputs, "input");
            }
        }
    }
}
