#!/usr/bin/env bash
# Packs a release: the program, licences (including linked crates), settings, networks, docs, man pages, completions.
# Usage: scripts/release.sh [OUT_DIR]
#
# Writes OUT_DIR/graspmill-VERSION-TARGET.tar.zst (.tar.gz without zstd), and OUT_DIR/SHA256SUMS of all archives there;
# the default of OUT_DIR is dist. The same commit and toolchain give the same bytes: names are sorted, the owner is 0,
# times are those of the commit. The programs are linked statically: against musl if rustup has that target and musl-gcc
# exists, else against glibc. (A static glibc needs the same version of glibc on the machine to resolve host names; for
# object stores use the musl build or build from source.)
#
# Environment: GRASPMILL_TARGET selects another target; GRASPMILL_PROGRAMS is a folder of built programs to pack;
# CARGO_TARGET_DIR as for cargo. Exit code: 0, or that of the failed step; 78 if the work tree differs from its commit.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
root=$PWD
out=$(mkdir -p "${1:-dist}" && cd "${1:-dist}" && pwd)
names=(generator trainer)
documents=(README.md CHANGELOG.md ARCHITECTURE.md CONTRIBUTING.md LICENSE-MIT LICENSE-APACHE)
folders=(configs models docs scripts)

say() { printf '\n%s\n' "$*" >&2; }
fail() {
    printf 'release: %s\n' "$2" >&2
    exit "$1"
}

# The packed files must be those of the commit, otherwise the version is wrong.
[[ -z $(git status --porcelain) ]] || fail 78 "the work tree differs from its commit: commit or stash first"
version=$(sed -n 's/^version = "\(.*\)"$/\1/p' Cargo.toml | head -n 1)
time=$(git log -1 --format=%ct)
host=$(rustc -vV | sed -n 's/^host: //p')

# The host's target with musl instead of glibc, if its toolchain is installed (ring, zstd and mimalloc are C).
linux_musl() {
    local musl=${host%-gnu}-musl
    command -v rustup >/dev/null && command -v musl-gcc >/dev/null &&
        rustup target list --installed | grep -qx "$musl" && printf '%s' "$musl"
}
target=${GRASPMILL_TARGET:-$(linux_musl || printf '%s' "$host")}
name=graspmill-$version-$target

if [[ -n ${GRASPMILL_PROGRAMS:-} ]]; then
    built=$(cd "$GRASPMILL_PROGRAMS" && pwd)
    say "1/4 packing the programs of $built"
else
    say "1/4 building $name"
    # --target, so that the flag is not for build scripts and procedural macros, which cannot be static; paths of this
    # machine are cut out of panic messages, so that another checkout gives the same bytes.
    flags="--remap-path-prefix=$root=graspmill --remap-path-prefix=${CARGO_HOME:-$HOME/.cargo}=cargo"
    # A static glibc hides getrandom(2) from the crate of that name, which then needs /dev/urandom, and an empty root
    # has none.
    flags="$flags --cfg getrandom_backend=\"linux_getrandom\""
    RUSTFLAGS="-C target-feature=+crt-static $flags" SOURCE_DATE_EPOCH=$time cargo build --locked --release \
        --target "$target" --package graspmill --bin graspmill
    built=$(cd "${CARGO_TARGET_DIR:-target}/$target/release" && pwd)
fi
[[ -x $built/graspmill ]] || fail 1 "no program: $built/graspmill"

stage=$(mktemp -d)
trap 'rm -rf "$stage"' EXIT
say "2/4 gathering"
folder=$stage/$name
mkdir -p "$folder"/{bin,share/man/man1,share/completions}
install -m 755 "$built/graspmill" "$folder/bin/graspmill"
# The same program under the names of parts.
for name_of_part in "${names[@]}"; do ln -s graspmill "$folder/bin/$name_of_part"; done
"$folder/bin/graspmill" manual man "$folder/share/man/man1"
for shell in bash zsh fish; do
    "$folder/bin/graspmill" manual completions "$shell" >"$folder/share/completions/graspmill.$shell"
done
# Only files in git.
git archive --format=tar HEAD -- "${documents[@]}" "${folders[@]}" | tar -xf - -C "$folder"
python3 scripts/third_party_licences.py "$target" >"$folder/THIRD-PARTY-LICENCES.txt"
chmod -R u=rwX,go=rX "$folder"

say "3/4 packing"
if command -v zstd >/dev/null; then
    archive=$name.tar.zst
    pack=(zstd -q -19 -T1)
    unpack=(zstd -q -d)
else
    archive=$name.tar.gz
    pack=(gzip -9 -n)
    unpack=(gzip -d)
fi
LC_ALL=C tar --sort=name --format=ustar --owner=0 --group=0 --numeric-owner --mtime="@$time" -cf - -C "$stage" "$name" |
    "${pack[@]}" >"$stage/$archive"

say "4/4 trying what was packed"
mkdir "$stage/tried"
"${unpack[@]}" <"$stage/$archive" | tar -xf - -C "$stage/tried"
static=yes
for program in graspmill "${names[@]}"; do
    tried=$stage/tried/$name/bin/$program
    told=$("$tried" --version)
    [[ $told == "graspmill $version" ]] || fail 1 "$program --version must say graspmill $version, got $told"
    # ldd ends with 1 for a static program.
    linked=$(ldd "$tried" 2>&1 | sed 's/^[[:space:]]*//' | paste -sd ';' || true)
    [[ $linked == "statically linked" || $linked == "not a dynamic executable" ]] || static=no
    printf '%-18s %5d kB  %s\n' "$told" "$(($(stat -L -c %s "$tried") / 1000))" "$linked"
done
# Static programs, as root, in a root folder that has nothing else in it.
cd "$stage/tried/$name"
run() {
    local program=$1
    shift
    if ((EUID == 0)) && [[ $static == yes ]]; then chroot . "/bin/$program" "$@"; else "bin/$program" "$@"; fi
}
run graspmill plan --demo --quiet --out plan.json
grep -q '"grasps"' plan.json
run graspmill generate --config configs/generate/demo.toml --attempts 60 --shards 1 --out tried
run graspmill dataset verify tried
cd "$root"
mv "$stage/$archive" "$out/$archive"
(cd "$out" && sha256sum -- graspmill-*.tar.* >"$stage/SHA256SUMS")
mv "$stage/SHA256SUMS" "$out/SHA256SUMS"
printf '%s: %s kB, SHA-256 %s\n' "$out/$archive" "$(($(stat -c %s "$out/$archive") / 1000))" \
    "$(sha256sum "$out/$archive" | cut -d ' ' -f 1)"
