//! What completing and opening a dataset of very many shards costs, in time and memory:
//! `cargo bench -p shards --bench many_shards -- DIR [SHARDS]`. The shards only look committed: a marker, and empty
//! files of the marker's sizes, which take neither time nor space.

#![expect(clippy::print_stdout, reason = "it is what this program is for")]

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use schema::{Outcome, Rule};
use sha2::{Digest, Sha256};
use shards::{Counts, Dataset, DatasetInfo, Draft, FileSummary, Finalized, ShardSummary, Table, Tally, layout};

/// Attempts of a shard: as docs/cluster.md recommends.
const ATTEMPTS: u64 = 10_000;
const ATTEMPTS_PER_SCENE: u32 = 60;

fn main() -> Result<()> {
    let mut args = std::env::args().skip(1).filter(|arg| arg != "--bench"); // cargo's word
    let Some(dir) = args.next().map(PathBuf::from) else {
        println!("not measured: many_shards takes DIR [SHARDS]");
        return Ok(());
    };
    let shards = args.next().map_or(Ok(100_000), |a| a.parse()).context("SHARDS must be a whole number")?;
    let sample = Dataset::open(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/format-1"))?;
    let attempt_count = u64::from(shards) * ATTEMPTS;
    let scene_count = attempt_count.div_ceil(ATTEMPTS_PER_SCENE.into());
    let sizes = DatasetInfo { shard_count: shards, scene_count, attempt_count, ..sample.info().clone() };
    let info = DatasetInfo { attempts_per_scene: ATTEMPTS_PER_SCENE, ..sizes };
    let draft = Draft::begin(&dir, &info)?;
    let dataset_id = info.dataset_id();
    let began = Instant::now();
    for shard in 0..shards {
        pretend(&dir, &info, &dataset_id, shard)?;
    }
    tell("pretend", began, &format!("{shards} shards"))?;

    let began = Instant::now();
    let unmarked = draft.unmarked()?;
    tell("quick look", began, &format!("{} missing", unmarked.len()))?;
    let began = Instant::now();
    let missing = draft.missing()?;
    tell("missing", began, &format!("{} missing", missing.len()))?;
    let began = Instant::now();
    ensure!(matches!(draft.finalize()?, Finalized::Complete(_)), "shards are missing");
    let bytes = fs::metadata(dir.join(layout::MANIFEST))?.len();
    tell("finalize", began, &format!("manifest of {bytes} bytes"))?;
    let began = Instant::now();
    let dataset = Dataset::open(&dir)?;
    tell("open to read", began, &format!("{} attempts", dataset.info().attempt_count))
}

fn tell(what: &str, began: Instant, more: &str) -> Result<()> {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or(" unknown").trim();
    println!("{what}: {:.2} s, peak memory {peak}, {more}", began.elapsed().as_secs_f64());
    Ok(())
}

/// Puts a shard that only looks committed into a dataset's folder.
fn pretend(dir: &Path, info: &DatasetInfo, dataset_id: &str, shard: u32) -> Result<()> {
    let scenes = info.scenes_of(shard);
    let (scenes, attempts) =
        (scenes.end - scenes.start, scenes.map(|scene| u64::from(info.attempts_of_scene(scene))).sum::<u64>());
    let file = |table: Table, rows: u64, bytes_of_row: u64| FileSummary {
        path: layout::table_file(table, shard, info.shard_count),
        bytes: 4_000 + rows * bytes_of_row,
        rows,
        sha256: hex(&shard.to_le_bytes()),
    };
    let summary = ShardSummary {
        dataset_id: dataset_id.to_owned(),
        shard,
        attempts: file(Table::Attempts, attempts, 56),
        scenes: file(Table::Scenes, scenes, 38_000),
        objects: file(Table::Objects, 4 * scenes, 40),
        counts: counts(scenes, attempts),
    };
    for table in Table::ALL {
        let file = summary.file(table);
        File::create(dir.join(&file.path))?.set_len(file.bytes)?;
    }
    Ok(fs::write(dir.join(layout::marker(shard)), sealed(&summary)?)?)
}

/// Consistent counts: a quarter is held, the rest collides on the way.
fn counts(scenes: u64, attempts: u64) -> Counts {
    let mut counts = Counts { scenes, objects: 4 * scenes, ..Counts::zero() };
    counts.labels = Tally { attempts, positives: attempts / 4 };
    counts.outcomes.insert(Outcome::Held.name().to_owned(), attempts / 4);
    counts.outcomes.insert(Outcome::PregraspCollision.name().to_owned(), attempts - attempts / 4);
    let rules = Rule::of_the_paper();
    for (place, rule) in (0..).zip(rules.iter()) {
        let attempts = attempts / rules.len() as u64 + u64::from(place < attempts % rules.len() as u64);
        counts.rules.insert(rule.name().to_owned(), Tally { attempts, positives: attempts / 4 });
    }
    counts
}

/// The marker's text, whose last key is the SHA-256 of the text without it.
fn sealed(summary: &ShardSummary) -> Result<String> {
    let text = serde_json::to_string_pretty(summary)?;
    let body = text.strip_suffix("\n}").context("an object")?;
    Ok(format!("{body},\n  \"seal\": \"{}\"\n}}\n", hex(body.as_bytes())))
}

fn hex(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}
