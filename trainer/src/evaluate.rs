//! Evaluates a checkpoint on a dataset: accuracy, precision, recall and confusion, also by shape and by rule;
//! ranking and calibration.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;
use std::slice;
use std::sync::atomic::AtomicBool;

use network::checkpoint::Checkpoint;
use network::{Architecture, checkpoint};
use program::{ExitCode, Failure};
use serde::Serialize;
use settings::words;
use shards::{Dataset, Location};

use crate::batch::Sample;
use crate::config::Config;
use crate::data::split_bits::NO_SAMPLE;
use crate::data::{GraspDataset, Set, for_each_batch};
use crate::device::Device;
use crate::fit::TEST_BATCH;
use crate::judge::Judge;
use crate::judge::scores::JudgeScores;
use crate::method::{FoundBy, Method};
use crate::metrics::{Summary, Tally, summaries, tallies};
use crate::order::{SceneOrder, steps_in_order};
use crate::results::Found;
use crate::scores::{Calibration, Ranking, Score, calibration, interval_by_scene, ranking, score};
use crate::split::split;
use crate::voxel::Voxel;

words! {
    /// The set of samples to evaluate.
    pub enum TestSet {
        /// Held-out attempts of training scenes.
        TestAttempts = "test-attempts",
        /// Held-out scenes.
        TestScenes = "test-scenes",
        /// Every sample.
        All = "all",
    }
}

/// A checkpoint's results on a set.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Evaluation {
    /// Epochs of the checkpoint.
    pub epoch: u32,
    /// Steps of the checkpoint.
    pub step: u64,
    /// Id of the training dataset.
    pub trained_on: String,
    /// Id of the evaluated dataset.
    pub dataset_id: String,
    /// The set.
    pub split: TestSet,
    /// Number of scenes of the set's samples.
    pub scenes: usize,
    /// Over the whole set.
    pub all: Summary,
    /// 95 % interval of its accuracy by bootstrap over scenes; `None` for fewer than two scenes.
    pub accuracy_95_by_scene: Option<(f64, f64)>,
    /// Average precision and the area under the ROC curve.
    pub ranking: Ranking,
    /// Predicted against observed shares.
    pub calibration: Calibration,
    /// By target shape, with names as in the shards.
    pub by_shape: BTreeMap<&'static str, Summary>,
    /// What only a judge is asked.
    #[serde(rename = "hands", skip_serializing_if = "Option::is_none")]
    pub grippers: Option<JudgeScores>,
}

/// Evaluates a checkpoint on a set of a dataset.
///
/// # Errors
/// If checkpoint or dataset cannot be read, or the set has no samples.
pub fn evaluate(path: &Path, data: impl Into<Location>, set: TestSet) -> Result<Evaluation, Failure> {
    let checkpoint = checkpoint::read(path)?;
    let dataset = Dataset::open(data)?;
    let trained_on = trained_on(&checkpoint, &dataset, set)?;
    match &checkpoint.architecture {
        Architecture::Voxel(params) => {
            evaluated(Voxel::new(*params, Device::Host), &checkpoint, &dataset, set, trained_on, path)
        }
        Architecture::Judge(scope) => {
            let grippers = dataset.info().grippers();
            grippers.iter().try_for_each(|gripper| scope.must_match(gripper, &dataset.info().grid))?;
            evaluated(Judge::new(scope, grippers.iter()), &checkpoint, &dataset, set, trained_on, path)
        }
    }
}

fn evaluated<M: Method>(
    method: M,
    checkpoint: &Checkpoint,
    dataset: &Dataset,
    set: TestSet,
    trained_on: String,
    path: &Path,
) -> Result<Evaluation, Failure> {
    let found = results(method, checkpoint, dataset, set, path)?;
    if found.is_empty() {
        let what = "the dataset has no attempt whose grasp lies in the grid";
        return Err(Failure::new(ExitCode::Config, what));
    }
    must_be_finite(&found, path)?;
    let scores: Vec<Score> = found.iter().map(|(_, result)| score(result)).collect();
    let scenes: Vec<(u64, u64)> = tallies(found.iter().map(|(sample, result)| (sample.id.scene, result)))
        .into_values()
        .map(|tally| (tally.confusion.true_positive + tally.confusion.true_negative, tally.confusion.count()))
        .collect();
    let by_shape = found.iter().map(|(sample, result)| (sample.id.rule.shape.kind_name(), result));
    let mut all = Tally::default();
    found.iter().for_each(|(_, result)| all.add(slice::from_ref(result)));
    let grippers = M::own_scores(&found);
    Ok(Evaluation {
        epoch: checkpoint.progress.epoch,
        step: checkpoint.progress.step,
        trained_on,
        dataset_id: dataset.id().to_owned(),
        split: set,
        scenes: scenes.len(),
        all: all.summary(),
        accuracy_95_by_scene: interval_by_scene(&scenes),
        ranking: ranking(&scores),
        calibration: calibration(&scores),
        by_shape: summaries(by_shape),
        grippers,
    })
}

/// The network's predictions for a set, by scene and attempt.
fn results<M: Method>(
    method: M,
    checkpoint: &Checkpoint,
    dataset: &Dataset,
    set: TestSet,
    path: &Path,
) -> Result<Vec<FoundBy<M>>, Failure> {
    let stop = AtomicBool::new(false);
    let mut samples = GraspDataset::survey(slice::from_ref(dataset), method, &stop, &|| {})?;
    let wanted = match set {
        TestSet::All => None,
        TestSet::TestAttempts => Some(Set::TestAttempts),
        TestSet::TestScenes => Some(Set::TestScenes),
    };
    if wanted.is_some() {
        let damaged = |error| Failure::new(ExitCode::Data, format!("damaged recipe in the checkpoint: {error}"));
        let config = Config::parse(&checkpoint.config, path).map_err(damaged)?;
        split(&mut samples.marks, config.seed, &config.split)?;
    }
    let set_of = |mark: u8| (if let Some(set) = wanted { mark == set as u8 } else { mark != NO_SAMPLE }).then_some(0);
    let order = SceneOrder::ascending(&samples.marks, |mark| set_of(mark).is_some());
    let mut found = Vec::new();
    let steps = steps_in_order(&samples.marks, &order, TEST_BATCH, set_of);
    for_each_batch(&samples, &order, 0, steps, None, |_, batch| {
        let results = samples.method.evaluate(&checkpoint.vector, &batch);
        found.extend(batch.samples.into_iter().zip(results));
        ControlFlow::Continue(())
    })?;
    Ok(found)
}

/// What a network was trained on, as the evaluation names it.
///
/// # Errors
/// If nothing of the dataset is held out, or the network saw it with others, so that no one knows what.
fn trained_on(checkpoint: &Checkpoint, dataset: &Dataset, set: TestSet) -> Result<String, Failure> {
    let (is, was) = (dataset.id(), &checkpoint.dataset_id);
    let refused = |text: String| Err(Failure::new(ExitCode::Config, text));
    if !was.split('+').any(|id| dataset.has_id(id)) {
        return match set {
            TestSet::All => Ok(was.clone()),
            TestSet::TestAttempts | TestSet::TestScenes => refused(format!(
                "the network was trained on another dataset, {was}, so nothing of this one, {is}, is held out: use \
                 --split all"
            )),
        };
    }
    if was.contains('+') {
        return refused(format!(
            "the network was trained on several datasets, {is} among them: evaluate it on one that it never saw"
        ));
    }
    Ok(is.to_owned())
}

fn must_be_finite<D>(found: &[Found<D>], path: &Path) -> Result<(), Failure> {
    let Some((Sample { id, .. }, result)) = found.iter().find(|(_, result)| !result.total.is_finite()) else {
        return Ok(());
    };
    let (attempt, scene, loss) = (id.attempt, id.scene, result.total);
    let text = format!("the loss of attempt {attempt} of scene {scene} must be finite, got {loss}");
    Err(Failure::new(ExitCode::Data, format!("{text}: {}", path.display())))
}
