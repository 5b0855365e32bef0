//! The kinds of numbers that tensors in files are made of.

use half::{bf16, f16};

/// A kind of number; little-endian in every file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Element {
    Float64,
    Float32,
    Float16,
    BFloat16,
    /// No number of a network: its name and its bytes, by which it is passed over.
    Other(&'static str, usize),
}

impl Element {
    /// The kind of a storage class of PyTorch, such as `FloatStorage` (`torch/storage.py`).
    pub(super) fn of_storage_class(class: &str) -> Option<Self> {
        Some(match class {
            "DoubleStorage" => Self::Float64,
            "FloatStorage" => Self::Float32,
            "HalfStorage" => Self::Float16,
            "BFloat16Storage" => Self::BFloat16,
            "LongStorage" => Self::Other("int64", 8),
            "IntStorage" => Self::Other("int32", 4),
            "ShortStorage" => Self::Other("int16", 2),
            "CharStorage" => Self::Other("int8", 1),
            "ByteStorage" => Self::Other("uint8", 1),
            "BoolStorage" => Self::Other("bool", 1),
            _ => return None,
        })
    }

    /// As PyTorch calls it.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Float64 => "float64",
            Self::Float32 => "float32",
            Self::Float16 => "float16",
            Self::BFloat16 => "bfloat16",
            Self::Other(name, _) => name,
        }
    }

    /// Bytes of one number.
    pub(super) fn len(self) -> usize {
        match self {
            Self::Float64 => 8,
            Self::Float32 => 4,
            Self::Float16 | Self::BFloat16 => 2,
            Self::Other(_, len) => len,
        }
    }

    /// Number `at` of a storage, rounded to float32; `None` outside of it and where it holds no floating point.
    pub(super) fn read(self, storage: &[u8], at: usize) -> Option<f32> {
        let start = at.checked_mul(self.len())?;
        let bytes = storage.get(start..start.checked_add(self.len())?)?;
        Some(match self {
            Self::Float64 => f64::from_le_bytes(bytes.try_into().ok()?) as f32,
            Self::Float32 => f32::from_le_bytes(bytes.try_into().ok()?),
            Self::Float16 => f16::from_le_bytes(bytes.try_into().ok()?).to_f32(),
            Self::BFloat16 => bf16::from_le_bytes(bytes.try_into().ok()?).to_f32(),
            Self::Other(..) => return None,
        })
    }

    pub(super) fn is_float(self) -> bool {
        !matches!(self, Self::Other(..))
    }
}
