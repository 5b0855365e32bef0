//! What `generator bench` measured, as Markdown.

use std::fmt::Write;

use generator::{Agreement, BenchReport, OutcomeCost, RunCost, StageCost};
use program::text::{bytes, grouped};

/// The report for people.
pub(crate) fn markdown(report: &BenchReport, command: &str) -> String {
    let mut text = format!("# generator bench\n\n    {command}\n\n");
    let BenchReport { version, processor, attempts, .. } = report;
    let _ = write!(text, "graspmill {version}, {processor}; {} attempts.\n\n", grouped(*attempts));
    add_runs(&mut text, report);
    add_stages(&mut text, &report.stages, report.attempts as f64);
    add_outcomes(&mut text, report);
    if !report.agreements.is_empty() {
        add_agreements(&mut text, &report.agreements);
    }
    text
}

fn add_runs(text: &mut String, report: &BenchReport) {
    text.push_str("## Whole runs, from nothing to committed shards\n\n");
    let attempts = report.attempts as f64;
    let row = |run: &RunCost| {
        vec![
            run.threads.to_string(),
            format!("{:.1}", run.wall_s),
            format!("{:.0}", attempts / run.wall_s),
            run.cpu_s.map_or("unknown".to_owned(), |cpu_s| format!("{:.0}", attempts / cpu_s)),
            format!("{:.2}", report.runs[0].wall_s / run.wall_s),
        ]
    };
    let head = ["threads", "seconds", "attempts/s", "attempts/s of processor time", "times one thread"];
    table(text, &head, report.runs.iter().map(row));
    let memory = report.memory_bytes.map_or("unknown".to_owned(), bytes);
    let per_attempt = report.bytes as f64 / attempts;
    let _ = write!(text, "Memory at most {memory}; {per_attempt:.0} bytes an attempt on disk, scenes included.\n\n");
}

fn add_stages(text: &mut String, stages: &[StageCost], attempts: f64) {
    text.push_str("## Stages, one thread\n\n");
    let whole_s: f64 = stages.iter().map(|stage| stage.total_s).sum();
    let row = |stage: &StageCost| {
        vec![
            stage.name.to_owned(),
            grouped(stage.count),
            format!("{:.1}", 1e6 * stage.total_s / stage.count.max(1) as f64),
            format!("{:.1}", 1e6 * stage.total_s / attempts),
            format!("{:.1} %", 100.0 * stage.total_s / whole_s),
        ]
    };
    table(text, &["stage", "times", "µs each", "µs an attempt of the dataset", "share"], stages.iter().map(row));
}

fn add_outcomes(text: &mut String, report: &BenchReport) {
    text.push_str("## Attempts by outcome, one thread\n\n");
    let row = |cost: &OutcomeCost| {
        let count = cost.count.max(1) as f64;
        vec![
            cost.outcome.to_owned(),
            grouped(cost.count),
            format!("{:.1}", cost.steps as f64 / count),
            format!("{:.1}", 1e6 * cost.total_s / count),
        ]
    };
    table(text, &["outcome", "attempts", "steps each", "µs each"], report.outcomes.iter().map(row));
    let _ = write!(text, "A simulated step takes {:.1} µs, with all that goes with it.\n\n", 1e6 * report.step_s);
}

fn add_agreements(text: &mut String, agreements: &[Agreement]) {
    text.push_str("## The same attempts by slower settings\n\n");
    let share = |part: u64, whole: u64| format!("{:.2} %", 100.0 * part as f64 / whole.max(1) as f64);
    let row = |a: &Agreement| {
        vec![
            a.settings.clone(),
            grouped(a.attempts),
            share(a.same_label, a.attempts),
            share(a.same_outcome, a.attempts),
            share(a.positives[0], a.attempts),
            share(a.positives[1], a.attempts),
            format!("{:.1}", a.total_s[1] / a.total_s[0]),
        ]
    };
    let head =
        ["settings", "attempts", "same label", "same outcome", "positive here", "positive there", "times slower"];
    table(text, &head, agreements.iter().map(row));
}

fn table(text: &mut String, head: &[&str], rows: impl Iterator<Item = Vec<String>>) {
    let _ = writeln!(text, "| {} |", head.join(" | "));
    let _ = writeln!(text, "|---{}|", "|---:".repeat(head.len() - 1));
    for row in rows {
        let _ = writeln!(text, "| {} |", row.join(" | "));
    }
    text.push('\n');
}
