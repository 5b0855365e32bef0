//! The loss of the head by closing ([`network::head`]), and its gradient.
//!
//! For a sample with label y, approach a, turn φ, width w and tips t, and a voxel's answer:
//!
//! - `L_q`: Eq. 2 with the quality at the turn that was tried;
//! - `L_a = 1 − â·a`;
//! - `L_φ`: the cross-entropy of the histogram with the two turns nearest to φ;
//! - `L_w = (ŵ(φ) − w)²` and `L_t = |t̂ − t|²`, in voxels;
//! - `L = L_q + y (L_a + 0.3 L_φ + k L_w + 0.03 L_t)` with the paper's k of 0.01.

use network::head::{ClosingsHead, TURNS, shares_of, turn_of, waves};
use schema::Vec3;

use super::loss::{Target, WIDTH_WEIGHT, apart, quality_loss, quality_slope, target_width};
use crate::results::SampleResult;

/// Weight of L_φ.
pub const TURN_WEIGHT: f32 = 0.3;
/// Weight of L_t.
pub const TIPS_WEIGHT: f32 = 0.03;

/// The loss of one sample with this answer.
#[must_use]
pub fn sample_loss(head: &ClosingsHead, target: &Target) -> SampleResult {
    let turn_rad = turn_of(target.rotation);
    let quality_logit = head.quality_logit(turn_rad);
    let quality = quality_loss(quality_logit, target);
    let predicted = head.answer().rotation;
    let (mut total, mut rotation, mut width) = (quality, 0.0, 0.0);
    if target.label == 1 {
        let off = head.width_voxels(turn_rad) - target_width(target);
        (rotation, width) = (apart(predicted, target), off * off);
        let approach = 1.0 - head.approach().0.dot(target.rotation * Vec3::Z);
        let shares = shares_of(turn_rad);
        // Far below what single precision tells from 0.
        let surprise: f32 = shares.iter().zip(head.shares()).map(|(to, own)| -to * libm::logf(own.max(1e-30))).sum();
        let tips: f32 = head.tips_voxels.iter().zip(target.tips_voxels).map(|(own, to)| (own - to) * (own - to)).sum();
        total += approach + TURN_WEIGHT * surprise + WIDTH_WEIGHT * width + TIPS_WEIGHT * tips;
    }
    SampleResult { total, quality, rotation, width, quality_logit, label: target.label, robustness: None }
}

/// The gradient of `weight` · L at the outputs.
#[must_use]
pub fn loss_gradient(head: &ClosingsHead, target: &Target, weight: f32) -> [f32; ClosingsHead::OUTPUTS] {
    let turn_rad = turn_of(target.rotation);
    let waves = waves(turn_rad);
    let d_quality = quality_slope(head.quality_logit(turn_rad), target, weight);
    let mut d = ClosingsHead {
        quality: waves.map(|wave| d_quality * wave),
        approach: [0.0; 3],
        turns: [0.0; TURNS],
        width_voxels: [0.0; 3],
        tips_voxels: [0.0; 3],
    };
    if target.label == 1 {
        let (approach, length) = head.approach();
        let to = target.rotation * Vec3::Z;
        d.approach = ((approach * approach.dot(to) - to) * (weight / length)).to_array();
        let (own, shares) = (head.shares(), shares_of(turn_rad));
        d.turns = core::array::from_fn(|at| weight * TURN_WEIGHT * (own[at] - shares[at]));
        let off = head.width_voxels(turn_rad) - target_width(target);
        d.width_voxels = waves.map(|wave| 2.0 * weight * WIDTH_WEIGHT * off * wave);
        let (own, to) = (head.tips_voxels, target.tips_voxels);
        d.tips_voxels = core::array::from_fn(|at| 2.0 * weight * TIPS_WEIGHT * (own[at] - to[at]));
    }
    d.outputs()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use schema::axis_angle;

    use super::*;

    /// L in double precision, by the formulas of the head, with turns from the angle between closing directions.
    fn slow(outputs: &[f64], target: &Target) -> f64 {
        let rotation = target.rotation;
        let turn = f64::from(turn_of(rotation));
        let at_turn = |from: usize| {
            outputs[from] + outputs[from + 1] * libm::cos(2.0 * turn) + outputs[from + 2] * libm::sin(2.0 * turn)
        };
        let (logit, label) = (at_turn(0), f64::from(target.label));
        let quality = libm::log1p(libm::exp(-logit.abs())) + logit.max(0.0) - logit * label;
        let mut total = f64::from(target.quality_weight) * quality;
        if target.label == 1 {
            let length = libm::sqrt(outputs[3..6].iter().map(|part| part * part).sum());
            let approach = (rotation * Vec3::Z).to_array();
            total +=
                1.0 - outputs[3..6].iter().zip(approach).map(|(own, to)| own * f64::from(to)).sum::<f64>() / length;
            let logits = &outputs[6..6 + TURNS];
            let sum: f64 = logits.iter().map(|logit| libm::exp(*logit)).sum();
            let shares = shares_of(turn as f32);
            total += 0.3 * shares.iter().zip(logits).map(|(to, z)| f64::from(*to) * (libm::log(sum) - z)).sum::<f64>();
            let off = at_turn(6 + TURNS) - f64::from(target.width_voxels);
            total += 0.01 * off * off;
            let tips = outputs[9 + TURNS..].iter().zip(target.tips_voxels);
            total += 0.03 * tips.map(|(own, to)| (own - f64::from(to)) * (own - f64::from(to))).sum::<f64>();
        }
        total
    }

    proptest! {
        #[test]
        fn losses_are_those_of_the_formulas_and_gradients_their_slopes(
            outputs in prop::collection::vec(-3.0_f64..3.0, ClosingsHead::OUTPUTS),
            axis in prop::array::uniform3(-1.0_f32..1.0),
            angle in -3.0_f32..3.0,
            (label, width_voxels, quality_weight) in (0_u8..2, 1.0_f32..10.0, 0.2_f32..3.0),
            tips_voxels in prop::array::uniform3(-7.0_f32..7.0),
        ) {
            prop_assume!(outputs[3..6].iter().map(|part| part * part).sum::<f64>() > 0.2);
            let rotation = axis_angle(Vec3::from_array(axis).normalize_or(Vec3::X), angle);
            let target = Target { label, rotation, width_voxels, tips_voxels, quality_weight };
            let single: Vec<f32> = outputs.iter().map(|value| *value as f32).collect();
            let head = ClosingsHead::new(&single);
            let expected = slow(&outputs, &target);
            prop_assert!((f64::from(sample_loss(&head, &target).total) - expected).abs() < 1e-4 * (1.0 + expected));
            for (at, own) in loss_gradient(&head, &target, 0.5).into_iter().enumerate() {
                let moved = |by: f64| {
                    let mut outputs = outputs.clone();
                    outputs[at] += by;
                    slow(&outputs, &target)
                };
                let slope = 0.5 * (moved(1e-5) - moved(-1e-5)) / 2e-5;
                prop_assert!((f64::from(own) - slope).abs() < 1e-4 * (1.0 + slope.abs()), "{at}: {own} {slope}");
            }
        }
    }

    #[test]
    fn the_histogram_of_the_targets_turn_costs_least() {
        let rotation = network::head::grasp_rotation(-Vec3::Z, 0.7);
        let target = Target { label: 1, rotation, width_voxels: 5.0, tips_voxels: [0.0; 3], quality_weight: 1.0 };
        let head = ClosingsHead {
            quality: [0.0; 3],
            approach: [0.0, 0.0, -1.0],
            turns: shares_of(0.7).map(|share| libm::logf(share.max(1e-9))),
            width_voxels: [5.0, 0.0, 0.0],
            tips_voxels: [0.0; 3],
        };
        let gradient = loss_gradient(&head, &target, 1.0);
        assert!(gradient[3..].iter().all(|slope| slope.abs() < 1e-4), "{gradient:?}");
    }
}
