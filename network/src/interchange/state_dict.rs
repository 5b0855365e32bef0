//! Named tensors in a file, and the network's parameters made from them.

use std::collections::{BTreeMap, BTreeSet};

use super::element::Element;
use super::problem::{Problem, damaged, shown};
use crate::layers::{ParameterSlot, parameter_slots, vector_of};

/// Prefixes that wrappers add to every name: `DataParallel`, `torch.compile`.
const PREFIXES: [&str; 2] = ["module.", "_orig_mod."];
/// Maximum number of prefixes of a name.
const PREFIXES_MAX: usize = 4;
/// Maximum number of axes of a tensor. The network's have 5.
pub(super) const AXES_MAX: usize = 16;
/// Maximum number of reported differences.
const PROBLEMS_MAX: usize = 6;

/// A tensor in a storage of a file.
#[derive(Debug, Clone)]
pub(super) struct StoredTensor<'a> {
    element: Element,
    storage: &'a [u8],
    offset: usize,
    shape: Vec<usize>,
    strides: Vec<usize>,
}

impl<'a> StoredTensor<'a> {
    /// A tensor whose first value is element `offset` of the storage; `strides` are in elements. Its last value must be
    /// inside the storage.
    pub(super) fn new(
        element: Element,
        storage: &'a [u8],
        offset: usize,
        shape: Vec<usize>,
        strides: Vec<usize>,
    ) -> Result<Self, Problem> {
        if shape.len() != strides.len() || shape.len() > AXES_MAX {
            return damaged(format!("a tensor of {} axes with {} strides", shape.len(), strides.len()));
        }
        let last = shape.iter().zip(&strides).try_fold(offset, |at, (len, stride)| {
            len.saturating_sub(1).checked_mul(*stride).and_then(|step| at.checked_add(step))
        });
        let len = storage.len() / element.len();
        let fits = shape.contains(&0) || last.is_some_and(|last| last < len);
        if !fits {
            return damaged(format!(
                "a tensor of shape {shape:?} and strides {strides:?} from {offset} on does not lie in its {len} numbers"
            ));
        }
        Ok(Self { element, storage, offset, shape, strides })
    }

    /// A tensor that covers its whole storage, with the last axis fastest.
    pub(super) fn contiguous(element: Element, storage: &'a [u8], shape: Vec<usize>) -> Result<Self, Problem> {
        let mut strides = vec![1_usize; shape.len()];
        for axis in (1..shape.len()).rev() {
            strides[axis - 1] = strides[axis].saturating_mul(shape[axis]);
        }
        Self::new(element, storage, 0, shape, strides)
    }

    /// All values, with the last axis fastest; `None` if one is not finite.
    fn values(&self) -> Option<Vec<f32>> {
        let count = self.shape.iter().product();
        let value = |flat: usize| {
            let (mut rest, mut at) = (flat, self.offset);
            for (len, stride) in self.shape.iter().zip(&self.strides).rev() {
                at += rest % len * stride;
                rest /= len;
            }
            self.element.read(self.storage, at).filter(|value| value.is_finite())
        };
        (0..count).map(value).collect()
    }
}

/// The network's parameters from a file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Parameters {
    /// In the order of [`parameter_slots`].
    pub(super) values: Vec<f32>,
    /// The prefix that was removed from every name.
    pub(super) prefix: String,
    /// Number types that were converted to float32.
    pub(super) converted_from: Vec<&'static str>,
}

/// Makes the parameters from a file's tensors, which must be exactly those of the network, with its shapes.
///
/// # Errors
/// [`Problem::Architecture`] lists missing and surplus tensors and wrong shapes.
pub(super) fn parameters(tensors: &BTreeMap<String, StoredTensor<'_>>) -> Result<Parameters, Problem> {
    let prefix = prefix(tensors);
    let slots = parameter_slots();
    let values = vector_of(&slots, |slot| {
        let tensor = tensors.get(&format!("{prefix}{}", slot.name));
        slot_values(slot, tensor.ok_or_else(|| format!("{} is missing", slot.name))?)
    });
    let (values, mut problems) = values.map_or_else(|problems| (Vec::new(), problems), |values| (values, Vec::new()));
    let names: BTreeSet<String> = slots.into_iter().map(|slot| slot.name).collect();
    let extra = tensors.keys().filter_map(|name| name.strip_prefix(&prefix)).filter(|name| !names.contains(*name));
    problems.extend(extra.map(|name| format!("{} is not in the network", shown(name))));
    if problems.is_empty() {
        let mut converted_from: BTreeSet<&str> = tensors.values().map(|tensor| tensor.element.name()).collect();
        converted_from.remove(Element::Float32.name());
        return Ok(Parameters { values, prefix, converted_from: converted_from.into_iter().collect() });
    }
    let more = problems.len().saturating_sub(PROBLEMS_MAX);
    problems.truncate(PROBLEMS_MAX);
    if more > 0 {
        problems.push(format!("and {more} more"));
    }
    Err(Problem::Architecture(problems))
}

fn slot_values(slot: &ParameterSlot, tensor: &StoredTensor<'_>) -> Result<Vec<f32>, String> {
    if !tensor.element.is_float() || tensor.shape != slot.shape {
        let (name, shape) = (&slot.name, &slot.shape);
        let (element, got) = (tensor.element.name(), &tensor.shape);
        return Err(format!("{name} must be float32 of shape {shape:?}, got {element} of shape {got:?}"));
    }
    tensor.values().ok_or_else(|| format!("{} holds values that are not finite in float32", slot.name))
}

/// The common prefix of all names.
fn prefix(tensors: &BTreeMap<String, StoredTensor<'_>>) -> String {
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

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(values: &[f32]) -> Vec<u8> {
        values.iter().flat_map(|value| value.to_le_bytes()).collect()
    }

    #[test]
    fn strides_choose_the_values() {
        let storage = bytes(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let tensor = |offset, strides: &[usize]| {
            StoredTensor::new(Element::Float32, &storage, offset, vec![2, 3], strides.to_vec())
                .unwrap()
                .values()
                .unwrap()
        };
        assert_eq!(tensor(0, &[3, 1]), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
        assert_eq!(tensor(1, &[1, 2]), [1.0, 3.0, 5.0, 2.0, 4.0, 6.0]);
        assert_eq!(tensor(6, &[0, 0]), [6.0; 6]);
    }

    #[test]
    fn a_tensor_beside_its_storage_is_damaged() {
        let storage = bytes(&[0.0; 7]);
        for (offset, shape, strides) in [
            (2, vec![2, 3], vec![3, 1]),
            (7, vec![], vec![]),
            (0, vec![2], vec![usize::MAX]),
            (usize::MAX, vec![usize::MAX], vec![2]),
            (0, vec![2, 2], vec![1]),
        ] {
            let problem = StoredTensor::new(Element::Float32, &storage, offset, shape, strides).unwrap_err();
            assert!(matches!(problem, Problem::Damaged(_)), "{problem:?}");
        }
    }

    #[test]
    fn numbers_beyond_float32_are_told() {
        let storage: Vec<u8> = [1.0, 1e300].into_iter().flat_map(f64::to_le_bytes).collect();
        let tensor = StoredTensor::contiguous(Element::Float64, &storage, vec![2]).unwrap();
        assert_eq!(tensor.values(), None);
    }
}
