//! The page of experiments: its words from numbers made by hand.

use experiments::statistics::results;

use super::*;

fn interval(value: f64, low: f64, high: f64) -> Option<Interval> {
    Some(Interval { value, low, high })
}

fn group(name: &str, held: u64) -> GroupResults {
    let rates = Rates {
        success_rate: interval(0.5, 0.25, 0.75),
        cleared_share: interval(0.75, 0.5, 1.0),
        rounds_cleared_share: None,
    };
    GroupResults { name: name.to_owned(), rounds: 2, objects: 4, attempts: 5, held, rates }
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
        by_group: vec![group("hard", 2), group("easy", 2)],
        by_seed: Vec::new(),
        plan_ms: Some(Percentiles { p50: 20.5, p90: 31.5, p99: 40.0 }),
    }
}

fn report(results: Results) -> Report {
    let versions = [("experiments", env!("CARGO_PKG_VERSION")), ("rapier3d", "0.36.1")];
    let about = About {
        command: "graspmill experiment run configs/experiment/pile.toml".to_owned(),
        config: "seed = 1\nname = \"```\"\n".to_owned(),
        planner: "judge".to_owned(),
        model_id: "c0ffee".to_owned(),
        versions: versions.map(|(name, version)| (name.to_owned(), version.to_owned())).into(),
    };
    Report { results, about }
}

fn played(results: Results) -> Played {
    Played { name: results.protocol.clone(), report: report(results) }
}

const EXPECTED: &str = r#"Experiment pile, planned by judge

LEAD

Rates

experiment  rounds  objects  attempts  held             GSR (95 %)               DR (95 %)         rounds cleared           ms a plan
pile             4        8        10     6  60.0 % (41.2 to 75.0)  75.0 % (50.0 to 100.0)  50.0 % (0.0 to 100.0)  20.5 / 31.5 / 40.0
– hard           2        4         5     2  50.0 % (25.0 to 75.0)  75.0 % (50.0 to 100.0)                      –
– easy           2        4         5     2  50.0 % (25.0 to 75.0)  75.0 % (50.0 to 100.0)                      –

warning: pile: only 4 rounds do not show what is rare: intervals are too narrow.

Why attempts failed

experiment       empty     slipped        held
pile        1 (10.0 %)  3 (30.0 %)  6 (60.0 %)

How rounds ended

experiment     cleared    failures
pile        2 (50.0 %)  2 (50.0 %)

How it was run: pile

Planned by judge, model c0ffee; experiments VERSION, rapier3d 0.36.1.

graspmill experiment run configs/experiment/pile.toml

seed = 1
name = "```"
"#;

#[test]
fn the_report_is_this_one() {
    let expected = EXPECTED.replace("VERSION", env!("CARGO_PKG_VERSION")).replace("LEAD", LEAD);
    assert_eq!(described(&[played(small("pile"))]).text(), expected);
}

#[test]
fn several_experiments_are_rows_of_the_same_tables_and_of_nothing_there_are_dashes() {
    let page = described(&[played(small("ours")), played(results("nothing", &[]))]).text();
    let rows: Vec<String> = page.lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" ")).collect();
    for row in [
        "2 experiments",
        "ours 4 8 10 6 60.0 % (41.2 to 75.0) 75.0 % (50.0 to 100.0) 50.0 % (0.0 to 100.0) 20.5 / 31.5 / 40.0",
        "nothing 0 0 0 0 – – – –",
        "ours 1 (10.0 %) 3 (30.0 %) 6 (60.0 %)",
        "nothing 0 (0.0 %) 0 (0.0 %) 0 (0.0 %)",
        "How it was run: nothing",
    ] {
        assert!(rows.iter().any(|line| line == row), "{row} is not in {page}");
    }
    assert!(!page.contains("NaN"), "{page}");
}

#[test]
fn the_json_has_these_keys_and_reads_back_as_the_same_numbers() {
    let written = report(small("pile"));
    let text = program::json(&written).unwrap();
    let read: serde_json::Value = serde_json::from_str(&text).unwrap();
    let keys = |at: &str| -> Vec<String> {
        let object = read.pointer(at).and_then(serde_json::Value::as_object).unwrap();
        let mut keys: Vec<String> = object.keys().cloned().collect();
        keys.sort();
        keys
    };
    assert_eq!(keys(""), ["about", "results"]);
    assert_eq!(keys("/about"), ["command", "config", "model_id", "planner", "versions"]);
    let wanted = "attempts by_group by_seed endings held objects outcomes plan_ms protocol rates removed rounds";
    assert_eq!(keys("/results").join(" "), wanted);
    assert_eq!(keys("/results/rates"), ["cleared_share", "rounds_cleared_share", "success_rate"]);
    assert_eq!(keys("/results/endings"), ["cleared", "failures"]);
    assert_eq!(read["results"]["outcomes"]["slipped"], 3);
    assert_eq!(read["results"]["rates"]["success_rate"]["low"], 0.412);
    assert_eq!(read["results"]["plan_ms"]["p50"], 20.5);
    assert_eq!(read["about"]["config"], written.about.config);
    let order = ["\"protocol\"", "\"rates\"", "\"by_group\"", "\"about\""].map(|key| text.find(key).unwrap());
    assert!(order.is_sorted() && text.ends_with("}\n"), "{text}");
}

#[test]
fn each_reason_to_worry_is_a_warning_and_none_is_invented() {
    let fine = Results { rounds: 30, ..small("pile") };
    assert_eq!(grouped_warnings(&[played(fine.clone())]), Vec::<String>::new());
    let point = Rates { success_rate: interval(1.0, 1.0, 1.0), ..fine.rates };
    for (changed, words) in [
        (Results { rounds: 29, ..fine.clone() }, "pile: only 29 rounds"),
        (Results { rates: point, ..fine.clone() }, "has no width"),
        (Results { endings: [(Ending::NoAnswer, 2)].into(), ..fine.clone() }, "2 of 30 rounds ended because"),
    ] {
        let found = grouped_warnings(&[played(changed)]);
        assert!(found.len() == 1 && found[0].contains(words), "{words}: {found:?}");
    }
    let both = ["pile", "packed"].map(|name| played(Results { rounds: 29, ..small(name) }));
    let found = grouped_warnings(&both);
    assert!(found.len() == 1 && found[0].starts_with("pile; packed: only 29 rounds"), "{found:?}");
}

#[test]
fn in_short_an_experiment_is_its_rates_with_their_protocol() {
    let text = in_short(&small("pile"));
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!((lines.len(), lines[0]), (5, "pile"), "{text}");
    assert!(lines[2].starts_with("60.0 % (41.2 to 75.0)") && lines[2].ends_with("6 of 10"), "{text}");
    let silent = in_short(&Results { endings: [(Ending::NoAnswer, 2)].into(), ..small("pile") });
    assert_eq!(silent, text + "2 of 4 rounds ended because the planner gave no answer; journal.jsonl says why.\n");
}
