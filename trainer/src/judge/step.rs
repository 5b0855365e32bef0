//! The judge's loss and its gradient over a batch: the cross-entropy of the outcomes, unweighted, so that their
//! probabilities are calibrated, and, for attempts that were repeated, that of the share that held.
//!
//! Where arithmetic knows that the gripper hits the table, the network is not asked: the attempt fails, without a loss.

use network::judge::{
    Crop, JudgeActivations, JudgeInputs, JudgeNetwork, OUTCOMES, OUTPUTS, PaddedGrid, probabilities, quality_logit,
    robustness,
};
use rayon::prelude::*;
use schema::Vec3;

use super::sample::{JudgeSample, Sample};
use crate::batch::Batch;
use crate::results::sum;
use crate::results::{SampleResult, StepResult};

/// Samples of a part of a batch, which one thread computes. It does not depend on the number of threads, so neither do
/// results.
const PART: usize = 32;
/// The logit of a quality of 0, for grasps at which the gripper hits the table.
const NEVER: f32 = -30.0;

/// Loss and gradient of a batch; at no grasp of it may the gripper hit the table.
#[must_use]
pub fn step(vector: &[f32], batch: &Batch<JudgeSample>, crops: &[Crop]) -> StepResult {
    let network = JudgeNetwork::new(vector);
    let transposed = network.transposed();
    let weight = 1.0 / batch.samples.len() as f32;
    let parts = batch.samples.par_chunks(PART).map(|samples| {
        let inputs = inputs(batch, samples, crops);
        let seen = network.forward(&inputs);
        let d_logits: Vec<_> = seen.logits().zip(samples).map(|(logits, own)| d_loss(&logits, own, weight)).collect();
        StepResult {
            gradient: network.gradient(&transposed, &inputs, &seen, &d_logits),
            samples: results(&seen, samples).collect(),
        }
    });
    sum(vector.len(), parts.collect())
}

/// Losses and predictions of a batch, without a gradient.
#[must_use]
pub fn evaluate(vector: &[f32], batch: &Batch<JudgeSample>, crops: &[Crop]) -> Vec<SampleResult> {
    let network = JudgeNetwork::new(vector);
    let parts = batch.samples.par_chunks(PART).map(|samples| {
        let asked: Vec<Sample> = samples.iter().filter(|sample| !sample.data.hits_table).copied().collect();
        let certain = |sample: &Sample| result(0.0, NEVER, None, sample);
        if asked.is_empty() {
            return samples.iter().map(certain).collect();
        }
        let seen = network.forward(&inputs(batch, &asked, crops));
        let mut asked = results(&seen, &asked);
        let mut answer = |sample: &Sample| if sample.data.hits_table { None } else { asked.next() };
        samples.iter().map(|sample| answer(sample).unwrap_or_else(|| certain(sample))).collect::<Vec<_>>()
    });
    parts.collect::<Vec<_>>().concat()
}

/// What the network sees of samples, which are in the order of their grids.
fn inputs(batch: &Batch<JudgeSample>, asked: &[Sample], crops: &[Crop]) -> JudgeInputs {
    let mut inputs = JudgeInputs::with_capacity(asked.len());
    for own in asked.chunk_by(|a, b| a.grid == b.grid) {
        let values = &batch.grids[own[0].grid];
        let side = (values.len() as f64).cbrt().round() as usize;
        let grid = PaddedGrid::new(Vec3::ZERO, [side; 3], values);
        for JudgeSample { workspace_from_grasp, views, mirrored, crop, .. } in own.iter().map(|sample| sample.data) {
            inputs.push(&crops[crop as usize], &grid, &workspace_from_grasp, views.into(), mirrored);
        }
    }
    inputs
}

fn results(seen: &JudgeActivations, samples: &[Sample]) -> impl Iterator<Item = SampleResult> {
    seen.logits().zip(samples).map(|(logits, sample)| {
        let loss = -libm::logf(probabilities(&logits)[sample.data.outcome as usize].max(f32::MIN_POSITIVE));
        let robustness = sample.data.robustness.map(|share| [robustness(&logits), share]);
        // Propagate NaN, so that training detects divergence.
        let loss = if logits.iter().all(|logit| logit.is_finite()) { loss } else { f32::NAN };
        result(loss, quality_logit(&logits), robustness, sample)
    })
}

fn result(loss: f32, quality_logit: f32, robustness: Option<[f32; 2]>, sample: &Sample) -> SampleResult {
    let label = sample.data.outcome.label();
    SampleResult { total: loss, quality: loss, rotation: 0.0, width: 0.0, quality_logit, label, robustness }
}

/// The gradient of `weight` times the cross-entropies at the logits.
fn d_loss(logits: &[f32; OUTPUTS], sample: &Sample, weight: f32) -> [f32; OUTPUTS] {
    let mut d = [0.0; OUTPUTS];
    d[..OUTCOMES].copy_from_slice(&probabilities(logits).map(|probability| weight * probability));
    d[sample.data.outcome as usize] -= weight;
    d[OUTCOMES] = sample.data.robustness.map_or(0.0, |share| weight * (robustness(logits) - share));
    d
}
