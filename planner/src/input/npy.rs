//! A strict reader of NumPy's array files. The header is a Python literal of three keys. Nothing is allocated before
//! its shape matches the number of bytes.

use serde::Deserialize;

use crate::input::error::{InputError, refuse, shown};

const MAGIC: &[u8; 6] = b"\x93NUMPY";
const HEADER_BYTES_MAX: usize = 64 * 1024;
const RANK_MAX: usize = 5;

/// A number type: its code in a dtype, its size, and how its numbers are read, which are little-endian.
#[derive(Debug)]
pub(crate) struct NumberType {
    code: &'static str,
    size_bytes: usize,
    read: fn(&[u8]) -> Vec<f32>,
}

static NUMBER_TYPES: [NumberType; 9] = [
    NumberType { code: "b1", size_bytes: 1, read: |data| each(data, |n| u8::from_le_bytes(n).into()) },
    NumberType { code: "f4", size_bytes: 4, read: |data| each(data, f32::from_le_bytes) },
    NumberType { code: "f8", size_bytes: 8, read: |data| each(data, |n| f64::from_le_bytes(n) as f32) },
    NumberType { code: "u1", size_bytes: 1, read: |data| each(data, |n| u8::from_le_bytes(n).into()) },
    NumberType { code: "u2", size_bytes: 2, read: |data| each(data, |n| u16::from_le_bytes(n).into()) },
    NumberType { code: "u4", size_bytes: 4, read: |data| each(data, |n| u32::from_le_bytes(n) as f32) },
    NumberType { code: "i2", size_bytes: 2, read: |data| each(data, |n| i16::from_le_bytes(n).into()) },
    NumberType { code: "i4", size_bytes: 4, read: |data| each(data, |n| i32::from_le_bytes(n) as f32) },
    NumberType { code: "i8", size_bytes: 8, read: |data| each(data, |n| i64::from_le_bytes(n) as f32) },
];

impl NumberType {
    pub(crate) fn is_float(&self) -> bool {
        self.code.starts_with('f')
    }

    pub(crate) const fn is_byte(&self) -> bool {
        self.size_bytes == 1
    }
}

/// Whether these bytes begin with the signature of an array file.
pub(crate) fn is_npy(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// The header of a file.
#[derive(Debug)]
pub(crate) struct NpyHeader {
    /// Length of each axis.
    pub(crate) shape: Vec<usize>,
    pub(crate) number: &'static NumberType,
    is_fortran: bool,
}

/// A file's header and its data, whose length matches the header.
pub(crate) fn split(bytes: &[u8]) -> Result<(NpyHeader, &[u8]), InputError> {
    let short = || damaged("it ends within its header");
    let rest = bytes.strip_prefix(MAGIC).ok_or_else(|| damaged("its first bytes are others"))?;
    let (&[major, _minor], rest) = rest.split_first_chunk::<2>().ok_or_else(short)?;
    let sized = match major {
        1 => rest.split_first_chunk::<2>().map(|(size, rest)| (usize::from(u16::from_le_bytes(*size)), rest)),
        2 | 3 => rest.split_first_chunk::<4>().map(|(size, rest)| (u32::from_le_bytes(*size) as usize, rest)),
        _ => return Err(damaged(&format!("its version must be 1, 2 or 3, got {major}"))),
    };
    let (size, rest) = sized.ok_or_else(short)?;
    if size > HEADER_BYTES_MAX {
        return Err(damaged(&format!("its header must have at most {HEADER_BYTES_MAX} bytes, got {size}")));
    }
    let (text, data) = rest.split_at_checked(size).ok_or_else(short)?;
    let text = std::str::from_utf8(text).map_err(|_| damaged("its header is no text"))?;
    let header = parse(text)?;
    header.check_length(data.len())?;
    Ok((header, data))
}

fn damaged(what: &str) -> InputError {
    InputError::Damaged(format!("not a NumPy array file: {what}"))
}

/// The header's keys.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    descr: serde_json::Value,
    fortran_order: bool,
    shape: Vec<usize>,
}

fn parse(text: &str) -> Result<NpyHeader, InputError> {
    // Such a literal is JSON but for its quotes, brackets, truth values, and commas at the end of a list.
    let packed: String = text.split_ascii_whitespace().collect();
    let python_and_json =
        [(",)", "]"), (",}", "}"), ("(", "["), (")", "]"), ("'", "\""), ("True", "true"), ("False", "false")];
    let json = python_and_json.iter().fold(packed, |text, (python, json)| text.replace(python, json));
    let keys: Keys = serde_json::from_str(&json)
        .map_err(|error| damaged(&format!("its header is not as it must be: {}", shown(&error.to_string()))))?;
    if keys.shape.len() > RANK_MAX {
        return refuse(format!("an array must have at most {RANK_MAX} axes"));
    }
    let Some(descr) = keys.descr.as_str() else {
        return refuse("an array of records is refused: save plain numbers");
    };
    Ok(NpyHeader { shape: keys.shape, number: number_of(descr)?, is_fortran: keys.fortran_order })
}

/// The number type of a dtype such as `<f4`.
fn number_of(descr: &str) -> Result<&'static NumberType, InputError> {
    let (order, code) = descr.split_at_checked(1).unwrap_or(("", descr));
    if code.starts_with('O') {
        return refuse("an array of pickled Python objects is refused: save plain numbers");
    }
    match NUMBER_TYPES.iter().find(|number| number.code == code) {
        Some(number) if order == "<" || (order == "|" && number.is_byte()) => Ok(number),
        _ => {
            let known = "<f4, <f8, |u1, <u2, <u4, <i2, <i4 or <i8";
            refuse(format!("an array's dtype must be {known}, got `{}`", shown(descr)))
        }
    }
}

impl NpyHeader {
    fn check_length(&self, got: usize) -> Result<(), InputError> {
        let count = self.shape.iter().try_fold(1_usize, |product, &axis| product.checked_mul(axis));
        let expected = count.and_then(|count| count.checked_mul(self.number.size_bytes));
        if expected == Some(got) {
            return Ok(());
        }
        let expected = expected.map_or("too many".to_owned(), |bytes| bytes.to_string());
        Err(InputError::Damaged(format!("an array of shape {:?} needs {expected} bytes, got {got}", self.shape)))
    }

    /// The values with the last axis fastest, for any order in the file.
    pub(crate) fn decode(&self, data: &[u8]) -> Vec<f32> {
        let values = (self.number.read)(data);
        if self.is_fortran { last_axis_fastest(&self.shape, &values) } else { values }
    }
}

/// Numbers of `N` bytes each.
pub(crate) fn each<const N: usize>(data: &[u8], convert: impl Fn([u8; N]) -> f32) -> Vec<f32> {
    data.as_chunks::<N>().0.iter().map(|bytes| convert(*bytes)).collect()
}

/// Reorders values from first-axis-fastest to last-axis-fastest.
fn last_axis_fastest(shape: &[usize], values: &[f32]) -> Vec<f32> {
    let place_of = |flat: usize| {
        // From the last axis to the first: the index along it, and how far apart its neighbours are.
        let step = |(rest, stride, place): (usize, usize, usize), length: &usize| {
            let stride = stride / length;
            (rest / length, stride, place + rest % length * stride)
        };
        shape.iter().rev().fold((flat, values.len(), 0), step).2
    };
    (0..values.len()).map(|flat| values[place_of(flat)]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::tests::npy_of;

    fn read(bytes: &[u8]) -> Result<Vec<f32>, InputError> {
        split(bytes).map(|(header, data)| header.decode(data))
    }

    /// A file with this header and this data.
    fn file(version: u8, header: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = [MAGIC.as_slice(), &[version, 0]].concat();
        if version == 1 {
            bytes.extend((header.len() as u16).to_le_bytes());
        } else {
            bytes.extend((header.len() as u32).to_le_bytes());
        }
        [bytes.as_slice(), header.as_bytes(), data].concat()
    }

    fn header(descr: &str, is_fortran: &str, shape: &str) -> String {
        format!("{{'descr': '{descr}', 'fortran_order': {is_fortran}, 'shape': {shape}, }}  \n")
    }

    #[test]
    fn what_is_written_is_read() {
        for shape in [vec![], vec![3], vec![2, 3], vec![1, 2, 2, 2], vec![0, 4]] {
            let count = shape.iter().product();
            let values: Vec<f32> = (0..count).map(|i: usize| i as f32 - 1.5).collect();
            let bytes = npy_of(&shape, &values);
            let (header, data) = split(&bytes).unwrap();
            assert_eq!((header.decode(data), header.number.is_float()), (values, true));
            assert_eq!(header.shape, shape);
        }
    }

    #[test]
    fn every_dtype_is_the_same_numbers() {
        let numbers = [0_u8, 3, 100];
        let wanted = [0.0, 3.0, 100.0];
        let mut files: Vec<(&str, Vec<u8>)> = vec![("|u1", numbers.to_vec())];
        macro_rules! of {
            ($descr:literal, $number:ty) => {
                files.push(($descr, numbers.iter().flat_map(|n| <$number>::from(*n).to_le_bytes()).collect()));
            };
        }
        of!("<f4", f32);
        of!("<f8", f64);
        of!("<u2", u16);
        of!("<u4", u32);
        of!("<i2", i16);
        of!("<i4", i32);
        of!("<i8", i64);
        for (descr, data) in files {
            for version in [1, 2, 3] {
                let read = read(&file(version, &header(descr, "False", "(3,)"), &data)).unwrap();
                assert_eq!(read, wanted, "{descr}");
            }
        }
    }

    #[test]
    fn fortran_order_is_transposed() {
        // In Fortran's order element (i, j, k) of a 2×3×2 array lies at i + 2 (j + 3 k). Each gets its C-order number.
        let mut data = vec![0_u8; 12];
        for (i, j, k) in (0..2).flat_map(|i| (0..3).flat_map(move |j| (0..2).map(move |k| (i, j, k)))) {
            data[i + 2 * (j + 3 * k)] = ((i * 3 + j) * 2 + k) as u8;
        }
        let read = read(&file(1, &header("|u1", "True", "(2, 3, 2)"), &data)).unwrap();
        assert_eq!(read, (0..12).map(|n| n as f32).collect::<Vec<_>>());
    }

    #[test]
    fn files_cut_short_or_too_long_are_damaged() {
        let whole = npy_of(&[2, 2], &[1.0, 2.0, 3.0, 4.0]);
        for end in 0..whole.len() {
            assert!(matches!(read(&whole[..end]), Err(InputError::Damaged(_))), "cut at {end}");
        }
        assert!(read(&[whole.as_slice(), &[0]].concat()).is_err());
    }

    #[test]
    fn headers_that_promise_too_much_are_refused_before_anything_is_allocated() {
        let huge = "(4294967296, 4294967296, 4294967296)";
        let message = read(&file(1, &header("<f4", "False", huge), &[0; 16])).unwrap_err().to_string();
        assert!(message.contains("needs too many bytes, got 16"), "{message}");
        assert!(read(&file(1, &header("<f4", "False", "(100000000000,)"), &[0; 16])).is_err());
        let mut long = file(2, "", &[]);
        long[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(read(&long).unwrap_err().to_string().contains("at most 65536 bytes"));
    }

    #[test]
    fn what_is_not_plain_numbers_is_refused() {
        let of = |header: &str| read(&file(1, header, &[0; 8])).unwrap_err().to_string();
        assert!(of(&header("|O", "False", "(1,)")).contains("pickled"));
        assert!(of(&header("<c8", "False", "(1,)")).contains("dtype"));
        assert!(of(&header("|f4", "False", "(2,)")).contains("dtype"));
        assert!(of(&header(">f4", "False", "(2,)")).contains("<i4 or <i8, got `>f4`"));
        assert!(of("{'descr': [('x', '<f4')], 'fortran_order': False, 'shape': (1,), }").contains("records"));
        assert!(of(&header("|u1", "False", "(1, 1, 1, 1, 1, 8)")).contains("axes"));
        assert!(of("{'shape': (8,), 'color': 'red'}").contains("unknown field `color`"));
        assert!(of("{'shape': (8,), 'descr': '|u1'}").contains("missing field `fortran_order`"));
        assert!(of("{'shape': (-8,)}").contains("invalid value: integer `-8`"));
        assert!(read(b"\x93NUMPY\x09\x00\x00\x00").unwrap_err().to_string().contains("version"));
    }
}
