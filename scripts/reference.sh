#!/usr/bin/env bash
# Writes the pages of the reference: commands.md, settings.md, tables.md and python.md.
# Usage: scripts/reference.sh [OUT_DIR]
#
# The default of OUT_DIR is target/reference. The pages say what the installed package says (`pip install '.[torch]'`),
# which has the program; without PyTorch graspmill.torch is left out. scripts/site.sh puts them into the site.
#
# Environment: PYTHON, default python3; CARGO_TARGET_DIR as for cargo. Exit code: 0, or that of the failed step.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
out=${1:-${CARGO_TARGET_DIR:-target}/reference}
python=${PYTHON:-python3}
mkdir -p "$out"
for page in commands settings tables; do
    "$python" -m graspmill manual markdown "$page" >"$out/$page.md"
done
"$python" scripts/python_reference.py >"$out/python.md"
