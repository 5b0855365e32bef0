#!/usr/bin/env bash
# All checks that a change must pass. Usage: scripts/test.sh [--quick|--rust-only|--no-torch|--long]
#
# --quick: format, house rules, locks, subjects of the last commits, and that all compiles; under a minute where the
# programs are built. Needs a Rust toolchain with clippy and rustfmt, a C compiler (zstd), and python3 with venv unless
# --rust-only. Python packages are installed in .venv/, PyTorch among them (3 GB) unless --no-torch, which skips the
# tests that need it; scripts/site.sh, which is a step, has a venv of its own. --long: also the long versions of the
# Python tests, those marked `long`: ten times as many faults, attacks and hostile datasets, an hour more; the fuzz
# targets compile; the training step is compared with Burn's. As root on Debian or Ubuntu, Slurm, strace, faketime,
# Chromium, zsh and fish are installed, too; elsewhere the tests that need them are skipped with a message, and so is
# that of real captures where GRASPMILL_REAL names none (by default ../shared/real, if that exists). With
# GRASPMILL_NO_SKIPS=1 any other skipped test fails. Every step runs even if an earlier one failed, unless it depends
# on it. The table at the end lists the results and times. Exit code: 0 if all passed, 1 if a step failed, 2 if the
# arguments are wrong.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

rust_only=no
quick=no
without=
long=no marked='not long'
GRASPMILL_MISSING=
requirements=(scripts/requirements.txt scripts/requirements-golden.txt)
case "${1-}" in
    '') ;;
    --quick) quick=yes ;;
    --rust-only) rust_only=yes ;;
    --no-torch) requirements=(scripts/requirements.txt); without=torch ;;
    --long) long=yes marked='long or not long' ;;
    *) echo "usage: scripts/test.sh [--quick|--rust-only|--no-torch|--long]" >&2; exit 2 ;;
esac

if [[ -z ${GRASPMILL_REAL-} && -d ../shared/real ]]; then
    GRASPMILL_REAL=$(realpath ../shared/real)
    export GRASPMILL_REAL
fi

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
log="$scratch/log"
table="$scratch/table"
touch "$log" "$table"
failed=0
declare -A passed=() pids=()

# step NAME NEEDED_STEPS COMMAND...
step() {
    local name=$1 needs=$2 start=$SECONDS result=ok need
    shift 2
    for need in $needs; do
        if [[ -z "${passed[$need]-}" ]]; then
            printf '%-10s %-7s %5s\n' "$name" skipped - >>"$table"
            failed=1
            return
        fi
    done
    printf '\n==> %s: %s\n' "$name" "$*"
    if "$@" 2>&1 | tee -a "$log"; then
        passed[$name]=yes
    else
        result=FAILED
        failed=1
    fi
    printf '%-10s %-7s %4ds\n' "$name" "$result" $((SECONDS - start)) | tee -a "$table"
}

# beside NAME COMMAND...: starts a step that mostly waits for networks and disks, or for one long compilation; `joined`
# ends it. What it says is printed then.
beside() {
    local name=$1
    shift
    ( begun=$SECONDS; result=ok; "$@" || result=FAILED; echo "$result $((SECONDS - begun))" >"$scratch/$name.result" ) >"$scratch/$name.log" 2>&1 &
    pids[$name]=$!
}

# joined NAME...: waits for steps that run beside the others.
joined() {
    local name result seconds
    for name in "$@"; do
        wait "${pids[$name]}" || true
        read -r result seconds <"$scratch/$name.result" || { result=FAILED; seconds=0; }
        printf '\n==> %s\n' "$name"
        tee -a "$log" <"$scratch/$name.log"
        if [[ $result == ok ]]; then passed[$name]=yes; else failed=1; fi
        printf '%-10s %-7s %4ds\n' "$name" "$result" "$seconds" | tee -a "$table"
    done
}

# With the features of the tests, so that clippy's results for other crates are used.
docs() {
    RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --features python/as-tests
}

# The fuzz targets compile, with the versions of their own Cargo.lock; what they found is replayed by `cargo test`.
fuzz() {
    RUSTFLAGS="--cfg fuzzing" cargo check --locked --manifest-path fuzz/Cargo.toml --target-dir "${CARGO_TARGET_DIR:-target}/fuzz"
}

# Both lock files have what their Cargo.toml files ask for.
locks() {
    cargo metadata --locked --format-version 1 >/dev/null && cargo metadata --locked --format-version 1 --manifest-path fuzz/Cargo.toml >/dev/null
}

# Of commits that may still be amended; a subject on main is there for ever.
subjects() {
    git log --no-merges --max-count 20 --format=%s | awk 'length($0) > 72 { print "more than 72 characters: " $0; bad = 1 } END { exit bad }'
}

# Security advisories and yanked versions. `cargo test` checks licences and sources, which needs no network.
advisories() {
    if ! cargo deny --version 2>/dev/null; then
        echo "not checked, cargo-deny is not installed: cargo install cargo-deny --locked"
    elif ! cargo deny fetch; then
        echo "not checked, the advisory database cannot be fetched"
    else
        cargo deny check --disable-fetch advisories
    fi
}

prepared() {
    local result=0
    engines || result=1
    venv || result=1
    return $result
}

# The venv is made again when the requirements change, and kept otherwise.
venv() {
    local stamp=.venv/requirements.txt
    if ! python3 -c 'import ensurepip, venv' 2>/dev/null; then
        echo "python3 has no venv module; on Debian and Ubuntu: apt-get install python3-venv" >&2
        return 1
    fi
    if cat "${requirements[@]}" | cmp -s - "$stamp"; then
        return 0
    fi
    rm -rf .venv \
        && python3 -m venv .venv \
        && .venv/bin/python -m pip install --quiet --disable-pip-version-check "${requirements[@]/#/-r}" \
        && cat "${requirements[@]}" >"$stamp"
}

# Packages that are not installed: a Slurm to run on, what disturbs programs, a browser for the pages, shells.
packages() {
    local PATH="$PATH:/usr/sbin" package
    command -v slurmctld >/dev/null || echo slurm-wlm
    command -v munged >/dev/null || echo munge
    for package in strace faketime chromium zsh fish; do
        command -v "$package" >/dev/null || echo "$package"
    done
}

# Without the packages the tests that need them are skipped.
engines() {
    local missing
    mapfile -t missing < <(packages)
    if ((${#missing[@]} == 0)); then
        return 0
    fi
    if ((EUID != 0)) || ! command -v apt-get >/dev/null; then
        echo "not installed, and their tests are skipped: ${missing[*]} (that takes root on Debian or Ubuntu)"
        return 0
    fi
    export DEBIAN_FRONTEND=noninteractive
    local package
    apt-get update -qq >/dev/null || true
    for package in "${missing[@]}"; do # one by one: one that is missing does not keep the others away
        apt-get install -y -qq --no-install-recommends "$package" >/dev/null \
            || echo "could not be installed, and its tests are skipped: $package"
    done
}

# What this machine lacks, in the words of the tests' reasons. Only these may be skipped under GRASPMILL_NO_SKIPS.
lacking() {
    mkdir "$scratch/disk"
    packages
    { mount -t tmpfs tmpfs "$scratch/disk" && umount "$scratch/disk"; } 2>/dev/null || echo mount
    strace -qq -f -o /dev/null -e trace=getpid -e inject=getppid:retval=1 true 2>/dev/null || echo strace
    echo "$without"
    [[ -n ${GRASPMILL_REAL-} ]] || echo graspmill_real
}

dataset() {
    local generator="${CARGO_TARGET_DIR:-target}/debug/generator"
    "$generator" --config configs/generate/demo.toml --shards 2 --attempts 600 --out "$scratch/dataset" \
        && "$generator" repeat "$scratch/dataset" \
        && "$generator" --config scripts/crosscheck/coulomb.toml --out "$scratch/coulomb"
}

# The Python package as users install it, in the profile and with the features of the tests; scripts/wheel.sh builds the
# one to give away.
wheel() {
    .venv/bin/python -m maturin build --quiet --locked --profile dev --features as-tests --auditwheel skip --out "$scratch/wheels" \
        && .venv/bin/python -m pip install --quiet --disable-pip-version-check --force-reinstall --no-deps "$scratch"/wheels/*.whl
}

# Three tests at a time, mostly in the order of the files, so that what a file sets up is made once or twice: half of
# the time goes to waiting for servers, schedulers and time limits.
readers() {
    GRASPMILL_DATASET="$scratch/dataset" GRASPMILL_COULOMB="$scratch/coulomb" \
        GRASPMILL_PROGRAMS="${CARGO_TARGET_DIR:-target}/debug" .venv/bin/python -m pytest -n 3 --dist worksteal --durations 15 -rs \
        -p no:cacheprovider -m "$marked" tests/python
}

if [[ $quick == yes ]]; then
    step fmt '' cargo fmt --all --check
    step locks '' locks
    step house '' cargo test --quiet --package workspace-tests
    step subjects '' subjects
    step build '' cargo build --quiet --workspace --bins --tests # as below, so that nothing is built twice
else
    [[ $rust_only == yes ]] || beside venv prepared
    step fmt '' cargo fmt --all --check
    # One profile, one set of features: the programs and the tests are built by one command, and `cargo test` finds
    # them. (`cargo run -p generator` alone would select other features of shared dependencies and build them again.)
    step build '' cargo build --workspace --bins --tests
    [[ $rust_only == yes ]] || joined venv
    GRASPMILL_MISSING=$(lacking)
    export GRASPMILL_MISSING
    [[ $long == no ]] || beside fuzz fuzz # a third of the tests' time goes to waiting
    step test build cargo test --workspace --no-fail-fast
    if [[ $long == yes ]]; then
        joined fuzz
        step burn build cargo test --package trainer --features flex
    fi
    step clippy '' cargo clippy --workspace --all-targets -- -D warnings
    step advisories '' advisories
    if [[ $rust_only == yes ]]; then
        step docs '' docs
    else
        step dataset build dataset
        step wheel 'build venv' wheel
        beside site env PYTHON=.venv/bin/python scripts/site.sh "$scratch/site"
        beside docs docs
        step readers 'venv dataset wheel' readers
        joined site docs
    fi
fi

# Rust: "test result: ok. 5 passed; 1 failed; ..."; pytest: "3 passed, 1 failed in 2.10s" in any order.
count() {
    grep -aE '^test result: |^=* ?[0-9]+ (passed|failed|error|skipped|deselected|xfailed|xpassed|warning).* in [0-9.]+s' "$log" \
        | grep -aoE "[0-9]+ ($1)" | awk '{ sum += $1 } END { print sum + 0 }'
}

printf '\nstep       result   time\n'
cat "$table"
[[ -z ${GRASPMILL_MISSING//[[:space:]]/} ]] || printf 'not tested, for lack of: %s\n' "${GRASPMILL_MISSING//$'\n'/ }"
printf '%d passed, %d failed in %ds\n' "$(count passed)" "$(count 'failed|errors?')" "$SECONDS"
exit "$failed"
