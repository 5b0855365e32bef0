//! A network's parameters in the order in which products read them.
//!
//! Layers that see the same inputs are one stage, such as the three heads of the paper's network: sixteen columns, of
//! which six are used. A stage's weights are `[taps, run, columns]` (tap: kernel x and y; run: kernel z and channels
//! in), then come its biases, `[columns]`.

use std::ops::Range;
use std::sync::LazyLock;

use rayon::prelude::*;

use super::tile::LANES;
use crate::head::Head;
use crate::layers::{LayerShape, count_of};

/// Number of stages of the paper's network.
pub(crate) const STAGES: usize = 7;
/// The stage of its heads.
pub(crate) const HEADS: usize = STAGES - 1;

/// The layout of a network of voxels.
pub(crate) fn voxel_layout(head: Head) -> &'static Layout {
    static LAYOUTS: [LazyLock<Layout>; 2] = [
        LazyLock::new(|| Layout::new(Head::Quaternion.layers(), HEADS)),
        LazyLock::new(|| Layout::new(Head::Closings.layers(), HEADS)),
    ];
    &LAYOUTS[head as usize]
}

/// Where a stage's parameters lie among all.
#[derive(Debug, Clone)]
struct Stage {
    weights: Range<usize>,
    bias: Range<usize>,
    /// Values of a run, all taps together: the rows of the weights as a matrix.
    fan_in: usize,
    /// Values of one run.
    run: usize,
    columns: usize,
}

/// Where the parameters of a network's layers lie.
#[derive(Debug)]
pub(crate) struct Layout {
    stages: Vec<Stage>,
    /// For each parameter of the flat vector, where it lies here.
    places: Vec<u32>,
}

impl Layout {
    /// Layers, of which those from number `last` on are the columns of one stage, the last one.
    pub(crate) fn new(layers: &[LayerShape], last: usize) -> Self {
        let mut start = 0;
        let stage = |(number, layer): (usize, &LayerShape)| {
            let together = if number == last { &layers[last..] } else { core::slice::from_ref(layer) };
            let columns = together.iter().map(|layer| layer.channels_out).sum::<usize>().next_multiple_of(LANES);
            let weights = start..start + layer.fan_in() * columns;
            let bias = weights.end..weights.end + columns;
            start = bias.end;
            let run = if number == last { layer.fan_in() } else { layer.kernel * layer.channels_in };
            Stage { weights, bias, fan_in: layer.fan_in(), run, columns }
        };
        let stages: Vec<Stage> = layers[..=last].iter().enumerate().map(stage).collect();
        let (mut places, mut column_of_last) = (Vec::with_capacity(count_of(layers)), 0);
        for (number, layer) in layers.iter().enumerate() {
            let stage = &stages[number.min(last)];
            let first_column = if number < last { 0 } else { column_of_last };
            let taps = layer.kernel.pow(3);
            // In the vector: out, in, kernel x, y, z.
            for column in 0..layer.channels_out {
                for channel in 0..layer.channels_in {
                    places.extend((0..taps).map(|tap| {
                        let row = tap * layer.channels_in + channel;
                        (stage.weights.start + row * stage.columns + first_column + column) as u32
                    }));
                }
            }
            places.extend((0..layer.channels_out).map(|column| (stage.bias.start + first_column + column) as u32));
            column_of_last += if number < last { 0 } else { layer.channels_out };
        }
        Self { stages, places }
    }

    fn len(&self) -> usize {
        self.stages.last().map_or(0, |stage| stage.bias.end)
    }
}

/// All parameters, or their gradients, stage by stage.
#[derive(Debug, Clone)]
pub(crate) struct Parameters {
    layout: &'static Layout,
    values: Vec<f32>,
}

impl Parameters {
    /// Zeros.
    pub(crate) fn zeros(layout: &'static Layout) -> Self {
        Self { layout, values: vec![0.0; layout.len()] }
    }

    /// From the flat vector ([`crate::layers::slots_of`]).
    pub(crate) fn from_vector(layout: &'static Layout, vector: &[f32]) -> Self {
        assert_eq!(vector.len(), layout.places.len(), "one value a parameter");
        let mut all = Self::zeros(layout);
        for (value, place) in vector.iter().zip(&layout.places) {
            all.values[*place as usize] = *value;
        }
        all
    }

    /// Back to the flat vector.
    pub(crate) fn to_vector(&self) -> Vec<f32> {
        self.layout.places.iter().map(|place| self.values[*place as usize]).collect()
    }

    /// A stage's weights and biases.
    pub(crate) fn stage(&self, number: usize) -> (&[f32], &[f32]) {
        let stage = &self.layout.stages[number];
        (&self.values[stage.weights.clone()], &self.values[stage.bias.clone()])
    }

    /// A stage's weights and biases.
    pub(crate) fn stage_mut(&mut self, number: usize) -> (&mut [f32], &mut [f32]) {
        let stage = &self.layout.stages[number];
        let (weights, bias) = self.values[stage.weights.start..stage.bias.end].split_at_mut(stage.weights.len());
        (weights, bias)
    }

    /// The weights of every stage but the first, which needs none, as [`Self::transposed`] gives them.
    pub(crate) fn all_transposed(&self) -> Vec<Vec<f32>> {
        let stages = (0..self.layout.stages.len()).into_par_iter();
        stages.map(|stage| if stage == 0 { Vec::new() } else { self.transposed(stage) }).collect()
    }

    /// A stage's weights as `[taps, columns, run]`, for the gradient of a stage's inputs.
    fn transposed(&self, number: usize) -> Vec<f32> {
        let Stage { fan_in, run, columns, .. } = self.layout.stages[number];
        let mut transposed = vec![0.0; fan_in * columns];
        let (weights, _) = self.stage(number);
        let taps = weights.chunks_exact(run * columns).zip(transposed.chunks_exact_mut(columns * run));
        for (from, to) in taps {
            for (place, row) in from.chunks_exact(columns).enumerate() {
                for (column, weight) in row.iter().enumerate() {
                    to[column * run + place] = *weight;
                }
            }
        }
        transposed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::{LAYERS, parameter_slots};

    #[test]
    fn a_vector_comes_back_and_every_parameter_has_its_own_place() {
        for head in Head::ALL {
            let vector: Vec<f32> = (1..=count_of(head.layers())).map(|number| number as f32).collect();
            let parameters = Parameters::from_vector(voxel_layout(head), &vector);
            assert_eq!(parameters.to_vector(), vector);
            assert_eq!(parameters.values.iter().filter(|value| **value != 0.0).count(), vector.len());
        }
    }

    /// decoder.conv2, out 3, in 5, kernel (2, 0, 1): tap (2, 0), place (1, 5) of the run.
    #[test]
    fn weights_lie_where_products_look_for_them() {
        let slot = &parameter_slots()[8];
        assert_eq!(slot.name, "decoder.conv2.weight");
        let mut vector = vec![0.0; count_of(&LAYERS)];
        vector[slot.start + (3 * 64 + 5) * 27 + 2 * 9 + 1] = 1.0;
        let parameters = Parameters::from_vector(voxel_layout(Head::Quaternion), &vector);
        let (tap, place, run) = (6, 64 + 5, 3 * 64);
        assert_eq!(parameters.stage(4).0[(tap * run + place) * 32 + 3], 1.0);
        assert_eq!(parameters.transposed(4)[(tap * 32 + 3) * run + place], 1.0);
    }
}
