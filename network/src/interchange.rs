//! Weights from and to other programs, as safetensors.
//!
//! PyTorch's own files are pickles, which only PyTorch reads well; `graspmill.torch` reads them there and writes
//! safetensors. The Python package writes ONNX.

mod state_dict;

use std::ffi::OsStr;
use std::fs;
use std::io;
use std::path::Path;

use program::{Context as _, ExitCode, Failure};
use safetensors::SafeTensors;

use crate::checkpoint::{self, Checkpoint, Progress};
use crate::head::Head;
use crate::upsampling::Upsampling;
use crate::{Architecture, BEHIND_TIPS_M_MAX, GraspOrigin, VoxelParams};

use state_dict::Parameters;

/// Maximum file size: the weights have 1.25 MB, and fifty times that is no state dict of this network.
const FILE_LEN_MAX: u64 = 64 << 20;
/// Replaces a dataset's id, which is a SHA-256 and therefore never equal to this.
pub const IMPORTED: &str = "unknown (imported weights)";

/// Imported weights.
#[derive(Debug, Clone)]
pub struct Imported {
    /// The weights; recipe and dataset record their origin.
    pub checkpoint: Checkpoint,
    /// The prefix that was removed from every name, such as `module.`.
    pub prefix: String,
    /// Number types that were converted to float32.
    pub converted_from: Vec<&'static str>,
}

/// What is said about imported weights that the weights themselves do not tell. What is not said is taken from the
/// metadata of a safetensors file that has it (`graspmill.torch` writes it), or else is VGN's.
#[derive(Debug, Clone, Copy, Default)]
pub struct GivenParams {
    /// How the decoder doubles its grids.
    pub upsampling: Option<Upsampling>,
    /// [`GraspOrigin::behind_tips_m`].
    pub origin_behind_tips_m: Option<f32>,
    /// [`GraspOrigin::voxel_offset`].
    pub voxel_offset: Option<f32>,
}

impl GivenParams {
    fn with_metadata(self, bytes: &[u8], head: Head) -> VoxelParams {
        let metadata = SafeTensors::read_metadata(bytes).ok().and_then(|(_, metadata)| metadata.metadata().clone());
        let said = |key: &str| metadata.as_ref().and_then(|said| said.get(key));
        let number = |key: &str, most: f32| {
            said(key).and_then(|text| text.parse::<f32>().ok()).filter(|value| (0.0..=most).contains(value))
        };
        let Self { upsampling, origin_behind_tips_m, voxel_offset } = self;
        let named = || said("upsampling").and_then(|name| Upsampling::from_name(name));
        let behind_tips_m = origin_behind_tips_m.or_else(|| number("origin_behind_tips_m", BEHIND_TIPS_M_MAX));
        let voxel_offset = voxel_offset.or_else(|| number("voxel_offset", 1.0));
        VoxelParams {
            head,
            upsampling: upsampling.or_else(named).unwrap_or(Upsampling::Nearest),
            origin: GraspOrigin {
                behind_tips_m: behind_tips_m.unwrap_or(GraspOrigin::VGN.behind_tips_m),
                voxel_offset: voxel_offset.unwrap_or(GraspOrigin::VGN.voxel_offset),
            },
        }
    }
}

/// Converts weights of VGN's network from another program to a checkpoint. `force` replaces `out`.
///
/// # Errors
/// If the file cannot be read or has no weights of this network, or `out` cannot be written. Then nothing is written.
pub fn import(file: &Path, out: &Path, given: GivenParams, force: bool) -> Result<Imported, Failure> {
    let bytes = read_bounded(file)?;
    let Parameters { head, values, prefix, converted_from } = read_weights(&bytes, file)?;
    let checkpoint = Checkpoint {
        vector: values,
        architecture: Architecture::Voxel(given.with_metadata(&bytes, head)),
        config: provenance(file.file_name().unwrap_or_default(), &bytes),
        dataset_id: IMPORTED.to_owned(),
        progress: Progress::default(),
        moments: None,
    };
    prepare(out, force)?;
    checkpoint::save(&checkpoint, out)?;
    Ok(Imported { checkpoint, prefix, converted_from })
}

/// Writes a checkpoint without the optimiser's moments, whose weights have VGN's names, and returns it. `force`
/// replaces `out`.
///
/// # Errors
/// If the file is no checkpoint or `out` cannot be written. Then nothing is written.
pub fn export(file: &Path, out: &Path, force: bool) -> Result<Checkpoint, Failure> {
    let checkpoint = Checkpoint { moments: None, ..checkpoint::read(file)? };
    prepare(out, force)?;
    checkpoint::save(&checkpoint, out)?;
    Ok(checkpoint)
}

/// The origin of imported weights, in place of the recipe.
fn provenance(name: &OsStr, bytes: &[u8]) -> String {
    let sha256 = checkpoint::digest(bytes);
    let name = name.to_string_lossy();
    let facts = [("file", name.as_ref()), ("format", "safetensors"), ("sha256", &sha256)];
    let imported: toml::Table = facts.into_iter().map(|(key, value)| (key.to_owned(), value.into())).collect();
    let table = toml::Table::from_iter([("imported".to_owned(), imported.into())]);
    format!("# Weights of another program; the recipe that made them is not known.\n{table}")
}

/// The weights in a safetensors file.
fn read_weights(bytes: &[u8], path: &Path) -> Result<Parameters, Failure> {
    let unsupported = |problem: &str| {
        let text = format!("not a state dict that can be read: {problem}: {}", path.display());
        Err(Failure::new(ExitCode::Config, text))
    };
    if checkpoint::has_header(bytes) {
        return unsupported("it is a checkpoint of trainer already, which needs no import");
    }
    if bytes.get(8) != Some(&b'{') {
        return unsupported(what_else(bytes));
    }
    let damaged = |error| checkpoint::damaged(format_args!("damaged weights: {error}"), path);
    let file = SafeTensors::deserialize(bytes).map_err(damaged)?;
    let parameters = state_dict::parameters(&file.tensors().into_iter().collect());
    parameters.map_err(|problems| checkpoint::of_another_network(&problems, path))
}

fn what_else(bytes: &[u8]) -> &'static str {
    if [&b"PK\x03\x04"[..], b"\x80"].iter().any(|of_pytorch| bytes.starts_with(of_pytorch)) {
        "PyTorch writes such files, and reads them; to convert, in Python: \
         graspmill.torch.VoxelNetwork.load(FILE).save(\"weights.safetensors\")"
    } else {
        "it is no safetensors file"
    }
}

fn read_bounded(path: &Path) -> Result<Vec<u8>, Failure> {
    let shown = path.display();
    let refused = |what: &str| Failure::new(ExitCode::Config, format!("{what}: {shown}"));
    match program::read(path, FILE_LEN_MAX) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Err(refused("no file here")),
        Err(error) if error.kind() == io::ErrorKind::InvalidData => {
            Err(refused("the network's weights have 1.25 MB; a file of more than 64 MiB is not read"))
        }
        read => read.context(format_args!("failed to read {shown}")),
    }
}

/// Creates the folder of a file to write, unless the target exists.
fn prepare(out: &Path, force: bool) -> Result<(), Failure> {
    if !force && out.symlink_metadata().is_ok() {
        let text = format!("there is a file already: --force replaces it: {}", out.display());
        return Err(Failure::new(ExitCode::Config, text));
    }
    match out.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        Some(folder) => fs::create_dir_all(folder).context(format_args!("failed to make {}", folder.display())),
        None => Ok(()),
    }
}
