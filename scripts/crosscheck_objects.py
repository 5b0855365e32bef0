#!/usr/bin/env python3
"""Repeats labelled grasps of floating objects in another physics engine and compares the labels.

    python scripts/crosscheck_objects.py SET [--grasps N] [--engine pybullet|mujoco|all] [--gate same|own|both]

Reads only what `graspmill objects annotate` wrote: NAME.json and NAME.parquet. Leaves out grasps for which an object
was pushed aside.
"""

import sys

from crosscheck.objects_cli import main

if __name__ == "__main__":
    sys.exit(main())
