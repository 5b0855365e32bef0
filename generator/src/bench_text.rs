//! What `generator bench` measured, as Markdown.

use std::fmt::Write;

use generator::{BenchReport, OutcomeCost, StageCost};
use program::text::{bytes, grouped};

/// The report for people.
pub(crate) fn markdown(report: &BenchReport, command: &str) -> String {
    let mut text = format!("# generator bench\n\n    {command}\n\n");
    let _ = write!(
        text,
        "graspmill {}, {}; {} attempts.\n\n## Whole runs, from nothing to committed shards\n\n",
        report.version,
        report.processor,
        grouped(report.attempts)
    );
    let attempts = report.attempts as f64;
    let mut rows = Vec::new();
    for run in &report.runs {
        let cpu = run.cpu_s.map_or("unknown".to_owned(), |cpu_s| format!("{:.0}", attempts / cpu_s));
        let ratio = report.runs[0].wall_s / run.wall_s;
        rows.push(vec![
            run.threads.to_string(),
            format!("{:.1}", run.wall_s),
            format!("{:.0}", attempts / run.wall_s),
            cpu,
            format!("{ratio:.2}"),
        ]);
    }
    table(&mut text, &["threads", "seconds", "attempts/s", "attempts/s of processor time", "times one thread"], &rows);
    let memory = report.memory_bytes.map_or("unknown".to_owned(), bytes);
    let per_attempt = report.bytes as f64 / attempts;
    let _ = write!(text, "Memory at most {memory}; {per_attempt:.0} bytes an attempt on disk, scenes included.\n\n");

    text += "## Stages, one thread\n\n";
    let whole_s: f64 = report.stages.iter().map(|stage| stage.total_s).sum();
    let row = |stage: &StageCost| {
        vec![
            stage.name.to_owned(),
            grouped(stage.count),
            format!("{:.1}", 1e6 * stage.total_s / stage.count.max(1) as f64),
            format!("{:.1}", 1e6 * stage.total_s / attempts),
            format!("{:.1} %", 100.0 * stage.total_s / whole_s),
        ]
    };
    let rows: Vec<_> = report.stages.iter().map(row).collect();
    table(&mut text, &["stage", "times", "µs each", "µs an attempt of the dataset", "share"], &rows);

    text += "## Attempts by outcome, one thread\n\n";
    let row = |cost: &OutcomeCost| {
        let count = cost.count.max(1) as f64;
        vec![
            cost.outcome.to_owned(),
            grouped(cost.count),
            format!("{:.1}", cost.steps as f64 / count),
            format!("{:.1}", 1e6 * cost.total_s / count),
        ]
    };
    let rows: Vec<_> = report.outcomes.iter().map(row).collect();
    table(&mut text, &["outcome", "attempts", "steps each", "µs each"], &rows);
    let _ = write!(text, "A simulated step takes {:.1} µs, with all that goes with it.\n\n", 1e6 * report.step_s);

    if !report.agreements.is_empty() {
        text += "## The same attempts by slower settings\n\n";
        let share = |part: u64, whole: u64| format!("{:.2} %", 100.0 * part as f64 / whole.max(1) as f64);
        let rows: Vec<_> = report
            .agreements
            .iter()
            .map(|a| {
                vec![
                    a.settings.clone(),
                    grouped(a.attempts),
                    share(a.same_label, a.attempts),
                    share(a.same_outcome, a.attempts),
                    share(a.positives[0], a.attempts),
                    share(a.positives[1], a.attempts),
                    format!("{:.1}", a.total_s[1] / a.total_s[0]),
                ]
            })
            .collect();
        let head =
            ["settings", "attempts", "same label", "same outcome", "positive here", "positive there", "times slower"];
        table(&mut text, &head, &rows);
    }
    text
}

fn table(text: &mut String, head: &[&str], rows: &[Vec<String>]) {
    let _ = writeln!(text, "| {} |", head.join(" | "));
    let _ = writeln!(text, "|---{}|", "|---:".repeat(head.len() - 1));
    for row in rows {
        let _ = writeln!(text, "| {} |", row.join(" | "));
    }
    text.push('\n');
}
