//! The loss of the paper, Eq. 1–5 (VGN, `train_vgn.py`).
//!
//! For a sample with label y, quaternion r and width w, and a prediction q̂, r̂, ŵ at its voxel:
//!
//! - Eq. 2: `L_q = −(y ln q̂ + (1 − y) ln(1 − q̂))`, taken from the logit so that it stays finite;
//! - Eq. 3, 4: `L_r = min(1 − |r̂·r|, 1 − |r̂·r_π|)`, r_π the same grasp turned by half a turn about its approach;
//! - width: `L_w = (ŵ − w)²`, widths in voxels;
//! - Eq. 1, 5: `L = L_q + y (L_r + k L_w)` with k = 0.01, averaged over the batch.
//!
//! Beyond the paper, a sample's L_q can have a weight ([`ClassWeights`]); the paper's is 1 for all.

use burn::tensor::activation::{relu, sigmoid};
use burn::tensor::{Device, Tensor, TensorData};
use schema::Quat;

/// k of Eq. 5: the weight of the squared error of the width in voxels.
pub const WIDTH_WEIGHT: f32 = 0.01;

/// What the network says about one voxel a sample.
#[derive(Debug, Clone)]
pub struct Prediction {
    /// Logit of the grasp quality, `[b]`.
    pub quality_logit: Tensor<1>,
    /// Unit quaternion xyzw, `[b, 4]`.
    pub rotation: Tensor<2>,
    /// Opening width in voxels, `[b]`.
    pub width_voxels: Tensor<1>,
}

/// What the attempt showed, for one sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// 1 if the object was held, else 0.
    pub label: u8,
    /// Orientation of the grasp.
    pub rotation: Quat,
    /// Opening width in voxels; counts only where `label` is 1.
    pub width_voxels: f32,
    /// Weight of Eq. 2 for this sample; 1 in the paper and whenever the network is tested.
    pub quality_weight: f32,
}

/// Weights of the quality loss (Eq. 2) by label. Their mean over the training samples is 1, so that quality keeps its
/// place beside rotation and width whatever the weight of a positive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClassWeights {
    /// Of a sample whose object was held.
    pub positive: f32,
    /// Of a failure.
    pub negative: f32,
}

impl ClassWeights {
    /// The paper's: none.
    pub const EQUAL: Self = Self { positive: 1.0, negative: 1.0 };

    /// A positive counts `positive_weight` times as much as a negative, where `positives` of `samples` are positive.
    /// (1 − share) / share makes both classes count alike.
    #[must_use]
    pub fn new(positive_weight: f64, positives: usize, samples: usize) -> Self {
        let share = positives as f64 / samples.max(1) as f64;
        let mean = share * positive_weight + (1.0 - share);
        Self { positive: (positive_weight / mean) as f32, negative: (1.0 / mean) as f32 }
    }

    /// The weight of a sample with that label.
    #[must_use]
    pub fn of(&self, label: u8) -> f32 {
        if label == 1 { self.positive } else { self.negative }
    }
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

/// The same grasp turned by half a turn about its approach (z) axis.
#[must_use]
pub fn half_turn(rotation: Quat) -> Quat {
    rotation * Quat::from_xyzw(0.0, 0.0, 1.0, 0.0)
}

impl Targets {
    /// Puts a batch of targets on a device.
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
            width_voxels: column(&|target| if target.label == 1 { target.width_voxels } else { 0.0 }),
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
    let quality = quality * targets.quality_weight.clone(); // times 1 changes no bit
    let apart = |rotation: &Tensor<2>| {
        let dot = (prediction.rotation.clone() * rotation.clone()).sum_dim(1).squeeze_dim::<1>(1);
        dot.abs().neg() + 1.0
    };
    let rotation = apart(&targets.rotation).min_pair(apart(&targets.rotation_turned)) * label();
    let width = (prediction.width_voxels.clone() - targets.width_voxels.clone()).square() * label();
    let total = quality.clone() + rotation.clone() + width.clone() * WIDTH_WEIGHT;
    SampleLosses { total, quality, rotation, width }
}

/// Least square of a norm that is divided by.
pub const NORM_SQUARED_MIN: f32 = 1e-24;

/// Divides by the Euclidean norm along an axis, held above 1e-12 (PyTorch's `F.normalize`). The square is held, not its
/// root, whose slope at 0 is infinite.
#[must_use]
pub fn normalise<const D: usize>(vectors: Tensor<D>, axis: usize) -> Tensor<D> {
    let norm = vectors.clone().square().sum_dim(axis).clamp_min(NORM_SQUARED_MIN).sqrt();
    vectors / norm
}

/// The grasp quality of a logit.
#[must_use]
pub fn quality(logit: Tensor<1>) -> Tensor<1> {
    sigmoid(logit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use schema::{Vec3, axis_angle};

    fn losses(logit: f32, rotation: Quat, width: f32, target: Target) -> [f32; 4] {
        let device = Device::flex();
        let prediction = Prediction {
            quality_logit: Tensor::from_data([logit], &device),
            rotation: Tensor::from_data([rotation.to_array()], &device),
            width_voxels: Tensor::from_data([width], &device),
        };
        let losses = sample_losses(&prediction, &Targets::new(&[target], &device));
        [losses.total, losses.quality, losses.rotation, losses.width].map(|loss| loss.into_scalar::<f32>())
    }

    #[test]
    fn a_half_turn_and_the_quaternions_sign_cost_nothing() {
        let rotation = axis_angle(Vec3::new(0.6, 0.0, 0.8), 1.1);
        let target = Target { label: 1, rotation, width_voxels: 5.0, quality_weight: 1.0 };
        for same in [rotation, -rotation, half_turn(rotation), -half_turn(rotation)] {
            let [_, _, apart, width] = losses(0.0, same, 7.0, target);
            assert!(apart.abs() < 1e-6, "{same}: {apart}");
            assert!((width - 4.0).abs() < 1e-6);
        }
    }

    #[test]
    fn failures_teach_the_quality_only() {
        let target = Target { label: 0, rotation: Quat::IDENTITY, width_voxels: f32::NAN, quality_weight: 1.0 };
        let [total, quality, rotation, width] = losses(0.0, axis_angle(Vec3::X, 1.0), 9.0, target);
        assert_eq!([rotation, width], [0.0, 0.0]);
        assert_eq!(total, quality);
        assert!((quality - core::f32::consts::LN_2).abs() < 1e-6);
    }

    #[test]
    fn the_loss_stays_finite_for_sure_predictions() {
        let sure_and_wrong = Target { label: 0, rotation: Quat::IDENTITY, width_voxels: 0.0, quality_weight: 1.0 };
        let [_, quality, _, _] = losses(200.0, Quat::IDENTITY, 0.0, sure_and_wrong);
        assert!((quality - 200.0).abs() < 1e-3, "{quality}");
    }

    /// Closed form: d(w L_q)/dz = w (σ(z) − y), and the mean weight over the training samples is 1.
    #[test]
    fn a_positives_weight_scales_its_quality_loss_and_gradient() {
        let weights = ClassWeights::new(3.0, 25, 100);
        assert_eq!(weights, ClassWeights { positive: 2.0, negative: 2.0 / 3.0 });
        assert!((0.25 * weights.positive + 0.75 * weights.negative - 1.0).abs() < 1e-6);
        assert_eq!(ClassWeights::new(1.0, 31, 97), ClassWeights::EQUAL);
        let device = Device::flex();
        for (label, logit) in [(0_u8, -1.3_f32), (0, 0.4), (1, -1.3), (1, 0.4)] {
            let weight = weights.of(label);
            let target = Target { label, rotation: Quat::IDENTITY, width_voxels: 5.0, quality_weight: weight };
            let unweighted = Target { quality_weight: 1.0, ..target };
            let turned = axis_angle(Vec3::X, 0.7);
            let [total, quality, rotation, width] = losses(logit, turned, 7.0, target);
            let [_, quality_1, rotation_1, width_1] = losses(logit, turned, 7.0, unweighted);
            assert_eq!([rotation, width], [rotation_1, width_1]);
            assert!((quality - weight * quality_1).abs() < 1e-6);
            assert!((total - (quality + rotation + WIDTH_WEIGHT * width)).abs() < 1e-6);

            let leaf = Tensor::<1>::from_data([logit], &device).autodiff().require_grad();
            let prediction = Prediction {
                quality_logit: leaf.clone(),
                rotation: Tensor::from_data([turned.to_array()], &device).autodiff(),
                width_voxels: Tensor::from_data([7.0], &device).autodiff(),
            };
            let gradients = sample_losses(&prediction, &Targets::new(&[target], &device)).total.sum().backward();
            let gradient = leaf.grad(&gradients).unwrap().into_scalar::<f32>();
            let expected = weight * (1.0 / (1.0 + libm::expf(-logit)) - f32::from(label));
            assert!((gradient - expected).abs() < 1e-6, "{label} {logit}: {gradient} against {expected}");
        }
    }
}
