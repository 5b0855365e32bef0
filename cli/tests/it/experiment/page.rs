//! Experiments as a page.

use std::fs;
use std::path::Path;

use serde_json::Value;

use super::{config, run, told};

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn play(name: &str, folder: &Path, out: &str, more: &[&str]) {
    let config = config(name);
    let out = folder.join(out);
    assert_eq!(told(&run(&[&["run", text(&config), "--out", text(&out)], more].concat())).0, Some(0));
}

fn page(folders: &[&Path], html: &Path) -> String {
    let mut arguments = vec!["report", "--html", text(html)];
    arguments.extend(folders.iter().map(|folder| text(folder)));
    let (code, said) = told(&run(&arguments));
    assert_eq!(code, Some(0), "{said}");
    fs::read_to_string(html).unwrap()
}

fn check_holds(page: &str, words: &[&str]) {
    for word in words {
        assert!(page.contains(word), "{word} is not in\n{page}");
    }
}

/// Grasps of primitives are executed again exactly, from what the journal says.
fn check_replays(out: &Path) {
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    let paths = fs::read_dir(out).unwrap().map(|entry| entry.unwrap().path());
    let pages: Vec<_> = paths.filter(|path| path.to_str().unwrap().contains("/failure-")).collect();
    assert!((1..=24).contains(&pages.len()) && page.matches("href=\"failure-").count() == pages.len(), "{pages:?}");
    for path in pages {
        let replay = fs::read_to_string(&path).unwrap();
        let json = replay.split("type=\"application/json\">").nth(1).unwrap().split("</script>").next().unwrap();
        let view: Value = serde_json::from_str(json).unwrap();
        let facts = view["facts"].as_array().unwrap();
        let fact = |key: &str| facts.iter().find(|fact| fact["key"] == key).unwrap()["value"].as_str().unwrap();
        let outcome = path.file_stem().unwrap().to_str().unwrap().splitn(4, '-').nth(3).unwrap().to_owned();
        assert!(fact("stored") == fact("now") && fact("now").starts_with(&outcome), "{facts:?} {}", path.display());
        assert!(facts.len() == 3 && !view["frames"].as_array().unwrap().is_empty(), "{facts:?}");
    }
}

/// `84.6 % (76.0 to 91.3)` as the page has it.
fn rate(of: &Value) -> String {
    let [value, low, high] = ["value", "low", "high"].map(|key| 100.0 * of[key].as_f64().unwrap());
    format!("{value:.1} % ({low:.1} to {high:.1})")
}

#[test]
fn a_page_has_the_numbers_of_the_report() {
    let folder = tempfile::tempdir().unwrap();
    play("pile.toml", folder.path(), "out", &["--rounds", "4", "--set", "plan=vgn"]);
    let (out, html) = (folder.path().join("out"), folder.path().join("page.html"));
    check_replays(&out);
    let found = page(&[&out], &html);
    assert_eq!(found, page(&[&out], &html));

    let report: Value = serde_json::from_str(&fs::read_to_string(out.join("report.json")).unwrap()).unwrap();
    let results = &report["results"];
    for key in ["success_rate", "cleared_share", "rounds_cleared_share"] {
        check_holds(&found, &[&rate(&results["rates"][key])]);
    }
    for key in ["outcomes", "endings"] {
        for (name, count) in results[key].as_object().unwrap() {
            check_holds(&found, &[&format!(">{name}</th>"), &format!("<td class=\"number\">{count} (")]);
        }
    }
    check_holds(&found, &["only 4 rounds", "quality_min", "pile, 5 objects, 6 views, plan = vgn, planned by vgn</h1>"]);
}

#[test]
fn several_are_rows_of_one_page() {
    let folder = tempfile::tempdir().unwrap();
    for (name, policy) in [("ours", "paper"), ("theirs", "vgn-best")] {
        let (set, protocol) = (format!("plan.ranking.policy={policy}"), format!("protocol={name}"));
        let sets = ["--rounds", "2", "--set", "seeds=[5, 6]", "--set", &set, "--set", &protocol];
        play("pile.toml", folder.path(), name, &sets);
    }
    let [ours, theirs, html] = ["ours", "theirs", "page.html"].map(|name| folder.path().join(name));
    let found = page(&[&ours, &theirs], &html);
    check_holds(
        &found,
        &["2 experiments", ">– seed 5</td>", ": theirs</h2>", "vgn-best", "ours; theirs: only 4 rounds"],
    );
    for name in [&ours, &theirs] {
        let report: Value = serde_json::from_str(&fs::read_to_string(name.join("report.json")).unwrap()).unwrap();
        check_holds(&found, &[&rate(&report["results"]["rates"]["success_rate"])]);
    }
    // The same experiment twice is told apart by its folders.
    check_holds(&page(&[&ours, &ours], &html), &[&format!("ours ({})", text(&ours))]);
}

#[test]
fn what_is_no_experiment_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let (out, html) = (folder.path().join("out"), folder.path().join("page.html"));
    let fails = |code: i32, words: &[&str]| {
        let (found, said) = told(&run(&["report", text(&out), "--html", text(&html)]));
        assert_eq!(found, Some(code), "{said}");
        words.iter().for_each(|word| assert!(said.contains(word), "{word} is not in {said}"));
        assert!(!html.exists());
    };
    fails(78, &["no experiment that is done here", text(&out)]);
    play("pile.toml", folder.path(), "out", &["--rounds", "1"]);
    let before = fs::read(out.join("report.json")).unwrap();
    fs::write(out.join("report.json"), "{\"results\":").unwrap();
    fails(65, &["damaged", "report.json"]);
    fs::write(out.join("report.json"), before).unwrap();
    let nowhere = folder.path().join("none/page.html");
    assert_eq!(told(&run(&["report", text(&out), "--html", text(&nowhere)])).0, Some(78));
}
