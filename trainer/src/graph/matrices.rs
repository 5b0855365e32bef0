//! The network's parameters as matrices for products with gathered rows.
//!
//! PyTorch and Burn order a weight `[out, in, x, y, z]`. A gathered row runs over x, y, z and then the channels, so the
//! matrix is `[x · y · z · in, out]`. The three heads read the same row and form one matrix with six columns.

use burn::tensor::Tensor;
use network::layers::{LAYERS, LayerShape, parameter_slots};

/// Weights `[kernel³ · in, out]` and biases `[out]` of every layer, in the order of [`LAYERS`].
#[derive(Debug, Clone)]
pub struct Matrices {
    /// One matrix per layer.
    pub weights: Vec<Tensor<2>>,
    /// One vector per layer.
    pub biases: Vec<Tensor<1>>,
}

impl Matrices {
    /// From the flat vector of all parameters.
    #[must_use]
    pub fn from_vector(vector: &Tensor<1>) -> Self {
        let slots = parameter_slots();
        let part = |slot: usize| vector.clone().slice(slots[slot].start..slots[slot].start + slots[slot].len);
        Self {
            weights: (0..LAYERS.len()).map(|number| to_matrix(LAYERS[number], part(2 * number))).collect(),
            biases: (0..LAYERS.len()).map(|number| part(2 * number + 1)).collect(),
        }
    }

    /// Back to the flat vector.
    #[must_use]
    pub fn into_vector(self) -> Tensor<1> {
        let layers = LAYERS.iter().zip(self.weights).zip(self.biases);
        let parts = layers.flat_map(|((layer, weight), bias)| [from_matrix(*layer, weight), bias]).collect();
        Tensor::cat(parts, 0)
    }

    /// The same values as leaves of a new autodiff graph. Graphs without a common leaf have no common lock, so each
    /// part of a batch takes its own copy and runs on its own thread.
    #[must_use]
    pub fn leaves(&self) -> Self {
        Self {
            weights: self.weights.iter().map(|w| w.clone().autodiff().require_grad()).collect(),
            biases: self.biases.iter().map(|b| b.clone().autodiff().require_grad()).collect(),
        }
    }
}

fn to_matrix(layer: LayerShape, weight: Tensor<1>) -> Tensor<2> {
    weight.reshape(layer.weight_shape()).permute([2, 3, 4, 1, 0]).reshape([layer.fan_in(), layer.channels_out])
}

fn from_matrix(layer: LayerShape, matrix: Tensor<2>) -> Tensor<1> {
    let k = layer.kernel;
    matrix
        .reshape([k, k, k, layer.channels_in, layer.channels_out])
        .permute([4, 3, 0, 1, 2])
        .reshape([layer.weight_count()])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::{to_device, to_host};
    use burn::tensor::Device;
    use network::layers::initial_vector;

    #[test]
    fn a_vector_comes_back_from_its_matrices() {
        let vector = initial_vector(3);
        let back = Matrices::from_vector(&to_device(&vector, &Device::flex())).into_vector();
        assert_eq!(vector, to_host(back));
    }
}
