#!/usr/bin/env bash
# Regenerates docs/reference/*.md with the programs. Usage: scripts/reference.sh [FOLDER_OF_PROGRAMS]
#
# tests/python/test_reference.py fails if a page is out of date. Exit code: 0, or that of the program that failed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
programs=${1-${CARGO_TARGET_DIR:-target}/debug}
mkdir -p docs/reference
for name in generator shards trainer planner experiments; do
    "$programs/$name" manual markdown >"docs/reference/$name.md"
done
