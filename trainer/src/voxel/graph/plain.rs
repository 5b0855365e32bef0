//! The volumetric grasp network (paper Fig. 1, VGN's `ConvNet`) in its plain, *dense* form: a TSDF of 40³ voxels in;
//! grasp quality, orientation and opening width out, for every voxel. Training evaluates the same function at one voxel
//! only ([`network::receptive_field`]).

use burn::tensor::Tensor;
use burn::tensor::activation::relu;
use burn::tensor::module::conv3d;
use burn::tensor::ops::ConvOptions;
use network::layers::LAYERS;
use network::upsampling::Upsampling;

use super::doubling::double;
use super::loss::normalise;
use super::parameters;

/// The network's output at every voxel of a batch.
#[derive(Debug, Clone)]
pub struct DenseOutput {
    /// Logit of the grasp quality, `[b, 1, 40, 40, 40]`; the quality is its sigmoid.
    pub quality_logit: Tensor<5>,
    /// Unit quaternion xyzw, `[b, 4, 40, 40, 40]`.
    pub rotation: Tensor<5>,
    /// Opening width in voxels, `[b, 1, 40, 40, 40]`.
    pub width_voxels: Tensor<5>,
}

/// Evaluates the whole volume. The flat vector of all parameters is laid out by [`network::layers::parameter_slots`].
///
/// Shapes: `tsdf` `[b, 1, 40, 40, 40]` (in VGN's values), out see [`DenseOutput`].
#[must_use]
pub fn dense(vector: &Tensor<1>, tsdf: Tensor<5>, mode: Upsampling) -> DenseOutput {
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
