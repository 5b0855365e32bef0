//! Lists of a request with limits that apply while parsing. A body of 60 MB may contain a list of millions of entries;
//! surplus entries are counted for the message but never stored.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{Error, IgnoredAny, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};

/// Exactly `N` numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Numbers<const N: usize>(pub(crate) [f64; N]);

impl<'de, const N: usize> Deserialize<'de> for Numbers<N> {
    fn deserialize<D: Deserializer<'de>>(source: D) -> Result<Self, D::Error> {
        numbers(source).map(Self)
    }
}

/// Reads exactly `N` numbers.
pub(crate) fn numbers<'de, D: Deserializer<'de>, const N: usize>(source: D) -> Result<[f64; N], D::Error> {
    let (kept, count) = entries::<f64, D>(source, N, "a list of numbers")?;
    let wrong = || D::Error::custom(format!("must have {N} numbers, got {count}"));
    if count == N { kept.try_into().map_err(|_| wrong()) } else { Err(wrong()) }
}

/// A list of at most `MAX` entries.
#[derive(Debug)]
pub(crate) struct AtMost<T, const MAX: usize>(pub(crate) Vec<T>);

impl<'de, T: Deserialize<'de>, const MAX: usize> Deserialize<'de> for AtMost<T, MAX> {
    fn deserialize<D: Deserializer<'de>>(source: D) -> Result<Self, D::Error> {
        match entries(source, MAX, "a list")? {
            (kept, count) if count <= MAX => Ok(Self(kept)),
            (_, count) => Err(D::Error::custom(format!("must have at most {MAX} entries, got {count}"))),
        }
    }
}

/// The first entries of a list, and its length.
pub(crate) fn first_entries<'de, T: Deserialize<'de>, A: SeqAccess<'de>>(
    mut list: A,
    kept_max: usize,
) -> Result<(Vec<T>, usize), A::Error> {
    let (mut kept, mut count) = (Vec::new(), 0);
    while count < kept_max {
        let Some(entry) = list.next_element()? else { return Ok((kept, count)) };
        kept.push(entry);
        count += 1;
    }
    while list.next_element::<IgnoredAny>()?.is_some() {
        count += 1;
    }
    Ok((kept, count))
}

fn entries<'de, T: Deserialize<'de>, D: Deserializer<'de>>(
    source: D,
    kept_max: usize,
    expected: &'static str,
) -> Result<(Vec<T>, usize), D::Error> {
    source.deserialize_seq(Entries { kept_max, expected, kind: PhantomData })
}

struct Entries<T> {
    kept_max: usize,
    expected: &'static str,
    kind: PhantomData<T>,
}

impl<'de, T: Deserialize<'de>> Visitor<'de> for Entries<T> {
    type Value = (Vec<T>, usize);

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.expected)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<Self::Value, A::Error> {
        first_entries(list, self.kept_max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points_of(json: &str) -> Result<Vec<Numbers<3>>, serde_json::Error> {
        serde_json::from_str::<AtMost<_, 2>>(json).map(|list| list.0)
    }

    #[test]
    fn lists_within_their_bounds_are_read() {
        assert!(points_of("[]").unwrap().is_empty());
        assert_eq!(
            points_of("[[1, 2, 3.5], [4, 5, 6]]").unwrap(),
            [Numbers([1.0, 2.0, 3.5]), Numbers([4.0, 5.0, 6.0])]
        );
    }

    #[test]
    fn what_is_too_much_or_too_little_is_counted() {
        let message = |json: &str| points_of(json).unwrap_err().to_string();
        for (json, expected) in [
            ("[[1, 2, 3], [1, 2, 3], 7, {}, []]", "must have at most 2 entries, got 5"),
            ("[[1, 2]]", "must have 3 numbers, got 2"),
            ("[[]]", "must have 3 numbers, got 0"),
            ("[[1, 2, 3, \"four\", []]]", "must have 3 numbers, got 5"),
            ("[7]", "expected a list of numbers"),
            ("7", "expected a list"),
        ] {
            assert!(message(json).contains(expected), "{json}: {}", message(json));
        }
    }
}
