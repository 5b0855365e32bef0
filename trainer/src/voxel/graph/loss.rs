//! The loss of [`crate::voxel::loss`] on tensors.

use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor, TensorData};
use network::layers::NORM_SQUARED_MIN;
use schema::Quat;

use crate::voxel::loss::{Target, WIDTH_WEIGHT, half_turn, target_width};

/// The network's output at one voxel per sample.
#[derive(Debug, Clone)]
pub struct Prediction {
    /// Logit of the grasp quality, `[b]`.
    pub quality_logit: Tensor<1>,
    /// Unit quaternion xyzw, `[b, 4]`.
    pub rotation: Tensor<2>,
    /// Opening width in voxels, `[b]`.
    pub width_voxels: Tensor<1>,
}

/// Targets of a batch on a device.
#[derive(Debug, Clone)]
pub struct Targets {
    /// 0 or 1, `[b]`.
    pub label: Tensor<1>,
    /// Quaternion xyzw, `[b, 4]`.
    pub rotation: Tensor<2>,
    /// The same grasp after half a turn about its approach, `[b, 4]`.
    pub rotation_turned: Tensor<2>,
    /// In voxels, `[b]`.
    pub width_voxels: Tensor<1>,
    /// Weight of Eq. 2, `[b]`.
    pub quality_weight: Tensor<1>,
}

/// The loss of each sample and its parts, all `[b]`. `rotation` and `width` are 0 where the label is.
#[derive(Debug, Clone)]
pub struct SampleLosses {
    /// L, Eq. 5.
    pub total: Tensor<1>,
    /// L_q, Eq. 2, times the sample's weight.
    pub quality: Tensor<1>,
    /// y · L_r, Eq. 3 and 4.
    pub rotation: Tensor<1>,
    /// y · L_w, in voxels², before the weight k.
    pub width: Tensor<1>,
}

impl Targets {
    /// Copies a batch of targets to a device.
    #[must_use]
    pub fn new(targets: &[Target], device: &Device) -> Self {
        let count = targets.len();
        let column = |value: &dyn Fn(&Target) -> f32| {
            Tensor::from_data(TensorData::new(targets.iter().map(value).collect(), [count]), device)
        };
        let rotations = |of: &dyn Fn(Quat) -> Quat| {
            let values = targets.iter().flat_map(|target| of(target.rotation).to_array()).collect();
            Tensor::from_data(TensorData::new(values, [count, 4]), device)
        };
        Self {
            label: column(&|target| f32::from(target.label)),
            rotation: rotations(&|rotation| rotation),
            rotation_turned: rotations(&half_turn),
            width_voxels: column(&target_width),
            quality_weight: column(&|target| target.quality_weight),
        }
    }
}

/// The loss of each sample.
#[must_use]
pub fn sample_losses(prediction: &Prediction, targets: &Targets) -> SampleLosses {
    let label = || targets.label.clone();
    let logit = prediction.quality_logit.clone();
    // −y ln σ(z) − (1 − y) ln(1 − σ(z)) = max(z, 0) − z y + ln(1 + e^−|z|)
    let quality = relu(logit.clone()) - logit.clone() * label() + logit.abs().neg().exp().log1p();
    let quality = quality * targets.quality_weight.clone(); // multiplying by 1 changes no bit
    let along =
        |rotation: &Tensor<2>| (prediction.rotation.clone() * rotation.clone()).sum_dim(1).squeeze_dim::<1>(1).abs();
    let [there, turned] = [&targets.rotation, &targets.rotation_turned].map(along);
    let rotation = (there.neg() + 1.0).min_pair(turned.neg() + 1.0) * label();
    let width = (prediction.width_voxels.clone() - targets.width_voxels.clone()).square() * label();
    let total = quality.clone() + rotation.clone() + width.clone() * WIDTH_WEIGHT;
    SampleLosses { total, quality, rotation, width }
}

/// Divides by the Euclidean norm along an axis, bounded below by 1e-12 (PyTorch's `F.normalize`). The square is
/// bounded, not its root, because the slope of the root at 0 is infinite.
#[must_use]
pub fn normalise<const D: usize>(vectors: Tensor<D>, axis: usize) -> Tensor<D> {
    let norm = vectors.clone().square().sum_dim(axis).clamp_min(NORM_SQUARED_MIN).sqrt();
    vectors / norm
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use schema::{Vec3, axis_angle};

    use super::*;
    use crate::results::SampleResult;
    use crate::voxel::graph::step::prediction_of;
    use crate::voxel::loss::{loss_gradient, sample_loss};

    /// Losses and gradients by autodiff: `[total, quality, rotation, width]` and the gradient at the heads.
    fn by_autodiff(heads: [f32; 6], target: Target, weight: f32) -> ([f32; 4], Vec<f32>) {
        let device = Device::flex();
        let leaf = Tensor::<2>::from_data([heads], &device).autodiff().require_grad();
        let losses = sample_losses(&prediction_of(&leaf), &Targets::new(&[target], &device));
        let gradients = (losses.total.clone().sum() * weight).backward();
        let values = [losses.total, losses.quality, losses.rotation, losses.width];
        (values.map(|loss| loss.into_scalar::<f32>()), leaf.grad(&gradients).unwrap().into_data().iter().collect())
    }

    fn check(heads: [f32; 6], target: Target, weight: f32) {
        let (losses, gradient) = by_autodiff(heads, target, weight);
        let SampleResult { total, quality, rotation, width, .. } = sample_loss(&heads, &target);
        let bits = |values: &[f32]| values.iter().map(|value| (value + 0.0).to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&[total, quality, rotation, width]), bits(&losses), "{heads:?} {target:?}");
        assert_eq!(bits(&loss_gradient(&heads, &target, weight)), bits(&gradient), "{heads:?} {target:?}");
    }

    #[test]
    fn edges_have_the_losses_and_gradients_that_are_written_out() {
        let target = Target {
            tips_voxels: [0.0; 3],
            label: 1,
            rotation: Quat::IDENTITY,
            width_voxels: 5.0,
            quality_weight: 1.3,
        };
        for heads in [[0.0; 6], [90.0, 0.0, 0.0, 0.0, 1.0, 5.0], [-90.0, 1e-13, 0.0, 0.0, 0.0, -1.0], [1e-40; 6]] {
            for label in [0, 1] {
                check(heads, Target { label, ..target }, 1.0 / 48.0);
            }
        }
    }

    proptest! {
        #[test]
        fn autodiff_computes_the_losses_and_gradients_that_are_written_out(
            heads in prop::array::uniform6(-9.0_f32..9.0),
            scale in prop::sample::select(vec![1.0_f32, 1e-3, 1e-12, 1e-20]),
            axis in prop::array::uniform3(-1.0_f32..1.0),
            angle in -6.0_f32..6.0,
            (label, width_voxels, quality_weight) in (0_u8..2, 0.0_f32..12.0, 0.1_f32..3.0),
            samples in 1_u16..300,
        ) {
            let [logit, x, y, z, w, width] = heads;
            let [x, y, z, w] = [x, y, z, w].map(|part| part * scale);
            let rotation = axis_angle(Vec3::from_array(axis).normalize_or(Vec3::Z), angle);
            let target = Target { tips_voxels: [0.0; 3], label, rotation, width_voxels, quality_weight };
            check([logit, x, y, z, w, width], target, 1.0 / f32::from(samples));
        }
    }
}
