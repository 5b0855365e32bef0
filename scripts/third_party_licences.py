#!/usr/bin/env python3
"""Collects the licence texts of every crate that is linked into the programs; whoever distributes binaries must include them.

    python3 scripts/third_party_licences.py TARGET > THIRD-PARTY-LICENCES.txt

Reads cargo's list of the crates for that target (without tests and build scripts) and each crate's files in cargo's registry
folder. Equal texts appear once. Needs only Python. Exit code: 1 if a crate has neither a licence file nor a licence name.
"""

import hashlib
import json
import subprocess
import sys
from pathlib import Path

NAMES = ("licen", "copying", "notice", "copyright", "unlicense")


def linked(target: str) -> set[str]:
    """Names and versions of the crates that are linked into the programs."""
    command = ["cargo", "tree", "--workspace", "--edges", "normal", "--target", target, "--prefix", "none", "--format", "{p}"]
    lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    return {" ".join(line.split()[:2]) for line in lines if line}


def texts(folder: Path) -> list[str]:
    """The licence files of a crate."""
    files = sorted(path for path in folder.iterdir() if path.is_file() and path.name.lower().startswith(NAMES))
    return [path.read_text(errors="replace").strip() for path in files]


def main() -> int:
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    metadata = json.loads(subprocess.run(["cargo", "metadata", "--format-version", "1", "--locked"], check=True, capture_output=True).stdout)
    wanted, missing = linked(sys.argv[1]), []
    by_text: dict[str, tuple[str, list[str]]] = {}
    for package in sorted(metadata["packages"], key=lambda package: (package["name"], package["version"])):
        name = f"{package['name']} v{package['version']}"
        if package["source"] is None or name not in wanted:
            continue
        found = texts(Path(package["manifest_path"]).parent)
        if not found and not package["license"]:
            missing.append(name)
        for text in found or [f"(no text came with it; its manifest says {package['license']})"]:
            key = hashlib.sha256(" ".join(text.split()).encode()).hexdigest()
            by_text.setdefault(key, (text, []))[1].append(f"{name} ({package['license']})")
    for text, names in by_text.values():
        print("=" * 80, *names, "-" * 80, text, "", sep="\n")
    if missing:
        print("no licence: " + ", ".join(missing), file=sys.stderr)
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
