//! A training run as a page: one file that tells how training went and, with a dataset, what came of it and where it is
//! wrong.

mod evaluation;
mod mistakes;
mod training;
mod warnings;

use std::path::{Path, PathBuf};

use network::checkpoint::{self, CheckpointError};
use program::{Exit, ExitCode};
use report::page::{Block, Cell, Page, Section, Table};
use shards::ReadError;

use crate::config::Config;
use crate::curves::{self, CurvesError, Epoch, FigureError};
use crate::evaluate::Examination;
use crate::run_folder::{CONFIG, METRICS, checkpoint_path, keys};

/// Mistakes of either kind that are shown.
pub const MISTAKES: usize = 6;

/// Why there is no page.
#[derive(Debug, thiserror::Error)]
pub enum PageError {
    /// Nothing of a run is there.
    #[error("no run here, neither config.toml nor metrics.jsonl: {}", .0.display())]
    NotARun(PathBuf),
    /// The metrics cannot be read.
    #[error(transparent)]
    Curves(#[from] CurvesError),
    /// The run's recipe is damaged.
    #[error("damaged recipe of the run: {0}")]
    Config(#[from] settings::Error),
    /// The best checkpoint is damaged.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A scene that is to be shown cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The library that draws failed.
    #[error(transparent)]
    Figure(#[from] FigureError),
}

impl Exit for PageError {
    fn exit_code(&self) -> ExitCode {
        match self {
            Self::NotARun(_) => ExitCode::Config,
            Self::Curves(error) => error.exit_code(),
            Self::Config(settings::Error::Read { .. }) => ExitCode::TryAgain,
            Self::Config(_) => ExitCode::Data,
            Self::Checkpoint(error) => error.exit_code(),
            Self::Read(error) => error.exit_code(),
            Self::Figure(_) => ExitCode::Internal,
        }
    }
}

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
    /// [`PageError`].
    pub fn read(run: &Path) -> Result<Self, PageError> {
        let recipe = run.join(CONFIG);
        let epochs = match curves::read(run) {
            Err(CurvesError::Missing(_)) if !recipe.exists() && !run.join(METRICS).exists() => {
                return Err(PageError::NotARun(run.to_owned()));
            }
            read => read?,
        };
        let config = if recipe.exists() { Some(Config::load(Some(&recipe))?) } else { None };
        let trained_on = match checkpoint::read(&checkpoint_path(run, "best")) {
            Err(CheckpointError::Missing(_)) => None,
            read => Some(read?.dataset_id),
        };
        Ok(Self { path: run.to_owned(), epochs, config, trained_on })
    }

    /// The page, with the evaluation of the run's best checkpoint if there is one. The same run and results give the
    /// same bytes.
    ///
    /// # Errors
    /// [`PageError`].
    pub fn page(&self, examined: Option<&Examination>) -> Result<String, PageError> {
        let evaluation = examined.map(|examined| &examined.evaluation);
        let mut sections = vec![training::section(self)?];
        match examined {
            None => sections.push(self.not_evaluated()),
            Some(examined) => {
                sections.extend([
                    evaluation::section(&examined.evaluation)?,
                    evaluation::kinds(&examined.evaluation),
                    mistakes::section(examined)?,
                ]);
            }
        }
        sections.push(self.provenance(examined));
        let mut tiles = training::tiles(self);
        tiles.extend(evaluation.map(evaluation::tiles).unwrap_or_default());
        let page = Page {
            title: "A training run of the grasp network".to_owned(),
            lead: self.lead(evaluation.is_some()),
            tiles,
            warnings: warnings::warnings(self, evaluation),
            sections,
            footer: format!("trainer report, Graspmill {}; run {}", env!("CARGO_PKG_VERSION"), self.path.display()),
        };
        Ok(page.html())
    }

    fn lead(&self, is_evaluated: bool) -> String {
        let epochs = self.epochs.len();
        let asked = self.config.as_ref().map_or_else(String::new, |config| format!(" of {}", config.training.epochs));
        let more = if is_evaluated { ", and what the best epoch's weights are worth on a dataset" } else { "" };
        format!(
            "How the network learned in {epochs}{asked} epochs to tell grasps that hold from grasps that fail{more}."
        )
    }

    fn not_evaluated(&self) -> Section {
        let run = self.path.display();
        let row = |command: String, what: &str| vec![Cell::Code(command), Cell::Text(what.to_owned())];
        let table = Table {
            head: vec!["command", "evaluates"],
            rows: vec![
                row(
                    format!("trainer report {run} --html FILE --data DIR"),
                    "held-out attempts of the dataset that was trained on; --split test-scenes: held-out scenes",
                ),
                row(format!("trainer report {run} --html FILE --data OTHER --split all"), "another dataset, all of it"),
            ],
        };
        Section {
            title: "Evaluation".to_owned(),
            text: "Left out, for no dataset was given. With one this page tells accuracy against always answering “failure”, \
                   precision–recall, calibration, errors of the grasps, and shows the worst mistakes."
                .to_owned(),
            blocks: vec![Block::Table(table)],
        }
    }

    fn provenance(&self, examined: Option<&Examination>) -> Section {
        let mut rows = Vec::new();
        let mut row = |key: &str, value: String| rows.push(vec![Cell::Code(key.to_owned()), Cell::Code(value)]);
        row("run", self.path.display().to_string());
        row(
            "trained on dataset",
            self.trained_on.clone().unwrap_or_else(|| "unknown: no best.safetensors here".to_owned()),
        );
        if let Some(Examination { evaluation, dataset, .. }) = examined {
            row("evaluated on dataset", format!("{} at {}", evaluation.dataset_id, dataset.location()));
            row("its code_version", dataset.info().code_version.clone());
            row("its seed", dataset.info().seed.to_string());
            row("its gripper", dataset.info().gripper.name.clone());
        }
        let recipe = self.config.as_ref().map(keys).unwrap_or_default();
        recipe.into_iter().for_each(|(key, value)| row(&key, value));
        Section {
            title: "Recipe and origin".to_owned(),
            text: match self.config {
                Some(_) => "From the dataset and these keys the CPU trains the same weights again, bit for bit, on machines of one kind.",
                None => "The run's config.toml is not here, so nothing is known of the recipe.",
            }
            .to_owned(),
            blocks: vec![Block::Table(Table { head: vec!["key", "value"], rows })],
        }
    }
}
