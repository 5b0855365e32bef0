//! What completing and opening a dataset of very many shards costs, in time and memory:
//! `cargo run --release --workspace --example many_shards -- DIR [SHARDS]`. The shards only look committed.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use shards::{Dataset, Draft, Finalized, layout, pretend_shard, synthetic};

/// Attempts of a shard: as docs/cluster.md recommends.
const ATTEMPTS: u64 = 10_000;

fn main() -> Result<()> {
    let mut args = std::env::args().skip(1);
    let dir = PathBuf::from(args.next().context("usage: many_shards DIR [SHARDS]")?);
    let shards = args.next().map_or(Ok(100_000), |a| a.parse()).context("SHARDS must be a whole number")?;
    let info = synthetic::info(42, shards, u64::from(shards) * ATTEMPTS, 60);
    let draft = Draft::begin(&dir, &info)?;
    let dataset_id = info.dataset_id();
    let began = Instant::now();
    for shard in 0..shards {
        pretend_shard(&dir, &info, &dataset_id, shard)?;
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
    let bytes = std::fs::metadata(dir.join(layout::MANIFEST))?.len();
    tell("finalize", began, &format!("manifest of {bytes} bytes"))?;
    let began = Instant::now();
    let dataset = Dataset::open(&dir)?;
    tell("open to read", began, &format!("{} attempts", dataset.info().attempt_count))
}

#[expect(clippy::print_stdout, reason = "it is what this program is for")]
fn tell(what: &str, began: Instant, more: &str) -> Result<()> {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or(" unknown").trim();
    println!("{what}: {:.2} s, peak memory {peak}, {more}", began.elapsed().as_secs_f64());
    Ok(())
}
