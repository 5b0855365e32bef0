//! Lists of a request with limits that apply while parsing. A body of 60 MB may contain a list of millions of entries;
//! surplus entries are counted for the message but never stored.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{Error, IgnoredAny, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};

/// The first entries of a list, at most `MAX`, and how many it has.
pub(crate) struct FirstEntries<T, const MAX: usize> {
    pub(crate) kept: Vec<T>,
    pub(crate) count: usize,
}

impl<'de, T: Deserialize<'de>, const MAX: usize> Deserialize<'de> for FirstEntries<T, MAX> {
    fn deserialize<D: Deserializer<'de>>(source: D) -> Result<Self, D::Error> {
        source.deserialize_seq(ListVisitor(PhantomData))
    }
}

struct ListVisitor<T, const MAX: usize>(PhantomData<T>);

impl<'de, T: Deserialize<'de>, const MAX: usize> Visitor<'de> for ListVisitor<T, MAX> {
    type Value = FirstEntries<T, MAX>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Self::Value, A::Error> {
        let mut kept = Vec::new();
        while kept.len() < MAX {
            let Some(entry) = list.next_element()? else { break };
            kept.push(entry);
        }
        let mut count = kept.len();
        while list.next_element::<IgnoredAny>()?.is_some() {
            count += 1;
        }
        Ok(FirstEntries { kept, count })
    }
}

/// Exactly `N` numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Numbers<const N: usize>(pub(crate) [f64; N]);

impl<'de, const N: usize> Deserialize<'de> for Numbers<N> {
    fn deserialize<D: Deserializer<'de>>(source: D) -> Result<Self, D::Error> {
        let FirstEntries { kept, count } = FirstEntries::<f64, N>::deserialize(source)?;
        let numbers = kept.try_into().ok().filter(|_| count == N).map(Self);
        numbers.ok_or_else(|| D::Error::custom(format!("must have {N} numbers, got {count}")))
    }
}

/// Reads exactly `N` numbers.
pub(crate) fn numbers<'de, D: Deserializer<'de>, const N: usize>(source: D) -> Result<[f64; N], D::Error> {
    Numbers::deserialize(source).map(|numbers| numbers.0)
}

/// Reads exactly `N` numbers, or nothing.
pub(crate) fn maybe_numbers<'de, D: Deserializer<'de>, const N: usize>(
    source: D,
) -> Result<Option<[f64; N]>, D::Error> {
    Ok(Option::<Numbers<N>>::deserialize(source)?.map(|numbers| numbers.0))
}

/// Reads a list of at most `MAX` entries, or nothing.
pub(crate) fn at_most<'de, D: Deserializer<'de>, T: Deserialize<'de>, const MAX: usize>(
    source: D,
) -> Result<Option<Vec<T>>, D::Error> {
    match Option::<FirstEntries<T, MAX>>::deserialize(source)? {
        Some(FirstEntries { count, .. }) if count > MAX => {
            Err(D::Error::custom(format!("must have at most {MAX} entries, got {count}")))
        }
        list => Ok(list.map(|list| list.kept)),
    }
}

/// Reads a list of at most `MAX` times `N` numbers, or nothing.
pub(crate) fn rows<'de, D: Deserializer<'de>, const N: usize, const MAX: usize>(
    source: D,
) -> Result<Option<Vec<[f64; N]>>, D::Error> {
    let rows = at_most::<D, Numbers<N>, MAX>(source)?;
    Ok(rows.map(|rows| rows.into_iter().map(|row| row.0).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points_of(json: &str) -> Result<Vec<[f64; 3]>, serde_json::Error> {
        let points = rows::<_, 3, 2>(&mut serde_json::Deserializer::from_str(json));
        points.map(|points| points.expect("a list is given"))
    }

    #[test]
    fn lists_within_their_bounds_are_read() {
        assert!(points_of("[]").unwrap().is_empty());
        assert_eq!(points_of("[[1, 2, 3.5], [4, 5, 6]]").unwrap(), [[1.0, 2.0, 3.5], [4.0, 5.0, 6.0]]);
    }

    #[test]
    fn what_is_too_much_or_too_little_is_counted() {
        let message = |json: &str| points_of(json).unwrap_err().to_string();
        for (json, expected) in [
            ("[[1, 2, 3], [1, 2, 3], 7, {}, []]", "must have at most 2 entries, got 5"),
            ("[[1, 2]]", "must have 3 numbers, got 2"),
            ("[[]]", "must have 3 numbers, got 0"),
            ("[[1, 2, 3, \"four\", []]]", "must have 3 numbers, got 5"),
            ("[7]", "expected a list"),
            ("7", "expected a list"),
        ] {
            assert!(message(json).contains(expected), "{json}: {}", message(json));
        }
    }
}
