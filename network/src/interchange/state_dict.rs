//! Named tensors in a file, and the network's parameters made from them.

use std::collections::{BTreeMap, BTreeSet};

use half::{bf16, f16};
use safetensors::Dtype;
use safetensors::tensor::TensorView;

use crate::head::Head;
use crate::layers::{ParameterSlot, slots_of, vector_of};

/// Prefixes that wrappers add to every name: `DataParallel`, `torch.compile`.
const PREFIXES: [&str; 2] = ["module.", "_orig_mod."];
/// Maximum number of prefixes of a name.
const PREFIXES_MAX: usize = 4;
/// Maximum number of reported differences.
const PROBLEMS_MAX: usize = 6;

/// The network's parameters from a file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Parameters {
    /// What the network answers at a voxel.
    pub(super) head: Head,
    /// In the order of [`slots_of`].
    pub(super) values: Vec<f32>,
    /// The prefix that was removed from every name.
    pub(super) prefix: String,
    /// Number types that were converted to float32.
    pub(super) converted_from: Vec<&'static str>,
}

/// Makes the parameters from a file's tensors, which must be exactly those of the network, with its shapes.
///
/// # Errors
/// Missing and surplus tensors and wrong shapes.
pub(super) fn parameters(tensors: &BTreeMap<String, TensorView<'_>>) -> Result<Parameters, Vec<String>> {
    let prefix = prefix(tensors);
    let has_turns = tensors.contains_key(&format!("{prefix}conv_turn.weight"));
    let head = if has_turns { Head::Closings } else { Head::Quaternion };
    let slots = slots_of(head.layers());
    let values = vector_of(&slots, |slot| {
        let tensor = tensors.get(&format!("{prefix}{}", slot.name));
        slot_values(slot, tensor.ok_or_else(|| format!("{} is missing", slot.name))?)
    });
    let (values, mut problems) = values.map_or_else(|problems| (Vec::new(), problems), |values| (values, Vec::new()));
    let names: BTreeSet<String> = slots.into_iter().map(|slot| slot.name).collect();
    let extra = tensors.keys().filter_map(|name| name.strip_prefix(&prefix)).filter(|name| !names.contains(*name));
    problems.extend(extra.map(|name| format!("{} is not in the network", shown(name))));
    if problems.is_empty() {
        let floats = tensors.values().filter_map(|tensor| Some(float(tensor.dtype())?.0));
        let converted_from = floats.filter(|name| *name != "float32").collect::<BTreeSet<_>>().into_iter().collect();
        return Ok(Parameters { head, values, prefix, converted_from });
    }
    let more = problems.len().saturating_sub(PROBLEMS_MAX);
    problems.truncate(PROBLEMS_MAX);
    if more > 0 {
        problems.push(format!("and {more} more"));
    }
    Err(problems)
}

/// A name from a file made safe for messages: shortened, and without control characters. The network's longest name has
/// 21 bytes.
fn shown(name: &str) -> String {
    name.chars().take(256).flat_map(char::escape_debug).collect()
}

fn slot_values(slot: &ParameterSlot, tensor: &TensorView<'_>) -> Result<Vec<f32>, String> {
    let (name, shape) = (&slot.name, &slot.shape);
    let Some((_, read)) = float(tensor.dtype()).filter(|_| tensor.shape() == shape) else {
        let (got, got_shape) = (tensor.dtype(), tensor.shape());
        return Err(format!("{name} must be F32 of shape {shape:?}, got {got:?} of shape {got_shape:?}"));
    };
    let values = read(tensor.data());
    match values.iter().all(|value| value.is_finite()) {
        true => Ok(values),
        false => Err(format!("{name} holds values that are not finite in float32")),
    }
}

type Read = fn(&[u8]) -> Vec<f32>;

/// A kind of floating-point numbers: PyTorch's name, and how its little-endian bytes become float32.
fn float(dtype: Dtype) -> Option<(&'static str, Read)> {
    fn each<const N: usize>(bytes: &[u8], read: impl Fn([u8; N]) -> f32) -> Vec<f32> {
        bytes.as_chunks().0.iter().map(|bytes| read(*bytes)).collect()
    }
    Some(match dtype {
        Dtype::F64 => ("float64", |bytes| each(bytes, |value| f64::from_le_bytes(value) as f32)),
        Dtype::F32 => ("float32", |bytes| each(bytes, f32::from_le_bytes)),
        Dtype::F16 => ("float16", |bytes| each(bytes, |value| f16::from_le_bytes(value).to_f32())),
        Dtype::BF16 => ("bfloat16", |bytes| each(bytes, |value| bf16::from_le_bytes(value).to_f32())),
        _ => return None,
    })
}

/// The common prefix of all names.
fn prefix(tensors: &BTreeMap<String, TensorView<'_>>) -> String {
    let mut prefix = String::new();
    for _ in 0..PREFIXES_MAX {
        let before_all = |more: &str| {
            tensors.keys().all(|name| name.strip_prefix(&prefix).is_some_and(|rest| rest.starts_with(more)))
        };
        match PREFIXES.into_iter().find(|more| before_all(more)) {
            Some(more) if !tensors.is_empty() => prefix.push_str(more),
            _ => break,
        }
    }
    prefix
}
