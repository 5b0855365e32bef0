//! A strict reader of NumPy's array files. The header is a Python literal, and the parser supports only its three keys.
//! Nothing is allocated before the header's shape matches the number of bytes.

use crate::input::error::{InputError, shown};

const MAGIC: &[u8; 6] = b"\x93NUMPY";
const HEADER_BYTES_MAX: usize = 64 * 1024;
const RANK_MAX: usize = 5;

/// The number type of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NpyNumber {
    /// Single precision.
    F32,
    /// Double precision.
    F64,
    /// Bytes.
    U8,
    /// Unsigned 16 bits, as depth cameras deliver.
    U16,
    /// Unsigned 32 bits.
    U32,
    /// Signed 16 bits.
    I16,
    /// Signed 32 bits.
    I32,
    /// Signed 64 bits.
    I64,
}

/// An array.
#[derive(Debug, Clone, PartialEq)]
pub struct Npy {
    /// Length of each axis.
    pub shape: Vec<usize>,
    /// Values with the last axis fastest, for any order in the file.
    pub values: Vec<f32>,
    /// Their type in the file.
    pub number: NpyNumber,
}

/// Reads an array file.
///
/// # Errors
/// [`InputError::Damaged`] if the bytes are not a complete array file, [`InputError::Value`] if the array does not
/// contain plain numbers.
pub fn read_npy(bytes: &[u8]) -> Result<Npy, InputError> {
    let (header, data) = split(bytes)?;
    Ok(header.decode(data))
}

/// An array file (version 1.0, `<f4`, C order) of these values.
///
/// # Panics
/// If the number of values differs from the shape.
#[must_use]
pub fn write_npy_f32(shape: &[usize], values: &[f32]) -> Vec<u8> {
    assert_eq!(shape.iter().product::<usize>(), values.len(), "the shape must fit the values");
    let axes: String = shape.iter().map(|axis| format!("{axis}, ")).collect();
    let mut header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}), }}", axes.trim_end());
    // NumPy aligns the data to 64 bytes; the header ends with a newline.
    let before = MAGIC.len() + 4;
    let padded = (before + header.len() + 1).next_multiple_of(64) - before;
    header.push_str(&" ".repeat(padded - 1 - header.len()));
    header.push('\n');
    let mut bytes = Vec::with_capacity(before + header.len() + 4 * values.len());
    bytes.extend_from_slice(MAGIC);
    bytes.extend_from_slice(&[1, 0]);
    bytes.extend_from_slice(&(header.len() as u16).to_le_bytes());
    bytes.extend_from_slice(header.as_bytes());
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    bytes
}

/// Whether these bytes begin with the signature of an array file.
pub(crate) fn is_npy(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// The header of a file.
#[derive(Debug, PartialEq)]
pub(crate) struct NpyHeader {
    pub(crate) shape: Vec<usize>,
    pub(crate) number: NpyNumber,
    is_big_endian: bool,
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

fn parse(text: &str) -> Result<NpyHeader, InputError> {
    let mut text = Literal(text);
    let (mut descr, mut is_fortran, mut shape) = (None, None, None);
    text.expect("{")?;
    while !text.take("}") {
        let key = text.quoted()?;
        text.expect(":")?;
        match key {
            "descr" => descr = Some(text.descr()?),
            "fortran_order" => is_fortran = Some(text.truth()?),
            "shape" => shape = Some(text.shape()?),
            other => return Err(damaged(&format!("its header has an unknown key `{}`", shown(other)))),
        }
        if !text.take(",") {
            text.expect("}")?;
            break;
        }
    }
    let missing = |key: &str| damaged(&format!("its header lacks `{key}`"));
    let (number, is_big_endian) = number_of(descr.ok_or_else(|| missing("descr"))?)?;
    Ok(NpyHeader {
        shape: shape.ok_or_else(|| missing("shape"))?,
        number,
        is_big_endian,
        is_fortran: is_fortran.ok_or_else(|| missing("fortran_order"))?,
    })
}

/// The number type of a dtype such as `<f4`, and whether it is big-endian.
fn number_of(descr: &str) -> Result<(NpyNumber, bool), InputError> {
    let (order, code) = descr.split_at_checked(1).unwrap_or(("", descr));
    let wrong = || {
        let known = "<f4, <f8, |u1, <u2, <u4, <i2, <i4 or <i8 (or big-endian, with >)";
        InputError::Value(format!("an array's dtype must be {known}, got `{}`", shown(descr)))
    };
    if code.starts_with('O') {
        return Err(InputError::Value("an array of pickled Python objects is refused: save plain numbers".to_owned()));
    }
    let number = match code {
        "f4" => NpyNumber::F32,
        "f8" => NpyNumber::F64,
        "u1" => NpyNumber::U8,
        "u2" => NpyNumber::U16,
        "u4" => NpyNumber::U32,
        "i2" => NpyNumber::I16,
        "i4" => NpyNumber::I32,
        "i8" => NpyNumber::I64,
        _ => return Err(wrong()),
    };
    match (order, number) {
        ("<", _) | ("|", NpyNumber::U8) => Ok((number, false)),
        (">", _) => Ok((number, true)),
        _ => Err(wrong()),
    }
}

/// The unparsed rest of a Python literal.
struct Literal<'a>(&'a str);

impl<'a> Literal<'a> {
    fn take(&mut self, token: &str) -> bool {
        self.0 = self.0.trim_start();
        let rest = self.0.strip_prefix(token);
        self.0 = rest.unwrap_or(self.0);
        rest.is_some()
    }

    fn expect(&mut self, token: &str) -> Result<(), InputError> {
        if self.take(token) {
            return Ok(());
        }
        Err(damaged(&format!("its header must have `{token}` before `{}`", shown(self.0.trim_end()))))
    }

    fn quoted(&mut self) -> Result<&'a str, InputError> {
        let quote = if self.take("'") { '\'' } else { '"' };
        if quote == '"' {
            self.expect("\"")?;
        }
        let (text, rest) = self.0.split_once(quote).ok_or_else(|| damaged("its header has a text without end"))?;
        self.0 = rest;
        Ok(text)
    }

    fn descr(&mut self) -> Result<&'a str, InputError> {
        if self.take("[") {
            return Err(InputError::Value("an array of records is refused: save plain numbers".to_owned()));
        }
        self.quoted()
    }

    fn truth(&mut self) -> Result<bool, InputError> {
        if self.take("True") {
            return Ok(true);
        }
        self.expect("False").map(|()| false)
    }

    fn shape(&mut self) -> Result<Vec<usize>, InputError> {
        let mut shape = Vec::new();
        self.expect("(")?;
        while !self.take(")") {
            if shape.len() == RANK_MAX {
                return Err(InputError::Value(format!("an array must have at most {RANK_MAX} axes")));
            }
            shape.push(self.whole_number()?);
            if !self.take(",") {
                self.expect(")")?;
                break;
            }
        }
        Ok(shape)
    }

    fn whole_number(&mut self) -> Result<usize, InputError> {
        self.0 = self.0.trim_start();
        let end = self.0.find(|c: char| !c.is_ascii_digit()).unwrap_or(self.0.len());
        let (digits, rest) = self.0.split_at(end);
        self.0 = rest;
        digits.parse().map_err(|_| damaged("its header's shape has something other than a length"))
    }
}

impl NpyNumber {
    const fn size_bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::F32 | Self::U32 | Self::I32 => 4,
            Self::F64 | Self::I64 => 8,
        }
    }
}

impl NpyHeader {
    fn check_length(&self, got: usize) -> Result<(), InputError> {
        let count = self.shape.iter().try_fold(1_usize, |product, &axis| product.checked_mul(axis));
        let expected = count.and_then(|count| count.checked_mul(self.number.size_bytes()));
        if expected == Some(got) {
            return Ok(());
        }
        let expected = expected.map_or("too many".to_owned(), |bytes| bytes.to_string());
        Err(InputError::Damaged(format!("an array of shape {:?} needs {expected} bytes, got {got}", self.shape)))
    }

    /// The values, the last axis fastest.
    pub(crate) fn decode(self, data: &[u8]) -> Npy {
        let is_big = self.is_big_endian;
        let values = match self.number {
            NpyNumber::F32 => each(data, is_big, f32::from_le_bytes),
            NpyNumber::F64 => each(data, is_big, |bytes| f64::from_le_bytes(bytes) as f32),
            NpyNumber::U8 => each(data, is_big, |bytes: [u8; 1]| f32::from(bytes[0])),
            NpyNumber::U16 => each(data, is_big, |bytes| f32::from(u16::from_le_bytes(bytes))),
            NpyNumber::U32 => each(data, is_big, |bytes| u32::from_le_bytes(bytes) as f32),
            NpyNumber::I16 => each(data, is_big, |bytes| f32::from(i16::from_le_bytes(bytes))),
            NpyNumber::I32 => each(data, is_big, |bytes| i32::from_le_bytes(bytes) as f32),
            NpyNumber::I64 => each(data, is_big, |bytes| i64::from_le_bytes(bytes) as f32),
        };
        let values = if self.is_fortran { last_axis_fastest(&self.shape, &values) } else { values };
        Npy { shape: self.shape, values, number: self.number }
    }
}

/// Numbers of `N` bytes each, passed to `convert` in little-endian order.
fn each<const N: usize>(data: &[u8], is_big_endian: bool, convert: impl Fn([u8; N]) -> f32) -> Vec<f32> {
    let (numbers, _) = data.as_chunks::<N>();
    let ordered = numbers.iter().map(|bytes| {
        let mut bytes = *bytes;
        if is_big_endian {
            bytes.reverse();
        }
        bytes
    });
    ordered.map(convert).collect()
}

/// Reorders values from first-axis-fastest to last-axis-fastest.
fn last_axis_fastest(shape: &[usize], values: &[f32]) -> Vec<f32> {
    let mut strides = Vec::with_capacity(shape.len());
    let mut stride = 1;
    for &axis in shape {
        strides.push(stride);
        stride *= axis;
    }
    let mut index = vec![0; shape.len()];
    let mut ordered = Vec::with_capacity(values.len());
    for _ in 0..values.len() {
        let flat: usize = index.iter().zip(&strides).map(|(i, stride)| i * stride).sum();
        ordered.push(values[flat]);
        for (place, &length) in index.iter_mut().zip(shape).rev() {
            *place += 1;
            if *place < length {
                break;
            }
            *place = 0;
        }
    }
    ordered
}

#[cfg(test)]
mod tests {
    use super::*;

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
            let bytes = write_npy_f32(&shape, &values);
            assert_eq!((bytes.len() - 4 * count) % 64, 0, "aligned as NumPy does it");
            assert_eq!(read_npy(&bytes).unwrap(), Npy { shape, values, number: NpyNumber::F32 });
        }
    }

    #[test]
    fn every_dtype_in_both_byte_orders_is_the_same_numbers() {
        let numbers = [0_u8, 3, 100];
        let wanted = [0.0, 3.0, 100.0];
        let mut files: Vec<(&str, Vec<u8>)> = vec![("|u1", numbers.to_vec())];
        macro_rules! both {
            ($little:literal, $big:literal, $number:ty) => {
                files.push(($little, numbers.iter().flat_map(|n| <$number>::from(*n).to_le_bytes()).collect()));
                files.push(($big, numbers.iter().flat_map(|n| <$number>::from(*n).to_be_bytes()).collect()));
            };
        }
        both!("<f4", ">f4", f32);
        both!("<f8", ">f8", f64);
        both!("<u2", ">u2", u16);
        both!("<u4", ">u4", u32);
        both!("<i2", ">i2", i16);
        both!("<i4", ">i4", i32);
        both!("<i8", ">i8", i64);
        for (descr, data) in files {
            for version in [1, 2, 3] {
                let read = read_npy(&file(version, &header(descr, "False", "(3,)"), &data)).unwrap();
                assert_eq!(read.values, wanted, "{descr}");
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
        let read = read_npy(&file(1, &header("|u1", "True", "(2, 3, 2)"), &data)).unwrap();
        assert_eq!(read.values, (0..12).map(|n| n as f32).collect::<Vec<_>>());
    }

    #[test]
    fn files_cut_short_or_too_long_are_damaged() {
        let whole = write_npy_f32(&[2, 2], &[1.0, 2.0, 3.0, 4.0]);
        for end in 0..whole.len() {
            assert!(matches!(read_npy(&whole[..end]), Err(InputError::Damaged(_))), "cut at {end}");
        }
        assert!(read_npy(&[whole.as_slice(), &[0]].concat()).is_err());
    }

    #[test]
    fn headers_that_promise_too_much_are_refused_before_anything_is_allocated() {
        let huge = "(4294967296, 4294967296, 4294967296)";
        let message = read_npy(&file(1, &header("<f4", "False", huge), &[0; 16])).unwrap_err().to_string();
        assert!(message.contains("needs too many bytes, got 16"), "{message}");
        assert!(read_npy(&file(1, &header("<f4", "False", "(100000000000,)"), &[0; 16])).is_err());
        let mut long = file(2, "", &[]);
        long[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(read_npy(&long).unwrap_err().to_string().contains("at most 65536 bytes"));
    }

    #[test]
    fn what_is_not_plain_numbers_is_refused() {
        let of = |header: &str| read_npy(&file(1, header, &[0; 8])).unwrap_err().to_string();
        assert!(of(&header("|O", "False", "(1,)")).contains("pickled"));
        assert!(of(&header("<c8", "False", "(1,)")).contains("dtype"));
        assert!(of(&header("|f4", "False", "(2,)")).contains("dtype"));
        assert!(of("{'descr': [('x', '<f4')], 'fortran_order': False, 'shape': (1,), }").contains("records"));
        assert!(of(&header("|u1", "False", "(1, 1, 1, 1, 1, 8)")).contains("axes"));
        assert!(of("{'shape': (8,), 'color': 'red'}").contains("unknown key `color`"));
        assert!(of("{'shape': (8,), 'descr': '|u1'}").contains("lacks `fortran_order`"));
        assert!(of("{'shape': (-8,)}").contains("something other than a length"));
        assert!(read_npy(b"\x93NUMPY\x09\x00\x00\x00").unwrap_err().to_string().contains("version"));
    }
}
