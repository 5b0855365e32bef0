//! What a step of training and a test give for each sample, whichever the method.

use rayon::prelude::*;

use crate::batch::Sample;

/// The losses of a sample and the network's prediction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SampleResult {
    /// Eq. 5; of a judge the quality's.
    pub total: f32,
    /// Eq. 2, times the sample's weight; of a judge the cross-entropy of the outcomes.
    pub quality: f32,
    /// Eq. 3 and 4; 0 for failures, and of a judge.
    pub rotation: f32,
    /// Squared error of the width in voxels; 0 for failures, and of a judge.
    pub width: f32,
    /// Logit of the predicted grasp quality: a success is predicted where it is above 0.
    pub quality_logit: f32,
    /// The true label.
    pub label: u8,
    /// Of a judge, where the attempt was repeated: the share of repeats that is expected to hold, and the true one.
    pub robustness: Option<[f32; 2]>,
}

/// A sample of a set and its result, in memory for each.
pub type Found<D> = (Sample<D>, SampleResult);

/// The gradient of a batch's mean loss, and the results of its samples, in the batch's order.
#[derive(Debug, Clone)]
pub struct StepResult {
    /// Gradient in the order of the flat parameter vector.
    pub gradient: Vec<f32>,
    /// One result per sample.
    pub samples: Vec<SampleResult>,
}

/// Adds the gradients of parts, each value in the order of parts.
pub(crate) fn sum(parameters: usize, parts: Vec<StepResult>) -> StepResult {
    let mut gradient = vec![-0.0; parameters]; // adding to −0 changes no bit of a number
    let chunk = parameters.div_ceil(64);
    gradient.par_chunks_mut(chunk).enumerate().for_each(|(number, sum)| {
        for part in &parts {
            for (sum, more) in sum.iter_mut().zip(&part.gradient[number * chunk..]) {
                *sum += more;
            }
        }
    });
    StepResult { gradient, samples: parts.into_iter().flat_map(|part| part.samples).collect() }
}
