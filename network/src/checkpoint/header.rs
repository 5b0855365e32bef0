//! A checkpoint's metadata: one JSON text under one key of the safetensors header. (One key, because the format's
//! writer orders several keys by a hash map, and equal runs must make equal files.)

use serde::{Deserialize, Serialize};

use super::Checkpoint;
use crate::upsampling::Upsampling;

/// Version of the checkpoint's layout.
pub const FORMAT_VERSION: u32 = 1;
/// The name of this crate's network in checkpoints.
pub const ARCHITECTURE: &str = "vgn-conv-40";

const KEY: &str = "graspmill";
const MADE_BY: &str = concat!("graspmill trainer ", env!("CARGO_PKG_VERSION"));

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct HeaderJson {
    format_version: u32,
    architecture: String,
    upsampling: String,
    dataset_id: String,
    config: String,
    progress: Progress,
    adam_steps: usize,
    made_by: String,
}

/// The progress of training when the checkpoint was written. Floats are stored as bit patterns, because a resumed epoch
/// must continue with exactly the same sums.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Progress {
    /// Epochs done.
    pub epoch: u32,
    /// Batches done in the current epoch.
    pub batch: u32,
    /// Total number of steps.
    pub step: u64,
    /// Predictions against labels in the current epoch.
    pub confusion: Confusion,
    /// Sums of the losses in the current epoch, as bits of `f64`.
    pub sums_bits: [u64; 4],
    /// Best accuracy of the test set so far, as bits of `f64`.
    pub best_accuracy_bits: Option<u64>,
}

/// True and false positives and negatives.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Confusion {
    /// Held, and predicted to hold.
    pub true_positive: u64,
    /// Failed, but predicted to hold.
    pub false_positive: u64,
    /// Failed, and predicted to fail.
    pub true_negative: u64,
    /// Held, but predicted to fail.
    pub false_negative: u64,
}

/// The keys that decide whether the rest can be understood.
#[derive(Deserialize)]
struct HeadJson {
    format_version: u32,
    architecture: String,
}

/// What a header holds.
pub(super) struct Header {
    pub(super) upsampling: Upsampling,
    pub(super) dataset_id: String,
    pub(super) config: String,
    pub(super) progress: Progress,
    pub(super) adam_steps: usize,
}

/// Why a header is refused.
pub(super) enum HeaderProblem {
    /// Another network.
    Architecture(String),
    /// Anything else.
    Other(String),
}

#[expect(clippy::disallowed_types, reason = "safetensors takes a HashMap; with one entry there is no order to leak")]
type Metadata = std::collections::HashMap<String, String>;

pub(super) fn write(checkpoint: &Checkpoint) -> Metadata {
    let json = HeaderJson {
        format_version: FORMAT_VERSION,
        architecture: ARCHITECTURE.to_owned(),
        upsampling: checkpoint.upsampling.name().to_owned(),
        dataset_id: checkpoint.dataset_id.clone(),
        config: checkpoint.config.clone(),
        progress: checkpoint.progress,
        adam_steps: checkpoint.moments.as_ref().map_or(0, |moments| moments.steps),
        made_by: MADE_BY.to_owned(),
    };
    let text = serde_json::to_string(&json).unwrap_or_default(); // texts and numbers under fixed keys: cannot fail
    Metadata::from([(KEY.to_owned(), text)])
}

pub(super) fn is_in(metadata: Option<&Metadata>) -> bool {
    metadata.is_some_and(|metadata| metadata.contains_key(KEY))
}

pub(super) fn read(metadata: Option<&Metadata>) -> Result<Header, HeaderProblem> {
    let other = HeaderProblem::Other;
    let text = metadata.and_then(|metadata| metadata.get(KEY)).ok_or_else(|| {
        other(format!("weights without the {KEY:?} header that tells how they were made: not a checkpoint of trainer"))
    })?;
    let damaged = |e: serde_json::Error| other(format!("damaged {KEY:?} header: {e}"));
    let head: HeadJson = serde_json::from_str(text).map_err(damaged)?;
    if head.architecture != ARCHITECTURE {
        let problem = format!("architecture must be {ARCHITECTURE:?}, got {:?}", head.architecture);
        return Err(HeaderProblem::Architecture(problem));
    }
    if head.format_version != FORMAT_VERSION {
        let problem = format!("checkpoint format must be {FORMAT_VERSION}, got {}", head.format_version);
        return Err(other(problem));
    }
    let json: HeaderJson = serde_json::from_str(text).map_err(damaged)?;
    let upsampling = Upsampling::from_name(&json.upsampling);
    Ok(Header {
        upsampling: upsampling.ok_or_else(|| other(format!("unknown upsampling {:?}", json.upsampling)))?,
        dataset_id: json.dataset_id,
        config: json.config,
        progress: json.progress,
        adam_steps: json.adam_steps,
    })
}
