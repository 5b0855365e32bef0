//! What people see while training and after.

use std::sync::Mutex;

use indicatif::{HumanDuration, ProgressBar, ProgressStyle};
use trainer::bench::BenchReport;
use trainer::config::{Config, SplitBy};
use trainer::evaluate::Evaluation;
use trainer::events::{Beginning, EpochReport, Event};
use trainer::metrics::Summary;
use trainer::scores::{BINS, Spread};

/// Progress bars and the table of epochs.
pub(crate) struct Screen {
    config: Config,
    bar: Mutex<ProgressBar>,
    last: Mutex<Option<EpochReport>>,
}

/// Steps after which the first estimate is printed.
const ESTIMATE_AFTER_STEPS: u64 = 20;

impl Screen {
    pub(crate) fn new(config: &Config) -> Self {
        Self { config: config.clone(), bar: Mutex::new(ProgressBar::hidden()), last: Mutex::new(None) }
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

    /// Clears the bar and, if an epoch was done, prints its results.
    pub(crate) fn end(&self) {
        self.bar().finish_and_clear();
        let last = self.last.lock().ok().and_then(|last| last.clone());
        let Some(report) = last else { return };
        print(&format!("\nafter epoch {}:", report.epoch));
        for (name, summary) in [("test attempts", &report.test_attempts), ("test scenes", &report.test_scenes)] {
            let (low, high) = summary.accuracy_95;
            let (accuracy, baseline) = (share(summary.accuracy), share(summary.baseline_accuracy));
            let samples = summary.samples;
            print(&format!(
                "{name:<14}accuracy {accuracy} (95 %: {low:.3} to {high:.3}; {samples} samples), always \"failure\" {baseline}"
            ));
        }
    }

    pub(crate) fn show(&self, event: &Event<'_>) {
        match event {
            Event::Loading(dataset) => {
                let info = dataset.info();
                self.replace(bar(info.scene_count, "reading scenes {bar:30} {pos}/{len} {eta}"));
                let (attempts, scenes) = (info.attempt_count, info.scene_count);
                self.line(&format!("dataset   {attempts} attempts in {scenes} scenes, {}", dataset.location()));
            }
            Event::SceneLoaded => self.bar().inc(1),
            Event::Begun(beginning) => self.begin(beginning),
            Event::Step { samples, loss, .. } => {
                let bar = self.bar();
                bar.inc(*samples as u64);
                bar.set_message(format!("loss {loss:.3}"));
                if bar.position().div_ceil(self.config.training.batch as u64) == ESTIMATE_AFTER_STEPS {
                    self.line(&format!("estimate  {} to go", HumanDuration(bar.eta())));
                }
            }
            Event::NoBetter(epochs) => {
                let plural = if *epochs == 1 { "" } else { "s" };
                self.line(&format!("ended early: no better test accuracy in {epochs} epoch{plural}"));
            }
            Event::Epoch(report) => {
                self.line(&epoch_line(report, self.config.training.epochs));
                if let Ok(mut last) = self.last.lock() {
                    *last = Some((*report).clone());
                }
            }
        }
    }

    fn begin(&self, beginning: &Beginning) {
        let Beginning { outside, train, test_attempts, test_scenes, progress } = beginning;
        let sets = [train, test_attempts, test_scenes];
        let left = u64::from(self.config.training.epochs.saturating_sub(progress.epoch)) * train.samples as u64;
        let done = u64::from(progress.batch) * self.config.training.batch as u64;
        self.replace(bar(left.saturating_sub(done), "{bar:30} {percent}% {msg}, {per_sec}, {eta} to go"));
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
        self.bar().suspend(|| print(text));
    }
}

/// A line to standard output. Training must not end because its output cannot be written.
fn print(text: &str) {
    let _ = program::print(format_args!("{}\n", text.trim_end_matches(' ')));
}

fn bar(len: u64, template: &str) -> ProgressBar {
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(len).with_style(style)
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

/// The results of `trainer evaluate`.
pub(crate) fn evaluation(evaluation: &Evaluation) -> String {
    let Evaluation { epoch, step, split, all, .. } = evaluation;
    let counts = all.confusion;
    let mut text = String::new();
    let mut line = |line: String| {
        text.push_str(line.trim_end());
        text.push('\n');
    };
    line(format!("checkpoint         epoch {epoch}, step {step}"));
    line(format!(
        "set                {}: {} samples of {} scenes",
        split.description(),
        all.samples,
        evaluation.scenes
    ));
    line(format!("loss               {:.4}", all.loss));
    line(format!("accuracy           {} (95 %: {})", share(all.accuracy), range(Some(all.accuracy_95))));
    line(format!("  scenes drawn     95 %: {}", range(evaluation.accuracy_95_by_scene)));
    line(format!("  always \"failure\" {}", share(all.baseline_accuracy)));
    line(format!("precision          {}", share(all.precision)));
    line(format!("recall             {}", share(all.recall)));
    line(format!("average precision  {}", share(evaluation.ranking.average_precision)));
    line(format!("area under ROC     {}", share(evaluation.ranking.roc_auc)));
    let calibration = &evaluation.calibration;
    line(format!("calibration error  {:.3}, Brier {:.3}", calibration.expected_error, calibration.brier));
    line(format!("rotation error     {}", spread(evaluation.errors.rotation_deg, "°")));
    line(format!("width error        {}", spread(evaluation.errors.width_mm, " mm")));
    line(String::new());
    line("                   predicted held  predicted failed".to_owned());
    line(format!("held               {:>14}  {:>16}", counts.true_positive, counts.false_negative));
    line(format!("failed             {:>14}  {:>16}", counts.false_positive, counts.true_negative));
    line(String::new());
    line("shape           samples  accuracy  always \"failure\"".to_owned());
    for (shape, summary) in &evaluation.by_shape {
        let (accuracy, baseline) = (share(summary.accuracy), share(summary.baseline_accuracy));
        line(format!("{shape:<14} {:>8}  {accuracy:>8}  {baseline:>16}", summary.samples));
    }
    line(String::new());
    line("quality     samples  predicted  observed".to_owned());
    for bin in &calibration.bins {
        let (from, to) = (bin.from, bin.from + 1.0 / BINS as f64);
        let (predicted, observed) = (share(bin.predicted), share(bin.observed));
        line(format!("{from:.1} to {to:.1} {:>8}  {predicted:>9}  {observed:>8}", bin.samples));
    }
    text
}

fn range(range: Option<(f64, f64)>) -> String {
    range.map_or_else(|| "-".to_owned(), |(low, high)| format!("{low:.3} to {high:.3}"))
}

fn spread(spread: Option<Spread>, unit: &str) -> String {
    spread.map_or_else(
        || "-".to_owned(),
        |Spread { mean, median, p90 }| {
            format!("mean {mean:.1}{unit}, median {median:.1}{unit}, nine of ten below {p90:.1}{unit} (held attempts)")
        },
    )
}

/// What `trainer bench` measured, as Markdown.
pub(crate) fn bench(report: &BenchReport) -> String {
    let rate = |seconds: f64| report.step_mac / seconds;
    let row = |name: &str, seconds: f64, mac_per_s: Option<f64>| {
        let samples = report.batch as f64 / seconds;
        let mac = mac_per_s.map_or((String::new(), String::new()), |mac| {
            let share = report.matmul_mac_per_s.map(|products| format!("{:.0} %", 100.0 * mac / products));
            (format!("{:.1}", mac / 1e9), share.unwrap_or_default())
        });
        format!("| {name} | {:.1} | {samples:.0} | {} | {} |\n", 1e3 * seconds, mac.0, mac.1)
    };
    let mut text = format!(
        "graspmill {}, {} threads{}.\n\n\
         | batch of {} | ms | samples/s | GMAC/s | of the products' rate |\n|---|---:|---:|---:|---:|\n",
        report.version,
        report.threads,
        report
            .matmul_mac_per_s
            .map_or_else(String::new, |rate| format!("; products of matrices: {:.1} GMAC/s", rate / 1e9)),
        report.batch
    );
    text += &row("training step, each sample of another scene", report.step_s, Some(rate(report.step_s)));
    text += &row("training step, six samples a scene", report.step_of_few_scenes_s, None);
    if let Some(step_s) = report.step_by_graph_s {
        text += &row("the same as the first, by Burn's autodiff", step_s, Some(rate(step_s)));
    }
    text += &row("test step, each sample of another scene", report.test_s, None);
    if let Some(read_s) = report.read_s {
        text += &row("reading alone", read_s, None);
    }
    let memory = report.memory_bytes.map_or("unknown".to_owned(), program::text::bytes);
    let [dense, alone] = [report.dense_s, report.dense_one_thread_s].map(|seconds| 1e3 * seconds);
    let by_burn = report.dense_by_graph_s.map(|seconds| format!(", {:.1} ms by Burn's convolutions", 1e3 * seconds));
    let by_burn = by_burn.unwrap_or_default();
    text + &format!(
        "\nDense network, one grid: {dense:.1} ms ({alone:.1} ms on one thread{by_burn}).\n\
         Memory of the training steps at most {memory}.\n"
    )
}
