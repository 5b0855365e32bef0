//! Types of settings: numbers, words, ranges, lists, and tables of settings.

use toml::Value;

use crate::limits::{Limits, Number};
use crate::reader::Reader;

/// A key for the reference.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Row {
    /// Its path; the name ends with the unit.
    pub key: String,
    /// Type and range.
    pub kind: String,
    /// What a file without it means, as a file has it; `None` if it must not be left out.
    pub default: Option<String>,
    /// Its meaning.
    pub meaning: String,
}

/// A type of settings.
pub trait Setting: Sized {
    /// The limits of its values besides the type.
    type Limits: Default;

    /// Type and range as text: `a number between 0 and 1`.
    fn kind(limits: &Self::Limits) -> String;

    /// Reads a value; `None` after a fault.
    fn read(value: &Value, limits: &Self::Limits, reader: &mut Reader<'_>) -> Option<Self>;

    /// The value as files have it, for the reference; tables have none.
    fn written(&self) -> Option<String> {
        None
    }

    /// Adds the rows of a table's keys, and says whether they tell all of it; other settings have none. `default` is
    /// the table's where it may be left out.
    fn add_rows(_prefix: &str, _default: Option<&Self>, _rows: &mut Vec<Row>) -> bool {
        false
    }
}

/// The rows of a table of settings, in the order of their declaration.
#[must_use]
pub fn rows_of<T: Setting>() -> Vec<Row> {
    let mut rows = Vec::new();
    T::add_rows("", None, &mut rows);
    rows
}

impl<T: Number> Setting for T {
    type Limits = Limits<T>;

    fn kind(limits: &Limits<T>) -> String {
        format!("{} {}", T::KIND, limits.text())
    }

    fn read(value: &Value, limits: &Limits<T>, reader: &mut Reader<'_>) -> Option<Self> {
        let number = T::of(value);
        let fitting = number.filter(|number| limits.hold(*number));
        match (fitting, number) {
            (Some(_), _) => {}
            (None, Some(number)) => reader.fault(format_args!("must be {}, got {number}", limits.text())),
            (None, None) => reader.misfit(Self::kind(limits), value),
        }
        fitting
    }

    fn written(&self) -> Option<String> {
        Some(self.to_string())
    }
}

macro_rules! plain {
    ($name:ty, $kind:literal, $of:path) => {
        impl Setting for $name {
            type Limits = ();

            fn kind((): &()) -> String {
                $kind.to_owned()
            }

            fn read(value: &Value, (): &(), reader: &mut Reader<'_>) -> Option<Self> {
                let found = $of(value).map(Self::from);
                if found.is_none() {
                    reader.misfit($kind, value);
                }
                found
            }

            fn written(&self) -> Option<String> {
                Some(format!("{self:?}"))
            }
        }
    };
}

plain!(bool, "true or false", Value::as_bool);
plain!(String, "a text", Value::as_str);

/// An optional setting.
impl<T: Setting> Setting for Option<T> {
    type Limits = T::Limits;

    fn kind(limits: &T::Limits) -> String {
        format!("{}, or left out", T::kind(limits))
    }

    fn read(value: &Value, limits: &T::Limits, reader: &mut Reader<'_>) -> Option<Self> {
        T::read(value, limits, reader).map(Some)
    }

    fn written(&self) -> Option<String> {
        self.as_ref().map_or_else(|| Some("left out".to_owned()), T::written)
    }

    fn add_rows(prefix: &str, default: Option<&Self>, rows: &mut Vec<Row>) -> bool {
        T::add_rows(prefix, default.and_then(Option::as_ref), rows);
        false
    }
}

/// A list; the limits apply to each value.
impl<T: Setting> Setting for Vec<T> {
    type Limits = T::Limits;

    fn kind(limits: &T::Limits) -> String {
        format!("a list, each {}", T::kind(limits))
    }

    fn read(value: &Value, limits: &T::Limits, reader: &mut Reader<'_>) -> Option<Self> {
        let Some(values) = value.as_array() else {
            reader.misfit(Self::kind(limits), value);
            return None;
        };
        // All values are read, so that all faults are found.
        let read: Vec<Option<T>> = values.iter().map(|value| T::read(value, limits, reader)).collect();
        read.into_iter().collect()
    }

    fn written(&self) -> Option<String> {
        listed(self)
    }

    fn add_rows(prefix: &str, _: Option<&Self>, rows: &mut Vec<Row>) -> bool {
        let list = prefix.strip_suffix('.').unwrap_or(prefix);
        T::add_rows(&format!("{list}[]."), None, rows);
        false
    }
}

/// A list as files have it.
fn listed<T: Setting>(values: &[T]) -> Option<String> {
    let values: Vec<String> = values.iter().map(T::written).collect::<Option<_>>()?;
    Some(format!("[{}]", values.join(", ")))
}

/// Two numbers are a range, the lower one first; three are one for each axis, and four are a quaternion.
impl<T: Number, const COUNT: usize> Setting for [T; COUNT] {
    type Limits = Limits<T>;

    fn kind(limits: &Limits<T>) -> String {
        match COUNT {
            2 => format!("a range [low, high] within {}", limits.interval()),
            3 => format!("three values, each {}", T::kind(limits)),
            _ => format!("four values, each {}", T::kind(limits)),
        }
    }

    fn read(value: &Value, limits: &Limits<T>, reader: &mut Reader<'_>) -> Option<Self> {
        let numbers: Option<Vec<T>> = value.as_array().and_then(|values| values.iter().map(T::of).collect());
        let fitting = numbers.and_then(|numbers| Self::try_from(numbers).ok());
        let fitting = fitting.filter(|numbers| numbers.iter().all(|number| limits.hold(*number)));
        let fitting = fitting.filter(|numbers| COUNT != 2 || numbers.is_sorted());
        if fitting.is_none() {
            reader.misfit(Self::kind(limits), value);
        }
        fitting
    }

    fn written(&self) -> Option<String> {
        listed(self)
    }
}
