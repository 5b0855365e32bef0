//! The loss of the paper, Eq. 1–5 (VGN, `train_vgn.py`), and its gradient.
//!
//! For a sample with label y, quaternion r and width w, and a prediction q̂, r̂, ŵ at its voxel:
//!
//! - Eq. 2: `L_q = −(y ln q̂ + (1 − y) ln(1 − q̂))`, taken from the logit so that it stays finite;
//! - Eq. 3, 4: `L_r = min(1 − |r̂·r|, 1 − |r̂·r_π|)`, r_π the same grasp turned by half a turn about its approach;
//! - width: `L_w = (ŵ − w)²`, widths in voxels;
//! - Eq. 1, 5: `L = L_q + y (L_r + k L_w)` with k = 0.01, averaged over the batch.
//!
//! As an extension, a sample's L_q can have a weight ([`ClassWeights`]); in the paper it is 1 for all.
//!
//! Values and gradients equal those of Burn's autodiff (`graph::loss`) bit for bit, as a test shows.

use network::head::Head;
use network::layers::NORM_SQUARED_MIN;
use schema::Quat;

use crate::results::SampleResult;

/// k of Eq. 5: the weight of the squared error of the width in voxels.
pub const WIDTH_WEIGHT: f32 = 0.01;

/// The result of the attempt, for one sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// 1 if the object was held, else 0.
    pub label: u8,
    /// Orientation of the grasp.
    pub rotation: Quat,
    /// Opening width in voxels; counts only where `label` is 1.
    pub width_voxels: f32,
    /// The point between the finger tips as seen from the middle of the voxel, in voxels, for heads that say it.
    pub tips_voxels: [f32; 3],
    /// Weight of Eq. 2 for this sample; 1 in the paper and in all tests.
    pub quality_weight: f32,
}

/// Weights of the quality loss (Eq. 2) by label. Their mean over the training samples is 1, so that the balance between
/// quality, rotation and width does not depend on the weight of positives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClassWeights {
    /// Weight of a success.
    pub positive: f32,
    /// Weight of a failure.
    pub negative: f32,
}

impl ClassWeights {
    /// A positive has `positive_weight` times the weight of a negative, where `positives` of `samples` are positive.
    /// (1 − share) / share gives both classes equal weight.
    #[must_use]
    pub fn new(positive_weight: f64, positives: usize, samples: usize) -> Self {
        let share = positives as f64 / samples.max(1) as f64;
        let mean = share * positive_weight + (1.0 - share);
        Self { positive: (positive_weight / mean) as f32, negative: (1.0 / mean) as f32 }
    }

    /// The weight of a sample with this label.
    #[must_use]
    pub fn of(&self, label: u8) -> f32 {
        if label == 1 { self.positive } else { self.negative }
    }
}

/// The same grasp turned by half a turn about its approach (z) axis.
#[must_use]
pub fn half_turn(rotation: Quat) -> Quat {
    rotation * Quat::from_xyzw(0.0, 0.0, 1.0, 0.0)
}

/// The target width; that of a failure does not count.
pub(crate) fn target_width(target: &Target) -> f32 {
    if target.label == 1 { target.width_voxels } else { 0.0 }
}

/// The normalisation of a predicted quaternion (PyTorch's `F.normalize`).
struct Rotation {
    raw: [f32; 4],
    /// Square of the norm, at least [`NORM_SQUARED_MIN`].
    norm_squared: f32,
    is_held: bool,
    norm: f32,
    unit: [f32; 4],
}

impl Rotation {
    fn new(raw: [f32; 4]) -> Self {
        let squared = dot(raw, raw);
        let is_held = squared < NORM_SQUARED_MIN;
        let norm_squared = if is_held { NORM_SQUARED_MIN } else { squared };
        let norm = norm_squared.sqrt();
        Self { raw, norm_squared, is_held, norm, unit: raw.map(|part| part / norm) }
    }

    /// From the gradient of the unit quaternion to that of the raw one.
    fn d_raw(&self, d_unit: [f32; 4]) -> [f32; 4] {
        let norm = self.norm;
        let d_norm = (0..4).map(|at| d_unit[at] * (-self.raw[at] / (norm * norm))).sum::<f32>();
        let d_squared = if self.is_held { 0.0 } else { d_norm * (self.norm_squared.powf(-0.5) / 2.0) };
        std::array::from_fn(|at| {
            let along = d_squared * self.raw[at];
            along + (along + d_unit[at] * (1.0 / norm))
        })
    }
}

fn dot(a: [f32; 4], b: [f32; 4]) -> f32 {
    (0..4).map(|at| a[at] * b[at]).sum()
}

/// Of a target's two orientations the one nearer to a predicted one. (So its product with the prediction has the
/// gradient of the largest product.)
fn nearest(unit: [f32; 4], target: &Target) -> [f32; 4] {
    let (there, turned) = (target.rotation.to_array(), half_turn(target.rotation).to_array());
    if -dot(unit, turned).abs() + 1.0 < -dot(unit, there).abs() + 1.0 { turned } else { there }
}

/// e^−|z|.
#[expect(clippy::disallowed_methods, reason = "the system's, as in every run before: weights keep their bits")]
fn exp_minus_abs(logit: f32) -> f32 {
    (-logit.abs()).exp()
}

/// L_q times the sample's weight.
pub(super) fn quality_loss(logit: f32, target: &Target) -> f32 {
    // −y ln σ(z) − (1 − y) ln(1 − σ(z)) = max(z, 0) − z y + ln(1 + e^−|z|)
    let quality = positive_part(logit, logit) - logit * f32::from(target.label) + exp_minus_abs(logit).ln_1p();
    quality * target.quality_weight // multiplying by 1 changes no bit
}

/// The slope of `weight` times [`quality_loss`].
pub(super) fn quality_slope(logit: f32, target: &Target, weight: f32) -> f32 {
    let d_quality = weight * target.quality_weight;
    let exp = exp_minus_abs(logit);
    let d_exp = d_quality * (1.0 / (exp + 1.0));
    let d_abs = -(d_exp * exp) * sign(logit);
    positive_part(logit, d_quality) + (-d_quality * f32::from(target.label) + d_abs)
}

/// L_r of a predicted unit quaternion xyzw.
pub(super) fn apart(unit: [f32; 4], target: &Target) -> f32 {
    -dot(unit, nearest(unit, target)).abs() + 1.0
}

/// The outputs of the paper's head at a voxel: logit, quaternion before its normalisation, width in voxels.
pub type Outputs = [f32; Head::Quaternion.outputs()];

/// The loss of one sample with these outputs.
#[must_use]
pub fn sample_loss(outputs: &Outputs, target: &Target) -> SampleResult {
    let [logit, x, y, z, w, width] = *outputs;
    let label = f32::from(target.label);
    let quality = quality_loss(logit, target);
    let unit = Rotation::new([x, y, z, w]).unit;
    let rotation = apart(unit, target) * label;
    let off = width - target_width(target);
    let width = off * off * label;
    let total = quality + rotation + width * WIDTH_WEIGHT;
    SampleResult { total, quality, rotation, width, quality_logit: logit, label: target.label, robustness: None }
}

/// The gradient of `weight` · L at the outputs.
#[must_use]
pub fn loss_gradient(outputs: &Outputs, target: &Target, weight: f32) -> Outputs {
    let [logit, x, y, z, w, width] = *outputs;
    let label = f32::from(target.label);
    let d_logit = quality_slope(logit, target, weight);

    let rotation = Rotation::new([x, y, z, w]);
    let nearest = nearest(rotation.unit, target);
    let d_dot = -(weight * label) * sign(dot(rotation.unit, nearest));
    let [dx, dy, dz, dw] = rotation.d_raw(nearest.map(|part| d_dot * part));

    let half = weight * WIDTH_WEIGHT * label * (width - target_width(target));
    [d_logit, dx, dy, dz, dw, half + half]
}

/// `value` where `z` is positive or NaN, else 0: ReLU and its gradient.
fn positive_part(z: f32, value: f32) -> f32 {
    if z.is_nan() || z > 0.0 { value } else { 0.0 }
}

/// −1, 0 or 1; 0 for NaN.
fn sign(z: f32) -> f32 {
    f32::from(i8::from(z > 0.0) - i8::from(z < 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use schema::{Vec3, axis_angle};

    fn heads(logit: f32, rotation: Quat, width: f32) -> Outputs {
        let [x, y, z, w] = rotation.to_array();
        [logit, x, y, z, w, width]
    }

    fn losses(logit: f32, rotation: Quat, width: f32, target: Target) -> [f32; 4] {
        let result = sample_loss(&heads(logit, rotation, width), &target);
        [result.total, result.quality, result.rotation, result.width]
    }

    #[test]
    fn a_half_turn_and_the_quaternions_sign_cost_nothing() {
        let rotation = axis_angle(Vec3::new(0.6, 0.0, 0.8), 1.1);
        let target = Target { tips_voxels: [0.0; 3], label: 1, rotation, width_voxels: 5.0, quality_weight: 1.0 };
        for same in [rotation, -rotation, half_turn(rotation), -half_turn(rotation)] {
            let [_, _, apart, width] = losses(0.0, same, 7.0, target);
            assert!(apart.abs() < 1e-6, "{same}: {apart}");
            assert!((width - 4.0).abs() < 1e-6);
        }
    }

    #[test]
    fn turns_cost_what_is_left_to_the_nearest_half_turn() {
        let rotation = axis_angle(Vec3::new(0.6, 0.0, 0.8), 1.1);
        let target = Target { tips_voxels: [0.0; 3], label: 1, rotation, width_voxels: 5.0, quality_weight: 1.0 };
        for degrees in -360_i32..360 {
            let turned = rotation * axis_angle(Vec3::Z, (degrees as f32).to_radians());
            // Halved, as quaternions have it.
            let left = degrees.rem_euclid(180).min(180 - degrees.rem_euclid(180)) as f32;
            let expected = 1.0 - libm::cosf(0.5 * left.to_radians());
            assert!((losses(0.0, turned, 5.0, target)[2] - expected).abs() < 1e-6, "{degrees}");
        }
        let tilted = losses(0.0, rotation * axis_angle(Vec3::X, 0.4), 5.0, target)[2];
        assert!((tilted - (1.0 - libm::cosf(0.2))).abs() < 1e-6, "the approach counts");
    }

    #[test]
    fn gradients_are_the_slopes_of_the_loss() {
        let rotation = axis_angle(Vec3::new(0.6, 0.0, 0.8), 1.1);
        let target = Target { tips_voxels: [0.0; 3], label: 1, rotation, width_voxels: 5.0, quality_weight: 1.0 };
        for (turn, tilt) in [(0.2, 0.3), (0.7, -0.5), (1.9, 0.1), (-2.6, 0.4)] {
            let heads = heads(0.3, rotation * axis_angle(Vec3::Z, turn) * axis_angle(Vec3::X, tilt), 4.0);
            let gradient = loss_gradient(&heads, &target, 1.0);
            for at in 1..5 {
                let moved = |by: f32| {
                    let mut heads = heads;
                    heads[at] += by;
                    f64::from(sample_loss(&heads, &target).rotation)
                };
                let slope = (moved(2e-3) - moved(-2e-3)) / 4e-3;
                assert!((f64::from(gradient[at]) - slope).abs() < 1e-3, "{turn} {tilt} {at}");
            }
        }
    }

    #[test]
    fn failures_teach_the_quality_only() {
        let target = Target {
            tips_voxels: [0.0; 3],
            label: 0,
            rotation: Quat::IDENTITY,
            width_voxels: f32::NAN,
            quality_weight: 1.0,
        };
        let [total, quality, rotation, width] = losses(0.0, axis_angle(Vec3::X, 1.0), 9.0, target);
        assert_eq!([rotation, width], [0.0, 0.0]);
        assert_eq!(total, quality);
        assert!((quality - core::f32::consts::LN_2).abs() < 1e-6);
    }

    #[test]
    fn the_loss_stays_finite_for_sure_predictions() {
        let sure_and_wrong = Target {
            tips_voxels: [0.0; 3],
            label: 0,
            rotation: Quat::IDENTITY,
            width_voxels: 0.0,
            quality_weight: 1.0,
        };
        let [_, quality, _, _] = losses(200.0, Quat::IDENTITY, 0.0, sure_and_wrong);
        assert!((quality - 200.0).abs() < 1e-3, "{quality}");
    }

    /// Closed form: d(w L_q)/dz = w (σ(z) − y), and the mean weight over the training samples is 1.
    #[test]
    fn a_positives_weight_scales_its_quality_loss_and_gradient() {
        let weights = ClassWeights::new(3.0, 25, 100);
        assert_eq!(weights, ClassWeights { positive: 2.0, negative: 2.0 / 3.0 });
        assert!((0.25 * weights.positive + 0.75 * weights.negative - 1.0).abs() < 1e-6);
        assert_eq!(ClassWeights::new(1.0, 31, 97), ClassWeights { positive: 1.0, negative: 1.0 });
        for (label, logit) in [(0_u8, -1.3_f32), (0, 0.4), (1, -1.3), (1, 0.4)] {
            let weight = weights.of(label);
            let target = Target {
                tips_voxels: [0.0; 3],
                label,
                rotation: Quat::IDENTITY,
                width_voxels: 5.0,
                quality_weight: weight,
            };
            let unweighted = Target { quality_weight: 1.0, ..target };
            let turned = axis_angle(Vec3::X, 0.7);
            let [total, quality, rotation, width] = losses(logit, turned, 7.0, target);
            let [_, quality_1, rotation_1, width_1] = losses(logit, turned, 7.0, unweighted);
            assert_eq!([rotation, width], [rotation_1, width_1]);
            assert!((quality - weight * quality_1).abs() < 1e-6);
            assert!((total - (quality + rotation + WIDTH_WEIGHT * width)).abs() < 1e-6);

            let [gradient, ..] = loss_gradient(&heads(logit, turned, 7.0), &target, 1.0);
            let expected = weight * (1.0 / (1.0 + libm::expf(-logit)) - f32::from(label));
            assert!((gradient - expected).abs() < 1e-6, "{label} {logit}: {gradient} against {expected}");
        }
    }
}
