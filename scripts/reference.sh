#!/usr/bin/env bash
# Writes docs/reference/*.md anew from the programs' own words. Usage: scripts/reference.sh [FOLDER_OF_PROGRAMS]
#
# tests/python/test_reference.py fails when a page is not what its program says now. Exit code: 0, or that of the program that failed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
programs=${1-${CARGO_TARGET_DIR:-target}/debug}
mkdir -p docs/reference
for name in generator shards trainer planner experiments; do
    "$programs/$name" manual markdown >"docs/reference/$name.md"
done
