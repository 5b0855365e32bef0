//! Weights of another program, as `graspmill.torch` or a script writes them, come in with their values.

use half::{bf16, f16};
use network::checkpoint;
use network::head::Head;
use network::interchange::{GivenParams, IMPORTED, Imported, export, import};
use network::layers::parameter_slots;
use network::upsampling::Upsampling;
use network::{Architecture, GraspOrigin, VoxelParams};
use program::ExitCode;
use proptest::prelude::*;
use safetensors::Dtype;
use safetensors::tensor::TensorView;

use crate::formula::noise;

/// A value for every parameter, half of them at full precision.
fn values() -> Vec<f32> {
    let count: usize = parameter_slots().iter().map(|slot| slot.len).sum();
    noise(count, 700).into_iter().map(|draw| (draw - 0.5) as f32).collect()
}

/// A file of the values of `bytes` a parameter, under a prefix.
fn file(prefix: &str, dtype: Dtype, bytes: impl Fn(f32) -> Vec<u8>) -> Vec<u8> {
    let mut rest = &values()[..];
    let slots: Vec<_> = parameter_slots()
        .into_iter()
        .map(|slot| {
            let (own, more) = rest.split_at(slot.len);
            rest = more;
            (
                format!("{prefix}{}", slot.name),
                slot.shape,
                own.iter().flat_map(|value| bytes(*value)).collect::<Vec<_>>(),
            )
        })
        .collect();
    let tensors = slots.iter().map(|(name, shape, data)| (name, TensorView::new(dtype, shape.clone(), data).unwrap()));
    safetensors::serialize(tensors, None).unwrap()
}

fn imported(folder: &std::path::Path, prefix: &str, dtype: Dtype, bytes: impl Fn(f32) -> Vec<u8>) -> Imported {
    let path = folder.join("weights.safetensors");
    std::fs::write(&path, file(prefix, dtype, bytes)).unwrap();
    import(&path, &folder.join("checkpoint"), GivenParams::default(), false).unwrap()
}

#[test]
fn weights_keep_their_values_and_are_vgns_unless_something_else_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let imported = imported(folder.path(), "", Dtype::F32, |value| value.to_le_bytes().to_vec());
    assert_eq!((imported.prefix.as_str(), imported.converted_from.len()), ("", 0));
    let read = checkpoint::read(&folder.path().join("checkpoint")).unwrap();
    assert!(imported.checkpoint.vector == values() && read.vector == values());
    assert_eq!(
        (read.dataset_id.as_str(), &read.architecture),
        (
            IMPORTED,
            &Architecture::Voxel(VoxelParams {
                head: Head::Quaternion,
                upsampling: Upsampling::Nearest,
                origin: GraspOrigin::VGN
            })
        )
    );
    let config = read.config.parse::<toml::Table>().unwrap();
    assert_eq!(config["imported"]["file"].as_str(), Some("weights.safetensors"));
}

#[test]
fn wrapped_names_and_other_numbers_are_found_and_converted() {
    type Case = (Dtype, &'static str, fn(f32) -> Vec<u8>, fn(f32) -> f32);
    let cases: [Case; 3] = [
        (Dtype::F64, "float64", |value| f64::from(value).to_le_bytes().to_vec(), |value| value),
        (Dtype::F16, "float16", |value| f16::from_f32(value).to_le_bytes().to_vec(), |v| f16::from_f32(v).to_f32()),
        (Dtype::BF16, "bfloat16", |value| bf16::from_f32(value).to_le_bytes().to_vec(), |v| bf16::from_f32(v).to_f32()),
    ];
    for (dtype, name, bytes, kept) in cases {
        let folder = tempfile::tempdir().unwrap();
        let imported = imported(folder.path(), "module._orig_mod.", dtype, bytes);
        assert_eq!((imported.prefix.as_str(), imported.converted_from), ("module._orig_mod.", vec![name]));
        assert!(imported.checkpoint.vector.into_iter().eq(values().into_iter().map(kept)), "{name}");
    }
}

#[test]
fn an_exported_checkpoint_is_one_without_moments() {
    let folder = tempfile::tempdir().unwrap();
    let imported = imported(folder.path(), "", Dtype::F32, |value| value.to_le_bytes().to_vec());
    let out = folder.path().join("deeper/plain.safetensors");
    export(&folder.path().join("checkpoint"), &out, false).unwrap();
    let read = checkpoint::read(&out).unwrap();
    assert!(read.vector == imported.checkpoint.vector);
    assert!(read.moments.is_none());
    let bytes = std::fs::read(&out).unwrap();
    let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let (mut names, mut slots) = (file.names(), parameter_slots());
    names.sort_unstable();
    slots.sort_by(|a, b| a.name.cmp(&b.name));
    assert!(names.into_iter().eq(slots.iter().map(|slot| slot.name.as_str())));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Whatever the bytes say, the answer is a checkpoint or an error, and only a checkpoint leaves a file.
    #[test]
    fn damaged_files_are_refused_or_read_but_never_panic(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), any::<bool>()), 1..6),
        keep in prop::option::of(any::<prop::sample::Index>()),
        header in prop::option::of("[{}\\[\\]:,\"a-z0-9_.]{0,60}"),
    ) {
        let mut bytes = file("", Dtype::F32, |value| value.to_le_bytes().to_vec());
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
        let folder = tempfile::tempdir().unwrap();
        let (path, out) = (folder.path().join("weights"), folder.path().join("checkpoint"));
        std::fs::write(&path, bytes).unwrap();
        let read = import(&path, &out, GivenParams::default(), false);
        prop_assert_eq!(read.is_ok(), out.exists());
        if let Err(failure) = read {
            prop_assert!(matches!(failure.exit_code(), ExitCode::Config | ExitCode::Data), "{:?}", failure.exit_code());
        }
    }
}
