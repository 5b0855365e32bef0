"""Grasps as the code of VGN (Breyer et al. 2020) and GIGA (Jiang et al. 2021) trains on them.

- VGN: ``Dataset(Path("this folder"))`` reads ``grasps.csv`` and ``scenes/``. i, j, k and width are in voxels: positions
  divided by the voxel's side, which VGN rounds.
- GIGA: ``DatasetVoxel(Path("this folder"), Path("this folder/raw"))`` reads ``raw/grasps.csv`` and ``raw/setup.json``.
  x, y, z and width are in metres.
- qx, qy, qz, qw: workspace from grasp; the gripper approaches along its +z and closes along y. The grasp's origin lies
  midway between the roots of the fingers, in our own data between their tips.
- width: opening between the fingers at the end of the hold; where the object was not held, the gripper's largest opening.
- grid: (tsdf + 1) / 2 where observed and abs(tsdf) < 0.98, else 0; ``grid[0, x, y, z]``.

The attempts along one point's normal make one grasp, the middle of the widest run of yaws that held. Grasps whose origin
lies nearer than 20 mm to a face of the workspace are left out, as VGN's recipe does.
"""

import io
import zipfile
from pathlib import Path
from typing import Any, Callable

import numpy as np
from numpy.typing import NDArray

from ... import _arrays
from ...dataset import Dataset
from ...scene import OUTCOMES
from .._files import as_json, finish, joined, part, write as write_file

#: Voxels along a side in VGN's and GIGA's code.
RESOLUTION = 40
#: What is nearer to a face of the workspace is left out.
MARGIN_M = np.float32(0.02)
#: Scenes that are in memory at a time, of 250 KiB each.
TOGETHER = 256


def check(info: dict[str, Any]) -> None:
    _arrays.must((got := info["grid"]["resolution"]) == RESOLUTION, f"VGN's code takes grids of {RESOLUTION}^3 voxels, the dataset has {got}^3")
    _arrays.must((count := len(info.get("grippers", [info["gripper"]]))) == 1, f"VGN's format has one gripper, the dataset has {count}")


def write(dataset: Dataset, folder: Path, done: Callable[[int], None]) -> dict[str, int]:
    info, native = dataset.info, dataset._native
    grid, gripper = info["grid"], info["gripper"]
    size_m, opening_m, finger_m = np.array([grid["size_m"], gripper["opening_m_max"], gripper["finger_length_m"]], np.float32)
    voxel_m = np.float32(size_m / RESOLUTION)
    margin_m = max(MARGIN_M, voxel_m)
    counts = dict.fromkeys(("grasps", "positives", "left_out", "scenes"), 0)
    (folder / "raw").mkdir(exist_ok=True)
    tables = (folder / "grasps.csv", folder / "raw/grasps.csv")
    with open(part(tables[0]), "w") as voxels, open(part(tables[1]), "w") as metres:
        units = ((voxels, voxel_m, "i,j,k"), (metres, np.float32(1), "x,y,z"))
        for file, _, axes in units:
            file.write(f"scene_id,qx,qy,qz,qw,{axes},width,label\n")
        for shard in range(dataset.shard_count):
            first, end = native.scenes_of(shard)
            for start in range(first, end, TOGETHER):
                scenes = list(range(start, min(start + TOGETHER, end)))
                grids, poses, width_m, numbers = native.samples(shard, scenes, False, float(finger_m))
                inside = np.all((poses[:, :3] >= margin_m) & (poses[:, :3] <= np.float32(size_m - margin_m)), axis=1)
                counts["left_out"] += int((~inside).sum())
                poses, width_m, numbers = poses[inside], width_m[inside], numbers[inside]
                held = numbers[:, 2] == OUTCOMES.index("held")
                width_m = np.where(held & np.isfinite(width_m), width_m, opening_m)
                names = [f"scene-{scene:09}" for scene in scenes]
                for place, pose, width, label in zip(numbers[:, 0], poses, width_m, held):
                    for file, unit_m, _ in units:
                        file.write(f"{names[place]},{joined([*pose[3:], *np.append(pose[:3], width) / unit_m], ',')},{int(label)}\n")
                kept = np.unique(numbers[:, 0])
                for place in kept:
                    path = folder / f"scenes/{names[place]}.npz"
                    if not path.is_file():
                        write_file(path, _npz(grids.reshape(len(scenes), 1, RESOLUTION, RESOLUTION, RESOLUTION)[place]))
                for key, count in (("grasps", len(held)), ("positives", held.sum()), ("scenes", len(kept))):
                    counts[key] += int(count)
                done(len(scenes))
    for table in tables:
        finish(table)
    width_px, height_px, fx, fy, cx, cy = native.intrinsics()
    lens = {"width": int(width_px), "height": int(height_px), "K": np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1], np.float32)}
    setup = {"size": size_m, "intrinsic": lens, "max_opening_width": opening_m, "finger_depth": finger_m}
    write_file(folder / "raw/setup.json", as_json(setup) + "\n")
    return {**counts, "attempts": dataset.attempt_count, "scenes_left_out": dataset.scene_count - counts["scenes"]}


def _npz(grid: NDArray[np.float32]) -> bytes:
    """What ``numpy.savez_compressed`` writes, without a clock: the same bytes each time."""
    inside, whole = io.BytesIO(), io.BytesIO()
    np.save(inside, grid)
    with zipfile.ZipFile(whole, "w") as archive:
        archive.writestr(zipfile.ZipInfo("grid.npy"), inside.getvalue(), zipfile.ZIP_DEFLATED, 6)
    return whole.getvalue()
