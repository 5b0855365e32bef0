//! The report as people read it: aligned, with bars.

use std::fmt::{self, Display, Formatter, Write as _};

use crate::report::{Bin, Group, OutcomeGroup, Report};
use crate::text::{bar, bytes, grouped, percent, ratio};

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
        writeln!(f, "\npositives : negatives = {} ({} positive)", ratio(labels), percent(labels.positive_share()))?;
        groups(f, "shape", &self.shapes)?;
        groups(f, "rule", &self.rules)?;
        groups(f, "objects in scene", &self.object_counts)?;
        outcomes(f, &self.outcomes, labels.attempts)?;
        let millimetres = |edge: f64| format!("{:.0}", edge * 1000.0);
        histogram(f, "opening width, mm (hand closed)", &self.width_m, millimetres)?;
        histogram(f, "approach, degrees from straight down", &self.approach_deg, |edge| format!("{edge:.0}"))?;
        rejections(f, self)?;
        sizes(f, self)
    }
}

fn groups(f: &mut Formatter<'_>, title: &str, groups: &[Group]) -> fmt::Result {
    writeln!(f, "\n{title:<20}{:>10}{:>10}{:>9}  positive share", "attempts", "positive", "share")?;
    for group in groups {
        let share = group.tally().positive_share();
        line(
            f,
            format_args!(
                "  {:<18}{:>10}{:>10}{:>9}  {}",
                group.name,
                grouped(group.attempts),
                grouped(group.positives),
                percent(share),
                bar(share, BAR)
            ),
        )?;
    }
    Ok(())
}

fn outcomes(f: &mut Formatter<'_>, outcomes: &[OutcomeGroup], attempts: u64) -> fmt::Result {
    writeln!(f, "\n{:<20}{:>10}{:>9}            of all attempts", "outcome", "attempts", "share")?;
    for group in outcomes {
        let share = group.attempts as f64 / attempts.max(1) as f64;
        let (count, percent) = (grouped(group.attempts), percent(share));
        line(f, format_args!("  {:<18}{count:>10}{percent:>9}            {}", group.outcome, bar(share, BAR)))?;
        for (hit, count) in &group.hits {
            let name = format!("with {hit}");
            let of_all = *count as f64 / attempts.max(1) as f64;
            line(f, format_args!("    {name:<16}{:>10}{:>9}", grouped(*count), self::percent(of_all)))?;
        }
    }
    Ok(())
}

fn histogram(f: &mut Formatter<'_>, title: &str, bins: &[Bin], edge: impl Fn(f64) -> String) -> fmt::Result {
    let most = bins.iter().map(|b| b.attempts).max().unwrap_or_default().max(1);
    writeln!(f, "\n{title:<40}{:>9}  attempts", "positive")?;
    for bin in bins {
        let range = format!("{} to {}", edge(bin.low), edge(bin.high));
        let tally = crate::Tally { attempts: bin.attempts, positives: bin.positives };
        let share = if bin.attempts == 0 { "-".to_owned() } else { percent(tally.positive_share()) };
        let length = bar(bin.attempts as f64 / most as f64, BAR);
        line(f, format_args!("  {range:<18}{:>10}{:>19}  {length}", grouped(bin.attempts), share))?;
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
    writeln!(f, "\n{:<20}{:>10}{:>12}{:>12}{:>14}", "table", "rows", "on disk", "B/scene", "B/attempt")?;
    for table in &report.tables {
        writeln!(
            f,
            "  {:<18}{:>10}{:>12}{:>12}{:>14.1}",
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
