#!/usr/bin/env bash
# The whole pipeline on a small dataset: builds, generates a dataset in physics, verifies it, prints its statistics, trains the
# grasp network on it, and evaluates it on held-out attempts. Needs only a Rust toolchain and a C compiler.
# Usage: scripts/demo.sh [FOLDER]      (default: demo; running it again continues an interrupted run)
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

folder=${1:-demo}
data=$folder/dataset
run=$folder/run

say() { printf '\n\033[1m%s\033[0m\n' "$*"; }

say "1/6 building (the first time takes some minutes)"
cargo build --release --workspace --bins
bin=${CARGO_TARGET_DIR:-target}/release
start=$SECONDS

say "2/6 generating 2,400 grasp attempts in 40 scenes"
"$bin/generator" --config configs/generate/demo.toml --out "$data"

say "3/6 verifying every byte and row"
"$bin/shards" verify "$data"

say "4/6 what is in it"
"$bin/shards" report "$data"

say "5/6 training"
"$bin/trainer" fit --data "$data" --config configs/train/quick.toml --run "$run" --resume

say "6/6 evaluating the best checkpoint on attempts that it has not seen"
"$bin/trainer" evaluate --data "$data" --run "$run" --checkpoint best

say "done in $((SECONDS - start)) s"
cat <<END
dataset     $data
            (open it in DuckDB, polars, pyarrow or datasets: docs/reading.md; its card: $data/README.md)
run         $run
            (loss.png, accuracy.png, tensorboard/, metrics.jsonl; checkpoints as safetensors)

next:
  $bin/shards inspect $data --scene 0
  $bin/generator --shards 64 --out paper                      the paper's 200,000 attempts
  $bin/trainer fit --data paper --config configs/train/paper.toml --run runs/paper
END
