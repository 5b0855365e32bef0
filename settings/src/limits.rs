//! Ranges of numbers.

use core::fmt::Display;
use core::ops::RangeInclusive;

use toml::Value;

/// Smallest and largest value of a number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits<T> {
    low: T,
    high: T,
    /// Whether `low` itself is out of range.
    is_above: bool,
}

/// Numbers above `low` and at most `high`.
pub const fn above<T: Copy>(low: T, high: T) -> Limits<T> {
    Limits { low, high, is_above: true }
}

impl<T> From<RangeInclusive<T>> for Limits<T> {
    fn from(range: RangeInclusive<T>) -> Self {
        let (low, high) = range.into_inner();
        Self { low, high, is_above: false }
    }
}

impl<T: Number> Default for Limits<T> {
    fn default() -> Self {
        T::ALL.into()
    }
}

impl<T: Number> Limits<T> {
    /// Whether a number is in range; NaN never is.
    pub(crate) fn hold(&self, value: T) -> bool {
        value <= self.high && if self.is_above { value > self.low } else { value >= self.low }
    }

    /// `[0.1, 2]`.
    pub(crate) fn interval(&self) -> String {
        let Self { low, high, .. } = self;
        format!("[{low}, {high}]")
    }

    /// `between 8 and 128`.
    pub(crate) fn text(&self) -> String {
        let Self { low, high, is_above } = self;
        if *is_above { format!("above {low} and at most {high}") } else { format!("between {low} and {high}") }
    }
}

/// A type of numbers in settings.
pub trait Number: Copy + PartialOrd + Display {
    /// The type's name for people.
    const KIND: &'static str;
    /// The range of all its finite values.
    const ALL: RangeInclusive<Self>;

    /// The number in a value, if the type can hold it.
    fn of(value: &Value) -> Option<Self>;
}

macro_rules! whole {
    ($($name:ty)*) => {$(
        impl Number for $name {
            const KIND: &'static str = "a whole number";
            const ALL: RangeInclusive<Self> = Self::MIN..=Self::MAX;

            fn of(value: &Value) -> Option<Self> {
                Self::try_from(value.as_integer()?).ok()
            }
        }
    )*};
}

whole!(u32 u64 usize);

macro_rules! real {
    ($($name:ty)*) => {$(
        impl Number for $name {
            const KIND: &'static str = "a number";
            const ALL: RangeInclusive<Self> = Self::MIN..=Self::MAX;

            fn of(value: &Value) -> Option<Self> {
                value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64)).map(|number| number as Self)
            }
        }
    )*};
}

real!(f32 f64);
