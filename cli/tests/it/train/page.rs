//! A run as a page.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use burn_dataset::Dataset as _;
use network::VoxelParams;
use network::upsampling::Upsampling;
use trainer::config::Targets;
use trainer::data::GraspDataset;
use trainer::data::batch;
use trainer::device::Device;
use trainer::evaluate::{TestSet, examine};
use trainer::method::Method;
use trainer::voxel::Voxel;

use super::fixture::{check_fails, trainer, write_config, write_dataset};

struct Place {
    dir: tempfile::TempDir,
    data: PathBuf,
    run: PathBuf,
}

impl Place {
    fn trained() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let (data, run) = (dir.path().join("data"), dir.path().join("run"));
        write_dataset(&data, 11, 2, 10, 12);
        let config = write_config(dir.path(), 2, 24);
        succeed(&["fit", "--data", text(&data), "--config", text(&config), "--run", text(&run)]);
        Self { dir, data, run }
    }

    fn page(&self, more: &[&str]) -> String {
        let path = self.dir.path().join("page.html");
        succeed(&[&["report", text(&self.run), "--html", text(&path)], more].concat());
        fs::read_to_string(path).unwrap()
    }
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn succeed(args: &[&str]) {
    let output = trainer(args);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
}

fn check_holds(page: &str, words: &[&str]) {
    for word in words {
        assert!(page.contains(word), "{word} is not in\n{page}");
    }
}

#[test]
fn a_page_has_the_numbers_of_the_evaluation_and_the_metrics() {
    let place = Place::trained();
    let data = text(&place.data);
    let folder = place.dir.path().join("report");
    let evaluate = ["evaluate", "--run", text(&place.run), "--data", data, "--split", "all", "--json"];
    succeed(&[&evaluate[..], &["--report", text(&folder)]].concat());
    let page = place.page(&["--data", data, "--split", "all"]);
    assert_eq!(page, place.page(&["--data", data, "--split", "all", "--threads", "1"]));

    let json = fs::read_to_string(folder.join("evaluation.json")).unwrap();
    let found: serde_json::Value = serde_json::from_str(&json).unwrap();
    let number = |at: &str| format!("{:.3}", found.pointer(at).unwrap().as_f64().unwrap());
    for (what, at) in [
        ("accuracy (Eq. 6)", "/all/accuracy"),
        ("accuracy of always &quot;failure&quot;", "/all/baseline_accuracy"),
        ("average precision", "/ranking/average_precision"),
        ("area under the ROC curve", "/ranking/roc_auc"),
        ("expected calibration error, 10 bins", "/calibration/expected_error"),
        ("Brier score", "/calibration/brier"),
    ] {
        check_holds(&page, &[&format!("<td>{what}</td><td class=\"number\">{}</td>", number(at))]);
    }
    let interval = format!("{} to {}", number("/accuracy_95_by_scene/0"), number("/accuracy_95_by_scene/1"));
    check_holds(&page, &[&interval, "epoch", "10 scenes only", "<td>all samples: "]);
    let count = |name: &str| found.pointer(&format!("/all/confusion/{name}")).unwrap().as_u64().unwrap();
    for (what, counts) in
        [("held", ["true_positive", "false_negative"]), ("failed", ["false_positive", "true_negative"])]
    {
        let [hold, fail] = counts.map(count);
        let row = format!("<td>{what}</td><td class=\"number\">{hold}</td><td class=\"number\">{fail}</td>");
        check_holds(&page, &[&row]);
    }
    for (rule, summary) in found["by_rule"].as_object().unwrap() {
        let row = format!(">{rule}</code></td><td class=\"number\">{}</td>", summary["samples"]);
        check_holds(&page, &[&row]);
    }
    // An epoch a row, with the losses of the metrics.
    for line in fs::read_to_string(place.run.join("metrics.jsonl")).unwrap().lines() {
        let line: serde_json::Value = serde_json::from_str(line).unwrap();
        for set in ["train", "test_attempts", "test_scenes"] {
            let loss = line[set]["loss"].as_f64().unwrap();
            check_holds(&page, &[&format!("<td class=\"number\">{loss:.4}</td>")]);
        }
    }
    check_holds(&page, &[">training.learning_rate</code>", "<svg", "Loss by epoch", "Precision and recall"]);
}

#[test]
fn the_worst_mistakes_are_those_that_looking_at_each_attempt_alone_finds() {
    let place = Place::trained();
    let best = place.run.join("best.safetensors");
    let examined = examine(&best, place.data.as_path(), TestSet::All, None, 6).unwrap();

    let data = std::slice::from_ref(&examined.dataset);
    let params = VoxelParams::at_tips(Upsampling::Nearest);
    let method = Voxel::new(params, Targets::Attempt, Device::Host);
    let samples = GraspDataset::survey(data, method, &AtomicBool::new(false), &|| {}).unwrap();
    let vector = network::checkpoint::read(&best).unwrap().vector;
    // (whether it held, badness, scene, attempt)
    let alone = |(scene, attempt): (u32, u32)| {
        let scenes = [(scene, Arc::new(samples.get(scene as usize).unwrap()))].into();
        let batch = batch(&samples.method, &scenes, vec![(scene, attempt)], None);
        let result = samples.method.evaluate(&vector, &batch)[0];
        let scene = u64::from(scene);
        let row = &examined.dataset.read_scene(scene).unwrap().attempts[attempt as usize];
        assert_eq!((row.attempt_id, row.label()), (attempt, result.label));
        (row.label() == 1, result.quality_logit, scene, attempt)
    };
    let all: Vec<(bool, f32, u64, u32)> = samples.ids().map(alone).collect();
    let page = place.page(&["--data", text(&place.data), "--split", "all"]);
    let mut places = Vec::new();
    for (held, found) in [(false, &examined.overrated), (true, &examined.underrated)] {
        let mut own: Vec<_> = all.iter().filter(|one| one.0 == held).copied().collect();
        own.sort_by(|a, b| if held { a.1.total_cmp(&b.1) } else { b.1.total_cmp(&a.1) });
        assert!(own.len() > 6, "{own:?}");
        assert_eq!(found.len(), 6);
        for (slow, quick) in own.iter().zip(found) {
            // A sample's bits hang on its neighbours in a batch: equal but for rounding.
            assert!((slow.1 - quick.score.logit).abs() < 1e-4, "{slow:?} {quick:?}");
            assert_eq!(quick.score.held, held);
            let own = all.iter().find(|one| (one.2, one.3) == (quick.scene_id, quick.attempt_id)).unwrap();
            assert!((own.1 - quick.score.logit).abs() < 1e-4, "{own:?} {quick:?}");
            let title = format!("{}/{}: quality {:.3}", quick.scene_id, quick.attempt_id, quick.score.quality());
            places.push(page.find(&title).unwrap());
            let (data, scene, attempt) = (text(&place.data), quick.scene_id, quick.attempt_id);
            check_holds(
                &page,
                &[
                    &format!("graspmill dataset replay {data} --attempt {scene}/{attempt} --out "),
                    &format!("graspmill dataset view {data} --scene {scene} --out "),
                ],
            );
        }
    }
    assert!(places.is_sorted(), "{places:?}");
    assert_eq!(page.matches("<svg class=\"scene\"").count(), 12);
    assert_eq!(page.matches("class=\"held\"").count(), 6, "a hand is drawn in each");
    assert_eq!(page.matches("</title></path>").count(), 12, "and one that failed in as many");
}

#[test]
fn without_a_dataset_it_says_what_is_left_out() {
    let place = Place::trained();
    let page = place.page(&[]);
    check_holds(&page, &["Left out", "--data DIR", "Loss by epoch", "best epoch", ">training.epochs</code>"]);
    assert!(!page.contains("Worst mistakes") && !page.contains("Precision and recall"));
    // Metrics alone are enough for curves.
    fs::remove_file(place.run.join("config.toml")).unwrap();
    fs::remove_file(place.run.join("best.safetensors")).unwrap();
    check_holds(&place.page(&[]), &["nothing is known of the recipe", "no best.safetensors here", "Loss by epoch"]);
}

#[test]
fn worries_stand_on_the_page() {
    let place = Place::trained();
    let metrics = place.run.join("metrics.jsonl");
    let lines = fs::read_to_string(&metrics).unwrap();
    let mut last: serde_json::Value = serde_json::from_str(lines.lines().last().unwrap()).unwrap();
    last["epoch"] = 3.into();
    last["train"]["loss"] = serde_json::Value::Null; // as a loss that is no number is written
    fs::write(&metrics, format!("{lines}{last}\n")).unwrap();
    let config = place.run.join("config.toml");
    fs::write(&config, fs::read_to_string(&config).unwrap().replace("epochs = 2", "epochs = 7")).unwrap();
    let page = place.page(&[]);
    check_holds(&page, &["no numbers in 1 of 3 epochs, first in epoch 3", "3 of the recipe's 7 epochs are done"]);
}

#[test]
fn several_runs_are_in_one_chart_with_what_differs() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    for (name, seed) in [("calm", 1), ("wild", 2)] {
        fs::create_dir(path(name)).unwrap();
        let config = write_config(dir.path(), 1, 24);
        let text = fs::read_to_string(config).unwrap().replace("seed = 3\n", &format!("seed = {seed}\n"));
        fs::write(path(name).join("config.toml"), text).unwrap();
        let line = |epoch: u32| {
            let of = |loss: f64| {
                format!("{{\"loss\": {loss}, \"accuracy\": {}, \"baseline_accuracy\": 0.74}}", 1.0 - loss / 2.0)
            };
            let set = of(f64::from(seed) * 0.2 / f64::from(epoch));
            format!("{{\"epoch\":{epoch},\"train\":{set},\"test_attempts\":{set},\"test_scenes\":{set}}}\n")
        };
        fs::write(path(name).join("metrics.jsonl"), (1..=3).map(line).collect::<String>()).unwrap();
    }
    let (calm, wild, html) = (path("calm"), path("wild"), path("runs.html"));
    succeed(&["report", text(&calm), text(&wild), "--html", text(&html)]);
    let page = fs::read_to_string(&html).unwrap();
    assert!(page.contains("<title>Training runs: calm, wild</title>"), "{page}");
    // 1 − 0.2 / 3 / 2 and 1 − 0.4 / 3 / 2
    assert!(page.contains(">0.967<") && page.contains(">0.933<"), "{page}");
    assert_eq!(page.matches("<figcaption><b>").count(), 2, "two charts with both runs in each");
    assert!(page.matches("calm").count() >= 5 && page.matches("wild").count() >= 5, "{page}");
    assert!(page.contains("<code class=\"short\">seed</code>"), "the seeds differ: {page}");
    let several = ["report", text(&calm), text(&wild), "--html", text(&html), "--data", "/nowhere"];
    check_fails(&several, 78, &["--data evaluates one run"]);
}

#[test]
fn what_is_no_run_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let (run, html) = (path("run"), path("page.html"));
    let args = |more: &[&'static str]| {
        let start = ["report", text(&run), "--html", text(&html)].map(str::to_owned);
        start.into_iter().chain(more.iter().map(|word| (*word).to_owned())).collect::<Vec<String>>()
    };
    let fails = |more: &[&'static str], code: i32, texts: &[&str]| {
        let args = args(more);
        check_fails(&args.iter().map(String::as_str).collect::<Vec<_>>(), code, texts);
        assert!(!html.exists(), "{texts:?}");
    };
    fails(&[], 78, &["no run here", "config.toml", text(&run)]);
    fs::create_dir(&run).unwrap();
    fails(&[], 78, &["no run here"]);
    let config = write_config(dir.path(), 1, 24);
    fs::copy(&config, run.join("config.toml")).unwrap();
    fails(&[], 78, &["no metrics here", "after its first epoch"]);
    fs::write(run.join("metrics.jsonl"), "").unwrap();
    fails(&[], 78, &["no metrics here"]);
    fs::write(run.join("metrics.jsonl"), "{\"epoch\":").unwrap();
    fails(&[], 65, &["damaged metrics in line 1"]);
    let set = "{\"loss\": 0.5, \"accuracy\": null, \"baseline_accuracy\": null}";
    let line = format!("{{\"epoch\":1,\"train\":{set},\"test_attempts\":{set},\"test_scenes\":{set}}}\n");
    fs::write(run.join("metrics.jsonl"), line).unwrap();
    fails(&["--data", "/nowhere"], 78, &["no checkpoint here", "best.safetensors"]);
    fails(&["--split", "all"], 2, &["--data"]);
    fs::write(run.join("best.safetensors"), "no weights").unwrap();
    fails(&[], 65, &["damaged checkpoint", "best.safetensors"]);
    fs::remove_file(run.join("best.safetensors")).unwrap();
    fs::write(run.join("config.toml"), "seed = ").unwrap();
    fails(&[], 65, &["damaged recipe", "config.toml"]);
    #[cfg(unix)]
    {
        fs::remove_file(run.join("config.toml")).unwrap();
        assert!(std::process::Command::new("mkfifo").arg(run.join("config.toml")).status().unwrap().success());
        fails(&[], 78, &["it must be a regular file", "config.toml"]);
        fs::remove_file(run.join("config.toml")).unwrap();
    }
    fs::copy(&config, run.join("config.toml")).unwrap();
    check_fails(&["report", text(&run)], 2, &["--html"]);
    check_fails(
        &["report", text(&run), "--html", text(&path("none/page.html"))],
        78,
        &["failed to write", "none/page.html"],
    );
    check_fails(&["report", text(&run), "--html", text(&html), "--data", "/nowhere"], 78, &["no checkpoint here"]);
    succeed(&["report", text(&run), "--html", text(&html)]);
}
