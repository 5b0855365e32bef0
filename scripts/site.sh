#!/usr/bin/env bash
# Makes a site with navigation and search of the README, docs/, the reference and the other pages, and checks its links.
# Usage: scripts/site.sh [OUT_DIR]
#
# The default of OUT_DIR is dist/site; a site that is there is replaced. Look at it with
# `python3 -m http.server -d dist/site`: opened from disk, it has no search. The pages load nothing from other
# servers. The build fails if a link or an anchor leads nowhere, or if docs/zensical.toml does not name a page. Zensical
# is installed in a venv of its own, target/site-venv, which takes seconds. The reference is what the installed package
# says: scripts/reference.sh.
#
# Environment: PYTHON, default python3 (3.10 or later, with venv and the package); CARGO_TARGET_DIR as for cargo. Exit
# code: 0, or that of the failed step; 2 if the arguments are wrong or OUT_DIR holds something else.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
if (($# > 1)) || [[ ${1-} == -* ]]; then
    echo "usage: scripts/site.sh [OUT_DIR]" >&2
    exit 2
fi
out=${1:-dist/site}
if [[ -e $out && ! -e $out/search.json && -n $(ls -A "$out") ]]; then
    echo "$out holds something else than a site" >&2
    exit 2
fi

venv=${CARGO_TARGET_DIR:-target}/site-venv
requirements=scripts/requirements-site.txt
if ! cmp -s "$requirements" "$venv/requirements.txt"; then
    rm -rf "$venv"
    "${PYTHON:-python3}" -m venv "$venv"
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --requirement "$requirements"
    cp "$requirements" "$venv/requirements.txt"
fi
python=$(realpath --no-symlinks "$venv/bin/python")

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cp docs/zensical.toml "$scratch"
scripts/reference.sh "$scratch/pages/docs/reference"
# As tests/tests/tidy.rs holds the pages of the repository.
if grep -nE $'\t|[ \r]$' "$scratch"/pages/docs/reference/*.md; then
    echo "a tab, or blanks at the end" >&2
    exit 1
fi
"$python" scripts/site.py pages . "$scratch/pages"
# Not --strict: `check` finds more, and all at once.
(cd "$scratch" && NO_COLOR=1 "$python" -m zensical build)
"$python" scripts/site.py check "$scratch/pages" "$scratch/site"
mkdir -p "$(dirname "$out")"
rm -rf "$out"
mv "$scratch/site" "$out"
echo "$out/index.html"
