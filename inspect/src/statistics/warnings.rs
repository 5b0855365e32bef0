//! Warnings about unusual datasets.

use program::text::{grouped, ratio};
use schema::Rule;
use shards::Tally;

use super::Report;

/// The usual range of the share of positives. The paper reports about one positive to three negatives for its rules: a
/// quarter.
const POSITIVE_SHARE: [f64; 2] = [0.15, 0.40];
/// Number of attempts of a group that should not all have failed.
const TRIED_MIN: u64 = 100;

impl Report {
    /// Unusual properties of the dataset, one sentence each.
    pub(crate) fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        let share = self.labels.positive_share();
        let by_rules = self.rules.iter().any(|group| group.labels.attempts > 0 && is_of_the_paper(&group.name));
        if by_rules && self.labels.attempts >= TRIED_MIN && !(POSITIVE_SHARE[0]..=POSITIVE_SHARE[1]).contains(&share) {
            warnings.push(format!(
                "Positives to negatives are {}: far from the paper's 1 : 3. Sizes against the gripper's opening and the number of \
                 objects decide this; labels are never resampled.",
                ratio(self.labels.positives, self.labels.negatives())
            ));
        }
        let failed = |labels: Tally| labels.attempts >= TRIED_MIN && labels.positives == 0;
        for group in self.shapes.iter().chain(&self.rules).filter(|group| failed(group.labels)) {
            warnings.push(format!("None of {} attempts of {} held.", grouped(group.labels.attempts), group.name));
        }
        warnings
    }
}

fn is_of_the_paper(rule: &str) -> bool {
    Rule::from_name(rule).is_some_and(|rule| rule.approach.axis().is_some())
}

#[cfg(test)]
mod tests {
    use shards::{Dataset, Draft};

    use super::super::{Group, report};
    use super::*;

    /// A report without warnings.
    fn fine() -> Report {
        let folder = tempfile::tempdir().unwrap();
        let info = crate::synthetic::info(7, 1, 1200, 60);
        let draft = Draft::begin(folder.path(), &info).unwrap();
        let mut writer = draft.shard(0).unwrap();
        for scene in info.scenes_of(0) {
            writer.push(&crate::synthetic::scene_rows(scene, info.seed, &info)).unwrap();
        }
        writer.commit().unwrap();
        draft.finalize().unwrap();
        let mut report = report(&Dataset::open(folder.path()).unwrap()).unwrap();
        report.labels = Tally { attempts: 1200, positives: 300 };
        report
    }

    #[test]
    fn each_reason_to_worry_is_told_and_none_is_invented() {
        let fine = fine();
        assert_eq!(fine.warnings(), Vec::<String>::new());
        let told = |change: fn(&mut Report), word: &str| {
            let mut report = fine.clone();
            change(&mut report);
            let warnings = report.warnings();
            assert!(warnings.len() == 1 && warnings[0].contains(word), "{word}: {warnings:?}");
        };
        told(|r| r.labels.positives = 60, "1 : 19.00");
        told(
            |r| r.rules[0] = Group { name: "cuboid_x".to_owned(), labels: Tally { attempts: 100, positives: 0 } },
            "cuboid_x",
        );
    }
}
