//! What `graspmill bench generate` measured, for people.

use generator::{Agreement, BenchReport, OutcomeCost, RunCost, StageCost};
use program::text::{bytes, grouped};
use report::document::{Block, Cell, Document, Table};

/// The report of `command`.
pub(crate) fn document(report: &BenchReport, command: &str) -> Document {
    let heading = |text: &str| Block::Heading(text.to_owned());
    let attempts = report.attempts as f64;
    let memory = report.memory_bytes.map_or("unknown".to_owned(), bytes);
    let mut blocks = vec![
        Block::Text(format!("    {command}")),
        Block::Text(format!(
            "graspmill {}, {}; {} attempts.",
            report.version,
            report.processor,
            grouped(report.attempts)
        )),
        heading("Whole runs, from nothing to committed shards"),
        runs(report),
        Block::Text(format!(
            "Memory at most {memory}; {:.0} bytes an attempt on disk, scenes included.",
            report.bytes as f64 / attempts
        )),
        heading("Stages, one thread"),
        stages(report),
        heading("Attempts by outcome, one thread"),
        outcomes(report),
        Block::Text(format!("A simulated step takes {:.1} µs, with all that goes with it.", 1e6 * report.step_s)),
    ];
    if !report.agreements.is_empty() {
        blocks.extend([heading("The same attempts by slower settings"), agreements(report)]);
    }
    Document { title: "graspmill bench generate".to_owned(), blocks, footer: String::new() }
}

/// A name, and numbers as they are to be read.
fn row(name: impl Into<Cell>, numbers: impl IntoIterator<Item = String>) -> Vec<Cell> {
    [name.into()].into_iter().chain(numbers.into_iter().map(Cell::Number)).collect()
}

fn runs(report: &BenchReport) -> Block {
    let attempts = report.attempts as f64;
    let row = |run: &RunCost| {
        let cpu = run.cpu_s.map_or("unknown".to_owned(), |cpu_s| format!("{:.0}", attempts / cpu_s));
        let (wall, rate) = (format!("{:.1}", run.wall_s), format!("{:.0}", attempts / run.wall_s));
        row(run.threads.to_string(), [wall, rate, cpu, format!("{:.2}", report.runs[0].wall_s / run.wall_s)])
    };
    let head = ["threads", "seconds", "attempts/s", "attempts/s of processor time", "times one thread"];
    Block::Table(Table::new(head, report.runs.iter().map(row)))
}

fn stages(report: &BenchReport) -> Block {
    let whole_s: f64 = report.stages.iter().map(|stage| stage.total_s).sum();
    let row = |stage: &StageCost| {
        let each = format!("{:.1}", 1e6 * stage.total_s / stage.count.max(1) as f64);
        let attempt = format!("{:.1}", 1e6 * stage.total_s / report.attempts as f64);
        row(stage.name, [grouped(stage.count), each, attempt, format!("{:.1} %", 100.0 * stage.total_s / whole_s)])
    };
    let head = ["stage", "times", "µs each", "µs an attempt of the dataset", "share"];
    Block::Table(Table::new(head, report.stages.iter().map(row)))
}

fn outcomes(report: &BenchReport) -> Block {
    let row = |cost: &OutcomeCost| {
        let each = |value: f64| format!("{:.1}", value / cost.count.max(1) as f64);
        row(cost.outcome, [grouped(cost.count), each(cost.steps as f64), each(1e6 * cost.total_s)])
    };
    Block::Table(Table::new(["outcome", "attempts", "steps each", "µs each"], report.outcomes.iter().map(row)))
}

fn agreements(report: &BenchReport) -> Block {
    let row = |a: &Agreement| {
        let of = |all: u64, part: u64| format!("{:.2} %", 100.0 * part as f64 / all.max(1) as f64);
        let share = |part: u64| of(a.attempts, part);
        // The gate decides the others alike.
        let closing = of(a.closing, a.closing - (a.attempts - a.same_label));
        let [here, there] = a.positives.map(share);
        let slower = format!("{:.1}", a.total_s[1] / a.total_s[0]);
        row(
            &a.settings,
            [grouped(a.attempts), share(a.same_label), closing, share(a.same_outcome), here, there, slower],
        )
    };
    let head = [
        "settings",
        "attempts",
        "same label",
        "of those that close",
        "same outcome",
        "positive here",
        "positive there",
        "times slower",
    ];
    Block::Table(Table::new(head, report.agreements.iter().map(row)))
}
