#!/usr/bin/env python3
"""Repeats the grasp attempts of a dataset or an experiment in another physics engine and compares the labels.

    python scripts/crosscheck.py DATASET|EXPERIMENT [--scenes N] [--engine pybullet|mujoco|all] [--report F.md] [--json F.json]

Reads only the shards and meta/info.json, or the tables and JSON files of the experiment. docs/label-parity.md has the
results.
"""

import sys

from crosscheck.cli import main

if __name__ == "__main__":
    sys.exit(main())
