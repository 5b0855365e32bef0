//! Which scenes of a dataset are exported: numbers and ranges, such as `0-9,17`.

use std::fmt::{self, Display};
use std::str::FromStr;

use shards::DatasetInfo;

/// Scenes by their numbers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SceneSelection(
    /// First and last scenes of ranges, ascending, neither empty nor overlapping nor adjacent; at least one.
    Vec<[u64; 2]>,
);

impl SceneSelection {
    /// Whether a scene is selected.
    #[must_use]
    pub fn has(&self, scene_id: u64) -> bool {
        self.0.iter().any(|[first, last]| (*first..=*last).contains(&scene_id))
    }

    /// How many scenes are selected.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.0.iter().map(|[first, last]| last - first + 1).sum()
    }

    /// Whether the dataset has all of them; else what is wrong.
    pub(super) fn check(&self, info: &DatasetInfo) -> Result<(), String> {
        let last = self.0.last().map_or(0, |[_, last]| *last);
        let count = info.scene_count;
        if last < count {
            Ok(())
        } else {
            Err(format!("scenes must be below the number of scenes, {count}, got {last}"))
        }
    }
}

impl FromStr for SceneSelection {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |part: &str| {
            let parsed = part.trim().parse::<u64>().ok().filter(|number| *number < u64::MAX);
            parsed.ok_or_else(|| format!("must be scenes' numbers and ranges, such as 0-9,17, got `{part}`"))
        };
        let mut ranges = Vec::new();
        for part in text.split(',') {
            let (first, last) = part.split_once('-').unwrap_or((part, part));
            let range = [number(first)?, number(last)?];
            if range[0] > range[1] {
                return Err(format!("the range `{part}` is empty"));
            }
            ranges.push(range);
        }
        ranges.sort_unstable();
        let mut merged: Vec<[u64; 2]> = Vec::new();
        for [first, last] in ranges {
            match merged.last_mut() {
                Some([_, end]) if first <= *end + 1 => *end = last.max(*end),
                _ => merged.push([first, last]),
            }
        }
        Ok(Self(merged))
    }
}

impl Display for SceneSelection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shown = |[first, last]: &[u64; 2]| {
            if first == last { first.to_string() } else { format!("{first}-{last}") }
        };
        f.write_str(&self.0.iter().map(shown).collect::<Vec<_>>().join(","))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_ranges_are_sorted_and_merged() {
        for (text, shown, count) in [("7", "7", 1), ("0-9,17", "0-9,17", 11), ("5, 3-4,0,4-8", "0,3-8", 7)] {
            let selection: SceneSelection = text.parse().unwrap();
            assert_eq!((selection.to_string().as_str(), selection.count()), (shown, count));
            assert_eq!((0..20).filter(|scene| selection.has(*scene)).count() as u64, count);
        }
    }

    #[test]
    fn what_is_no_selection_is_refused() {
        for (text, told) in [("", "got ``"), ("a", "got `a`"), ("-3", "got ``"), ("9-3", "the range `9-3` is empty")] {
            let refused = text.parse::<SceneSelection>().unwrap_err();
            assert!(refused.contains(told), "{text:?}: {refused}");
        }
    }
}
