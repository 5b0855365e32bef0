//! What people see while training and after.

use indicatif::{HumanDuration, ProgressBar};
use trainer::config::{Config, SplitBy};
use trainer::events::{Beginning, EpochReport, Event};
use trainer::metrics::Summary;
use trainer::split::Labels;

use crate::progress::style;

/// Progress bars and the table of epochs.
pub(crate) struct Screen {
    config: Config,
    bar: ProgressBar,
}

/// Steps after which the first estimate is printed.
const ESTIMATE_AFTER_STEPS: u64 = 20;

impl Screen {
    pub(crate) fn new(config: &Config) -> Self {
        Self { config: config.clone(), bar: ProgressBar::no_length() }
    }

    /// Begins the bar anew.
    fn begin_bar(&self, len: u64, of: &str) {
        self.bar.finish_and_clear();
        self.bar.set_style(style(of));
        self.bar.set_length(len);
        self.bar.reset();
    }

    /// Clears the bar.
    pub(crate) fn end(&self) {
        self.bar.finish_and_clear();
    }

    pub(crate) fn show(&self, event: &Event<'_>) {
        match event {
            Event::Loading(datasets) => {
                let scenes = datasets.iter().map(|dataset| dataset.info().scene_count).sum();
                self.begin_bar(scenes, "scenes read");
                for dataset in *datasets {
                    let (attempts, scenes) = (dataset.info().attempt_count, dataset.info().scene_count);
                    self.line(&format!("dataset   {attempts} attempts in {scenes} scenes, {}", dataset.location()));
                }
            }
            Event::SceneLoaded => self.bar.inc(1),
            Event::Begun(beginning) => self.begin(beginning),
            Event::Step { samples, loss } => {
                self.bar.inc(*samples as u64);
                self.bar.set_message(format!("loss {loss:.3}"));
                if self.bar.position().div_ceil(self.config.training.batch as u64) == ESTIMATE_AFTER_STEPS {
                    self.line(&format!("estimate  {} to go", HumanDuration(self.bar.eta())));
                }
            }
            Event::Epoch(report) => self.line(&epoch_line(report, self.config.training.epochs)),
        }
    }

    fn begin(&self, beginning: &Beginning) {
        let Beginning { outside, labels: Labels { train, test_attempts, test_scenes }, progress } = beginning;
        let sets = [train, test_attempts, test_scenes];
        let left = u64::from(self.config.training.epochs.saturating_sub(progress.epoch)) * train.samples as u64;
        let done = u64::from(progress.batch) * self.config.training.batch as u64;
        self.begin_bar(left.saturating_sub(done), "samples · {per_sec:1}");
        let [training, attempts, scenes] = sets.map(|set| set.samples);
        self.line(&format!("samples   {training} train, {attempts} test attempts, {scenes} of test scenes"));
        self.line(&format!("          {outside} attempts lie outside the grid and are left out"));
        let chooser = match self.config.split.by {
            SplitBy::Attempt => "test attempts",
            SplitBy::Scene => "test scenes",
        };
        self.line(&format!("          * marks the best epoch so far by {chooser}"));
        if progress.step > 0 {
            self.line(&format!("resumed   after epoch {}, step {}", progress.epoch, progress.step));
        }
        let columns = format!("{:<26}", "loss    acc   prec  rec");
        self.line(&format!("\n{:<15}  {:<26}{:<26}{:<26}", "", "train", "test attempts", "test scenes"));
        self.line(&format!("{:<15}  {}", "epoch", columns.repeat(3)));
        let baselines = sets.map(|set| format!("        {:<18.3}", set.baseline_accuracy())).concat();
        self.line(&format!("always failure   {baselines}"));
    }

    /// Prints above the bar.
    fn line(&self, text: &str) {
        self.bar.suspend(|| print(text));
    }
}

/// A line to standard output. Training must not end because its output cannot be written.
fn print(text: &str) {
    let _ = program::print(format_args!("{}\n", text.trim_end_matches(' ')));
}

fn epoch_line(report: &EpochReport, epochs: u32) -> String {
    let sets = [&report.train, &report.test_attempts, &report.test_scenes].map(numbers).concat();
    let place = format!("{}/{epochs}", report.epoch);
    let star = if report.is_best { "*" } else { "" };
    format!("{place:<7} {:>5.0} s  {sets}{star}", report.seconds)
}

fn numbers(summary: &Summary) -> String {
    let Summary { loss, accuracy, precision, recall, .. } = summary;
    format!("{loss:.4}  {} {} {}  ", share(*accuracy), share(*precision), share(*recall))
}

fn share(share: Option<f64>) -> String {
    share.map_or_else(|| "  -  ".to_owned(), |share| format!("{share:.3}"))
}
