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

    /// Reports values out of range in a setting that was not read.
    fn check(&self, limits: &Self::Limits, reader: &mut Reader<'_>);

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
        match T::of(value) {
            Some(number) if limits.hold(number) => return Some(number),
            Some(number) => number.check(limits, reader),
            None if T::is_kind(value) => reader.misfit(limits.text(), value),
            None => reader.misfit(T::KIND, value),
        }
        None
    }

    fn check(&self, limits: &Limits<T>, reader: &mut Reader<'_>) {
        if !limits.hold(*self) {
            reader.fault(format_args!("must be {}, got {self}", limits.text()));
        }
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

            fn check(&self, (): &(), _: &mut Reader<'_>) {}

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

    fn check(&self, limits: &T::Limits, reader: &mut Reader<'_>) {
        self.iter().for_each(|inner| inner.check(limits, reader));
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

    fn check(&self, limits: &T::Limits, reader: &mut Reader<'_>) {
        self.iter().for_each(|inner| inner.check(limits, reader));
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

/// A range: two numbers, the lower one first.
impl<T: Number> Setting for [T; 2] {
    type Limits = Limits<T>;

    fn kind(limits: &Limits<T>) -> String {
        format!("a range [low, high] within {}", limits.interval())
    }

    fn read(value: &Value, limits: &Limits<T>, reader: &mut Reader<'_>) -> Option<Self> {
        let numbers: Option<Vec<T>> = value.as_array().and_then(|values| values.iter().map(T::of).collect());
        match numbers.as_deref() {
            Some(&[low, high]) if limits.hold(low) && limits.hold(high) && low <= high => Some([low, high]),
            _ => {
                reader.misfit(format_args!("a range [low, high] within {}", limits.interval()), value);
                None
            }
        }
    }

    fn check(&self, limits: &Limits<T>, reader: &mut Reader<'_>) {
        let [low, high] = *self;
        if !(limits.hold(low) && limits.hold(high) && low <= high) {
            let within = limits.interval();
            reader.fault(format_args!("must be a range [low, high] within {within}, got [{low}, {high}]"));
        }
    }

    fn written(&self) -> Option<String> {
        listed(self)
    }
}

macro_rules! numbers {
    ($count:literal, $word:literal) => {
        impl<T: Number> Setting for [T; $count] {
            type Limits = Limits<T>;

            fn kind(limits: &Limits<T>) -> String {
                format!(concat!($word, " values, each {}"), T::kind(limits))
            }

            fn read(value: &Value, limits: &Limits<T>, reader: &mut Reader<'_>) -> Option<Self> {
                let numbers: Option<Vec<T>> = value.as_array().and_then(|values| values.iter().map(T::of).collect());
                let fitting = numbers.and_then(|numbers| Self::try_from(numbers).ok());
                let fitting = fitting.filter(|numbers| numbers.iter().all(|number| limits.hold(*number)));
                if fitting.is_none() {
                    reader.misfit(Self::kind(limits), value);
                }
                fitting
            }

            fn check(&self, limits: &Limits<T>, reader: &mut Reader<'_>) {
                self.iter().for_each(|number| number.check(limits, reader));
            }

            fn written(&self) -> Option<String> {
                listed(self)
            }
        }
    };
}

// One number for each axis, or for each part of a quaternion; two are a range.
numbers!(3, "three");
numbers!(4, "four");
