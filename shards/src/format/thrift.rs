//! Validates data of the Thrift compact protocol against a grammar. parquet-rs trusts the content of footers and page
//! headers: it recurses as deep as a schema nests, reserves memory for any declared number of children, truncates
//! numbers to 32 bits, and ignores field types. Data that pass this check are read correctly.

/// The expected type of a value.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Shape {
    /// A boolean field; its value is part of the field's type.
    Bool,
    /// 8 bits.
    I8,
    /// 16 bits.
    I16,
    /// 32 bits.
    I32,
    /// 64 bits.
    I64,
    /// Bytes.
    Binary,
    /// Fields by number: each at most once, in order.
    Struct(&'static [(u8, Shape)]),
    /// A union: exactly one of the fields.
    OneOf(&'static [(u8, Shape)]),
    /// A list with a maximum length.
    List(usize, &'static Shape),
}

/// Receives the path of field numbers to each number, and the number.
pub(crate) type Visit<'a> = &'a mut dyn FnMut(&[u8], i64);

/// The size of a value at the start of `bytes`.
pub(crate) fn measure(bytes: &[u8], shape: &Shape, visit: Visit) -> Result<usize, String> {
    let mut walk = Walk { rest: bytes, path: Vec::new(), visit };
    walk.value(shape).map_err(|message| {
        let path: Vec<String> = walk.path.iter().map(ToString::to_string).collect();
        format!("{message} in field {}", path.join("."))
    })?;
    Ok(bytes.len() - walk.rest.len())
}

struct Walk<'a, 'v> {
    rest: &'a [u8],
    path: Vec<u8>,
    visit: Visit<'v>,
}

type Walked = Result<(), &'static str>;

const CUT: &str = "it ends too early";
const TYPE: &str = "a value has another type";

impl Shape {
    /// Its type code as a field or an element; a true field has 1.
    fn code(self) -> u8 {
        match self {
            Self::Bool => 2,
            Self::I8 => 3,
            Self::I16 => 4,
            Self::I32 => 5,
            Self::I64 => 6,
            Self::Binary => 8,
            Self::List(..) => 9,
            Self::Struct(_) | Self::OneOf(_) => 12,
        }
    }
}

impl Walk<'_, '_> {
    fn value(&mut self, shape: &Shape) -> Walked {
        match *shape {
            Shape::Bool => Ok(()),
            Shape::I8 => self.byte().map(drop),
            Shape::I16 => self.whole(i16::MIN.into(), i16::MAX.into()),
            Shape::I32 => self.whole(i32::MIN.into(), i32::MAX.into()),
            Shape::I64 => self.whole(i64::MIN, i64::MAX),
            Shape::Binary => {
                let length = usize::try_from(self.varint()?).map_err(|_| CUT)?;
                self.rest = self.rest.get(length..).ok_or(CUT)?;
                Ok(())
            }
            Shape::Struct(fields) => self.fields(fields).map(drop),
            Shape::OneOf(fields) => (self.fields(fields)? == 1).then_some(()).ok_or("not one of several"),
            Shape::List(most, element) => self.list(most, element),
        }
    }

    /// Number of fields.
    fn fields(&mut self, fields: &[(u8, Shape)]) -> Result<usize, &'static str> {
        let (mut last, mut count) = (0, 0);
        loop {
            let head = self.byte()?;
            if head == 0 {
                return Ok(count);
            }
            let (step, code) = (head >> 4, head & 0x0f);
            let number = last + step; // at most 15 more than a field number of the grammar
            let known = fields.iter().find(|(known, _)| *known == number && step > 0);
            self.path.push(number);
            let (_, shape) = known.ok_or("a field is unknown or in the wrong place")?;
            if code != shape.code() && !(code == 1 && matches!(shape, Shape::Bool)) {
                return Err(TYPE);
            }
            self.value(shape)?;
            self.path.pop();
            (last, count) = (number, count + 1);
        }
    }

    fn list(&mut self, most: usize, element: &Shape) -> Walked {
        let head = self.byte()?;
        if head & 0x0f != element.code() {
            return Err(TYPE);
        }
        let count = match head >> 4 {
            15 => usize::try_from(self.varint()?).unwrap_or(usize::MAX),
            short => usize::from(short),
        };
        if count > most {
            return Err("a list is too long");
        }
        (0..count).try_for_each(|_| self.value(element))
    }

    /// A number in zigzag.
    fn whole(&mut self, low: i64, high: i64) -> Walked {
        let bits = self.varint()?;
        let value = (bits >> 1) as i64 ^ -((bits & 1) as i64); // all 64 bits are used
        if !(low..=high).contains(&value) {
            return Err("a number is too large");
        }
        (self.visit)(&self.path, value);
        Ok(())
    }

    fn varint(&mut self) -> Result<u64, &'static str> {
        let mut value = 0;
        for place in 0..10 {
            let byte = self.byte()?;
            if place == 9 && byte > 1 {
                break;
            }
            value |= u64::from(byte & 0x7f) << (7 * place);
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err("a number is too large")
    }

    fn byte(&mut self) -> Result<u8, &'static str> {
        let (first, rest) = self.rest.split_first().ok_or(CUT)?;
        self.rest = rest;
        Ok(*first)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INNER: Shape = Shape::Struct(&[(1, Shape::Bool), (3, Shape::I64)]);
    const OUTER: Shape = Shape::Struct(&[
        (1, Shape::I32),
        (2, Shape::Binary),
        (4, Shape::List(3, &INNER)),
        (5, Shape::OneOf(&[(1, Shape::I8), (2, Shape::I16)])),
    ]);

    type Numbers = Vec<(Vec<u8>, i64)>;

    fn read(bytes: &[u8]) -> Result<(usize, Numbers), String> {
        let mut seen = Vec::new();
        let length = measure(bytes, &OUTER, &mut |path, value| seen.push((path.to_vec(), value)))?;
        Ok((length, seen))
    }

    #[test]
    fn what_the_grammar_allows_is_seen() {
        let bytes =
            [0x15, 5, 0x18, 2, b'a', b'b', 0x29, 0x2c, 0x11, 0x26, 0x80, 1, 0, 0x12, 0, 0x1c, 0x13, 9, 0, 0, 77];
        let seen = vec![(vec![1], -3), (vec![4, 3], 64)];
        assert_eq!(read(&bytes), Ok((bytes.len() - 1, seen)));
        for end in 0..bytes.len() - 1 {
            assert!(read(&bytes[..end]).is_err(), "cut at {end}");
        }
    }

    #[test]
    fn everything_else_is_refused() {
        let most = [0xff; 9];
        for (bytes, reason) in [
            (&[0x35, 2, 0][..], "a field is unknown or in the wrong place in field 3"),
            (&[0x15, 2, 0x05, 2, 2, 0], "a field is unknown or in the wrong place in field 1"),
            (&[0x16, 2, 0], "a value has another type in field 1"),
            (&[0x15, 0xfe, 0xff, 0xff, 0xff, 0x1f, 0], "a number is too large in field 1"),
            (&[&[0x15], &most[..], &[2, 0]].concat(), "a number is too large in field 1"),
            (&[&[0x28], &most[..], &[1, 0]].concat(), "it ends too early in field 2"),
            (&[0x49, 0x4c, 0, 0, 0, 0, 0], "a list is too long in field 4"),
            (&[0x49, 0xfc, 0xff, 0xff, 0xff, 0xff, 7], "a list is too long in field 4"),
            (&[0x49, 0x12, 0, 0], "a value has another type in field 4"),
            (&[0x5c, 0, 0], "not one of several in field 5"),
            (&[0x5c, 0x13, 1, 0x14, 1, 0, 0], "not one of several in field 5"),
        ] {
            assert_eq!(read(bytes), Err(reason.to_owned()), "{bytes:x?}");
        }
    }
}
