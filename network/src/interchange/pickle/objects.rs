//! The objects in a state dict's pickle.

use crate::interchange::element::Element;

/// Index of an object in [`Pickle::objects`].
pub(super) type Id = usize;

/// A parsed pickle.
#[derive(Debug)]
pub(in crate::interchange) struct Pickle<'a> {
    /// All objects, in the order of creation.
    pub(in crate::interchange) objects: Vec<Object<'a>>,
    /// The root object.
    pub(in crate::interchange) root: Id,
}

/// An object of a pickle.
#[derive(Debug)]
pub(in crate::interchange) enum Object<'a> {
    /// `None`, and values that are not needed: booleans, floats, bytes.
    Nothing,
    Int(i128),
    Text(&'a str),
    /// A tuple, list or set.
    Sequence(Vec<Id>),
    /// Keys and values in the order of assignment; of equal keys the last counts.
    Dict(Vec<(Id, Id)>),
    Known(Known),
    Storage(StorageRef<'a>),
    Tensor(TensorRef<'a>),
}

/// Numbers outside the pickle.
#[derive(Debug, Clone, Copy)]
pub(in crate::interchange) struct StorageRef<'a> {
    pub(in crate::interchange) element: Element,
    /// Its name in the file.
    pub(in crate::interchange) key: &'a str,
    /// Number of its elements.
    pub(in crate::interchange) len: usize,
}

/// A tensor as a view of a storage.
#[derive(Debug, Clone)]
pub(in crate::interchange) struct TensorRef<'a> {
    pub(in crate::interchange) storage: StorageRef<'a>,
    /// Index of its first element.
    pub(in crate::interchange) offset: usize,
    pub(in crate::interchange) shape: Vec<usize>,
    /// Number of elements between neighbours along each axis.
    pub(in crate::interchange) strides: Vec<usize>,
}

/// The names that a pickle may use.
#[derive(Debug, Clone, Copy)]
pub(in crate::interchange) enum Known {
    /// `collections.OrderedDict`.
    OrderedDict,
    /// `torch.Size`.
    Size,
    /// `torch._utils._rebuild_tensor` and `_rebuild_tensor_v2`: storage, offset, shape, strides, and more for
    /// gradients.
    Tensor,
    /// `torch._utils._rebuild_parameter`: a tensor, and more for gradients.
    Parameter,
    /// `torch.FloatStorage` and similar classes.
    Storage(Element),
}

impl Known {
    pub(super) fn named(module: &str, name: &str) -> Option<Self> {
        match (module, name) {
            ("collections", "OrderedDict") => Some(Self::OrderedDict),
            ("torch", "Size") => Some(Self::Size),
            ("torch._utils", "_rebuild_tensor" | "_rebuild_tensor_v2") => Some(Self::Tensor),
            ("torch._utils", "_rebuild_parameter" | "_rebuild_parameter_with_state") => Some(Self::Parameter),
            ("torch" | "torch.cuda", class) => Element::of_storage_class(class).map(Self::Storage),
            _ => None,
        }
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::OrderedDict => "OrderedDict",
            Self::Size => "Size",
            Self::Tensor => "_rebuild_tensor",
            Self::Parameter => "_rebuild_parameter",
            Self::Storage(_) => "a storage",
        }
    }
}
