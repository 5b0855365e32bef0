#!/usr/bin/env bash
# The whole pipeline on a small dataset: builds, generates a dataset in physics, verifies it, trains the grasp network
# on it, evaluates it on held-out attempts, and ends with pages to look at: scenes, a report, replays, a plan. Needs
# only a Rust toolchain and a C compiler.
# Usage: scripts/demo.sh [FOLDER]      (default: demo; running it again continues an interrupted run)
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

folder=${1:-demo}
data=$folder/grasps
run=$folder/runs/first

say() { printf '\n\033[1m%s\033[0m\n' "$*"; }

say "1/6 building (the first time takes some minutes)"
cargo build --release --workspace --bins
bin=${CARGO_TARGET_DIR:-target}/release
start=$SECONDS

say "2/6 generating 2,400 grasp attempts in 40 scenes"
"$bin/graspmill" generate --config configs/generate/demo.toml --out "$data"

say "3/6 verifying every byte and row"
"$bin/graspmill" dataset verify "$data"

say "4/6 training"
"$bin/graspmill" fit --data "$data" --config configs/train/quick.toml --run "$run" --resume

say "5/6 evaluating the best checkpoint on attempts that it has not seen"
"$bin/graspmill" evaluate --data "$data" --run "$run"

say "6/6 pages, and a plan by the built-in judge of images that come with it"
"$bin/graspmill" dataset browse "$data" --out "$folder/pages"
"$bin/graspmill" plan --demo --out "$folder/plan.json" --html "$folder/plan.html"

say "done in $((SECONDS - start)) s; open these"
cat <<END
scenes, report and replays    $folder/pages/index.html
a plan from depth images      $folder/plan.html
the training's numbers        $run/metrics.jsonl
the dataset's card            $data/README.md      (DuckDB, polars, pyarrow and datasets open it: docs/reading.md)

next: docs/tutorial.md; the paper's 200,000 attempts: $bin/graspmill generate --shards 64 --out data/grasps
END
