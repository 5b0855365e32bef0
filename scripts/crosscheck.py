#!/usr/bin/env python3
"""Repeats a dataset's grasp attempts in another physics engine and compares the labels.

    python scripts/crosscheck.py DATASET [--scenes N] [--engine pybullet|mujoco|all] [--report F.md] [--json F.json]

Reads only the shards and meta/info.json. docs/label-parity.md has the results.
"""

import sys

from crosscheck.cli import main

if __name__ == "__main__":
    sys.exit(main())
