//! The judge's loss and its gradient over a batch: the cross-entropy of the outcomes, unweighted, so that their
//! probabilities are calibrated.
//!
//! Where arithmetic knows that the hand hits the table, the network is not asked: the attempt fails, without a loss.

use network::judge::{
    Crop, JudgeActivations, JudgeInputs, JudgeNetwork, OUTCOMES, PaddedGrid, probabilities, quality_logit,
};
use network::receptive_field::RESOLUTION;
use rayon::prelude::*;

use crate::batch::{Batch, Hand, Sample};
use crate::loss::SampleResult;
use crate::step::{StepResult, sum};

/// Samples of a part of a batch, which one thread computes. It does not depend on the number of threads, so neither do
/// results.
const PART: usize = 32;
/// The logit of a quality of 0, for hands that hit the table.
const NEVER: f32 = -30.0;

/// Loss and gradient of a batch; no hand of it may hit the table.
#[must_use]
pub fn step(vector: &[f32], batch: &Batch, crops: &[Crop]) -> StepResult {
    let network = JudgeNetwork::new(vector);
    let transposed = network.transposed();
    let weight = 1.0 / batch.samples.len() as f32;
    let parts = by_parts(batch, |samples, hands| {
        let asked: Vec<(&Sample, &Hand)> = samples.iter().zip(hands).collect();
        let inputs = inputs(batch, &asked, crops);
        let seen = network.forward(&inputs);
        let d_logits: Vec<[f32; OUTCOMES]> =
            seen.logits().zip(hands).map(|(logits, hand)| d_loss(&logits, hand, weight)).collect();
        StepResult {
            gradient: network.gradient(&transposed, &inputs, &seen, &d_logits),
            samples: results(&seen, hands.iter()).collect(),
        }
    });
    sum(vector.len(), parts)
}

/// Losses and predictions of a batch, without a gradient.
#[must_use]
pub fn evaluate(vector: &[f32], batch: &Batch, crops: &[Crop]) -> Vec<SampleResult> {
    let network = JudgeNetwork::new(vector);
    let parts = by_parts(batch, |samples, hands| {
        let asked: Vec<(&Sample, &Hand)> = samples.iter().zip(hands).filter(|(_, hand)| !hand.hits_table).collect();
        if asked.is_empty() {
            return hands.iter().map(certain).collect();
        }
        let seen = network.forward(&inputs(batch, &asked, crops));
        let mut asked = results(&seen, asked.iter().map(|(_, hand)| *hand));
        hands
            .iter()
            .map(|hand| if hand.hits_table { certain(hand) } else { asked.next().unwrap_or_else(|| certain(hand)) })
            .collect::<Vec<_>>()
    });
    parts.concat()
}

/// What arithmetic alone says of each hand ([`Crop::clearance`]); the least for hands that hit the table.
#[must_use]
pub fn clearances(batch: &Batch, crops: &[Crop]) -> Vec<f32> {
    let parts = by_parts(batch, |samples, hands| {
        let asked: Vec<(&Sample, &Hand)> = samples.iter().zip(hands).collect();
        let seen = inputs(batch, &asked, crops);
        let clearances = seen.crops.chunks_exact(Crop::LEN).zip(hands);
        let clearance = |(crop, hand): (&[f32], &Hand)| if hand.hits_table { NEVER } else { Crop::clearance(crop) };
        clearances.map(clearance).collect::<Vec<f32>>()
    });
    parts.concat()
}

fn by_parts<T: Send>(batch: &Batch, work: impl Fn(&[Sample], &[Hand]) -> T + Sync) -> Vec<T> {
    let parts = batch.samples.par_chunks(PART).zip(batch.hands.par_chunks(PART));
    parts.map(|(samples, hands)| work(samples, hands)).collect()
}

/// What the network sees of samples, which are in the order of their grids.
fn inputs(batch: &Batch, asked: &[(&Sample, &Hand)], crops: &[Crop]) -> JudgeInputs {
    let mut inputs = JudgeInputs::with_capacity(asked.len());
    for own in asked.chunk_by(|(a, _), (b, _)| a.grid == b.grid) {
        let grid = PaddedGrid::new(RESOLUTION, &batch.grids[own[0].0.grid]);
        for (_, Hand { workspace_from_grasp, views, mirrored, crop, .. }) in own {
            inputs.push(&crops[*crop], &grid, workspace_from_grasp, *views, *mirrored);
        }
    }
    inputs
}

fn results<'a>(
    seen: &'a JudgeActivations,
    hands: impl Iterator<Item = &'a Hand>,
) -> impl Iterator<Item = SampleResult> {
    seen.logits().zip(hands).map(|(logits, hand)| {
        let loss = -libm::logf(probabilities(&logits)[hand.outcome as usize].max(f32::MIN_POSITIVE));
        // Propagate NaN, so that training detects divergence.
        let loss = if logits.iter().all(|logit| logit.is_finite()) { loss } else { f32::NAN };
        result(loss, quality_logit(&logits), hand)
    })
}

fn certain(hand: &Hand) -> SampleResult {
    result(0.0, NEVER, hand)
}

fn result(loss: f32, quality_logit: f32, hand: &Hand) -> SampleResult {
    let label = hand.outcome.label();
    SampleResult { total: loss, quality: loss, rotation: 0.0, width: 0.0, quality_logit, predicted: None, label }
}

/// The gradient of `weight` times the cross-entropy at the logits.
fn d_loss(logits: &[f32; OUTCOMES], hand: &Hand, weight: f32) -> [f32; OUTCOMES] {
    let mut d = probabilities(logits).map(|probability| weight * probability);
    d[hand.outcome as usize] -= weight;
    d
}
