//! The two file formats of `torch.save` (`torch/serialization.py`).
//!
//! Since PyTorch 1.6: a zip of one folder with `data.pkl`, a pickle that refers to storages by key, and each storage's
//! bytes in `data/<key>`. Earlier, and now with `_use_new_zipfile_serialization=False`: five consecutive pickles – a
//! magic number, a version, facts about the machine, the object, a list of keys – and then each storage of that list:
//! the count of its numbers (64 bits), then its bytes.

use std::collections::BTreeMap;

use super::cursor::Cursor;
use super::pickle::{self, Object, Pickle, StorageRef, TensorRef};
use super::problem::{NAME_LEN_MAX, Problem, damaged, shown, unsupported};
use super::state_dict::StoredTensor;
use super::zip;

/// The first pickle of a file in the old format.
const MAGIC_NUMBER: i128 = 0x1950_A86A_20F9_469C_FC6C;
/// The second pickle.
const VERSION: i128 = 1001;
/// Keys under which training scripts store the state dict together with other objects.
const NESTED: [&str; 3] = ["state_dict", "model_state_dict", "model"];
/// Maximum nesting of dictionaries around a state dict.
const DEPTH_MAX: usize = 4;

/// The state dict of a zip file.
pub(super) fn read_zip(bytes: &[u8]) -> Result<BTreeMap<String, StoredTensor<'_>>, Problem> {
    let entries = zip::read(bytes)?;
    let Some(folder) = entries.keys().find_map(|name| name.strip_suffix("data.pkl").filter(|at| at.ends_with('/')))
    else {
        return unsupported("a zip without data.pkl, so not written by torch.save");
    };
    let entry = |name: &str| entries.get(format!("{folder}{name}").as_str()).copied();
    if entry("byteorder").is_some_and(|order| order != b"little") {
        return unsupported("its numbers are big-endian; to convert, load and save it on a usual machine");
    }
    let pickle = pickle::read(&mut Cursor::new(entry("data.pkl").unwrap_or_default()))?;
    tensors(&pickle, |key| entry(&format!("data/{key}")))
}

/// Whether bytes begin like a file in the old format.
pub(super) fn is_legacy(bytes: &[u8]) -> bool {
    bytes.first() == Some(&0x80) && integer(&mut Cursor::new(bytes)).is_ok_and(|number| number == Some(MAGIC_NUMBER))
}

/// The state dict of a file in the old format.
pub(super) fn read_legacy(bytes: &[u8]) -> Result<BTreeMap<String, StoredTensor<'_>>, Problem> {
    let mut bytes = Cursor::new(bytes);
    integer(&mut bytes)?; // the magic number
    match integer(&mut bytes)? {
        Some(VERSION) => {}
        other => return unsupported(format!("version {other:?} of PyTorch's old format, only {VERSION} is known")),
    }
    pickle::read(&mut bytes)?; // the machine's byte order, which does not apply to storages, and unused lengths
    let pickle = pickle::read(&mut bytes)?;
    let refs: BTreeMap<&str, StorageRef<'_>> = pickle
        .objects
        .iter()
        .filter_map(|object| if let Object::Storage(storage) = object { Some((storage.key, *storage)) } else { None })
        .collect();
    let keys = pickle::read(&mut bytes)?;
    let Object::Sequence(ids) = &keys.objects[keys.root] else { return damaged("the list of storages is no list") };
    let mut storages = BTreeMap::new();
    for id in ids {
        let Object::Text(key) = keys.objects[*id] else { return damaged("a storage's key is no text") };
        let Some(storage) = refs.get(key) else { return damaged(format!("nothing refers to storage {}", shown(key))) };
        let len = bytes.number(8)?.saturating_mul(storage.element.len() as u64);
        storages.insert(key, bytes.take_long(len)?);
    }
    tensors(&pickle, |key| storages.get(key).copied())
}

/// A pickle of one integer.
fn integer(bytes: &mut Cursor<'_>) -> Result<Option<i128>, Problem> {
    let pickle = pickle::read(bytes)?;
    Ok(if let Object::Int(value) = pickle.objects[pickle.root] { Some(value) } else { None })
}

/// Attaches storages, given by their keys, to the tensors of a state dict.
fn tensors<'a>(
    pickle: &Pickle<'a>,
    storage: impl Fn(&str) -> Option<&'a [u8]>,
) -> Result<BTreeMap<String, StoredTensor<'a>>, Problem> {
    let stored = |(name, tensor): (&str, &TensorRef<'a>)| {
        let TensorRef { storage: StorageRef { element, key, len }, offset, shape, strides } = tensor.clone();
        match storage(key) {
            Some(storage) if Some(storage.len()) == len.checked_mul(element.len()) => {
                Ok((name.to_owned(), StoredTensor::new(element, storage, offset, shape, strides)?))
            }
            Some(storage) => damaged(format!(
                "storage {} has {} bytes, {len} numbers of {} were to be there",
                shown(key),
                storage.len(),
                element.name()
            )),
            None => damaged(format!("storage {} is missing", shown(key))),
        }
    };
    state_dict(pickle)?.into_iter().map(stored).collect()
}

/// The names and tensors of the state dict in a pickle: the root dictionary or one inside it.
fn state_dict<'p, 'a>(pickle: &'p Pickle<'a>) -> Result<Vec<(&'a str, &'p TensorRef<'a>)>, Problem> {
    let mut at = pickle.root;
    for _ in 0..DEPTH_MAX {
        let Object::Dict(pairs) = &pickle.objects[at] else { return unsupported(NO_STATE_DICT) };
        let under = |key: &str| {
            let is = |id: usize| matches!(pickle.objects[id], Object::Text(text) if text == key);
            let found = pairs.iter().rev().find(|(id, _)| is(*id));
            found.map(|(_, value)| *value).filter(|value| matches!(pickle.objects[*value], Object::Dict(_)))
        };
        match NESTED.into_iter().find_map(under) {
            Some(inner) => at = inner,
            None => return named_tensors(pickle, pairs),
        }
    }
    unsupported(NO_STATE_DICT)
}

const NO_STATE_DICT: &str = "it holds no state dict, alone or under \"state_dict\", \"model_state_dict\" or \"model\": in \
                             PyTorch, torch.save(model.state_dict(), FILE)";

fn named_tensors<'p, 'a>(
    pickle: &'p Pickle<'a>,
    pairs: &[(usize, usize)],
) -> Result<Vec<(&'a str, &'p TensorRef<'a>)>, Problem> {
    let (mut named, mut problems) = (Vec::new(), Vec::new());
    for (key, value) in pairs {
        match (&pickle.objects[*key], &pickle.objects[*value]) {
            (Object::Text(name), _) if name.len() > NAME_LEN_MAX => {
                return damaged(format!("a name of {} bytes", name.len()));
            }
            (Object::Text(name), Object::Tensor(tensor)) => named.push((*name, tensor)),
            (Object::Text(name), _) if problems.len() < NOT_TENSORS_MAX => {
                problems.push(format!("{} is no tensor", shown(name)));
            }
            (Object::Text(_), _) => {}
            _ => return unsupported(NO_STATE_DICT),
        }
    }
    match (named.is_empty(), problems.is_empty()) {
        (_, true) => Ok(named),
        (true, false) => unsupported(NO_STATE_DICT),
        (false, false) => Err(Problem::Architecture(problems)),
    }
}

/// Maximum number of reported entries that are not tensors.
const NOT_TENSORS_MAX: usize = 4;
