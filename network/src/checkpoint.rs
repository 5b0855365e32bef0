//! Checkpoints: safetensors files with VGN's parameter names.
//!
//! `best.safetensors` contains only the weights, so PyTorch loads it with `strict=True`. `last.safetensors` also
//! contains the optimiser's moments (`adam.first.<name>`, `adam.second.<name>`) and, in its header, everything that
//! training needs to continue as if it had never stopped. Each file records how it was made: config, dataset, versions.

mod header;
mod progress;

use std::fmt::Display;
use std::io::{self, ErrorKind};
use std::path::Path;

use program::{Exit as _, ExitCode, Failure, publish};
use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensorError, SafeTensors};
use sha2::{Digest as _, Sha256};

use crate::Architecture;
use crate::layers::{ParameterSlot, parameter_slots, vector_of};

use header::Stored;
pub use progress::{Confusion, Progress};

/// A network's parameters and their origin.
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpoint {
    /// All parameters ([`Architecture::slots`]).
    pub vector: Vec<f32>,
    /// Which network they are of.
    pub architecture: Architecture,
    /// The recipe, as TOML.
    pub config: String,
    /// Id of the dataset it was trained on: SHA-256 of its `meta/info.json`.
    pub dataset_id: String,
    /// The progress of training.
    pub progress: Progress,
    /// Adam's moments; only in `last`, after the first step.
    pub moments: Option<Moments>,
}

/// Adam's state between steps, each in the order of the flat parameter vector.
#[derive(Debug, Clone, PartialEq)]
pub struct Moments {
    /// Number of steps.
    pub steps: usize,
    /// Running mean of the gradient.
    pub first: Vec<f32>,
    /// Running mean of its square.
    pub second: Vec<f32>,
    /// The parameters from which the next step goes on, where those of the network are their running mean.
    pub point: Option<Vec<f32>>,
}

/// Maximum size of a file: with the optimiser's moments the network has 4 MB.
const FILE_BYTES_MAX: u64 = 64 << 20;
/// Maximum number of differences in a message.
const PROBLEMS_MAX: usize = 4;
const MOMENTS: [&str; 3] = ["adam.first.", "adam.second.", "adam.point."];

/// Writes a checkpoint atomically.
///
/// # Errors
/// If the file cannot be written.
pub fn save(checkpoint: &Checkpoint, path: &Path) -> Result<(), Failure> {
    let file = encode(checkpoint).map_err(|source| broken(source, path))?;
    publish(path, &file).map_err(|source| failed("write", &source, path))
}

/// The bytes of a checkpoint's file.
fn encode(checkpoint: &Checkpoint) -> Result<Vec<u8>, SafeTensorError> {
    let mut vectors = vec![("", &checkpoint.vector)];
    if let Some(moments) = &checkpoint.moments {
        vectors.extend([(MOMENTS[0], &moments.first), (MOMENTS[1], &moments.second)]);
        vectors.extend(moments.point.iter().map(|point| (MOMENTS[2], point)));
    }
    let vectors: Vec<(&str, Vec<u8>)> = vectors.into_iter().map(|(prefix, vector)| (prefix, bytes(vector))).collect();
    let slots = checkpoint.architecture.slots();
    let named = vectors.iter().flat_map(|(prefix, bytes)| {
        slots.iter().map(move |slot| (format!("{prefix}{}", slot.name), slot, &bytes[4 * slot.start..][..4 * slot.len]))
    });
    let views = named.map(|(name, slot, data)| Ok((name, TensorView::new(Dtype::F32, slot.shape.clone(), data)?)));
    let views = views.collect::<Result<Vec<_>, SafeTensorError>>()?;
    let mut file = safetensors::serialize(views, Some(header::write(checkpoint)))?;
    let own = own_digest(&file, header::BLANK);
    if let Some(place) = place_of(header::BLANK, &file) {
        file[place..place + own.len()].copy_from_slice(own.as_bytes());
    }
    Ok(file)
}

/// Where a digest first stands in a file.
fn place_of(digest: &str, file: &[u8]) -> Option<usize> {
    file.windows(header::BLANK.len()).position(|part| part == digest.as_bytes())
}

/// The digest of a file but for the digest that it states.
fn own_digest(file: &[u8], stated: &str) -> String {
    let Some(place) = place_of(stated, file) else { return digest(file) };
    digest(&[&file[..place], header::BLANK.as_bytes(), &file[place + header::BLANK.len()..]].concat())
}

fn failed(action: &str, source: &io::Error, path: &Path) -> Failure {
    Failure::new(source.exit_code(), format!("failed to {action} a checkpoint: {source}: {}", path.display()))
}

fn broken(source: SafeTensorError, path: &Path) -> Failure {
    damaged(format_args!("damaged checkpoint: {source}"), path)
}

/// A file that is truncated, no safetensors file, not of this crate, or of an unknown version.
fn damaged(problem: impl Display, path: &Path) -> Failure {
    Failure::new(ExitCode::Data, format!("{problem}: {}", path.display()))
}

/// A file whose tensors belong to another network, with the first differences.
fn of_another_network(problems: &[String], path: &Path) -> Failure {
    let (problems, path) = (problems.join("; "), path.display());
    Failure::new(ExitCode::Config, format!("a checkpoint of another architecture: {problems}: {path}"))
}

/// Reads a checkpoint.
///
/// # Errors
/// If the file is missing or damaged, or belongs to another network.
pub fn read(path: &Path) -> Result<Checkpoint, Failure> {
    Ok(read_digested(path)?.0)
}

/// Reads a checkpoint, and gives the SHA-256 of its file in hex.
///
/// # Errors
/// As [`read`].
pub fn read_digested(path: &Path) -> Result<(Checkpoint, String), Failure> {
    let file = program::read(path, FILE_BYTES_MAX).map_err(|source| match source.kind() {
        ErrorKind::NotFound => Failure::new(ExitCode::Config, format!("no checkpoint here: {}", path.display())),
        _ => failed("read", &source, path),
    })?;
    Ok((from_bytes(&file, path)?, digest(&file)))
}

/// SHA-256 of a checkpoint's file, in hex: its name wherever it is used.
#[must_use]
pub fn digest(file: &[u8]) -> String {
    Sha256::digest(file).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Parses a checkpoint; `path` is for messages.
///
/// # Errors
/// As [`read`], except errors of reading the file.
pub fn from_bytes(file: &[u8], path: &Path) -> Result<Checkpoint, Failure> {
    let (_, metadata) = SafeTensors::read_metadata(file).map_err(|source| broken(source, path))?;
    let tensors = SafeTensors::deserialize(file).map_err(|source| broken(source, path))?;
    let header = header::read(metadata.metadata().as_ref(), path);
    if metadata.metadata().as_ref().is_none_or(|metadata| !metadata.contains_key(header::KEY)) {
        // Weights of another program: what is wrong with them says more than what they lack.
        vector(&tensors, &parameter_slots(), "", path)?;
    }
    let (architecture, Stored { file_sha256, dataset_id, config, progress, adam_steps, .. }) = header?;
    if let Some(stated) = file_sha256 {
        let own = own_digest(file, &stated);
        if own != stated {
            let problem = format!("damaged checkpoint: file_sha256 of its header must be {own}, got {stated}");
            return Err(damaged(problem, path));
        }
    }
    let slots = architecture.slots();
    let vector = |prefix: &str| {
        let vector = vector(&tensors, &slots, prefix, path)?;
        let diverged = slots.iter().find_map(|slot| {
            let value = vector[slot.start..][..slot.len].iter().find(|value| !value.is_finite())?;
            Some(format!("{prefix}{} must be finite, got {value}: the training that wrote it diverged", slot.name))
        });
        diverged.map_or(Ok(vector), |problem| Err(damaged(problem, path)))
    };
    let parameters = vector("")?;
    let moments = match adam_steps {
        0 => None,
        steps => {
            let is_averaged = tensors.names().iter().any(|name| name.starts_with(MOMENTS[2]));
            let point = if is_averaged { Some(vector(MOMENTS[2])?) } else { None };
            Some(Moments { steps, first: vector(MOMENTS[0])?, second: vector(MOMENTS[1])?, point })
        }
    };
    Ok(Checkpoint { vector: parameters, architecture, config, dataset_id, progress, moments })
}

/// The flat vector of the tensors whose names begin with `prefix`.
fn vector(tensors: &SafeTensors<'_>, slots: &[ParameterSlot], prefix: &str, path: &Path) -> Result<Vec<f32>, Failure> {
    vector_of(tensors, slots, prefix).map_err(|mut problems| {
        problems.truncate(PROBLEMS_MAX);
        of_another_network(&problems, path)
    })
}

fn bytes(vector: &[f32]) -> Vec<u8> {
    vector.iter().flat_map(|value| value.to_le_bytes()).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use schema::{Grid, Gripper};

    use super::*;
    use crate::head::Head;
    use crate::judge::Scope;
    use crate::layers::initial_vector;
    use crate::upsampling::Upsampling;
    use crate::{GraspOrigin, VoxelParams};

    #[test]
    fn a_checkpoint_comes_back_and_equal_ones_make_equal_files() {
        let folder = tempfile::tempdir().unwrap();
        let mut checkpoint = Checkpoint {
            vector: initial_vector(1),
            architecture: Architecture::Voxel(VoxelParams {
                head: Head::Quaternion,
                upsampling: Upsampling::Nearest,
                origin: GraspOrigin::behind_tips(0.035),
            }),
            config: "seed = 1".to_owned(),
            dataset_id: "abc".to_owned(),
            progress: Progress {
                epoch: 2,
                batch: 3,
                step: 45,
                best_accuracy_bits: Some(0.3_f64.to_bits()),
                ..Progress::default()
            },
            moments: None,
        };
        let path = |name: &str| folder.path().join(name);
        for point in [None, Some(initial_vector(4))] {
            checkpoint.moments =
                Some(Moments { steps: 45, first: initial_vector(2), second: initial_vector(3), point });
            save(&checkpoint, &path("a")).unwrap();
            let back = read(&path("a")).unwrap();
            save(&back, &path("b")).unwrap();
            assert!(std::fs::read(path("a")).unwrap() == std::fs::read(path("b")).unwrap());
            assert_eq!(back, checkpoint);
        }
    }

    /// Wherever a bit is flipped: in weights, in moments, in the progress, in names, in the digest.
    #[test]
    fn a_checkpoint_with_a_flipped_bit_is_refused_and_one_without_a_digest_is_read() {
        let checkpoint = Checkpoint {
            vector: initial_vector(1),
            architecture: Architecture::Voxel(VoxelParams::at_tips(Upsampling::Linear)),
            config: format!("# {}\n", "0".repeat(70)),
            dataset_id: "abc".to_owned(),
            progress: Progress { step: 45, ..Progress::default() },
            moments: Some(Moments { steps: 45, first: initial_vector(2), second: initial_vector(3), point: None }),
        };
        let (path, file) = (Path::new("x"), encode(&checkpoint).unwrap());
        assert_eq!(from_bytes(&file, path).unwrap(), checkpoint);
        let header_len = 8 + u64::from_le_bytes(file[..8].try_into().unwrap()) as usize;
        for at in (0..header_len).step_by(61).chain((header_len..file.len()).step_by(file.len() / 24)) {
            let mut flipped = file.clone();
            flipped[at] ^= 1 << (at % 7);
            assert!(from_bytes(&flipped, path).is_err(), "byte {at}");
        }
        let mut flipped = file.clone();
        flipped[file.len() - 2] ^= 1;
        let error = from_bytes(&flipped, path).unwrap_err();
        assert!(error.exit_code() == ExitCode::Data && error.to_string().contains("file_sha256"), "{error}");
        // As versions before 0.4.0 wrote it: safetensors' header has its length before it.
        let text = String::from_utf8(file[8..header_len].to_vec()).unwrap();
        let [from, to] = ["\\\"file_sha256", "\\\"format_version"].map(|key| text.find(key).unwrap());
        let older = [&text[..from], &text[to..]].concat().into_bytes();
        let whole = [&(older.len() as u64).to_le_bytes()[..], &older[..], &file[header_len..]].concat();
        assert_eq!(from_bytes(&whole, path).unwrap(), checkpoint);
    }

    #[test]
    fn a_diverged_network_is_refused_and_its_tensor_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("diverged");
        let header = Checkpoint {
            vector: initial_vector(1),
            architecture: Architecture::Voxel(VoxelParams {
                head: Head::Quaternion,
                upsampling: Upsampling::Linear,
                origin: GraspOrigin::TIPS,
            }),
            config: String::new(),
            dataset_id: String::new(),
            progress: Progress::default(),
            moments: None,
        };
        let slot = parameter_slots().swap_remove(3);
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut diverged = header.clone();
            diverged.vector[slot.start + slot.len - 1] = value;
            save(&diverged, &path).unwrap();
            let error = read(&path).unwrap_err();
            assert_eq!(error.exit_code(), ExitCode::Data);
            assert!(error.to_string().starts_with(&format!("{} must be finite, got {value}", slot.name)), "{error}");
        }
    }

    #[test]
    fn a_judge_comes_back_with_what_it_was_trained_for() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("judge");
        let gripper = Gripper::from_toml(Gripper::BUILT_IN[1].1).unwrap();
        let scope = Scope::of(&[gripper], 0.07, Grid::PAPER, true);
        let architecture = Architecture::Judge(Box::new(scope));
        let judge = Checkpoint {
            vector: architecture.initial_vector(1),
            architecture,
            config: String::new(),
            dataset_id: "abc".to_owned(),
            progress: Progress::default(),
            moments: None,
        };
        save(&judge, &path).unwrap();
        let back = read(&path).unwrap();
        assert_eq!(back, judge);
        let other = Architecture::Voxel(VoxelParams::at_tips(Upsampling::Linear));
        let message = other.scope("this").unwrap_err().to_string();
        assert!(message.starts_with("this needs a judge") && message.ends_with("answers for voxels"), "{message}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        /// Whatever the bytes say, the answer is a checkpoint or an error.
        #[test]
        fn damaged_files_are_refused_or_read_but_never_panic(
            changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), any::<bool>()), 1..6),
            keep in prop::option::of(any::<prop::sample::Index>()),
            header in prop::option::of("[{}\\[\\]:,\"a-z0-9_.]{0,60}"),
        ) {
            let mut bytes = encode(&Checkpoint {
                vector: initial_vector(1),
                architecture: Architecture::Voxel(VoxelParams::at_tips(Upsampling::Linear)),
                config: String::new(),
                dataset_id: String::new(),
                progress: Progress::default(),
                moments: None,
            }).unwrap();
            let header_len = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
            for (at, value, in_header) in changes {
                let at = at.index(if in_header { header_len } else { bytes.len() });
                bytes[at] = value;
            }
            if let Some(header) = header {
                bytes.splice(..header_len, (header.len() as u64).to_le_bytes().into_iter().chain(header.into_bytes()));
            }
            if let Some(keep) = keep {
                bytes.truncate(keep.index(bytes.len()));
            }
            if let Err(failure) = from_bytes(&bytes, Path::new("x")) {
                let code = failure.exit_code();
                prop_assert!(matches!(code, ExitCode::Config | ExitCode::Data), "{code:?}");
            }
        }
    }
}
