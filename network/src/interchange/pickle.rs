//! Reads the pickles that `torch.save` writes, without executing anything.
//!
//! A pickle is a program for a stack machine (Python's `Lib/pickletools.py` lists the opcodes). Two opcodes, `REDUCE`
//! and `BUILD`, call functions named by the file, so in Python a hostile file can call anything. Here only the names in
//! [`Known`] are accepted, and "calling" one of them makes an [`Object`] of our own. Objects are in one list and refer
//! to each other by index, so a self-referencing file makes a cycle that is never followed.
//!
//! Supports protocols 2 to 5; `torch.save` writes 2 by default.

use std::collections::BTreeMap;

use super::cursor::Cursor;
use super::element::Element;
use super::problem::{NAME_LEN_MAX, Problem, damaged, shown, unsupported};
use super::state_dict::AXES_MAX;

/// Maximum total number of objects and stack pushes. A checkpoint with an optimiser's state needs some thousands.
const WORK_MAX: usize = 1_000_000;

/// Index of an object in [`Pickle::objects`].
type Id = usize;

/// A parsed pickle.
#[derive(Debug)]
pub(super) struct Pickle<'a> {
    /// All objects, in the order of creation.
    pub(super) objects: Vec<Object<'a>>,
    /// The root object.
    pub(super) root: Id,
}

/// An object of a pickle.
#[derive(Debug)]
pub(super) enum Object<'a> {
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
pub(super) struct StorageRef<'a> {
    pub(super) element: Element,
    /// Its name in the file.
    pub(super) key: &'a str,
    /// Number of its elements.
    pub(super) len: usize,
}

/// A tensor as a view of a storage.
#[derive(Debug, Clone)]
pub(super) struct TensorRef<'a> {
    pub(super) storage: StorageRef<'a>,
    /// Index of its first element.
    pub(super) offset: usize,
    pub(super) shape: Vec<usize>,
    /// Number of elements between neighbours along each axis.
    pub(super) strides: Vec<usize>,
}

/// The names that a pickle may use.
#[derive(Debug, Clone, Copy)]
pub(super) enum Known {
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
    fn named(module: &str, name: &str) -> Option<Self> {
        match (module, name) {
            ("collections", "OrderedDict") => Some(Self::OrderedDict),
            ("torch", "Size") => Some(Self::Size),
            ("torch._utils", "_rebuild_tensor" | "_rebuild_tensor_v2") => Some(Self::Tensor),
            ("torch._utils", "_rebuild_parameter" | "_rebuild_parameter_with_state") => Some(Self::Parameter),
            ("torch" | "torch.cuda", class) => Element::of_storage_class(class).map(Self::Storage),
            _ => None,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::OrderedDict => "OrderedDict",
            Self::Size => "Size",
            Self::Tensor => "_rebuild_tensor",
            Self::Parameter => "_rebuild_parameter",
            Self::Storage(_) => "a storage",
        }
    }
}

/// Reads the pickle at the cursor and moves the cursor behind it.
pub(super) fn read<'a>(bytes: &mut Cursor<'a>) -> Result<Pickle<'a>, Problem> {
    let mut machine = Machine::default();
    loop {
        let opcode = bytes.number(1)? as u8;
        if opcode == b'.' {
            let root = machine.pop()?;
            return Ok(Pickle { objects: machine.objects, root });
        }
        machine.run(opcode, bytes)?;
    }
}

#[derive(Default)]
struct Machine<'a> {
    objects: Vec<Object<'a>>,
    stack: Vec<Id>,
    /// Heights of the stack at open `MARK`s.
    marks: Vec<usize>,
    memo: BTreeMap<u64, Id>,
    work: usize,
}

impl<'a> Machine<'a> {
    /// Executes an opcode.
    fn run(&mut self, opcode: u8, bytes: &mut Cursor<'a>) -> Result<(), Problem> {
        match opcode {
            // Framing.
            0x80 => match bytes.number(1)? {
                0..=5 => Ok(()),
                protocol => unsupported(format!("pickle protocol {protocol}, at most 5 is known")),
            },
            0x95 => bytes.take(8).map(|_| ()), // FRAME
            // The stack.
            b'(' => self.spend(1).map(|()| self.marks.push(self.stack.len())),
            b'0' => self.pop().map(|_| ()),
            b'1' => self.pop_to_mark().map(|_| ()),
            b'2' => self.top().and_then(|id| self.push_id(id)),
            // The memo.
            b'q' => self.remember(bytes.number(1)?),
            b'r' => self.remember(bytes.number(4)?),
            0x94 => self.remember(self.memo.len() as u64),
            b'h' => self.recall(bytes.number(1)?),
            b'j' => self.recall(bytes.number(4)?),
            // Tuples, lists, sets, dictionaries.
            0x85..=0x87 => self.tuple_of((opcode - 0x84).into()),
            b't' | b'l' => self.pop_to_mark().and_then(|items| self.push(Object::Sequence(items))),
            b'a' => self.pop().and_then(|item| self.append(&[item])),
            b'e' | 0x90 => self.pop_to_mark().and_then(|items| self.append(&items)),
            b'd' => {
                let items = self.pop_to_mark()?;
                self.push(Object::Dict(Vec::new()))?;
                self.set_items(&items)
            }
            b's' => {
                let (value, key) = (self.pop()?, self.pop()?);
                self.set_items(&[key, value])
            }
            b'u' => self.pop_to_mark().and_then(|items| self.set_items(&items)),
            // Names and calls.
            b'c' => {
                let (module, name) = (bytes.line()?, bytes.line()?);
                self.push_known(utf8(module)?, utf8(name)?)
            }
            0x93 => {
                let (name, module) = (self.pop()?, self.pop()?);
                let (module, name) = (self.text(module)?, self.text(name)?);
                self.push_known(module, name)
            }
            b'R' => self.reduce(),
            b'b' => self.build(),
            b'Q' => self.persistent(),
            _ => constant(opcode, bytes).and_then(|object| self.push(object)),
        }
    }

    fn spend(&mut self, work: usize) -> Result<(), Problem> {
        self.work = self.work.saturating_add(work);
        if self.work > WORK_MAX {
            return unsupported(format!("a pickle of more than {WORK_MAX} objects is no state dict of this network"));
        }
        Ok(())
    }

    fn push(&mut self, object: Object<'a>) -> Result<(), Problem> {
        self.objects.push(object);
        self.push_id(self.objects.len() - 1)
    }

    fn push_id(&mut self, id: Id) -> Result<(), Problem> {
        self.spend(1)?;
        self.stack.push(id);
        Ok(())
    }

    /// Pops the top object; objects below an open mark cannot be reached.
    fn pop(&mut self) -> Result<Id, Problem> {
        let id = self.top()?;
        self.stack.pop();
        Ok(id)
    }

    fn top(&self) -> Result<Id, Problem> {
        let bottom = self.marks.last().copied().unwrap_or(0);
        match self.stack.last() {
            Some(id) if self.stack.len() > bottom => Ok(*id),
            _ => damaged("a pickle takes more from its stack than it put there"),
        }
    }

    fn pop_to_mark(&mut self) -> Result<Vec<Id>, Problem> {
        match self.marks.pop() {
            Some(height) => Ok(self.stack.split_off(height)),
            None => damaged("a pickle goes back to a mark that is not there"),
        }
    }

    fn remember(&mut self, at: u64) -> Result<(), Problem> {
        self.spend(1)?;
        self.memo.insert(at, self.top()?);
        Ok(())
    }

    fn recall(&mut self, at: u64) -> Result<(), Problem> {
        match self.memo.get(&at) {
            Some(id) => self.push_id(*id),
            None => damaged(format!("a pickle refers to its memo {at}, which is empty")),
        }
    }

    fn push_known(&mut self, module: &str, name: &str) -> Result<(), Problem> {
        match Known::named(module, name) {
            Some(known) => self.push(Object::Known(known)),
            None => unsupported(format!(
                "it names {}.{}, which no state dict needs (a whole model, or more than weights?) and which is not run \
                 here: in PyTorch, torch.save(model.state_dict(), FILE)",
                shown(module),
                shown(name)
            )),
        }
    }

    fn tuple_of(&mut self, count: usize) -> Result<(), Problem> {
        let mut items = (0..count).map(|_| self.pop()).collect::<Result<Vec<Id>, Problem>>()?;
        items.reverse();
        self.push(Object::Sequence(items))
    }

    fn append(&mut self, items: &[Id]) -> Result<(), Problem> {
        let id = self.top()?;
        match &mut self.objects[id] {
            Object::Sequence(all) => all.extend(items),
            _ => return damaged("a pickle appends to what is no list"),
        }
        Ok(())
    }

    /// Sets keys of the top dictionary; `items` are alternating keys and values.
    fn set_items(&mut self, items: &[Id]) -> Result<(), Problem> {
        let id = self.top()?;
        let (pairs, []) = items.as_chunks::<2>() else { return damaged("a pickle sets a key without a value") };
        match &mut self.objects[id] {
            Object::Dict(all) => all.extend(pairs.iter().map(|[key, value]| (*key, *value))),
            _ => return damaged("a pickle sets keys of what is no dictionary"),
        }
        Ok(())
    }

    /// `_metadata` and other attributes of an `OrderedDict`, which are ignored.
    fn build(&mut self) -> Result<(), Problem> {
        self.pop()?;
        match self.objects[self.top()?] {
            Object::Dict(_) => Ok(()),
            _ => unsupported("a pickle sets attributes of what is no dictionary, which no state dict needs"),
        }
    }

    /// Replaces a known callable and its arguments by the resulting object.
    fn reduce(&mut self) -> Result<(), Problem> {
        let (arguments, callable) = (self.pop()?, self.pop()?);
        let Object::Known(known) = self.objects[callable] else { return damaged("a pickle calls what has no name") };
        let count = self.sequence(arguments)?.len();
        self.spend(count)?;
        let arguments = self.sequence(arguments)?.to_vec();
        match (known, arguments.as_slice()) {
            (Known::OrderedDict, []) => self.push(Object::Dict(Vec::new())),
            (Known::OrderedDict, [pairs]) => self.dict_of_pairs(*pairs),
            (Known::Size, [sizes]) => self.push_id(*sizes),
            (Known::Parameter, [data, ..]) => self.push_id(*data),
            (Known::Tensor, [storage, offset, shape, strides, ..]) => {
                let Object::Storage(storage) = self.objects[*storage] else {
                    return damaged("a tensor without a storage");
                };
                let tensor = TensorRef {
                    storage,
                    offset: self.size(*offset)?,
                    shape: self.sizes(*shape)?,
                    strides: self.sizes(*strides)?,
                };
                self.push(Object::Tensor(tensor))
            }
            _ => damaged(format!("a pickle calls {} with {} arguments", known.name(), arguments.len())),
        }
    }

    /// An `OrderedDict` as Python 2 writes it.
    fn dict_of_pairs(&mut self, pairs: Id) -> Result<(), Problem> {
        let count = self.sequence(pairs)?.len();
        self.spend(count)?;
        let mut all = Vec::with_capacity(count);
        for pair in self.sequence(pairs)? {
            let [key, value] = self.sequence(*pair)? else { return damaged("a pair of more or less than two") };
            all.push((*key, *value));
        }
        self.push(Object::Dict(all))
    }

    /// `('storage', class, key, location, length[, view])`, PyTorch's reference to numbers outside the pickle.
    fn persistent(&mut self) -> Result<(), Problem> {
        let id = self.pop()?;
        let parts = self.sequence(id)?;
        let kind = parts.first().map(|kind| self.text(*kind)).transpose()?;
        match (kind, parts) {
            (Some("storage"), [_, class, key, _, len, view @ ..]) => {
                let Object::Known(Known::Storage(element)) = self.objects[*class] else {
                    return damaged("a storage without a class");
                };
                if view.iter().any(|view| !matches!(self.objects[*view], Object::Nothing)) {
                    return unsupported(
                        "it holds views of storages, as PyTorch before 0.4 wrote them; to convert, in PyTorch: \
                         torch.save(torch.load(FILE, map_location=\"cpu\"), NEW)",
                    );
                }
                let (key, len) = (self.text(*key)?, self.size(*len)?);
                if key.len() > NAME_LEN_MAX {
                    return damaged(format!("a storage's key of {} bytes", key.len()));
                }
                self.push(Object::Storage(StorageRef { element, key, len }))
            }
            (Some("module"), _) => unsupported(
                "it holds a whole model with its code, which is not run here: in PyTorch, \
                 torch.save(model.state_dict(), FILE)",
            ),
            _ => damaged("a reference to something outside the pickle that is no storage"),
        }
    }

    fn sequence(&self, id: Id) -> Result<&[Id], Problem> {
        match &self.objects[id] {
            Object::Sequence(items) => Ok(items),
            _ => damaged("something else where a pickle needs a tuple"),
        }
    }

    fn text(&self, id: Id) -> Result<&'a str, Problem> {
        match self.objects[id] {
            Object::Text(text) => Ok(text),
            _ => damaged("something else where a pickle needs a text"),
        }
    }

    fn size(&self, id: Id) -> Result<usize, Problem> {
        match self.objects[id] {
            Object::Int(value) => usize::try_from(value).or_else(|_| damaged(format!("a size of {value}"))),
            _ => damaged("something else where a pickle needs a size"),
        }
    }

    fn sizes(&self, id: Id) -> Result<Vec<usize>, Problem> {
        match self.sequence(id)? {
            ids if ids.len() <= AXES_MAX => ids.iter().map(|id| self.size(*id)).collect(),
            ids => damaged(format!("a tensor of {} axes", ids.len())),
        }
    }
}

/// The object that an opcode alone makes, from the bytes after it.
fn constant<'a>(opcode: u8, bytes: &mut Cursor<'a>) -> Result<Object<'a>, Problem> {
    let skipped = |_: &[u8]| Object::Nothing; // floats and bytes are not needed
    let text = |text: &'a [u8]| utf8(text).map(Object::Text);
    match opcode {
        b'N' | 0x88 | 0x89 => Ok(Object::Nothing), // NONE, NEWTRUE, NEWFALSE
        b'G' => bytes.take(8).map(skipped),
        b'B' => bytes.counted(4).map(skipped),
        b'C' => bytes.counted(1).map(skipped),
        b'J' => bytes.take(4).and_then(integer),
        b'K' => Ok(Object::Int(bytes.number(1)?.into())),
        b'M' => Ok(Object::Int(bytes.number(2)?.into())),
        0x8a => bytes.counted(1).and_then(integer),
        0x8b => bytes.counted(4).and_then(integer),
        0x8c | b'U' => bytes.counted(1).and_then(text),
        b'X' | b'T' => bytes.counted(4).and_then(text),
        0x8d => bytes.counted(8).and_then(text),
        b')' | b']' | 0x8f => Ok(Object::Sequence(Vec::new())),
        b'}' => Ok(Object::Dict(Vec::new())),
        _ => unsupported(format!(
            "opcode 0x{opcode:02x} in a pickle, which no state dict needs (a whole model, or pickle protocol 0?): in \
             PyTorch, torch.save(model.state_dict(), FILE)"
        )),
    }
}

/// A little-endian two's complement integer of up to 16 bytes; state dicts have no longer ones.
fn integer<'a>(bytes: &[u8]) -> Result<Object<'a>, Problem> {
    let mut wide = [if bytes.last().is_some_and(|byte| *byte >= 0x80) { 0xFF } else { 0 }; 16];
    match wide.get_mut(..bytes.len()) {
        Some(low) => low.copy_from_slice(bytes),
        None => return unsupported(format!("an integer of {} bytes", bytes.len())),
    }
    Ok(Object::Int(i128::from_le_bytes(wide)))
}

fn utf8(text: &[u8]) -> Result<&str, Problem> {
    std::str::from_utf8(text).or_else(|_| damaged("a text in a pickle is not UTF-8"))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn read_all(bytes: &[u8]) -> Result<Pickle<'_>, Problem> {
        read(&mut Cursor::new(bytes))
    }

    #[test]
    fn what_a_file_names_is_not_run_but_told() {
        for bytes in
            [&b"\x80\x02cposix\nsystem\nX\x02\x00\x00\x00id\x85R."[..], b"\x80\x04\x8c\x05posix\x8c\x06system\x93."]
        {
            let Err(Problem::Unsupported(problem)) = read_all(bytes) else { panic!("{bytes:?} must be refused") };
            assert!(problem.contains("names posix.system,"), "{problem}");
        }
    }

    #[test]
    fn a_circle_and_a_doubling_list_end() {
        let circle = b"\x80\x02]q\x00h\x00a.";
        let pickle = read_all(circle).unwrap();
        assert!(matches!(&pickle.objects[pickle.root], Object::Sequence(items) if items == &[pickle.root]));
        // Each round appends a list to two new ones: "billion laughs".
        let mut laughs = b"\x80\x02]".to_vec();
        laughs.extend(b"q\x00](h\x00h\x00e".repeat(100_000));
        laughs.push(b'.');
        assert!(read_all(&laughs).is_ok());
        let mut endless = b"\x80\x02N".to_vec();
        endless.extend(vec![b'2'; WORK_MAX]);
        assert!(matches!(read_all(&endless), Err(Problem::Unsupported(_))));
    }

    #[test]
    fn lengths_that_lie_cost_nothing() {
        for bytes in
            [&b"X\xff\xff\xff\xff"[..], b"\x8d\xff\xff\xff\xff\xff\xff\xff\xff", b"\x8b\xff\xff\xff\x7f", b"\x8a\xff"]
        {
            assert!(matches!(read_all(bytes), Err(Problem::Damaged(_))), "{bytes:?}");
        }
    }

    #[test]
    fn long_integers_have_their_sign() {
        for (bytes, value) in
            [(&b"\x8a\x00."[..], 0), (b"\x8a\x01\xff.", -1), (b"\x8a\x02\xff\x00.", 255), (b"J\xfe\xff\xff\xff.", -2)]
        {
            let pickle = read_all(bytes).unwrap();
            assert!(matches!(pickle.objects[pickle.root], Object::Int(read) if read == value), "{value}");
        }
    }

    proptest! {
        #[test]
        fn any_bytes_end(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
            let _ = read_all(&bytes);
        }

        /// Random programs of known opcodes reach more code than random bytes.
        #[test]
        fn any_opcodes_end(opcodes in proptest::collection::vec(0_usize..32, 0..200)) {
            const OPCODES: [&[u8]; 32] = [
                b"(", b"0", b"1", b"2", b"q\x00", b"q\x01", b"h\x00", b"h\x01", b"\x94", b"N", b"K\x02", b"J\xff\xff\xff\xff",
                b"U\x07storage", b"U\x011", b")", b"\x85", b"\x86", b"\x87", b"t", b"]", b"a", b"e", b"}", b"s", b"u", b"d",
                b"ccollections\nOrderedDict\n", b"ctorch\nFloatStorage\n", b"ctorch._utils\n_rebuild_tensor_v2\n", b"R", b"b", b"Q",
            ];
            let mut bytes: Vec<u8> = opcodes.iter().flat_map(|opcode| OPCODES[*opcode]).copied().collect();
            bytes.push(b'.');
            let _ = read_all(&bytes);
        }
    }
}
