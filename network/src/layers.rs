//! The nine convolutions of the network as a table (paper Fig. 1; VGN, `networks.py`), and the flat vector of all their
//! parameters for optimisers and files.

use safetensors::{Dtype, SafeTensors};
use schema::{Purpose, Stream};

/// A 3-D convolution with a cubic kernel, padded by half the kernel with zeros. With a kernel of 1 it is also a product
/// with a matrix.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LayerShape {
    /// Path of the module in PyTorch (that of the paper's network in VGN's class); `.weight` and `.bias` follow.
    pub name: &'static str,
    /// Channels in.
    pub channels_in: usize,
    /// Channels out.
    pub channels_out: usize,
    /// Side of the kernel.
    pub kernel: usize,
    /// Step between outputs, in inputs.
    pub stride: usize,
}

pub(crate) const fn layer(
    name: &'static str,
    channels_in: usize,
    channels_out: usize,
    kernel: usize,
    stride: usize,
) -> LayerShape {
    LayerShape { name, channels_in, channels_out, kernel, stride }
}

/// All layers of the paper's network, in the order of their parameters in the flat vector. Those with other heads have
/// the same first six ([`crate::head`]).
pub const LAYERS: [LayerShape; 9] = [
    layer("encoder.conv1", 1, 16, 5, 2),
    layer("encoder.conv2", 16, 32, 3, 2),
    layer("encoder.conv3", 32, 64, 3, 2),
    layer("decoder.conv1", 64, 64, 3, 1),
    layer("decoder.conv2", 64, 32, 3, 1),
    layer("decoder.conv3", 32, 16, 5, 1),
    layer("conv_qual", 16, 1, 5, 1),
    layer("conv_rot", 16, 4, 5, 1),
    layer("conv_width", 16, 1, 5, 1),
];

impl LayerShape {
    /// Number of inputs of one output: kernel³ · channels in.
    #[must_use]
    pub const fn fan_in(&self) -> usize {
        self.kernel.pow(3) * self.channels_in
    }

    /// Number of zeros added at each side.
    #[must_use]
    pub const fn padding(&self) -> usize {
        self.kernel / 2
    }

    /// Shape of the weight in PyTorch and Burn: `[out, in, k, k, k]`.
    #[must_use]
    pub const fn weight_shape(&self) -> [usize; 5] {
        [self.channels_out, self.channels_in, self.kernel, self.kernel, self.kernel]
    }

    /// Number of weights.
    #[must_use]
    pub const fn weight_count(&self) -> usize {
        self.fan_in() * self.channels_out
    }
}

/// One named parameter in the flat vector.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ParameterSlot {
    /// VGN's name, such as `encoder.conv1.weight`.
    pub name: String,
    /// Shape, `[out, in, k, k, k]` or `[out]`.
    pub shape: Vec<usize>,
    /// Start of its values.
    pub start: usize,
    /// Number of values.
    pub len: usize,
}

/// Every parameter of the paper's network with its position in the flat vector: for each layer its weight, then its
/// bias.
#[must_use]
pub fn parameter_slots() -> Vec<ParameterSlot> {
    slots_of(&LAYERS)
}

/// Every parameter of some layers with its position in the flat vector: for each layer its weight, then its bias.
#[must_use]
pub fn slots_of(layers: &[LayerShape]) -> Vec<ParameterSlot> {
    let mut start = 0;
    let mut slots = Vec::with_capacity(2 * layers.len());
    for layer in layers {
        for (part, shape) in [("weight", layer.weight_shape().to_vec()), ("bias", vec![layer.channels_out])] {
            let len = shape.iter().product();
            slots.push(ParameterSlot { name: format!("{}.{part}", layer.name), shape, start, len });
            start += len;
        }
    }
    slots
}

/// The flat vector of the tensors whose names begin with `prefix`, or everything that is wrong with them.
pub(crate) fn vector_of(
    tensors: &SafeTensors<'_>,
    slots: &[ParameterSlot],
    prefix: &str,
) -> Result<Vec<f32>, Vec<String>> {
    let (mut vector, mut problems) = (Vec::new(), Vec::new());
    for ParameterSlot { name, shape: expected, .. } in slots {
        let name = format!("{prefix}{name}");
        match tensors.tensor(&name) {
            Ok(view) if view.dtype() == Dtype::F32 && view.shape() == expected => {
                vector.extend(view.data().as_chunks::<4>().0.iter().map(|value| f32::from_le_bytes(*value)));
            }
            Ok(view) => {
                let (kind, shape) = (view.dtype(), view.shape());
                problems.push(format!("{name} must be F32 of shape {expected:?}, got {kind:?} of shape {shape:?}"));
            }
            Err(_) => problems.push(format!("{name} is missing")),
        }
    }
    if problems.is_empty() { Ok(vector) } else { Err(problems) }
}

/// Number of parameters of some layers: 313,238 for the paper's network.
pub(crate) fn count_of(layers: &[LayerShape]) -> usize {
    layers.iter().map(|layer| layer.weight_count() + layer.channels_out).sum()
}

/// Initial parameters as in PyTorch: U(−1/√fan_in, 1/√fan_in) for weights and biases, each layer from its own
/// stream of `seed`.
#[must_use]
pub fn initial_vector(seed: u64) -> Vec<f32> {
    initial_of(&LAYERS, seed)
}

/// As [`initial_vector`], for some layers.
pub(crate) fn initial_of(layers: &[LayerShape], seed: u64) -> Vec<f32> {
    let mut values = Vec::with_capacity(count_of(layers));
    for (number, layer) in layers.iter().enumerate() {
        let mut stream = Stream::new(seed, number as u64, Purpose::Weights, 0);
        let bound = 1.0 / (layer.fan_in() as f32).sqrt();
        values.extend((0..layer.weight_count() + layer.channels_out).map(|_| stream.uniform(-bound, bound)));
    }
    values
}

/// Lower bound of the square of a quaternion's norm in the normalisation. The square is bounded, not its root, because
/// the slope of the root at 0 is infinite.
pub const NORM_SQUARED_MIN: f32 = 1e-24;

/// The positions of a cube of side `n`, x slowest.
pub fn positions(n: usize) -> impl Iterator<Item = [usize; 3]> {
    (0..n.pow(3)).map(move |at| [at / (n * n), at / n % n, at % n])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slots_tile_the_vector() {
        let slots = parameter_slots();
        assert_eq!(slots.len(), 18);
        let mut end = 0;
        for slot in &slots {
            assert_eq!(slot.start, end, "{}", slot.name);
            end += slot.len;
        }
        assert_eq!(end, count_of(&LAYERS));
        assert_eq!(end, 2_016 + 13_856 + 55_360 + 110_656 + 55_328 + 64_016 + 2_001 + 8_004 + 2_001);
    }
}
