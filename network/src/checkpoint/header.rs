//! A checkpoint's metadata: one JSON text under one key of the safetensors header. (One key, because the format's
//! writer orders several keys by a hash map, and equal runs must make equal files.)

use std::path::Path;

use program::Failure;
use serde::{Deserialize, Serialize};

use super::{Checkpoint, Progress, damaged, of_another_network};
use crate::upsampling::Upsampling;

/// Version of the checkpoint's layout.
const FORMAT_VERSION: u32 = 1;
/// The name of this crate's network in checkpoints.
pub(crate) const ARCHITECTURE: &str = "vgn-conv-40";

const KEY: &str = "graspmill";
const MADE_BY: &str = concat!("graspmill trainer ", env!("CARGO_PKG_VERSION"));

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Header {
    format_version: u32,
    architecture: String,
    pub(super) upsampling: Upsampling,
    pub(super) dataset_id: String,
    pub(super) config: String,
    pub(super) progress: Progress,
    pub(super) adam_steps: usize,
    made_by: String,
}

/// The keys that decide whether the rest can be understood.
#[derive(Deserialize)]
struct Head {
    format_version: u32,
    architecture: String,
}

#[expect(clippy::disallowed_types, reason = "safetensors takes a HashMap; with one entry there is no order to leak")]
type Metadata = std::collections::HashMap<String, String>;

pub(super) fn write(checkpoint: &Checkpoint) -> Metadata {
    let header = Header {
        format_version: FORMAT_VERSION,
        architecture: ARCHITECTURE.to_owned(),
        upsampling: checkpoint.upsampling,
        dataset_id: checkpoint.dataset_id.clone(),
        config: checkpoint.config.clone(),
        progress: checkpoint.progress,
        adam_steps: checkpoint.moments.as_ref().map_or(0, |moments| moments.steps),
        made_by: MADE_BY.to_owned(),
    };
    let text = serde_json::to_string(&header).unwrap_or_default(); // texts and numbers under fixed keys: cannot fail
    Metadata::from([(KEY.to_owned(), text)])
}

pub(super) fn is_in(metadata: Option<&Metadata>) -> bool {
    metadata.is_some_and(|metadata| metadata.contains_key(KEY))
}

/// The header in the metadata of a file; `path` is for messages.
pub(super) fn read(metadata: Option<&Metadata>, path: &Path) -> Result<Header, Failure> {
    let refused = |problem: String| damaged(problem, path);
    let text = metadata.and_then(|metadata| metadata.get(KEY)).ok_or_else(|| {
        refused(format!(
            "weights without the {KEY:?} header that tells how they were made: not a checkpoint of trainer"
        ))
    })?;
    let broken = |e: serde_json::Error| refused(format!("damaged {KEY:?} header: {e}"));
    let Head { format_version, architecture } = serde_json::from_str(text).map_err(broken)?;
    if architecture != ARCHITECTURE {
        let problem = format!("architecture must be {ARCHITECTURE:?}, got {architecture:?}");
        return Err(of_another_network(&[problem], path));
    }
    if format_version != FORMAT_VERSION {
        return Err(refused(format!("checkpoint format must be {FORMAT_VERSION}, got {format_version}")));
    }
    serde_json::from_str(text).map_err(broken)
}
