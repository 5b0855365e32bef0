//! A training run as a page: one file that tells how training went and, with a dataset, what came of it and where it is
//! wrong.

mod side_by_side;
mod training;
mod warnings;
mod worst_errors;

pub use side_by_side::comparison;

use std::path::{Path, PathBuf};

use network::checkpoint;
use program::text::grouped;
use program::{ExitCode, Failure};
use report::document::{Block, Cell, Document, Table};

use crate::config::Config;
use crate::curves::{self, Epoch};
use crate::evaluate::report::{blocks, number};
use crate::evaluate::{Evaluation, Examination};
use crate::run_folder::{CONFIG, METRICS, SavedAs, begun_with, keys};

/// Mistakes of either kind that are shown.
pub const MISTAKES: usize = 6;

/// What a run left behind, as far as it is shown.
#[derive(Debug)]
pub struct TrainedRun {
    path: PathBuf,
    /// At least one, ascending.
    epochs: Vec<Epoch>,
    /// `None` where only the metrics were kept.
    config: Option<Config>,
    /// Id of the dataset that the best checkpoint says it was trained on; `None` without one.
    trained_on: Option<String>,
}

impl TrainedRun {
    /// Reads a run's folder: its metrics, and its recipe and best checkpoint where they are there.
    ///
    /// # Errors
    /// If the folder holds no run, or a file of the run is damaged or cannot be read.
    pub fn read(run: &Path) -> Result<Self, Failure> {
        let recipe = run.join(CONFIG);
        if !recipe.exists() && !run.join(METRICS).exists() {
            let text = format!("no run here, neither config.toml nor metrics.jsonl: {}", run.display());
            return Err(Failure::new(ExitCode::Config, text));
        }
        let epochs = curves::read(run)?;
        let config = if recipe.exists() { Some(begun_with(run)?) } else { None };
        let best = SavedAs::Best.path(run);
        let trained_on = if best.exists() { Some(checkpoint::read(&best)?.dataset_id) } else { None };
        Ok(Self { path: run.to_owned(), epochs, config, trained_on })
    }

    /// The run, with the evaluation of its best checkpoint if there is one. The same run and results give the same
    /// document.
    ///
    /// # Errors
    /// [`Failure`] if a scene that is to be shown cannot be read.
    pub fn document(&self, examined: Option<&Examination>) -> Result<Document, Failure> {
        let evaluation = examined.map(|examined| &examined.evaluation);
        let mut numbers = training::tiles(self);
        numbers.extend(evaluation.into_iter().flat_map(tiles));
        let mut blocks = vec![
            Block::Text(self.lead(evaluation.is_some())),
            Block::Tiles(numbers),
            Block::Warnings(warnings::warnings(self, evaluation)),
        ];
        blocks.extend(training::section(self));
        blocks.push(Block::Heading("Evaluation".to_owned()));
        match examined {
            None => blocks.extend(self.not_evaluated()),
            Some(examined) => {
                blocks.extend(self::blocks(&examined.evaluation));
                blocks.extend(worst_errors::section(examined)?);
            }
        }
        blocks.extend(self.provenance(examined));
        Ok(Document {
            title: format!("Training run {}", self.name()),
            blocks,
            footer: format!(
                "graspmill fit-report, Graspmill {}; run {}",
                env!("CARGO_PKG_VERSION"),
                self.path.display()
            ),
        })
    }

    /// Its folder's name.
    fn name(&self) -> String {
        let name = |path: &Path| path.file_name().map(|name| name.to_string_lossy().into_owned());
        let absolute = || std::path::absolute(&self.path).ok().as_deref().and_then(name);
        name(&self.path).or_else(absolute).unwrap_or_else(|| self.path.display().to_string())
    }

    fn lead(&self, is_evaluated: bool) -> String {
        let epochs = self.epochs.len();
        let asked = self.config.as_ref().map_or_else(String::new, |config| format!(" of {}", config.training.epochs));
        let more = if is_evaluated { ", and what the best epoch's weights are worth on a dataset" } else { "" };
        format!(
            "How the network learned in {epochs}{asked} epochs to tell grasps that hold from grasps that fail{more}."
        )
    }

    fn not_evaluated(&self) -> [Block; 2] {
        let run = self.path.display();
        let row = |command: String, what: &str| vec![Cell::Code(command), what.into()];
        let rows = [
            row(
                format!("graspmill fit-report {run} --html FILE --data DIR"),
                "held-out attempts of the dataset that was trained on; --split test-scenes: held-out scenes",
            ),
            row(
                format!("graspmill fit-report {run} --html FILE --data OTHER --split all"),
                "another dataset, all of it",
            ),
        ];
        let text = "Left out, for no dataset was given. With a dataset this page also shows the accuracy beside that of always answering \
                    \"failure\", precision and recall, calibration, the errors of the grasps, and the worst mistakes.";
        [Block::Text(text.to_owned()), Block::Table(Table::new(["command", "evaluates"], rows))]
    }

    fn provenance(&self, examined: Option<&Examination>) -> [Block; 3] {
        let row = |key: &str, value: String| vec![Cell::code(key), Cell::Code(value)];
        let unknown = || "unknown: no best.safetensors here".to_owned();
        let mut rows = vec![
            row("run", self.path.display().to_string()),
            row("trained on dataset", self.trained_on.clone().unwrap_or_else(unknown)),
        ];
        if let Some(Examination { evaluation, dataset, .. }) = examined {
            let info = dataset.info();
            rows.extend([
                row("evaluated on dataset", format!("{} at {}", evaluation.dataset_id, dataset.location())),
                row("its code_version", info.code_version.clone()),
                row("its seed", info.seed.to_string()),
                row("its gripper", info.hands().iter().map(|hand| hand.name.as_str()).collect::<Vec<_>>().join(", ")),
            ]);
        }
        let recipe = self.config.as_ref().map(keys).unwrap_or_default();
        rows.extend(recipe.into_iter().map(|(key, value)| row(&key, value)));
        let text = match self.config {
            Some(_) => {
                "From the dataset and these keys the CPU trains the same weights again, bit for bit, on machines of one kind."
            }
            None => "The run's config.toml is not here, so nothing is known of the recipe.",
        };
        [
            Block::Heading("Recipe and origin".to_owned()),
            Block::Text(text.to_owned()),
            Block::Table(Table::new(["key", "value"], rows)),
        ]
    }
}

/// The evaluation's numbers that a reader wants first.
fn tiles(evaluation: &Evaluation) -> [(String, String); 4] {
    let all = &evaluation.all;
    let baseline = number(all.baseline_accuracy);
    let set = evaluation.split.description();
    [
        (number(all.accuracy), format!("accuracy on {set}; always \"failure\" {baseline}")),
        (grouped(all.samples), format!("samples of {} scenes", grouped(evaluation.scenes as u64))),
        (number(evaluation.ranking.roc_auc), "area under the ROC curve".to_owned()),
        (format!("{:.3}", evaluation.calibration.expected_error), "expected calibration error".to_owned()),
    ]
}
