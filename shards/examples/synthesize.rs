//! Writes a synthetic dataset for tests of readers: `cargo run -p shards --example synthesize -- DIR [ATTEMPTS]
//! [SHARDS]`.

use std::path::PathBuf;

use anyhow::{Context, Result};
use shards::{Draft, synthetic};

fn main() -> Result<()> {
    let mut args = std::env::args().skip(1);
    let dir = PathBuf::from(args.next().context("usage: synthesize DIR [ATTEMPTS] [SHARDS]")?);
    let attempts = args.next().map_or(Ok(2_400), |a| a.parse()).context("ATTEMPTS must be a whole number")?;
    let shards = args.next().map_or(Ok(4), |a| a.parse()).context("SHARDS must be a whole number")?;
    let info = synthetic::info(42, shards, attempts, 60);
    let draft = Draft::begin(&dir, &info)?;
    for shard in 0..info.shard_count {
        if draft.is_committed(shard)? {
            continue;
        }
        let mut writer = draft.shard(shard)?;
        for scene in info.scenes_of(shard) {
            writer.push(&synthetic::scene_rows(scene, info.seed, &info))?;
        }
        writer.commit()?;
    }
    draft.finalize()?;
    Ok(())
}
