//! What a reader of a run's page should be worried about.

use super::TrainedRun;
use super::training::best;
use crate::curves::{Epoch, Set};
use crate::evaluate::Evaluation;
use crate::evaluate::report::{number, range};

/// A last epoch that brings the training loss down by this share has not ended learning.
const FALLING_SHARE: f64 = 0.01;
/// So many epochs after the lowest test loss, all of them above it by …
const RISING_EPOCHS_MIN: usize = 3;
/// … this share, are no accident.
const RISING_SHARE: f64 = 0.01;
/// Qualities that are off by more are no probabilities.
const CALIBRATION_ERROR_MAX: f64 = 0.1;
/// Samples of fewer scenes say little of others.
const SCENES_MIN: usize = 20;

/// A set that the network was not trained on.
type HeldOut = (&'static str, fn(&Epoch) -> &Set);

/// Both are looked at, whichever chooses the best epoch: known scenes and new ones are different questions.
const HELD_OUT: [HeldOut; 2] =
    [("held-out attempts", |epoch| &epoch.test_attempts), ("held-out scenes", |epoch| &epoch.test_scenes)];

/// What is unusual about a run and its evaluation, one sentence each.
pub(super) fn warnings(run: &TrainedRun, evaluation: Option<&Evaluation>) -> Vec<String> {
    let mut warnings = Vec::new();
    warnings.extend(no_numbers(run));
    warnings.extend(HELD_OUT.iter().filter_map(|(name, set)| {
        let Set { accuracy, baseline_accuracy, accuracy_95, .. } = *set(best(run));
        let whose = format!("The best epoch's accuracy on {name}");
        let moral = ": the network has learned nothing that helps";
        no_better_than_failure(&whose, (accuracy, baseline_accuracy), ("95 %", accuracy_95), moral)
    }));
    warnings.extend(stopped_early(run));
    let rising: Vec<String> = HELD_OUT.iter().filter_map(|set| rising(run, *set)).collect();
    // More epochs of overfitting help nobody.
    warnings.extend(still_falling(run).filter(|_| rising.is_empty()));
    warnings.extend(rising);
    warnings.extend(evaluation.into_iter().flat_map(of_evaluation));
    warnings
}

fn no_numbers(run: &TrainedRun) -> Option<String> {
    let sets = |epoch: &Epoch| [&epoch.train, &epoch.test_attempts, &epoch.test_scenes].map(|set| set.loss);
    let is_broken = |epoch: &&Epoch| sets(epoch).iter().any(|loss| !loss.is_some_and(f64::is_finite));
    let first = run.epochs.iter().find(is_broken)?;
    let count = run.epochs.iter().filter(is_broken).count();
    Some(format!(
        "Losses are no numbers in {count} of {} epochs, first in epoch {}: training diverged, a smaller step size may help.",
        run.epochs.len(),
        first.epoch
    ))
}

/// An accuracy that is not, or may not be, above that of always answering "failure". `whose` begins the sentence,
/// `drawn` says how the interval was made, `moral` ends the sentence.
fn no_better_than_failure(
    whose: &str,
    shares: (Option<f64>, Option<f64>),
    (drawn, interval): (&str, Option<(f64, f64)>),
    moral: &str,
) -> Option<String> {
    let (accuracy, baseline) = shares.0.zip(shares.1)?;
    if accuracy <= baseline {
        return Some(format!(
            "{whose}, {accuracy:.3}, is not above that of always answering \"failure\", {baseline:.3}{moral}."
        ));
    }
    let interval = range(Some(interval.filter(|(low, _)| *low <= baseline)?));
    Some(format!(
        "{whose}, {accuracy:.3} ({drawn}: {interval}), may be no better than always answering \"failure\", {baseline:.3}."
    ))
}

fn stopped_early(run: &TrainedRun) -> Option<String> {
    let config = run.config.as_ref()?;
    let (done, asked) = (run.epochs.len(), config.training.epochs as usize);
    if done >= asked {
        return None;
    }
    let since = done.saturating_sub(best(run).epoch as usize);
    let patience = config.training.patience_epochs as usize;
    let why = if patience > 0 && since >= patience {
        format!("none of the last {since} was better, and the recipe's patience is {patience}")
    } else {
        "it was stopped, or goes on; --resume continues it".to_owned()
    };
    Some(format!("{done} of the recipe's {asked} epochs are done: {why}."))
}

fn still_falling(run: &TrainedRun) -> Option<String> {
    let [.., before, last] = run.epochs.as_slice() else { return None };
    let (was, is) = (before.train.loss?, last.train.loss?);
    (is < was * (1.0 - FALLING_SHARE)).then(|| {
        format!(
            "The training loss was still falling at the last epoch, from {was:.4} to {is:.4}: more epochs may learn more, if the test \
             losses fall too."
        )
    })
}

fn rising(run: &TrainedRun, (name, set): HeldOut) -> Option<String> {
    let losses: Vec<(u32, f64)> = run.epochs.iter().filter_map(|epoch| Some((epoch.epoch, set(epoch).loss?))).collect();
    let lowest = losses.iter().enumerate().min_by(|a, b| a.1.1.total_cmp(&b.1.1))?.0;
    let (epoch, least) = losses[lowest];
    let after = &losses[lowest + 1..];
    let is_above = |(_, loss): &(u32, f64)| *loss > least * (1.0 + RISING_SHARE);
    if after.len() < RISING_EPOCHS_MIN || !after[after.len() - RISING_EPOCHS_MIN..].iter().all(is_above) {
        return None;
    }
    let (last, now) = losses[losses.len() - 1];
    Some(format!(
        "The loss on {name} was lowest at epoch {epoch}, {least:.4}, and is {now:.4} at epoch {last}: since then the network has been \
         overfitting. More data, augmentation or patience_epochs help."
    ))
}

fn of_evaluation(evaluation: &Evaluation) -> Vec<String> {
    let mut warnings = Vec::new();
    let all = &evaluation.all;
    if !all.loss.is_finite() {
        warnings.push("The evaluation's loss is no number: the checkpoint's weights are broken.".to_owned());
    }
    let whose = format!("On {} the accuracy", evaluation.split.description());
    let interval = evaluation.accuracy_95_by_scene.or(Some(all.accuracy_95));
    let shares = (all.accuracy, all.baseline_accuracy);
    warnings.extend(no_better_than_failure(&whose, shares, ("95 %, scenes drawn", interval), ""));
    let error = evaluation.calibration.expected_error;
    if error > CALIBRATION_ERROR_MAX {
        warnings.push(format!(
            "Qualities are off by {error:.3} on average (expected calibration error): do not read them as probabilities."
        ));
    }
    if evaluation.scenes < SCENES_MIN {
        warnings.push(format!(
            "The evaluation has samples of {} scenes only: another draw of scenes may give other numbers (accuracy {}, 95 % {}).",
            evaluation.scenes,
            number(all.accuracy),
            range(evaluation.accuracy_95_by_scene)
        ));
    }
    warnings
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    use network::checkpoint::Confusion;

    use super::*;
    use crate::config::Config;
    use crate::evaluate::TestSet;
    use crate::metrics::Tally;
    use crate::scores::{GraspErrors, Score, calibration, ranking};

    fn set(loss: Option<f64>) -> Set {
        Set { loss, accuracy: Some(0.8), baseline_accuracy: Some(0.7), accuracy_95: Some((0.75, 0.85)) }
    }

    fn epoch(epoch: u32, train: f64, test: f64) -> Epoch {
        let [train, test_attempts, test_scenes] = [train, test, test].map(|loss| set(Some(loss)));
        let (learning_rate, split_by, seconds) = (None, None, None);
        Epoch { epoch, train, test_attempts, test_scenes, learning_rate, split_by, is_best: epoch == 4, seconds }
    }

    /// A run that has nothing to worry about.
    fn fine() -> TrainedRun {
        let recipe = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/train/quick.toml"));
        let mut config = Config::parse(&recipe.unwrap(), Path::new("quick.toml")).unwrap();
        config.training.epochs = 4;
        let epochs = vec![epoch(1, 0.6, 0.5), epoch(2, 0.5, 0.45), epoch(3, 0.46, 0.43), epoch(4, 0.459, 0.42)];
        TrainedRun { path: PathBuf::from("run"), epochs, config: Some(config), trained_on: None }
    }

    #[test]
    fn each_reason_to_worry_is_told_and_none_is_invented() {
        assert_eq!(warnings(&fine(), None), Vec::<String>::new());
        let told = |change: &dyn Fn(&mut TrainedRun), word: &str| {
            let mut run = fine();
            change(&mut run);
            let warnings = warnings(&run, None);
            assert!(warnings.len() == 1 && warnings[0].contains(word), "{word}: {warnings:?}");
        };
        told(&|run| run.epochs[3].test_attempts.accuracy = Some(0.7), "learned nothing");
        told(&|run| run.epochs[3].test_attempts.accuracy_95 = Some((0.69, 0.85)), "may be no better");
        told(&|run| run.epochs[3].test_scenes.accuracy = Some(0.6), "accuracy on held-out scenes, 0.600, is not above");
        told(&|run| run.epochs[3].train.loss = Some(0.4), "still falling");
        told(&|run| run.epochs[1].test_scenes.loss = None, "first in epoch 2");
        told(
            &|run| run.config.as_mut().unwrap().training.epochs = 9,
            "4 of the recipe's 9 epochs are done: it was stopped",
        );
        let patient = |run: &mut TrainedRun| {
            (run.epochs[0].is_best, run.epochs[3].is_best) = (true, false);
            let config = run.config.as_mut().unwrap();
            (config.training.epochs, config.training.patience_epochs) = (9, 3);
        };
        told(&patient, "patience is 3");
        told(
            &|run| run.epochs[0].test_attempts.loss = Some(0.41),
            "lowest at epoch 1, 0.4100, and is 0.4200 at epoch 4",
        );
        // Two epochs after the lowest may be an accident.
        let mut run = fine();
        run.epochs[1].test_attempts.loss = Some(0.3);
        assert_eq!(warnings(&run, None), Vec::<String>::new());
    }

    /// 100 attempts, of which 30 held, with qualities that are as honest as `logits`.
    fn evaluation(logits: [f32; 2]) -> Evaluation {
        let scores: Vec<Score> =
            (0..100).map(|at| Score { held: at < 30, logit: logits[usize::from(at < 30)] }).collect();
        let mut confusion = Confusion::default();
        scores.iter().for_each(|score| confusion.add(u8::from(score.held), score.logit > 0.0));
        Evaluation {
            epoch: 1,
            step: 1,
            trained_on: String::new(),
            dataset_id: String::new(),
            split: TestSet::All,
            scenes: 50,
            all: Tally { confusion, sums: [0.0; 4] }.summary(),
            accuracy_95_by_scene: Some((0.9, 1.0)),
            ranking: ranking(&scores),
            calibration: calibration(&scores),
            errors: GraspErrors::default(),
            errors_of_sure: GraspErrors::default(),
            by_shape: Default::default(),
            by_rule: Default::default(),
            hands: None,
        }
    }

    #[test]
    fn of_an_evaluation_too() {
        let of = |evaluation: Evaluation| warnings(&fine(), Some(&evaluation));
        assert_eq!(of(evaluation([-5.0, 5.0])), Vec::<String>::new());
        let told = |found: Vec<String>, word: &str| {
            assert!(found.len() == 1 && found[0].contains(word), "{word}: {found:?}");
        };
        told(of(Evaluation { accuracy_95_by_scene: Some((0.7, 1.0)), ..evaluation([-5.0, 5.0]) }), "may be no better");
        told(of(Evaluation { scenes: 19, ..evaluation([-5.0, 5.0]) }), "19 scenes only");
        told(of(evaluation([-0.5, 5.0])), "probabilities");
        // 30 % for all: honest, and never a success.
        let flat = libm::logf(0.3 / 0.7);
        told(of(evaluation([flat, flat])), "0.700, is not above");
        let mut broken = evaluation([-5.0, 5.0]);
        broken.all.loss = f64::NAN;
        told(of(broken), "weights are broken");
    }
}
