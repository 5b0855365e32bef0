//! The volumetric grasp network (paper Fig. 1, VGN's `ConvNet`): a TSDF of 40³ voxels in; grasp quality, orientation
//! and opening width out, for every voxel.
//!
//! The module's paths are those of VGN's PyTorch class, so state dicts are interchangeable by name. This is the *dense*
//! form; training evaluates the same function at one voxel only ([`network::receptive_field`]).

use burn::module::{Module, Param};
use burn::tensor::Tensor;
use burn::tensor::activation::relu;
use burn::tensor::module::conv3d;
use burn::tensor::ops::ConvOptions;
use network::layers::{LAYERS, LayerShape, ParameterSlot, parameter_count, parameter_slots};
use network::upsampling::Upsampling;

use super::doubling::double;
use super::loss::normalise;

/// A convolution's parameters.
#[derive(Module, Debug)]
pub struct Conv {
    /// `[out, in, k, k, k]`.
    pub weight: Param<Tensor<5>>,
    /// `[out]`.
    pub bias: Param<Tensor<1>>,
}

/// Three convolutions of stride 2: `[b, 1, 40, 40, 40]` to `[b, 64, 5, 5, 5]`.
#[derive(Module, Debug)]
pub struct Encoder {
    /// 1 → 16, kernel 5.
    pub conv1: Conv,
    /// 16 → 32, kernel 3.
    pub conv2: Conv,
    /// 32 → 64, kernel 3.
    pub conv3: Conv,
}

/// Three convolutions, each followed by a doubling: `[b, 64, 5, 5, 5]` to `[b, 16, 40, 40, 40]`.
#[derive(Module, Debug)]
pub struct Decoder {
    /// 64 → 64, kernel 3, at 5³.
    pub conv1: Conv,
    /// 64 → 32, kernel 3, at 10³.
    pub conv2: Conv,
    /// 32 → 16, kernel 5, at 20³.
    pub conv3: Conv,
}

/// The network.
#[derive(Module, Debug)]
pub struct Network {
    /// Encoder.
    pub encoder: Encoder,
    /// Decoder.
    pub decoder: Decoder,
    /// 16 → 1, kernel 5: logit of the grasp's success.
    pub conv_qual: Conv,
    /// 16 → 4, kernel 5: quaternion before normalisation.
    pub conv_rot: Conv,
    /// 16 → 1, kernel 5: opening width in voxels.
    pub conv_width: Conv,
    /// The decoder's upsampling mode.
    #[module(skip)]
    pub upsampling: Upsampling,
}

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

impl Network {
    /// A network whose parameters are the slices of a flat vector of [`parameter_count`] values, in the order of
    /// [`parameter_slots`].
    ///
    /// # Panics
    /// If the vector has another length.
    #[must_use]
    pub fn from_vector(vector: Tensor<1>, upsampling: Upsampling) -> Self {
        assert_eq!(vector.dims(), [parameter_count()], "one value a parameter");
        let slots = parameter_slots();
        let conv = |layer: usize| {
            let (weight, bias) = (&slots[2 * layer], &slots[2 * layer + 1]);
            let part = |slot: &ParameterSlot| vector.clone().slice(slot.start..slot.start + slot.len);
            Conv {
                weight: Param::from_tensor(part(weight).reshape(LAYERS[layer].weight_shape())),
                bias: Param::from_tensor(part(bias)),
            }
        };
        Self {
            encoder: Encoder { conv1: conv(0), conv2: conv(1), conv3: conv(2) },
            decoder: Decoder { conv1: conv(3), conv2: conv(4), conv3: conv(5) },
            conv_qual: conv(6),
            conv_rot: conv(7),
            conv_width: conv(8),
            upsampling,
        }
    }

    /// The convolutions in the order of [`LAYERS`].
    #[must_use]
    pub fn convs(&self) -> [&Conv; 9] {
        let (encoder, decoder) = (&self.encoder, &self.decoder);
        [
            &encoder.conv1,
            &encoder.conv2,
            &encoder.conv3,
            &decoder.conv1,
            &decoder.conv2,
            &decoder.conv3,
            &self.conv_qual,
            &self.conv_rot,
            &self.conv_width,
        ]
    }

    /// Evaluates the whole volume.
    ///
    /// Shapes: in `[b, 1, 40, 40, 40]` (TSDF in VGN's values), out see [`DenseOutput`].
    #[must_use]
    pub fn forward(&self, tsdf: Tensor<5>) -> DenseOutput {
        let [enc1, enc2, enc3, dec1, dec2, dec3, qual, rot, width] = self.convs();
        let conv = |layer: usize, parameters: &Conv, x: Tensor<5>| convolve(LAYERS[layer], parameters, x);
        let x = relu(conv(0, enc1, tsdf));
        let x = relu(conv(1, enc2, x));
        let x = relu(conv(2, enc3, x));
        let x = double(relu(conv(3, dec1, x)), self.upsampling);
        let x = double(relu(conv(4, dec2, x)), self.upsampling);
        let x = double(relu(conv(5, dec3, x)), self.upsampling);
        DenseOutput {
            quality_logit: conv(6, qual, x.clone()),
            rotation: normalise(conv(7, rot, x.clone()), 1),
            width_voxels: conv(8, width, x),
        }
    }
}

fn convolve(layer: LayerShape, parameters: &Conv, input: Tensor<5>) -> Tensor<5> {
    let options = ConvOptions::new([layer.stride; 3], [layer.padding(); 3], [1; 3], 1);
    conv3d(input, parameters.weight.val(), Some(parameters.bias.val()), options)
}
