#!/usr/bin/env bash
# Regenerates docs/reference/{commands,settings,tables}.md with the program.
# Usage: scripts/reference.sh [FOLDER_OF_PROGRAM]
#
# tests/python/test_reference.py fails if a page is out of date. Exit code: 0, or that of the program.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
programs=${1-${CARGO_TARGET_DIR:-target}/debug}
mkdir -p docs/reference
for page in commands settings tables; do
    # Written when it is whole: without a program the old page stays.
    made=$("$programs/graspmill" manual markdown "$page" && echo .)
    printf '%s' "${made%.}" >"docs/reference/$page.md"
done
