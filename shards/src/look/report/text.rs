//! The report as people read it: aligned, with bars.

use std::fmt::{self, Display, Formatter, Write as _};

use program::text::{bar, bytes, grouped, percent, ratio};

use crate::Tally;
use crate::look::report::{Bin, Group, OutcomeGroup, Report};

/// Characters of the longest bar.
const BAR: usize = 24;

impl Display for Report {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let labels = self.labels;
        writeln!(f, "dataset {}, code {}, seed {}", &self.dataset_id[..12], self.code_version, self.seed)?;
        writeln!(
            f,
            "{} attempts on {} objects in {} scenes, {} {}",
            grouped(labels.attempts),
            grouped(self.objects),
            grouped(self.scenes),
            grouped(u64::from(self.shards)),
            if self.shards == 1 { "shard" } else { "shards" },
        )?;
        writeln!(
            f,
            "\npositives : negatives = {} ({} positive)",
            ratio(labels.positives, labels.negatives()),
            percent(labels.positive_share())
        )?;
        groups(f, "shape", &self.shapes)?;
        groups(f, "rule", &self.rules)?;
        groups(f, "objects in scene", &self.object_counts)?;
        outcomes(f, &self.outcomes, labels.attempts)?;
        let millimetres = |edge: f64| format!("{:.0}", edge * 1000.0);
        histogram(f, "width, mm, if closed", &self.width_m, millimetres)?;
        histogram(f, "degrees off vertical", &self.approach_deg, |edge| format!("{edge:.0}"))?;
        rejections(f, self)?;
        sizes(f, self)
    }
}

/// The head of a block: every block has the same columns, and says what its bars are.
fn head(f: &mut Formatter<'_>, title: &str, bars: &str) -> fmt::Result {
    writeln!(f, "\n{title:<22}{:>10}{:>10}{:>9}  {bars}", "attempts", "positive", "share")
}

fn row(f: &mut Formatter<'_>, name: &str, tally: Tally, length: f64) -> fmt::Result {
    let share = if tally.attempts == 0 { "-".to_owned() } else { percent(tally.positive_share()) };
    let (attempts, positives) = (grouped(tally.attempts), grouped(tally.positives));
    line(f, format_args!("  {name:<20}{attempts:>10}{positives:>10}{share:>9}  {}", bar(length, BAR)))
}

fn groups(f: &mut Formatter<'_>, title: &str, groups: &[Group]) -> fmt::Result {
    head(f, title, "positive share")?;
    groups.iter().try_for_each(|group| row(f, &group.name, group.tally(), group.tally().positive_share()))
}

fn outcomes(f: &mut Formatter<'_>, outcomes: &[OutcomeGroup], attempts: u64) -> fmt::Result {
    writeln!(f, "\n{:<22}{:>10}{:>19}  share of all attempts", "outcome", "attempts", "share")?;
    let share = |count: u64| count as f64 / attempts.max(1) as f64;
    for group in outcomes {
        let (count, percent) = (grouped(group.attempts), percent(share(group.attempts)));
        line(f, format_args!("  {:<20}{count:>10}{percent:>19}  {}", group.outcome, bar(share(group.attempts), BAR)))?;
        for (hit, count) in &group.hits {
            let (name, percent) = (format!("with {hit}"), self::percent(share(*count)));
            line(f, format_args!("    {name:<18}{:>10}{percent:>19}", grouped(*count)))?;
        }
    }
    Ok(())
}

fn histogram(f: &mut Formatter<'_>, title: &str, bins: &[Bin], edge: impl Fn(f64) -> String) -> fmt::Result {
    let most = bins.iter().map(|b| b.attempts).max().unwrap_or_default().max(1);
    head(f, title, "attempts")?;
    for bin in bins {
        let range = format!("{:>3} to {:>3}", edge(bin.low), edge(bin.high));
        let tally = Tally { attempts: bin.attempts, positives: bin.positives };
        row(f, &range, tally, bin.attempts as f64 / most as f64)?;
    }
    Ok(())
}

fn rejections(f: &mut Formatter<'_>, report: &Report) -> fmt::Result {
    let rejected = &report.rejections;
    writeln!(
        f,
        "\nscenes thrown away: {} ({} unsettled, {} empty, {} unstable)",
        grouped(rejected.total()),
        grouped(rejected.unsettled),
        grouped(rejected.empty),
        grouped(rejected.unstable),
    )?;
    let outside = report.outside_grid;
    let share = outside.attempts as f64 / report.labels.attempts.max(1) as f64;
    writeln!(
        f,
        "grasps outside the grid: {} ({}), {} of them positive",
        grouped(outside.attempts),
        percent(share),
        grouped(outside.positives)
    )
}

fn sizes(f: &mut Formatter<'_>, report: &Report) -> fmt::Result {
    writeln!(f, "\n{:<22}{:>10}{:>12}{:>12}{:>14}", "table", "rows", "on disk", "B/scene", "B/attempt")?;
    for table in &report.tables {
        writeln!(
            f,
            "  {:<20}{:>10}{:>12}{:>12}{:>14.1}",
            table.table,
            grouped(table.rows),
            bytes(table.bytes),
            grouped(table.bytes_per_scene.round() as u64), // a size, from 0
            table.bytes_per_attempt,
        )?;
    }
    Ok(())
}

/// A line without blanks at its end, where a bar of no length would leave some.
fn line(f: &mut Formatter<'_>, text: fmt::Arguments<'_>) -> fmt::Result {
    let mut line = String::new();
    line.write_fmt(text)?;
    writeln!(f, "{}", line.trim_end())
}
