//! The network's parameters in the order in which products read them.
//!
//! The three heads see the same inputs and are one stage of sixteen columns, of which six are used; so there are seven
//! stages. A stage's weights are `[taps, run, columns]` (tap: kernel x and y; run: kernel z and channels in), then come
//! its biases, `[columns]`.

use std::ops::Range;
use std::sync::LazyLock;

use super::tile::LANES;
use crate::layers::{LAYERS, parameter_count, parameter_slots};

/// Number of stages.
pub(crate) const STAGES: usize = 7;
/// The stage of the heads.
pub(crate) const HEADS: usize = STAGES - 1;
/// Columns of the heads that are used: logit, quaternion, width.
pub(crate) const HEAD_COLUMNS: usize = 6;

/// Where a stage's parameters lie among all.
#[derive(Debug, Clone)]
pub(crate) struct Stage {
    pub weights: Range<usize>,
    pub bias: Range<usize>,
    /// Values of a run, all taps together: the rows of the weights as a matrix.
    pub fan_in: usize,
    /// Values of one run.
    pub run: usize,
    pub columns: usize,
}

/// For each parameter of the flat vector, where it lies here.
static PLACES: LazyLock<Vec<u32>> = LazyLock::new(places);
static TABLE: LazyLock<Vec<Stage>> = LazyLock::new(table);

fn table() -> Vec<Stage> {
    let mut start = 0;
    let stage = |(number, layer): (usize, &crate::layers::LayerShape)| {
        let columns = layer.channels_out.next_multiple_of(LANES);
        let weights = start..start + layer.fan_in() * columns;
        let bias = weights.end..weights.end + columns;
        start = bias.end;
        let run = if number == HEADS { layer.fan_in() } else { layer.kernel * layer.channels_in };
        Stage { weights, bias, fan_in: layer.fan_in(), run, columns }
    };
    LAYERS[..STAGES].iter().enumerate().map(stage).collect()
}

fn places() -> Vec<u32> {
    let mut places = Vec::with_capacity(parameter_count());
    let mut head_column = 0;
    for (number, layer) in LAYERS.iter().enumerate() {
        let stage = &TABLE[number.min(HEADS)];
        let first_column = if number < HEADS { 0 } else { head_column };
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
        head_column += if number < HEADS { 0 } else { layer.channels_out };
    }
    debug_assert_eq!(places.len(), parameter_slots().iter().map(|slot| slot.len).sum::<usize>());
    places
}

/// All parameters, or their gradients, stage by stage.
#[derive(Debug, Clone)]
pub(crate) struct Parameters(Vec<f32>);

impl Parameters {
    /// Zeros.
    pub(crate) fn zeros() -> Self {
        Self(vec![0.0; TABLE[HEADS].bias.end])
    }

    /// From the flat vector ([`parameter_slots`]).
    pub(crate) fn from_vector(vector: &[f32]) -> Self {
        let mut all = Self::zeros();
        for (value, place) in vector.iter().zip(PLACES.iter()) {
            all.0[*place as usize] = *value;
        }
        all
    }

    /// Back to the flat vector.
    pub(crate) fn to_vector(&self) -> Vec<f32> {
        PLACES.iter().map(|place| self.0[*place as usize]).collect()
    }

    /// A stage's weights and biases.
    pub(crate) fn stage(&self, number: usize) -> (&[f32], &[f32]) {
        let stage = &TABLE[number];
        (&self.0[stage.weights.clone()], &self.0[stage.bias.clone()])
    }

    /// A stage's weights and biases.
    pub(crate) fn stage_mut(&mut self, number: usize) -> (&mut [f32], &mut [f32]) {
        let stage = &TABLE[number];
        let (weights, bias) = self.0[stage.weights.start..stage.bias.end].split_at_mut(stage.weights.len());
        (weights, bias)
    }

    /// A stage's weights as `[taps, columns, run]`, for the gradient of a stage's inputs.
    pub(crate) fn transposed(&self, number: usize) -> Vec<f32> {
        let Stage { fan_in, run, columns, .. } = TABLE[number];
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

    #[test]
    fn a_vector_comes_back_and_every_parameter_has_its_own_place() {
        let vector: Vec<f32> = (1..=parameter_count()).map(|number| number as f32).collect();
        let parameters = Parameters::from_vector(&vector);
        assert_eq!(parameters.to_vector(), vector);
        assert_eq!(parameters.0.iter().filter(|value| **value != 0.0).count(), vector.len());
    }

    /// decoder.conv2, out 3, in 5, kernel (2, 0, 1): tap (2, 0), place (1, 5) of the run.
    #[test]
    fn weights_lie_where_products_look_for_them() {
        let slot = &parameter_slots()[8];
        assert_eq!(slot.name, "decoder.conv2.weight");
        let mut vector = vec![0.0; parameter_count()];
        vector[slot.start + (3 * 64 + 5) * 27 + 2 * 9 + 1] = 1.0;
        let parameters = Parameters::from_vector(&vector);
        let (tap, place, run) = (6, 64 + 5, 3 * 64);
        assert_eq!(parameters.stage(4).0[(tap * run + place) * 32 + 3], 1.0);
        assert_eq!(parameters.transposed(4)[(tap * 32 + 3) * run + place], 1.0);
    }
}
