//! The version of the format on disk.

use serde::{Deserialize, Serialize};

/// Version of a dataset's format. It increases if readers of the previous version would fail or misinterpret the data.
/// A dataset has the lowest version that describes it, so that older programs can read it if possible.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(transparent)]
pub struct FormatVersion(u32);

impl FormatVersion {
    /// The version of datasets whose objects are primitives.
    pub const CURRENT: Self = Self(1);
    /// The version of datasets whose objects are models: `meta/info.json` has `models`, and `shape` is a model's name.
    pub const MODELS: Self = Self(2);
    /// The version of datasets with several hands: `meta/info.json` has `grippers`, and `scenes` the column `gripper`.
    pub const HANDS: Self = Self(3);
    /// The version of datasets with containers: `scenes` has their columns, and `hit` may be `container`.
    pub const CONTAINERS: Self = Self(4);
    /// The version of datasets whose attempts were repeated: `attempts` has the column `robustness`.
    pub const REPEATS: Self = Self(5);
    /// The newest version that this program reads.
    pub const NEWEST: Self = Self::REPEATS;
    /// The oldest version that this program reads.
    pub const OLDEST: Self = Self(1);

    /// A version by its number, as found in a file.
    #[must_use]
    pub const fn new(number: u32) -> Self {
        Self(number)
    }

    /// The number.
    #[must_use]
    pub const fn number(self) -> u32 {
        self.0
    }

    /// Whether this program can read the version.
    ///
    /// # Errors
    /// What is wrong, if it is older or newer than the supported versions.
    pub fn check_readable(self) -> Result<(), String> {
        let (Self(oldest), Self(newest), Self(got)) = (Self::OLDEST, Self::NEWEST, self);
        if (oldest..=newest).contains(&got) {
            return Ok(());
        }
        let hint = if got > newest { "read it with a newer graspmill" } else { "no graspmill wrote that" };
        Err(format!("format_version must be between {oldest} and {newest}, got {got}; {hint}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_from_the_future_and_from_nowhere_are_refused() {
        assert!(FormatVersion::CURRENT.check_readable().is_ok());
        assert!(FormatVersion::MODELS.check_readable().is_ok());
        assert!(FormatVersion::HANDS.check_readable().is_ok());
        assert!(FormatVersion::CONTAINERS.check_readable().is_ok());
        assert!(FormatVersion::REPEATS.check_readable().is_ok());
        let future = FormatVersion::new(FormatVersion::NEWEST.number() + 1).check_readable().unwrap_err();
        assert_eq!(future, "format_version must be between 1 and 5, got 6; read it with a newer graspmill");
        assert!(FormatVersion::new(0).check_readable().is_err());
    }
}
