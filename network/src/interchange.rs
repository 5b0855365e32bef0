//! Weights from and to other programs: PyTorch's state dicts and safetensors in, safetensors and ONNX out.
//!
//! Files of other programs may be hostile. No code in a file is executed (`pickle.rs`), the sizes of files and of
//! parsed objects are limited (64 MiB, a million objects), every loop ends, and every fault is reported.
//!
//! The crate `pytorch-reader` (0.23.0-pre.1, its only release) was tried on the same files. It panics on none of 24,000
//! damaged ones and needs 16 MB, but it does not verify a zip's checksums: a flipped bit of a storage became a weight,
//! and a storage shorter than it declares was accepted. Therefore the readers here stay.

mod cursor;
mod element;
mod onnx;
mod pickle;
mod problem;
mod protobuf;
mod pth;
mod state_dict;
#[cfg(test)]
mod tests;
mod zip;

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs;
use std::io;
use std::path::Path;

use clap::ValueEnum;
use program::{Context as _, ExitCode, Failure};
use safetensors::{Dtype, SafeTensors};

use crate::checkpoint::{self, Checkpoint, Progress};
use crate::upsampling::Upsampling;
use crate::{Architecture, BEHIND_TIPS_M_MAX, GraspOrigin, VoxelParams};

use element::Element;
use problem::Problem;
use state_dict::{Parameters, StoredTensor};

/// Maximum file size: the weights have 1.25 MB, and fifty times that is no state dict of this network.
const FILE_LEN_MAX: u64 = 64 << 20;
/// Replaces a dataset's id, which is a SHA-256 and therefore never equal to this.
pub const IMPORTED: &str = "unknown (imported weights)";

/// The format of a file of weights to import.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// `torch.save` since PyTorch 1.6.
    TorchZip,
    /// `torch.save` before PyTorch 1.6.
    TorchLegacy,
    /// safetensors.
    Safetensors,
}

impl Source {
    /// The name in messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::TorchZip => "PyTorch (zip)",
            Self::TorchLegacy => "PyTorch before 1.6 (pickles)",
            Self::Safetensors => "safetensors",
        }
    }
}

/// The format of a file of weights to export.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Target {
    /// The weights under VGN's names.
    // The 18 tensors and our header: a checkpoint without the optimiser's moments.
    Safetensors,
    /// The whole network.
    // Dense, with the sigmoid and the normalisation.
    Onnx,
}

/// Imported weights.
#[derive(Debug, Clone)]
pub struct Imported {
    /// The weights; recipe and dataset record their origin.
    pub checkpoint: Checkpoint,
    /// The file's format.
    pub source: Source,
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
    fn with_metadata(self, bytes: &[u8]) -> VoxelParams {
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
    let (source, parameters) = read_weights(&bytes).map_err(|problem| problem.at(file))?;
    let Parameters { values, prefix, converted_from } = parameters;
    let checkpoint = Checkpoint {
        vector: values,
        architecture: Architecture::Voxel(given.with_metadata(&bytes)),
        config: provenance(file.file_name().unwrap_or_default(), source, &bytes),
        dataset_id: IMPORTED.to_owned(),
        progress: Progress::default(),
        moments: None,
    };
    prepare(out, force)?;
    checkpoint::save(&checkpoint, out)?;
    Ok(Imported { checkpoint, source, prefix, converted_from })
}

/// Writes a checkpoint's weights for other programs and returns the checkpoint. `force` replaces `out`.
///
/// # Errors
/// If the file is no checkpoint or `out` cannot be written. Then nothing is written.
pub fn export(file: &Path, out: &Path, target: Target, force: bool) -> Result<Checkpoint, Failure> {
    let checkpoint = Checkpoint { moments: None, ..checkpoint::read(file)? };
    prepare(out, force)?;
    match target {
        Target::Safetensors => checkpoint::save(&checkpoint, out)?,
        Target::Onnx => program::write(out, onnx::model(&checkpoint))?,
    }
    Ok(checkpoint)
}

/// The origin of imported weights, in place of the recipe.
fn provenance(name: &OsStr, source: Source, bytes: &[u8]) -> String {
    let sha256 = checkpoint::digest(bytes);
    let name = name.to_string_lossy();
    let facts = [("file", name.as_ref()), ("format", source.name()), ("sha256", &sha256)];
    let imported: toml::Table = facts.into_iter().map(|(key, value)| (key.to_owned(), value.into())).collect();
    let table = toml::Table::from_iter([("imported".to_owned(), imported.into())]);
    format!("# Weights of another program; the recipe that made them is not known.\n{table}")
}

/// The weights in a file of any supported format.
fn read_weights(bytes: &[u8]) -> Result<(Source, Parameters), Problem> {
    let (source, tensors) = if bytes.starts_with(zip::SIGNATURE) {
        (Source::TorchZip, pth::read_zip(bytes)?)
    } else if pth::is_legacy(bytes) {
        (Source::TorchLegacy, pth::read_legacy(bytes)?)
    } else if bytes.get(8) == Some(&b'{') {
        (Source::Safetensors, read_safetensors(bytes)?)
    } else {
        return problem::unsupported(what_else(bytes));
    };
    Ok((source, state_dict::parameters(&tensors)?))
}

fn what_else(bytes: &[u8]) -> &'static str {
    const TAR_AT: usize = 257;
    if bytes.get(TAR_AT..).is_some_and(|rest| rest.starts_with(b"ustar")) {
        "a tar file, as PyTorch before 0.2 wrote them; to convert, in PyTorch: torch.save(torch.load(FILE, \
         map_location=\"cpu\"), NEW)"
    } else if bytes.first() == Some(&0x80) {
        "a pickle, but not one of torch.save; to convert, in PyTorch: torch.save(model.state_dict(), NEW)"
    } else {
        "neither torch.save nor safetensors wrote it"
    }
}

fn read_safetensors(bytes: &[u8]) -> Result<BTreeMap<String, StoredTensor<'_>>, Problem> {
    let damaged = |error: safetensors::SafeTensorError| Problem::Damaged(error.to_string());
    if checkpoint::has_header(bytes) {
        return problem::unsupported("it is a checkpoint of trainer already, which needs no import");
    }
    let mut tensors = BTreeMap::new();
    for (name, view) in SafeTensors::deserialize(bytes).map_err(damaged)?.tensors() {
        let element = match view.dtype() {
            Dtype::F64 => Element::Float64,
            Dtype::F32 => Element::Float32,
            Dtype::F16 => Element::Float16,
            Dtype::BF16 => Element::BFloat16,
            other => {
                let name = problem::shown(&name);
                return Err(Problem::Architecture(vec![format!("{name} must be float32, got {other:?}")]));
            }
        };
        tensors.insert(name, StoredTensor::contiguous(element, view.data(), view.shape().to_vec())?);
    }
    Ok(tensors)
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
