#!/usr/bin/env bash
# Builds the Python package: a wheel for every Python from 3.10 on, and the source distribution.
# Usage: scripts/wheel.sh [OUT_DIR]
#
# Writes OUT_DIR/graspmill-VERSION-cp310-abi3-manylinux_2_28_ARCH.whl and OUT_DIR/graspmill-VERSION.tar.gz; the default
# of OUT_DIR is dist. Needs Rust and Python with `pip install maturin ziglang`. Zig links against the symbols of glibc
# 2.28, whatever this machine has, and maturin's audit refuses a wheel that needs others. The same commit, toolchain and
# maturin give the same bytes: times are those of the commit, and paths of this machine are cut out of messages.
#
# Environment: PYTHON, default python3; GRASPMILL_TARGET selects another target that the toolchain has; CARGO_TARGET_DIR
# as for cargo. Exit code: 0, or that of the failed step.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
out=${1:-dist}
python=${PYTHON:-python3}
target=${GRASPMILL_TARGET:-$(rustc -vV | sed -n 's/^host: //p')}
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct)
export SOURCE_DATE_EPOCH
export RUSTFLAGS="--remap-path-prefix=$PWD=graspmill --remap-path-prefix=${CARGO_HOME:-$HOME/.cargo}=cargo"
# The licences of what is linked; the file is there only while the package is built.
licences=python/graspmill/THIRD-PARTY-LICENCES.txt
trap 'rm -f "$licences"' EXIT
"$python" scripts/third_party_licences.py "$target" >"$licences"
"$python" -m maturin build --release --zig --target "$target" --compatibility manylinux_2_28 --out "$out"
"$python" -m maturin sdist --out "$out"
