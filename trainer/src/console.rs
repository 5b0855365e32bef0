//! What people see while training and after.
#![expect(clippy::print_stderr, reason = "progress and failures go to standard error")]

use std::fmt::Write as _;
use std::sync::Mutex;

use indicatif::{HumanDuration, ProgressBar, ProgressStyle};
use trainer::config::{Config, SplitBy};
use trainer::evaluate::{Evaluation, TestSet};
use trainer::fit::{Beginning, EpochReport, Event};
use trainer::metrics::Summary;

/// Progress bars and the table of epochs.
pub(crate) struct Screen {
    config: Config,
    bar: Mutex<ProgressBar>,
}

/// Steps after which the first estimate is printed.
const ESTIMATE_AFTER_STEPS: u64 = 20;

impl Screen {
    pub(crate) fn new(config: &Config) -> Self {
        Self { config: config.clone(), bar: Mutex::new(ProgressBar::hidden()) }
    }

    fn bar(&self) -> ProgressBar {
        self.bar.lock().map_or_else(|poisoned| poisoned.into_inner().clone(), |bar| bar.clone())
    }

    fn replace(&self, bar: ProgressBar) {
        self.bar().finish_and_clear();
        if let Ok(mut slot) = self.bar.lock() {
            *slot = bar;
        }
    }

    pub(crate) fn end(&self) {
        self.bar().finish_and_clear();
    }

    pub(crate) fn show(&self, event: &Event<'_>) {
        match event {
            Event::Loading(dataset) => {
                let info = dataset.info();
                self.replace(bar(info.scene_count, "reading scenes {bar:30} {pos}/{len} {eta}"));
                let (attempts, scenes) = (info.attempt_count, info.scene_count);
                self.line(&format!("dataset   {attempts} attempts in {scenes} scenes, {}", dataset.dir().display()));
            }
            Event::SceneLoaded => self.bar().inc(1),
            Event::Begun(beginning) => self.begin(beginning),
            Event::Step { samples, loss } => {
                let bar = self.bar();
                bar.inc(*samples as u64);
                bar.set_message(format!("loss {loss:.3}"));
                if bar.position().div_ceil(self.config.batch as u64) == ESTIMATE_AFTER_STEPS {
                    self.line(&format!("estimate  {} to go", HumanDuration(bar.eta())));
                }
            }
            Event::Epoch(report) => self.line(&epoch_line(report, self.config.epochs)),
        }
    }

    fn begin(&self, beginning: &Beginning) {
        let Beginning { outside, train, test_attempts, test_scenes, positive_share, progress } = beginning;
        let (this, other) = match self.config.split.by {
            SplitBy::Attempt => ("test attempts choose the best epoch", "test scenes are beside it"),
            SplitBy::Scene => ("test scenes choose the best epoch", "test attempts are beside it"),
        };
        let left = u64::from(self.config.epochs.saturating_sub(progress.epoch)) * *train as u64;
        let done = u64::from(progress.batch) * self.config.batch as u64;
        self.replace(bar(left.saturating_sub(done), "{bar:30} {percent}% {msg}, {per_sec}, {eta} to go"));
        self.line(&format!("samples   {train} train, {test_attempts} test attempts, {test_scenes} of test scenes"));
        self.line(&format!("          {outside} attempts lie outside the grid and are left out"));
        self.line(&format!("          {:.1} % successes; {this}, {other}", 100.0 * positive_share));
        if progress.step > 0 {
            self.line(&format!("resumed   after epoch {}, step {}", progress.epoch, progress.step));
        }
        self.line("");
        self.line(&header());
    }

    /// Prints above the bar, to standard output if there is no bar to keep clear of.
    fn line(&self, text: &str) {
        self.bar().suspend(|| println!("{text}"));
    }
}

fn bar(len: u64, template: &str) -> ProgressBar {
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(len).with_style(style)
}

fn header() -> String {
    let columns = "loss    acc   prec  rec";
    format!(
        "epoch   | train  {columns} | test attempts {columns} (always \"failure\") | test scenes {columns} (always \"failure\")"
    )
}

fn epoch_line(report: &EpochReport, epochs: u32) -> String {
    let star = if report.is_best { " *best" } else { "" };
    format!(
        "{:>3}/{epochs:<3} | train  {} | test attempts {} ({}) | test scenes {} ({}) | {:.0} s{star}",
        report.epoch,
        numbers(&report.train),
        numbers(&report.test_attempts),
        share(report.test_attempts.baseline_accuracy),
        numbers(&report.test_scenes),
        share(report.test_scenes.baseline_accuracy),
        report.seconds,
    )
}

fn numbers(summary: &Summary) -> String {
    let Summary { loss, accuracy, precision, recall, .. } = summary;
    format!("{loss:.4} {} {} {}", share(*accuracy), share(*precision), share(*recall))
}

fn share(share: Option<f64>) -> String {
    share.map_or_else(|| "  -  ".to_owned(), |share| format!("{share:.3}"))
}

/// The report of `trainer evaluate`.
pub(crate) fn evaluation(evaluation: &Evaluation) -> String {
    let Evaluation { epoch, step, split, all, by_shape } = evaluation;
    let set = match split {
        TestSet::TestAttempts => "held-out attempts of scenes that trained",
        TestSet::TestScenes => "held-out scenes",
        TestSet::All => "all samples",
    };
    let counts = all.confusion;
    let (low, high) = all.accuracy_95;
    let mut text = String::new();
    let mut line = |line: String| {
        text.push_str(&line);
        text.push('\n');
    };
    line(format!("checkpoint         epoch {epoch}, step {step}"));
    line(format!("set                {set}: {} samples", all.samples));
    line(format!("loss               {:.4}", all.loss));
    line(format!("accuracy           {} (95 %: {low:.3} to {high:.3})", share(all.accuracy)));
    line(format!("  always \"failure\" {}", share(all.baseline_accuracy)));
    line(format!("precision          {}", share(all.precision)));
    line(format!("recall             {}", share(all.recall)));
    line(String::new());
    line("                   predicted held  predicted failed".to_owned());
    line(format!("held               {:>14}  {:>16}", counts.true_positive, counts.false_negative));
    line(format!("failed             {:>14}  {:>16}", counts.false_positive, counts.true_negative));
    line(String::new());
    line("shape           samples  accuracy  always \"failure\"".to_owned());
    for (shape, summary) in by_shape {
        let (accuracy, baseline) = (share(summary.accuracy), share(summary.baseline_accuracy));
        line(format!("{shape:<14} {:>8}  {accuracy:>8}  {baseline:>16}", summary.samples));
    }
    text
}

/// An error with its causes, on standard error.
pub(crate) fn failure(error: &anyhow::Error) {
    let mut text = format!("error: {error}");
    for cause in error.chain().skip(1) {
        let cause = cause.to_string();
        if !text.contains(&cause) {
            let _ = write!(text, ": {cause}"); // writing to a String cannot fail
        }
    }
    eprintln!("{text}");
}
