//! The volumetric grasp network (paper Fig. 1, VGN's `ConvNet`) in its plain, *dense* form: a TSDF of 40³ voxels in;
//! grasp quality, orientation and opening width out, for every voxel. Training evaluates the same function at one voxel
//! only ([`network::receptive_field`]).

use burn::tensor::activation::relu;
use burn::tensor::module::conv3d;
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, Tensor, TensorData};
use network::layers::LAYERS;
use network::upsampling::Upsampling;
use trainer::voxel::graph::doubling::double_patches;
use trainer::voxel::graph::loss::normalise;
use trainer::voxel::graph::parameters;

/// The network's output at every voxel of a batch.
pub(crate) struct DenseOutput {
    /// Logit of the grasp quality, `[b, 1, 40, 40, 40]`; the quality is its sigmoid.
    pub(crate) quality_logit: Tensor<5>,
    /// Unit quaternion xyzw, `[b, 4, 40, 40, 40]`.
    pub(crate) rotation: Tensor<5>,
    /// Opening width in voxels, `[b, 1, 40, 40, 40]`.
    pub(crate) width_voxels: Tensor<5>,
}

/// Evaluates the whole volume. The flat vector of all parameters is laid out by [`network::layers::parameter_slots`].
///
/// Shapes: `tsdf` `[b, 1, 40, 40, 40]` (in VGN's values), out see [`DenseOutput`].
pub(crate) fn dense(vector: &Tensor<1>, tsdf: Tensor<5>, mode: Upsampling) -> DenseOutput {
    let parameters = parameters(vector);
    let conv = |number: usize, x: Tensor<5>| {
        let (layer, (weight, bias)) = (LAYERS[number], parameters[number].clone());
        let options = ConvOptions::new([layer.stride; 3], [layer.padding(); 3], [1; 3], 1);
        conv3d(x, weight, Some(bias), options)
    };
    let x = relu(conv(0, tsdf));
    let x = relu(conv(1, x));
    let x = relu(conv(2, x));
    let x = double(relu(conv(3, x)), mode);
    let x = double(relu(conv(4, x)), mode);
    let x = double(relu(conv(5, x)), mode);
    DenseOutput {
        quality_logit: conv(6, x.clone()),
        rotation: normalise(conv(7, x.clone()), 1),
        width_voxels: conv(8, x),
    }
}

/// Doubles the three last axes of `[batch, channels, n, n, n]`.
///
/// Burn's `interpolate` supports only 4-D tensors, so each axis is multiplied with its matrix.
fn double(input: Tensor<5>, mode: Upsampling) -> Tensor<5> {
    let n = input.dims()[2];
    let window = TensorData::new(mode.window(n, 0, 2 * n, 0, n), [1, 2 * n, n]);
    let matrix = Tensor::from_data(window, &input.device());
    double_patches(input.permute([0, 2, 3, 4, 1]), [&matrix; 3]).permute([0, 4, 1, 2, 3])
}

#[test]
fn nearest_doubling_repeats_each_value_eight_times() {
    let input = Tensor::<1>::from_data(TensorData::new((0..8).map(|v| v as f32).collect(), [8]), &Device::flex());
    let output = double(input.reshape([1, 1, 2, 2, 2]), Upsampling::Nearest);
    let values = output.into_data().try_to_vec::<f32>().unwrap();
    for (at, value) in values.iter().enumerate() {
        let (x, y, z) = (at / 16, at / 4 % 4, at % 4);
        assert_eq!(*value, (x / 2 * 4 + y / 2 * 2 + z / 2) as f32);
    }
}
