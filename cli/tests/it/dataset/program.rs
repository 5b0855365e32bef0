//! The program, run as people run it.

use std::path::Path;
use std::process::{Command, Output};

use crate::sample;

fn shards(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_graspmill")).arg("dataset").args(args).output().unwrap()
}

/// A dataset of 600 attempts at full variety on a coarse grid.
fn dataset() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    sample::write(dir.path(), &sample::sized(42, 3, 600, 20));
    dir
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn report_reads_well() {
    let dir = dataset();
    let output = shards(&["report", text(dir.path())]);
    assert!(output.status.success());
    insta::assert_snapshot!("report", String::from_utf8(output.stdout).unwrap());
    let output = shards(&["report", text(dir.path()), "--json"]);
    insta::assert_snapshot!("report_json", String::from_utf8(output.stdout).unwrap());
}

#[test]
fn a_report_is_a_page_that_holds_its_numbers_and_needs_nothing_else() {
    let dir = dataset();
    let page = dir.path().join("report.html");
    let output = shards(&["report", text(dir.path()), "--html", text(&page)]);
    assert_eq!(String::from_utf8(output.stdout).unwrap(), format!("{}\n", page.display()));
    let html = std::fs::read_to_string(&page).unwrap();
    let json = shards(&["report", text(dir.path()), "--json"]).stdout;
    let json: serde_json::Value = serde_json::from_slice(&json).unwrap();
    for group in ["shapes", "rules", "object_counts"] {
        for one in json[group].as_array().unwrap().iter().filter(|one| one["attempts"] != 0) {
            let [name, attempts, held] = ["name", "attempts", "positives"].map(|key| one[key].to_string());
            let row = format!(
                "{}</code></td><td class=\"number\">{attempts}</td><td class=\"number\">{held}</td>",
                name.trim_matches('"')
            );
            assert!(html.contains(&row), "{row} is not in {html}");
        }
    }
    let places = ["class=\"tiles\"", ">How attempts ended</h2>"].map(|word| html.find(word));
    assert!(places.iter().all(Option::is_some) && places.is_sorted(), "the summary comes first: {places:?}");
    assert!(html.contains(json["dataset_id"].as_str().unwrap()));
    for word in ["http://", "https://", "<script", "src=", "url("] {
        assert!(!html.contains(word), "{word}");
    }
    shards(&["report", text(dir.path()), "--html", text(&page)]);
    assert_eq!(std::fs::read_to_string(&page).unwrap(), html, "the same dataset, the same page");
    let output = shards(&["report", text(dir.path()), "--html", "/no/such/folder/r.html"]);
    assert_eq!(output.status.code(), Some(78));
    assert!(String::from_utf8(output.stderr).unwrap().contains("/no/such/folder/r.html"));
}

#[test]
fn scenes_are_browsed_as_pages_that_lead_to_each_other() {
    let dir = dataset();
    let out = dir.path().join("pages");
    let browse =
        |more: &[&str]| shards(&[&["browse", text(dir.path()), "--out", text(&out), "--no-replays"], more].concat());
    let output = browse(&["--scenes", "5"]);
    assert_eq!(String::from_utf8(output.stdout).unwrap(), format!("{}\n", out.join("index.html").display()));
    let page = |name: &str| std::fs::read_to_string(out.join(name)).unwrap();
    let scenes: Vec<String> = std::fs::read_dir(&out)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.starts_with("scene-"))
        .collect();
    let index = page("index.html");
    assert_eq!((scenes.len(), index.matches("<figure>").count()), (5, 5));
    for scene in &scenes {
        assert!(index.contains(&format!("href=\"{scene}\"")), "{scene}");
        assert!(page(scene).contains("href=\"index.html\"") && page(scene).contains("href=\"report.html\""));
        assert!(!page(scene).contains("id=\"replay-"), "there are none");
    }
    for outcome in ["held", "slipped", "pregrasp_collision"] {
        assert!(index.contains(&format!("<option>{outcome}</option>")), "{outcome}");
    }
    let before = (index, page("scenes.js"));
    assert!(browse(&["--scenes", "5"]).status.success());
    assert!((page("index.html"), page("scenes.js")) == before, "the same bytes again");
    assert!(browse(&["--scene", "7", "--scene", "3", "--scene", "7"]).status.success());
    assert!(page("scene-3.html").contains("<a id=\"next\" href=\"scene-7.html\">"));
    assert!(
        scenes
            .iter()
            .all(|scene| ["scene-3.html", "scene-7.html"].contains(&scene.as_str()) || !out.join(scene).exists())
    );
    assert!(browse(&[]).status.success());
    let (index, count) = (page("index.html"), std::fs::read_dir(&out).unwrap().count());
    assert!((0..30).all(|scene| index.contains(&format!("href=\"scene-{scene}.html\""))), "all scenes can be reached");
    assert_eq!(count, 30 + 6, "a file for each scene; index, report, listing, two scripts, a style");
    let refused = browse(&["--scene", "30"]);
    assert_eq!(refused.status.code(), Some(78));
    assert_eq!(String::from_utf8(refused.stderr).unwrap(), "error: scene must be below 30, got 30\n");
    let mine = shards(&["browse", text(dir.path()), "--out", text(dir.path())]);
    assert_eq!(mine.status.code(), Some(78), "the dataset's own folder is no folder of pages: {mine:?}");
}

#[test]
fn where_attempts_cannot_be_executed_again_pages_have_no_replays_and_the_program_ends_with_66() {
    let dir = dataset(); // made up, of no engine
    let out = dir.path().join("pages");
    let output = shards(&["browse", text(dir.path()), "--out", text(&out), "--scene", "3"]);
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(66), "{said}");
    assert!(said.starts_with("not all attempts have replays: "), "{said}");
    assert!(!std::fs::read_to_string(out.join("scene-3.html")).unwrap().contains("id=\"replay-"));
}

#[test]
fn the_card_reads_well() {
    let dir = dataset();
    let card = std::fs::read_to_string(dir.path().join("README.md")).unwrap();
    insta::assert_snapshot!("card", card);
}

#[test]
fn verify_says_ok_or_what_is_wrong() {
    let dir = dataset();
    let output = shards(&["verify", text(dir.path())]);
    assert_eq!(output.status.code(), Some(0));
    let told = String::from_utf8(output.stdout).unwrap();
    assert!(told.ends_with("bytes read and checked\nok\n"), "{told}");

    let file = dir.path().join("objects/shard-00001-of-00003.parquet");
    let mut bytes = std::fs::read(&file).unwrap();
    bytes[100] ^= 1;
    std::fs::write(&file, bytes).unwrap();
    let output = shards(&["verify", text(dir.path())]);
    assert_eq!(output.status.code(), Some(65));
    let told = String::from_utf8(output.stdout).unwrap();
    assert!(told.starts_with("shard 1: sha256 must be ") && told.ends_with("NOT ok: 1 problems\n"), "{told}");
    let output = shards(&["report", text(dir.path())]);
    assert_eq!(output.status.code(), Some(65), "a report of damaged data would be a wrong one");
}

#[test]
fn every_way_to_fail_has_its_code() {
    let dir = tempfile::tempdir().unwrap();
    let empty = dir.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    assert_eq!(shards(&["verify", text(&empty)]).status.code(), Some(78));
    assert_eq!(shards(&["verify"]).status.code(), Some(2));
    assert_eq!(shards(&["frobnicate"]).status.code(), Some(2));
    let begun = dir.path().join("begun");
    shards::Draft::begin(&begun, &sample::info(1)).unwrap();
    let output = shards(&["verify", text(&begun)]);
    assert_eq!(output.status.code(), Some(69));
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(told.starts_with("error: the dataset is not complete, there is no meta/manifest.json"), "{told}");
}

#[test]
fn export_says_who_does_it() {
    for words in [&["export", "grasps", "--format", "vgn", "--out", "x"][..], &["export", "--help"]] {
        let output = shards(words);
        let told = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && told.contains("pip install graspmill"), "{told}");
    }
}

#[test]
fn help_shows_examples_and_exit_codes() {
    let help = String::from_utf8(shards(&["--help"]).stdout).unwrap();
    for part in ["Examples:", "graspmill dataset browse grasps --out pages", "Exit codes:", "65  data damaged"] {
        assert!(help.contains(part), "{help}");
    }
}
