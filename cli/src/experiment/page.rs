//! Experiments that were run as one description, which becomes a page, Markdown and a terminal's text: rates with their
//! intervals, and why attempts failed; several of them side by side.
//!
//! A success rate without its protocol is a rumour: every section says whose numbers it holds.

mod differences;
mod sections;
mod side_by_side;
mod warnings;

use std::path::{Path, PathBuf};

use experiments::journal::journalled;
use experiments::record::Round;
use experiments::report::Report;
use experiments::statistics::{DRAWS, Interval, Rates, Results};
use program::text::grouped;
use program::{Failure, write};
use report::document::{Block, Document, Drawing, Picture, below};
use report::figure::{Intervals, Rate, Row};

use sections::{details, origin, parts, share, times};

/// An experiment that was run.
#[derive(Debug)]
pub struct Played {
    folder: PathBuf,
    report: Report,
    /// `None` where the journal was not kept.
    rounds: Option<Vec<Round>>,
}

impl Played {
    /// Reads the folder of an experiment: `report.json` and, if it is there, `journal.jsonl`.
    ///
    /// # Errors
    /// If there is no experiment that is done, or a file cannot be read or is not what a run writes.
    pub fn read(folder: &Path) -> Result<Self, Failure> {
        let report = Report::read(folder)?;
        // A run that was made shorter keeps the rounds that it does not count any more.
        let counted = |rounds: Vec<Round>| rounds.into_iter().filter(|r| r.round < report.results.rounds).collect();
        let rounds = journalled(folder)?.map(counted);
        Ok(Self { folder: folder.to_owned(), rounds, report })
    }

    fn results(&self) -> &Results {
        &self.report.results
    }
}

/// One or several experiments. The same folders give the same document.
#[must_use]
pub fn document(all: &[Played]) -> Document {
    let names = names(all);
    let attempts: u64 = all.iter().map(|one| one.results().attempts).sum();
    let (title, mut blocks) = if let [one] = all {
        let lead = "Observe, plan, grasp; repeat until the table is empty or a stop rule applies.";
        let title = format!("Experiment {}", one.results().protocol);
        (title, vec![Block::Text(lead.to_owned()), Block::Tiles(tiles(one.results()))])
    } else {
        let lead = format!("{} experiments, {} grasps executed in physics.", all.len(), grouped(attempts));
        ("Experiments side by side".to_owned(), vec![Block::Text(lead)])
    };
    blocks.push(Block::Warnings(warnings::warnings(all, &names)));
    blocks.extend(rates(all));
    if all.len() > 1 {
        blocks.push(Block::Heading("Side by side".to_owned()));
        blocks.extend(side_by_side::blocks(all, &names));
        blocks.extend(differences::blocks(all, &names));
    }
    for (one, name) in all.iter().zip(&names) {
        let mut own = details(one.results());
        own.extend(origin(&one.report.about));
        if all.len() > 1 { blocks.extend(below(name, own)) } else { blocks.extend(own) }
    }
    Document { title, blocks, footer: format!("graspmill experiment report, Graspmill {}", env!("CARGO_PKG_VERSION")) }
}

/// Writes the page of an experiment that is done into its folder, and returns its file.
///
/// # Errors
/// If a file cannot be read or written.
pub fn write_page(folder: &Path) -> Result<PathBuf, Failure> {
    let path = folder.join("report.html");
    write(&path, document(&[Played::read(folder)?]).html()?)?;
    Ok(path)
}

/// An experiment's rates with their protocol in a few lines, as they are read last in a terminal.
#[must_use]
pub fn in_short(results: &Results) -> String {
    let blocks = vec![Block::Tiles(tiles(results))];
    Document { title: results.protocol.clone(), blocks, footer: String::new() }.text()
}

fn intervals(rows: impl Iterator<Item = (String, Rates)>) -> Intervals {
    let rate = |name, rate: Option<Interval>| Rate {
        name,
        share: rate.map(|Interval { value, low, high }| [value, low, high]),
        text: share(rate),
    };
    let row = |(name, rates): (String, Rates)| Row {
        name,
        rates: [rate("GSR", rates.success_rate), rate("cleared", rates.cleared_share)],
    };
    Intervals { title: "Grasp success rate and share of objects cleared".to_owned(), rows: rows.map(row).collect() }
}

/// What experiments are called: by their protocols; where two have the same, by their folders too.
fn names(all: &[Played]) -> Vec<String> {
    let name = |one: &Played| {
        let protocol = &one.results().protocol;
        if all.iter().filter(|other| other.results().protocol == *protocol).count() > 1 {
            format!("{protocol} ({})", one.folder.display())
        } else {
            protocol.clone()
        }
    };
    all.iter().map(name).collect()
}

/// What a reader wants first.
fn tiles(results: &Results) -> Vec<(String, String)> {
    let Results { rounds, objects, attempts, held, removed, .. } = results;
    let [success, cleared, all_cleared] = results.rates.all().map(share);
    vec![
        (success, format!("of the grasps held (GSR): {} of {}", grouped(*held), grouped(*attempts))),
        (cleared, format!("of the objects removed: {} of {}", grouped(*removed), grouped(*objects))),
        (all_cleared, format!("of the {} rounds cleared", grouped(*rounds))),
        (times(results.plan_ms), "ms a plan, p50 / p90 / p99".to_owned()),
    ]
}

/// The rates as a figure and, of a single experiment, those of its parts.
fn rates(all: &[Played]) -> [Block; 3] {
    let whole = intervals(names(all).into_iter().zip(all.iter().map(|one| one.results().rates)));
    let title = whole.title.clone();
    let mut pictures = vec![Picture::new(Drawing::Intervals(whole), title, "Disc: GSR. Ring: cleared.")];
    if let [one] = all {
        for (title, groups) in parts(one.results()) {
            let parts = intervals(groups.iter().map(|group| (group.name.clone(), group.rates)));
            let caption = "The same for parts of the rounds; their intervals are wider, for they are fewer.";
            pictures.push(Picture::new(Drawing::Intervals(parts), title, caption));
        }
    }
    let text = format!(
        "GSR, the grasp success rate: attempts that held, of all attempts. % cleared, also called DR: objects removed, \
         of those at the beginning. Intervals: 95 %, by bootstrap over whole rounds ({DRAWS} draws), because grasps of \
         one round fail together."
    );
    [Block::Heading("Rates".to_owned()), Block::Text(text), Block::Figures(pictures)]
}

#[cfg(test)]
mod tests {
    use experiments::record::Ending;
    use experiments::report::About;
    use experiments::statistics::{GroupResults, Percentiles, TargetResults, results};
    use schema::Outcome;

    use super::*;

    fn interval(value: f64, low: f64, high: f64) -> Option<Interval> {
        Some(Interval { value, low, high })
    }

    fn group(name: &str, held: u64, unviable: u64) -> GroupResults {
        let rates = Rates {
            success_rate: interval(0.5, 0.25, 0.75),
            cleared_share: interval(0.75, 0.5, 1.0),
            rounds_cleared_share: None,
        };
        GroupResults { name: name.to_owned(), rounds: 2, unviable, objects: 4, attempts: 5, held, rates }
    }

    /// Made by hand, so that the text does not depend on how intervals are drawn.
    fn small(protocol: &str) -> Results {
        Results {
            protocol: protocol.to_owned(),
            rounds: 4,
            objects: 8,
            attempts: 10,
            held: 6,
            removed: 6,
            rates: Rates {
                success_rate: interval(0.6, 0.412, 0.75),
                cleared_share: interval(0.75, 0.5, 1.0),
                rounds_cleared_share: interval(0.5, 0.0, 1.0),
            },
            endings: [(Ending::Cleared, 2), (Ending::Failures, 2)].into(),
            outcomes: [(Outcome::Empty, 1), (Outcome::Slipped, 3), (Outcome::Held, 6)].into(),
            by_group: vec![group("hard", 2, 1), group("easy", 2, 0)],
            by_seed: Vec::new(),
            by_target: vec![
                TargetResults {
                    name: "cuboid".to_owned(),
                    attempts: 8,
                    held: 4,
                    success_rate: interval(0.5, 0.25, 0.687),
                },
                TargetResults {
                    name: "cylinder".to_owned(),
                    attempts: 2,
                    held: 2,
                    success_rate: interval(1.0, 1.0, 1.0),
                },
            ],
            plan_ms: Some(Percentiles { p50: 20.5, p90: 31.5, p99: 40.0 }),
            observe_ms: Some(Percentiles { p50: 50.0, p90: 60.0, p99: 70.5 }),
            planned_per_attempt_mean: Some(12.5),
        }
    }

    fn about() -> About {
        let versions = [("experiments", env!("CARGO_PKG_VERSION")), ("rapier3d", "0.36.1")];
        About {
            command: "graspmill experiment run configs/experiment/pile.toml".to_owned(),
            config: "seed = 1\nname = \"```\"\n".to_owned(),
            model_id: "c0ffee".to_owned(),
            versions: versions.map(|(name, version)| (name.to_owned(), version.to_owned())).into(),
        }
    }

    fn played(results: Results) -> [Played; 1] {
        let report = Report { results, about: about() };
        [Played { folder: PathBuf::from("out"), report, rounds: Some(Vec::new()) }]
    }

    fn several(results: impl IntoIterator<Item = Results>) -> Vec<Played> {
        results.into_iter().flat_map(played).collect()
    }

    fn comparison(all: &[Played]) -> String {
        Document { blocks: side_by_side::blocks(all, &names(all)), ..Document::default() }.markdown()
    }

    const PAGE: &str = r#"# Experiment pile

Observe, plan, grasp; repeat until the table is empty or a stop rule applies.

- 60.0 % (41.2 to 75.0): of the grasps held (GSR): 6 of 10
- 75.0 % (50.0 to 100.0): of the objects removed: 6 of 8
- 50.0 % (0.0 to 100.0): of the 4 rounds cleared
- 20.5 / 31.5 / 40.0: ms a plan, p50 / p90 / p99

- Only 4 rounds: intervals are wide, and too narrow still, for few rounds cannot show what is rare.
- Rounds of the report that the journal lacks: 4.

## Rates

GSR, the grasp success rate: attempts that held, of all attempts. % cleared, also called DR: objects removed, of those at the beginning. Intervals: 95 %, by bootstrap over whole rounds (2000 draws), because grasps of one round fail together.

6 of 10 attempts held, 6 of 8 objects were removed.
Rendering the views took 50.0 / 60.0 / 70.5 ms (p50 / p90 / p99); a plan gave 12.5 grasps on average.

## Attempts by outcome

| outcome | attempts | of all attempts |
|---|---:|---:|
| empty | 1 | 10.0 % |
| slipped | 3 | 30.0 % |
| held | 6 | 60.0 % |

## Endings of rounds

| ending | rounds | of all rounds |
|---|---:|---:|
| cleared | 2 | 50.0 % |
| failures | 2 | 50.0 % |

## By scene

| what | rounds | not viable | objects | attempts | held | GSR (95 %) | % cleared (95 %) |
|---|---:|---:|---:|---:|---:|---:|---:|
| hard | 2 | 1 | 4 | 5 | 2 | 50.0 % (25.0 to 75.0) | 75.0 % (50.0 to 100.0) |
| easy | 2 | 0 | 4 | 5 | 2 | 50.0 % (25.0 to 75.0) | 75.0 % (50.0 to 100.0) |

## By what was to be held

| object | attempts | held | GSR (95 %) |
|---|---:|---:|---:|
| cuboid | 8 | 4 | 50.0 % (25.0 to 68.7) |
| cylinder | 2 | 2 | 100.0 % (100.0 to 100.0) |

## How it was run

| what | value |
|---|---|
| model | c0ffee |
| experiments | VERSION |
| rapier3d | 0.36.1 |

```sh
graspmill experiment run configs/experiment/pile.toml
```

````toml
seed = 1
name = "```"
````
"#;

    #[test]
    fn the_report_is_this_one() {
        let expected = PAGE.replace("VERSION", env!("CARGO_PKG_VERSION"));
        assert_eq!(document(&played(small("pile"))).markdown(), expected);
    }

    #[test]
    fn a_report_of_nothing_has_dashes_and_no_numbers_that_are_none() {
        let page = document(&played(results("pile", &[]))).markdown();
        assert!(page.contains("- –: of the grasps held") && page.contains("\nNone.\n"), "{page}");
        assert!(!page.contains("NaN"), "{page}");
    }

    #[test]
    fn the_json_has_these_keys_and_reads_back_as_the_same_numbers() {
        let text = program::json(&Report { results: small("pile"), about: about() }).unwrap();
        let read: serde_json::Value = serde_json::from_str(&text).unwrap();
        let keys = |at: &str| -> Vec<String> {
            let object = read.pointer(at).and_then(serde_json::Value::as_object).unwrap();
            let mut keys: Vec<String> = object.keys().cloned().collect();
            keys.sort();
            keys
        };
        assert_eq!(keys(""), ["about", "results"]);
        assert_eq!(keys("/about"), ["command", "config", "model_id", "versions"]);
        let wanted = "attempts by_group by_seed by_target endings held objects observe_ms outcomes plan_ms planned_per_trial_mean protocol \
                      rates removed rounds";
        assert_eq!(keys("/results").join(" "), wanted);
        assert_eq!(keys("/results/rates"), ["cleared_share", "rounds_cleared_share", "success_rate"]);
        assert_eq!(keys("/results/endings"), ["cleared", "failures"]);
        assert_eq!(read["results"]["outcomes"]["slipped"], 3);
        assert_eq!(read["results"]["rates"]["success_rate"]["low"], 0.412);
        assert_eq!(read["results"]["by_target"][0]["name"], "cuboid");
        assert_eq!(read["results"]["plan_ms"]["p50"], 20.5);
        assert_eq!(read["about"]["config"], about().config);
        let order = ["\"protocol\"", "\"rates\"", "\"by_target\"", "\"about\""].map(|key| text.find(key).unwrap());
        assert!(order.is_sorted() && text.ends_with("}\n"), "{text}");
    }

    #[test]
    fn a_comparison_names_those_that_are_apart() {
        let mut best = small("ours");
        best.rates.success_rate = interval(0.9, 0.76, 0.97);
        let touching = Results { protocol: "touching".to_owned(), ..small("") };
        let nothing = results("nothing", &[]);
        let text = comparison(&several([small("vgn"), best.clone(), touching.clone(), nothing]));
        let rows: Vec<&str> = text.lines().filter(|line| line.starts_with("| ")).collect();
        assert_eq!(rows.len(), 5, "{text}");
        assert!(rows[2].starts_with("| ours | 4 | 10 | 90.0 % (76.0 to 97.0) | 75.0 %"), "{text}");
        for low in ["vgn", "touching"] {
            assert!(text.contains(&format!("- ours, 90.0 % (76.0 to 97.0), is above {low}, 60.0 %")), "{text}");
        }
        best.rates.success_rate = interval(0.9, 0.75, 0.97);
        assert!(!comparison(&several([best, touching])).contains("is above vgn"));
    }

    #[test]
    fn experiments_on_the_same_scenes_stand_side_by_side() {
        let text = comparison(&several([small("ours"), small("vgn")]));
        let head = "| scene | ours: held of attempts | GSR (95 %) | vgn: held of attempts | GSR (95 %) |";
        let row = "| hard | 2 of 5 | 50.0 % (25.0 to 75.0) | 2 of 5 | 50.0 % (25.0 to 75.0) |";
        assert!(text.contains(head) && text.contains(row), "{text}");
        let other = Results { by_group: vec![group("alone", 1, 0)], ..small("other") };
        assert!(!comparison(&several([small("ours"), other])).contains("| scene |"));
    }

    #[test]
    fn in_short_an_experiment_is_its_rates_with_their_protocol() {
        let text = in_short(&small("pile"));
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!((lines.len(), lines[0]), (6, "pile"), "{text}");
        assert!(lines[2].contains("60.0 % (41.2 to 75.0)") && lines[2].ends_with("6 of 10"), "{text}");
    }

    #[test]
    fn seeds_have_a_mean_and_a_deviation() {
        let mut seeds = vec![group("seed 0", 1, 0), group("seed 1", 1, 0)];
        seeds[1].rates.success_rate = interval(0.7, 0.5, 0.9);
        let page = document(&played(Results { by_seed: seeds, ..small("pile") })).markdown();
        assert!(page.contains("GSR 60.0 ± 10.0 %, % cleared 75.0 ± 0.0 %"), "{page}");
    }
}
