"""A first dataset in five minutes: make it, check it, look at it.

    python first_dataset.py [FOLDER]
"""

import sys
from pathlib import Path

import graspmill

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "first-dataset")

# 6,000 attempts by the paper's rules, 60 in each scene. Run it again and it is there already; the bytes never differ.
dataset = graspmill.generate(folder / "grasps", attempts=6_000, shards=4, seed=1)
print(dataset)
assert dataset.verify() == []

# A scene: objects at rest, cameras, TSDF, attempts, and how each ended.
scene = dataset[7]
print(scene.scene, scene.outcomes)
first_held = int(scene.outcomes.held.argmax())
print("replay:", scene.replay(first_held).save(folder / "attempt.html"))
print("report:", dataset.page().save(folder / "report.html"))

# The rows are Parquet; any Arrow library takes them.
ratio = (dataset.attempt_count - dataset.positive_count) / dataset.positive_count
print(f"1 positive to {ratio:.2f} negatives")
