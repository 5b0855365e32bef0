//! Warnings about unusual datasets.

use program::text::{grouped, percent, ratio};
use schema::Rule;
use shards::Tally;

use super::Report;
use super::goodness_of_fit::MODELS;

/// The usual range of the share of positives. The paper reports about one positive to three negatives for its rules: a
/// quarter.
const POSITIVE_SHARE: [f64; 2] = [0.15, 0.40];
/// Number of attempts of a group that should not all have failed.
const TRIED_MIN: u64 = 100;
/// Share of rejected scenes that causes a warning.
const REJECTED_SHARE_MAX: f64 = 0.1;
/// Share of grasps outside the grid that causes a warning.
const OUTSIDE_SHARE_MAX: f64 = 0.01;
/// Objects of a catalogue that a warning names, at most.
const RARE_MAX: usize = 5;
/// p-value for a warning: once in a million datasets.
const P_MIN: f64 = 1e-6;

impl Report {
    /// Unusual properties of the dataset, one sentence each.
    pub(crate) fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        let share = self.labels.positive_share();
        let by_rules = self.rules.iter().any(|group| group.labels.attempts > 0 && is_of_the_paper(&group.name));
        if by_rules && self.labels.attempts >= TRIED_MIN && !(POSITIVE_SHARE[0]..=POSITIVE_SHARE[1]).contains(&share) {
            warnings.push(format!(
                "Positives to negatives are {}: far from the paper's 1 : 3. Sizes against the hand's opening and the number of \
                 objects decide this; labels are never resampled.",
                ratio(self.labels.positives, self.labels.negatives())
            ));
        }
        let failed = |labels: Tally| labels.attempts >= TRIED_MIN && labels.positives == 0;
        for group in self.shapes.iter().chain(&self.rules).filter(|group| failed(group.labels)) {
            warnings.push(format!("None of {} attempts of {} held.", grouped(group.labels.attempts), group.name));
        }
        let tried = self.scenes + self.rejections.total();
        let rejected = self.rejections.total() as f64 / tried.max(1) as f64;
        if rejected > REJECTED_SHARE_MAX {
            let (unsettled, empty, unstable) =
                (self.rejections.unsettled, self.rejections.empty, self.rejections.unstable);
            warnings.push(format!(
                "{} of the scenes that were built were thrown away ({unsettled} did not come to rest, {empty} lost every object, \
                 {unstable} broke the physics): what is left is not what was drawn.",
                percent(rejected)
            ));
        }
        let outside = self.outside_grid.attempts as f64 / self.labels.attempts.max(1) as f64;
        if outside > OUTSIDE_SHARE_MAX {
            warnings
                .push(format!("{} of the grasps lie outside the grid: no voxel learns from them.", percent(outside)));
        }
        for fit in self.fits.iter().filter(|fit| fit.complete) {
            if let Some(test) = fit.chi_square().filter(|test| test.p < P_MIN) {
                warnings.push(format!(
                    "The {} does not follow its law: χ² = {:.1} with {} degrees of freedom.",
                    fit.name, test.statistic, test.degrees
                ));
            }
        }
        warnings.extend(self.missing_models());
        warnings
    }

    /// The objects of a catalogue that are rarer than they were drawn, if chance does not explain it.
    fn missing_models(&self) -> Option<String> {
        let fit = self.fits.iter().find(|fit| fit.name == MODELS)?;
        let test = fit.chi_square().filter(|test| test.p < P_MIN)?;
        let expected = fit.total() as f64 / fit.counts.len() as f64;
        let mut rare: Vec<_> = fit.counts.iter().zip(&self.shapes).filter(|(n, _)| (**n as f64) < expected).collect();
        rare.sort_by_key(|(count, _)| **count);
        let rare =
            rare.iter().take(RARE_MAX).map(|(count, of)| format!("{} {count}", of.name)).collect::<Vec<_>>().join(", ");
        Some(format!(
            "The objects of the catalogue are not there as often as they were drawn: χ² = {:.1} with {} degrees of freedom; \
             {expected:.1} of each are expected, the rarest are {rare}. They fell off the table, or their scenes were thrown away.",
            test.statistic, test.degrees
        ))
    }
}

fn is_of_the_paper(rule: &str) -> bool {
    Rule::from_name(rule).is_some_and(|rule| rule.approach.axis().is_some())
}

#[cfg(test)]
mod tests {
    use shards::{Dataset, Draft};

    use super::super::{Fit, Group, report};
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
        report.fits.clear();
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
        told(|r| r.rejections.unsettled = r.scenes, "50.0 %");
        told(|r| r.outside_grid.attempts = 60, "5.0 %");
        told(|r| r.fits.push(Fit::of_models(vec![3, 66, 65, 66])), "the rarest are cuboid 3.");
        let mut even = fine;
        even.fits.push(Fit::of_models(vec![40, 61, 52, 47]));
        assert_eq!(even.warnings(), Vec::<String>::new());
    }
}
