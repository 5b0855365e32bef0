//! A checkpoint's metadata: one JSON text under one key of the safetensors header. (One key, because the format's
//! writer orders several keys by a hash map, and equal runs must make equal files.)

use std::path::Path;

use program::Failure;
use serde::{Deserialize, Serialize};

use super::{Checkpoint, Progress, damaged, of_another_network};
use crate::head::Head;
use crate::judge::Scope;
use crate::upsampling::Upsampling;
use crate::{Architecture, BEHIND_TIPS_M_MAX, GraspOrigin, VoxelParams};

/// Version of the checkpoint's layout.
const FORMAT_VERSION: u32 = 1;
/// The names of the networks in checkpoints.
const VOXEL: &str = "vgn-conv-40";
const CLOSINGS: &str = "closings-conv-40";
const JUDGE: &str = "hand-judge-1";

pub(super) const KEY: &str = "graspmill";
/// What stands in place of a file's digest while that is taken.
pub(super) const BLANK: &str = "0000000000000000000000000000000000000000000000000000000000000000";
const MADE_BY: &str = concat!("graspmill trainer ", env!("CARGO_PKG_VERSION"));

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Stored {
    /// SHA-256 of the file in hex, with [`BLANK`] in its own place; older checkpoints do not say it. First, so that
    /// nothing like it comes before it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) file_sha256: Option<String>,
    format_version: u32,
    architecture: String,
    /// Of the paper's network.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    upsampling: Option<Upsampling>,
    /// Of the paper's network where it is not [`GraspOrigin::TIPS`], which checkpoints have that do not say it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    origin_behind_tips_m: Option<f32>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    voxel_offset: Option<f32>,
    /// Of a judge.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    trained_for: Option<Box<Scope>>,
    pub(super) dataset_id: String,
    pub(super) config: String,
    pub(super) progress: Progress,
    pub(super) adam_steps: usize,
    made_by: String,
}

/// The keys that decide whether the rest can be understood.
#[derive(Deserialize)]
struct Version {
    format_version: u32,
    architecture: String,
}

#[expect(clippy::disallowed_types, reason = "safetensors takes a HashMap; with one entry there is no order to leak")]
type Metadata = std::collections::HashMap<String, String>;

pub(super) fn write(checkpoint: &Checkpoint) -> Metadata {
    let (architecture, voxel, trained_for) = match &checkpoint.architecture {
        Architecture::Voxel(params) => (name_of(params.head), Some(*params), None),
        Architecture::Judge(scope) => (JUDGE, None, Some(scope.clone())),
    };
    let unusual = |value: fn(GraspOrigin) -> f32| {
        voxel.map(|params| value(params.origin)).filter(|own| *own != value(GraspOrigin::TIPS))
    };
    let header = Stored {
        file_sha256: Some(BLANK.to_owned()),
        format_version: FORMAT_VERSION,
        architecture: architecture.to_owned(),
        upsampling: voxel.map(|params| params.upsampling),
        origin_behind_tips_m: unusual(|origin| origin.behind_tips_m),
        voxel_offset: unusual(|origin| origin.voxel_offset),
        trained_for,
        dataset_id: checkpoint.dataset_id.clone(),
        config: checkpoint.config.clone(),
        progress: checkpoint.progress,
        adam_steps: checkpoint.moments.as_ref().map_or(0, |moments| moments.steps),
        made_by: MADE_BY.to_owned(),
    };
    let text = serde_json::to_string(&header).unwrap_or_default(); // texts and numbers under fixed keys: cannot fail
    Metadata::from([(KEY.to_owned(), text)])
}

/// The name of a network of voxels.
const fn name_of(head: Head) -> &'static str {
    match head {
        Head::Quaternion => VOXEL,
        Head::Closings => CLOSINGS,
    }
}

/// The network that the metadata of a file names, and the header there; `path` is for messages.
pub(super) fn read(metadata: Option<&Metadata>, path: &Path) -> Result<(Architecture, Stored), Failure> {
    let refused = |problem: String| damaged(problem, path);
    let text = metadata.and_then(|metadata| metadata.get(KEY)).ok_or_else(|| {
        refused(format!(
            "weights without the {KEY:?} header that says how they were made: not a checkpoint of trainer; in Python, \
             graspmill.torch.VoxelNetwork.load(FILE).save(NEW) makes one of VGN's weights"
        ))
    })?;
    let broken = |e: serde_json::Error| refused(format!("damaged {KEY:?} header: {e}"));
    let Version { format_version, architecture }: Version = serde_json::from_str(text).map_err(broken)?;
    if ![VOXEL, CLOSINGS, JUDGE].contains(&architecture.as_str()) {
        let problem = format!("architecture must be {VOXEL:?}, {CLOSINGS:?} or {JUDGE:?}, got {architecture:?}");
        return Err(of_another_network(&[problem], path));
    }
    if format_version != FORMAT_VERSION {
        return Err(refused(format!("checkpoint format must be {FORMAT_VERSION}, got {format_version}")));
    }
    let mut stored: Stored = serde_json::from_str(text).map_err(broken)?;
    let head = Head::ALL.into_iter().find(|head| name_of(*head) == architecture);
    let architecture = match (head, stored.upsampling, stored.trained_for.take()) {
        (Some(head), Some(upsampling), None) => {
            let origin = GraspOrigin {
                behind_tips_m: stored.origin_behind_tips_m.unwrap_or(GraspOrigin::TIPS.behind_tips_m),
                voxel_offset: stored.voxel_offset.unwrap_or(GraspOrigin::TIPS.voxel_offset),
            };
            if !(0.0..=BEHIND_TIPS_M_MAX).contains(&origin.behind_tips_m) || !(0.0..=1.0).contains(&origin.voxel_offset)
            {
                return Err(refused(format!("damaged {KEY:?} header: {origin:?} is no place of a grasp's origin")));
            }
            Architecture::Voxel(VoxelParams { head, upsampling, origin })
        }
        (None, None, Some(scope)) => Architecture::Judge(scope),
        _ => {
            return Err(refused(format!(
                "damaged {KEY:?} header: {architecture:?} has upsampling, a judge trained_for"
            )));
        }
    };
    Ok((architecture, stored))
}
