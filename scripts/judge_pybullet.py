#!/usr/bin/env python3
"""Executes the grasps of an experiment again in PyBullet, and compares how they end.

    python scripts/judge_pybullet.py DIR [--rounds N] [--report F.md] [--json F.json]

DIR is the folder of `graspmill experiment run CONFIG --out DIR`. Reads only the tables and JSON files there; the report goes to stdout.
"""

import sys

from judge.cli import main

if __name__ == "__main__":
    sys.exit(main())
