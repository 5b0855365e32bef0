#!/usr/bin/env python3
"""Writes the golden files for comparing planning with published implementations: scipy, scikit-learn and numpy.

    python3 -m venv venv && venv/bin/pip install -r scripts/requirements-golden.txt
    venv/bin/python lab/golden_planning.py            # writes planner/tests/golden and perception/tests/golden
    venv/bin/python lab/golden_planning.py --check    # writes nothing; exit 1 unless the files are equal

Made with numpy, scipy and scikit-learn as pinned in requirements-golden.txt, on x86-64; a few seconds. PyTorch is not needed.

  planner/tests/golden/detect-*.bin, detections.json
      quality, TSDF and width volumes with the detections of VGN's published procedure (detection.py: `process`, then `select`;
      reimplemented here with scipy.ndimage).
  perception/tests/golden/clusters-*.bin, planes-*.bin, perception.json
      point sets with the labels of sklearn.cluster.DBSCAN; tables with outliers, and the planes that numpy's SVD fits.

Layouts are in the README.md beside the files. All inputs come from `noise`, an integer hash, and arithmetic that every machine
rounds equally. They are stored as small integers, so both sides read the same float32 values.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
import scipy
import sklearn
from golden_formula import noise
from scipy import ndimage
from scipy.spatial import cKDTree
from sklearn.cluster import DBSCAN

ROOT = Path(__file__).resolve().parent.parent
PLANNER = Path("planner/tests/golden")
PERCEPTION = Path("perception/tests/golden")

SIDE = 40
I, J, K = np.meshgrid(*[np.arange(SIDE)] * 3, indexing="ij")

SIGMA = 1.0
THRESHOLD = 0.9
WIDTHS = (1.33, 9.33)
MAXIMUM_SIZE = 4
PROBES = 200

# (eps in metres, min_samples: the point itself counts). The same eps in units of 0.1 mm: 200 and 75.
DENSITIES = [(0.02, 100), (0.0075, 8)]
UNIT = 1e-4
CLEARANCE = 1e-7
INLIER = 0.01


# --- detection --------------------------------------------------------------------------------------------------------


def process(quality, tsdf, width):
    """VGN's `process`: returns the smoothed volume, the mask near the surface, and quality after each of the two rejections."""
    # On float32 input scipy correlates along axis 0, then 1, then 2; each pass sums in double (the centre first, then
    # pairs from the outermost inwards) and rounds its result to float32. NumPy 2 compares float32 with 0.9 rounded to
    # float32.
    smooth = ndimage.gaussian_filter(quality, sigma=SIGMA, mode="nearest", truncate=4.0)
    assert smooth.dtype == np.float32
    inside = (tsdf > 1e-3) & (tsdf < 0.5)
    near = ndimage.binary_dilation(tsdf > 0.5, iterations=2, mask=~inside)
    good = np.where(near & ~(smooth < THRESHOLD), smooth, np.float32(0))
    fits = ~((width < WIDTHS[0]) | (width > WIDTHS[1]))
    return smooth, near, good, np.where(fits, good, np.float32(0))


def select(quality):
    """VGN's `select`: voxels that are not 0 and equal the maximum of their window. Of an even window of 4, scipy places 2 voxels
    before and 1 after; its default border is `reflect` (d c b a | a b c d)."""
    peak = quality == ndimage.maximum_filter(quality, size=MAXIMUM_SIZE)
    return np.argwhere(peak & (quality != 0))


def cells(values, cell, seed):
    """One of `values` for each cube of `cell` voxels, drawn by hash."""
    number = -(-SIDE // cell)
    drawn = np.asarray(values)[(noise(number**3, seed) * len(values)).astype(int)].reshape([number] * 3)
    return drawn[I // cell, J // cell, K // cell]


def each(values, seed):
    return cells(values, 1, seed)


def bump(centre, radius, gain=1.0):
    """A paraboloid of height `gain`, cut at 1: with a gain over 1 its top is flat."""
    square = (I - centre[0]) ** 2 + (J - centre[1]) ** 2 + (K - centre[2]) ** 2
    return np.clip(gain * (1.0 - square / radius**2), 0.0, 1.0)


def boxes_tsdf():
    """Boxes on a table that fills k < 6, truncated at 4 voxels; deeper than that, and in a shadow behind a box, 0: unseen."""
    distance = K - 5.5
    for low, high in BOXES:
        beyond = [np.maximum(a - at, at - b) for at, a, b in zip((I, J, K), low, high)]
        distance = np.minimum(distance, np.maximum(np.maximum(*beyond[:2]), beyond[2]))
    seen = (distance > -4.0) & ~((I > 33) & (J > 12) & (J < 24) & (K < 14))
    return np.where(seen, np.clip((distance / 4.0 + 1.0) / 2.0, 0.0, 1.0), 0.0)


BOXES = [((5.5, 4.5, 5.5), (14.5, 12.5, 17.5)), ((20.5, 10.5, 5.5), (33.5, 25.5, 12.5)), ((6.5, 26.5, 5.5), (13.5, 35.5, 26.5))]


def byte(field, divisor=255):
    return np.floor(field * divisor + 0.5).astype(np.uint8)


def volume_boxes():
    """Blobs near boxes: round ones, flat ones, equal ones 3, 4 and 5 voxels apart, some in the solid, some of a wrong width."""
    bumps = [
        bump((10, 8, 18), 7, 1.1), bump((10, 8, 10), 8, 2.0), bump((27, 18, 13), 9, 1.6), bump((10, 30, 27), 6, 1.4),
        bump((10, 30, 15), 9, 3.0), bump((36, 18, 9), 8, 2.0), bump((30, 4, 7), 7, 1.5), bump((37, 37, 30), 6, 2.5),
        bump((20, 4, 30), 5, 2.0), bump((23, 4, 30), 5, 2.0), bump((20, 14, 32), 4, 4.0), bump((24, 14, 32), 4, 4.0),
        bump((20, 24, 34), 4, 8.0), bump((25, 24, 34), 4, 8.0), bump((3, 18, 30), 6, 0.95), bump((18, 36, 6), 7, 1.3),
    ]
    plateau = ((I > 26) & (I < 37) & (J > 28) & (J < 38) & (K > 14) & (K < 24)) * 1.0
    width = np.where(I < 30, 60 + 2 * I, 250 - 2 * (K + J))
    width = np.where((I == 11) | (J == 17), 26, width)
    return byte(np.maximum.reduce(bumps + [plateau])), byte(boxes_tsdf()), width.astype(np.uint8), 255, 0.05


def volume_edges():
    """Blobs on every face, edge and corner of the volume, and one voxel away from them; half of them flat."""
    places = [(a, b, c) for a in (0, 20, 39) for b in (0, 20, 39) for c in (0, 20, 39)]
    places += [(1, 10, 38), (38, 10, 1), (10, 38, 38), (1, 1, 10), (10, 1, 30), (38, 38, 29), (30, 38, 2)]
    bumps = [bump(place, 5 + number % 3, 1.1 + number % 4) for number, place in enumerate(places)]
    ball = 0.5 + ((I - 26) ** 2 + (J - 12) ** 2 + (K - 20) ** 2 - 49.5) / 200.0
    width = 27 + 4 * J + (noise(SIDE**3, 11) * 5).astype(int).reshape(I.shape)
    return byte(np.maximum.reduce(bumps)), byte(np.clip(ball, 0.0, 1.0)), np.minimum(width, 255).astype(np.uint8), 255, 0.05


def volume_limits():
    """Values on the limits themselves: quality 0.9 = 225/250 on wide plateaus, TSDF 0.5 = 125/250, width 1.33 = 1 x 1.33."""
    return (
        cells([60, 60, 224, 225, 225, 226], 11, 25).astype(np.uint8),
        cells([0, 124, 124, 125, 125, 126], 3, 22).astype(np.uint8),
        each([0, 0, 0, 0, 0, 1, 1, 2, 7, 8, 8, 8, 8, 8], 23).astype(np.uint8),
        250,
        1.33,
    )


def volume_blocks():
    """Noise in blocks. The TSDF is noise too, so that dilation has to find its way around; width 9.33 = 1 x 9.33 is on the limit."""
    quality = cells([250, 255, 255, 245, 60, 255], 6, 31) - each(range(12), 32)
    tsdf, width = each([0, 0, 0, 0, 60, 60, 60, 127, 128], 33), each([1] * 9 + [0, 2], 34)
    return quality.astype(np.uint8), tsdf.astype(np.uint8), width.astype(np.uint8), 255, 9.33


def volume_none():
    """No detections: good voxels are in the solid or have a wrong width; reachable voxels are below the threshold."""
    solid = np.maximum(bump((27, 18, 2), 9, 3.0), bump((36, 18, 3), 8, 3.0))
    reached = np.maximum(bump((10, 8, 20), 8, 3.0), bump((25, 5, 30), 9, 3.0)) * 0.89
    thin, fat = bump((10, 31, 29), 6, 3.0), bump((39, 39, 39), 7, 3.0)
    width = np.where(fat > 0.0, 200, np.where(thin > 0.0, 20, 100))
    tsdf = np.where(solid > 0.0, 0.3, boxes_tsdf())
    return byte(np.maximum.reduce([solid, reached, thin, fat])), byte(tsdf), width.astype(np.uint8), 255, 0.05


def volume_hundreds():
    """Noise around 0.92: hundreds of maxima."""
    return (215 + each(range(41), 51)).astype(np.uint8), byte(boxes_tsdf()), each(range(20, 192), 52).astype(np.uint8), 255, 0.05


def decimal(value):
    """The shortest decimal that names this float32, also if read as a double with an error in its last place first."""
    text = str(np.float32(value))
    for double in (float(text), np.nextafter(float(text), 0.0), np.nextafter(float(text), 2.0)):
        assert np.float32(double) == np.float32(value), text
    return text


def fnv1a(data):
    """64-bit FNV-1a, in hexadecimal."""
    state = 0xCBF29CE484222325
    for octet in data:
        state = (state ^ octet) * 0x100000001B3 & 0xFFFFFFFFFFFFFFFF
    return f"{state:016x}"


def rows(lists):
    return "[" + ",".join("\n    [" + ",".join(row) + "]" for row in lists) + "]"


def detections():
    files, entries = {}, []
    for make in (volume_boxes, volume_edges, volume_limits, volume_blocks, volume_none, volume_hundreds):
        name = make.__name__.removeprefix("volume_")
        *volumes, divisor, width_step = make()
        assert all(volume.dtype == np.uint8 and volume.shape == (SIDE,) * 3 for volume in volumes)
        quality, tsdf = (volume.astype(np.float32) / np.float32(divisor) for volume in volumes[:2])
        width = volumes[2].astype(np.float32) * np.float32(width_step)
        assert quality.dtype == tsdf.dtype == width.dtype == np.float32
        smooth, near, good, fit = process(quality, tsdf, width)
        found = select(fit)
        at = np.unique(np.concatenate([[0, SIDE - 1, SIDE**3 - 1], (noise(PROBES, 61) * SIDE**3).astype(int)]))
        fields = {
            "name": json.dumps(name),
            "file": json.dumps(f"detect-{name}.bin"),
            "about": json.dumps(" ".join(make.__doc__.split())),
            "divisor": str(divisor),
            "width_step": str(width_step),
            "near_surface": str(np.count_nonzero(near)),
            "at_threshold": str(np.count_nonzero(good)),
            "width_fits": str(np.count_nonzero(fit)),
            "smooth_fnv1a": json.dumps(fnv1a(smooth.astype("<f4").tobytes())),
            "near_surface_fnv1a": json.dumps(fnv1a(near.astype(np.uint8).tobytes())),
            "smooth_probes": rows([str(index), decimal(smooth.flat[index])] for index in at),
            "detections": rows([*map(str, voxel), decimal(fit[tuple(voxel)])] for voxel in found),
        }
        entries.append("  {\n" + ",\n".join(f'   "{key}": {value}' for key, value in fields.items()) + "}")
        files[PLANNER / f"detect-{name}.bin"] = b"".join(volume.tobytes() for volume in volumes)
        print(f"{name}: near {fields['near_surface']}, good {fields['at_threshold']}, fit {fields['width_fits']}, found {len(found)}")
    files[PLANNER / "detections.json"] = document({"made_with": made_with(), "volumes": "[\n" + ",\n".join(entries) + "\n ]"})
    return files


# --- clusters ---------------------------------------------------------------------------------------------------------


def uniform(shape, seed):
    """Numbers in [-1, 1)."""
    return 2.0 * noise(int(np.prod(shape)), seed).reshape(shape) - 1.0


def shuffled(points, seed):
    return points[np.argsort(noise(len(points), seed), kind="stable")]


def sheet(corner, along, across, seed, pitch=2.5):
    """A lattice of points, jittered by up to 0.4 mm, on a rectangle with its sides on two axes; millimetres."""
    (axis, length), (other, breadth) = along, across
    steps = np.stack(np.meshgrid(np.arange(0.0, length + 0.01, pitch), np.arange(0.0, breadth + 0.01, pitch), indexing="ij"), -1)
    points = np.zeros((steps.shape[0] * steps.shape[1], 3))
    points[:, [axis, other]] = steps.reshape(-1, 2)
    return points + np.asarray(corner, float) + 0.4 * uniform(points.shape, seed)


def box(x, y, size, seed):
    """What a camera sees of a box: its top and the two faces of least x and y."""
    a, b, c = size
    return np.concatenate([
        sheet((x, y, c), (0, a), (1, b), seed),
        sheet((x, y, 0), (0, a), (2, c - 2.5), seed + 1),
        sheet((x, y + 2.5, 0), (1, b - 2.5), (2, c - 2.5), seed + 2),
    ])


def disc(x, y, radius, seed):
    points = sheet((x - radius, y - radius, 0), (0, 2 * radius), (1, 2 * radius), seed)
    return points[(points[:, 0] - x) ** 2 + (points[:, 1] - y) ** 2 <= radius**2]


def round_surface(centre, radius, height, count, seed):
    """A sphere's upper half or, with a height, a cylinder's side; points thrown at random."""
    points = uniform((4 * count, 3), seed)
    flat = 2 if height else 3
    length = np.sqrt((points[:, :flat] ** 2).sum(1))
    points = points[(length > 0.1) & (length < 1.0)][:count]
    points[:, :flat] *= radius / np.sqrt((points[:, :flat] ** 2).sum(1, keepdims=True))
    points[:, 2] = height * (points[:, 2] + 1.0) / 2.0 if height else np.abs(points[:, 2])
    return points + np.asarray(centre, float)


def cloud_boxes():
    """Boxes touching, and 18, 19.5, 20.5 and 22 mm apart; one too small to be dense; single points."""
    return np.concatenate([
        box(-120, -80, (45, 45, 45), 101), box(-57, -80, (40, 40, 30), 111), box(2.5, -80, (35, 45, 40), 121),
        box(58, -80, (30, 30, 50), 131), box(110, -80, (20, 60, 25), 141), box(-120, -15.5, (30, 40, 35), 151),
        box(-90, -15.5, (25, 30, 20), 161), box(0, 10, (15, 15, 15), 171), box(50, 20, (7.5, 7.5, 7.5), 181),
        box(-40, 30, (40, 30, 10), 191), uniform((60, 3), 199) * (160, 120, 30) + (0, 40, 80),
    ])


def cloud_bridge():
    """Two pairs of discs with a few points between, within reach of both discs: border points of two clusters. The points come first."""
    wide = np.stack([np.arange(-1.0, 2.0), 3.0 * np.arange(-1.0, 2.0), np.zeros(3)], -1)
    narrow = np.array([[-0.3, 60, 0], [0.2, 66, 0], [0.1, 60, 5]])
    discs = [disc(44, 0, 30, 201), disc(-44, 0, 30, 202), disc(-13, 60, 8, 203), disc(13, 60, 8, 204)]
    return np.concatenate([wide, narrow, *discs, disc(0, -70, 12, 205), disc(0, -110, 15, 206)])


def cloud_duplicates():
    """Points on top of each other: 100, 99, 8 and 7 of them; again 100 and 8 with hangers-on within eps and beyond; others alone."""
    piles = [((0, 0, 0), 100), ((100, 0, 0), 99), ((0, 100, 0), 8), ((0, 0, 100), 7), ((0, 0, -100), 100), ((0, -100, 0), 8)]
    points = [np.tile(np.asarray(place, float), (count, 1)) for place, count in piles]
    points.append(np.array([[19.9, 0, -100], [0, -20.1, -100], [0, 7.4, -100], [0, 0, -107.6], [0, -92.6, 0], [0, -100, 7.6]]))
    points.append(uniform((80, 3), 301) * 30 + (-150, 0, 0))
    return shuffled(np.concatenate(points), 302)


def cloud_round():
    """Cylinders, a ball and clutter, in shuffled order."""
    return shuffled(np.concatenate([
        round_surface((0, 0, 0), 20, 50, 1000, 401), round_surface((58, 0, 0), 20, 40, 800, 411),
        round_surface((0, 66, 0), 25, 0, 700, 421), round_surface((70, 70, 0), 12, 0, 150, 431),
        uniform((250, 3), 441) * 110 + (30, 30, 20),
    ]), 451)


def metres(units):
    return units.astype(np.float32) * np.float32(UNIT)


def off_the_limit(points):
    """Rounds millimetres to units of 0.1 mm, and moves points by one unit until no two are at a distance of exactly eps: the next
    possible distances are more than `CLEARANCE` away, so float32 and double cannot disagree on who is a neighbour."""
    units = np.floor(points * 10.0 + 0.5).astype(np.int64)
    for turn in range(100):
        late = [b for eps, _ in DENSITIES for b in at_distance(units, round(eps / UNIT))]
        if not late:
            break
        for point in sorted(set(late)):
            units[point, (turn + point) % 3] += 1
    assert not late and np.abs(units).max() < 2**15
    exact = metres(units).astype(np.float64)
    for eps, _ in DENSITIES:
        outer = cKDTree(exact).query_pairs(eps + 1e-5, output_type="ndarray")
        length = np.sqrt(((exact[outer[:, 0]] - exact[outer[:, 1]]) ** 2).sum(1))
        assert np.abs(length - eps).min() > CLEARANCE
    return units.astype("<i2")


def at_distance(units, eps):
    """The later of each pair of points that are `eps` apart."""
    pairs = cKDTree(units).query_pairs(eps + 0.5, output_type="ndarray")
    square = ((units[pairs[:, 0]] - units[pairs[:, 1]]) ** 2).sum(1)
    return pairs[square == eps**2].max(1).tolist()


def labelled(points, eps, min_samples):
    """sklearn's labels: -1 is noise; clusters are numbered by their first core point; a border point that two clusters reach goes
    to the lower number. `contested` counts those."""
    found = DBSCAN(eps=eps, min_samples=min_samples, algorithm="brute").fit(points)
    labels, core = found.labels_, np.zeros(len(points), bool)
    core[found.core_sample_indices_] = True
    around = cKDTree(points).query_ball_point(points, eps)
    contested = sum(not core[at] and len({labels[other] for other in near if core[other]}) > 1 for at, near in enumerate(around))
    summary = {
        "eps_m": eps,
        "min_points": min_samples,
        "clusters": int(labels.max()) + 1,
        "noise": int((labels == -1).sum()),
        "core": int(core.sum()),
        "border": int(((labels != -1) & ~core).sum()),
        "contested": int(contested),
    }
    return labels.astype("<i2"), summary


def clusters():
    files, entries = {}, []
    for make in (cloud_boxes, cloud_bridge, cloud_duplicates, cloud_round):
        name = make.__name__.removeprefix("cloud_")
        units = off_the_limit(make())
        results = [labelled(metres(units).astype(np.float64), *density) for density in DENSITIES]
        file = f"clusters-{name}.bin"
        files[PERCEPTION / file] = units.tobytes() + b"".join(labels.tobytes() for labels, _ in results)
        about, summaries = " ".join(make.__doc__.split()), [summary for _, summary in results]
        entries.append({"name": name, "file": file, "about": about, "points": len(units), "results": summaries})
        print(f"{name}: {len(units)} points", *[list(summary.values()) for _, summary in results])
    for number in range(len(DENSITIES)):
        assert any(entry["results"][number]["contested"] for entry in entries)
    return files, entries


# --- planes -----------------------------------------------------------------------------------------------------------

# name, true normal (towards the objects), normal . p = offset in metres, points of the plane, of objects, of a wall
PLANES = [
    ("level", (0.0, 0.0, 1.0), 0.05, 3000, 1500, 0),
    ("camera", (2 / 7, -3 / 7, -6 / 7), -0.55, 2000, 900, 400),
    ("crowded", (0.6, 0.0, 0.8), 0.0, 500, 450, 250),
]


def normal_deviates(count, seed):
    """Twelve uniform numbers less six: near enough to Gaussian, and the same on every machine."""
    return noise(12 * count, seed).reshape(count, 12).sum(1) - 6.0


def table(normal, offset, flat, objects, wall, seed):
    """A table with 2 mm of noise; objects 12 to 120 mm above it, the lowest parts of their sides, a few ghosts below, a wall."""
    normal = np.asarray(normal)
    u = np.cross(normal, (0.0, 1.0, 0.0))
    u /= np.sqrt((u**2).sum())
    v = np.cross(normal, u)
    ghosts = flat // 50
    side = np.concatenate([
        uniform((flat, 2), seed) * 0.2, uniform((objects, 2), seed + 1) * 0.08 + 0.03, uniform((ghosts, 2), seed + 2) * 0.2,
    ])
    height = np.concatenate([
        0.002 * normal_deviates(flat, seed + 3), 0.012 + 0.108 * noise(objects, seed + 4), -0.012 - 0.05 * noise(ghosts, seed + 5),
    ])
    height[flat : flat + objects // 40] *= 0.06  # sides, down to the table: outliers that no threshold sees
    upright = np.stack([np.full(wall, 0.15), 0.2 * uniform(wall, seed + 6), 0.012 + 0.2 * noise(wall, seed + 7)], -1)
    local = np.concatenate([np.concatenate([side, height[:, None]], 1), upright])
    return shuffled(local @ np.stack([u, v, normal]) + offset * normal, seed + 8)


def refit(points, normal, offset):
    """Inliers within 10 mm, least squares through them (SVD), and again until the inliers stay the same."""
    before = None
    for _ in range(50):
        inliers = np.abs(points @ normal - offset) <= INLIER
        if before is not None and (inliers == before).all():
            return normal, offset, inliers
        centre = points[inliers].mean(0)
        fitted = np.linalg.svd(points[inliers] - centre, full_matrices=False)[2][2]
        normal = fitted if fitted @ normal > 0.0 else -fitted
        offset, before = centre @ normal, inliers
    raise AssertionError("refitting found no fixed point")


def planes():
    files, entries = {}, []
    for number, (name, true_normal, true_offset, *counts) in enumerate(PLANES):
        units = np.floor(table(true_normal, true_offset, *counts, 500 + 10 * number) / UNIT + 0.5)
        assert np.abs(units).max() < 2**15
        units = units.astype("<i2")
        points = metres(units).astype(np.float64)
        normal, offset, inliers = refit(points, np.asarray(true_normal), true_offset)
        distance = np.abs(points @ normal - offset)
        assert np.abs(distance - INLIER).min() > 1e-6
        # the answer must not depend on where the search began
        for tilt, shift in zip(uniform((50, 3), 600), uniform(50, 601)):
            start = normal + 0.015 * tilt
            start /= np.sqrt((start**2).sum())
            again = refit(points, start, start @ points[inliers].mean(0) + 0.003 * shift)
            assert (again[2] == inliers).all(), (name, again[2].sum(), inliers.sum())
        file = f"planes-{name}.bin"
        files[PERCEPTION / file] = units.tobytes()
        # twelve decimals: beyond them linear algebra libraries differ
        entries.append({
            "name": name,
            "file": file,
            "points": len(units),
            "true_normal": [round(float(c), 12) for c in true_normal],
            "true_offset_m": true_offset,
            "inlier_distance_m": INLIER,
            "normal": [round(float(c), 12) + 0.0 for c in normal],
            "offset_m": round(float(offset), 12),
            "inliers": int(inliers.sum()),
            "inlier_rms_m": round(float(np.sqrt((distance[inliers] ** 2).mean())), 12),
        })
        print(f"{name}: {len(units)} points, {inliers.sum()} inliers, nearest to the limit {np.abs(distance - INLIER).min():.1e} m")
    return files, entries


# --- files ------------------------------------------------------------------------------------------------------------


def made_with():
    versions = {"numpy": np.__version__, "scipy": scipy.__version__, "scikit-learn": sklearn.__version__}
    return json.dumps({"script": "lab/golden_planning.py", **versions})


def document(fields):
    text = "{\n" + ",\n".join(f' "{key}": {value}' for key, value in fields.items()) + "\n}\n"
    json.loads(text)
    return text.encode()


def lines(entries):
    return "[\n" + ",\n".join("  " + json.dumps(entry) for entry in entries) + "\n ]"


def golden():
    files = detections()
    cluster_files, cluster_entries = clusters()
    plane_files, plane_entries = planes()
    fields = {"made_with": made_with(), "unit_m": json.dumps(UNIT), "clusters": lines(cluster_entries), "planes": lines(plane_entries)}
    return {**files, **cluster_files, **plane_files, PERCEPTION / "perception.json": document(fields)}


def main():
    parser = argparse.ArgumentParser(description="Golden files for planning, by published implementations.")
    parser.add_argument("--check", action="store_true", help="compare with the committed files instead of writing them")
    check = parser.parse_args().check
    files = golden()
    present = [path for folder in (PLANNER, PERCEPTION) for path in (ROOT / folder).glob("*.*") if path.suffix in (".bin", ".json")]
    there = {path.relative_to(ROOT) for path in present}
    wrong = [f"{path}: nothing makes it" for path in sorted(there - files.keys())]
    for path, data in files.items():
        if check:
            if path not in there:
                wrong.append(f"{path}: missing")
            elif (ROOT / path).read_bytes() != data:
                wrong.append(f"{path}: differs")
        else:
            (ROOT / path).parent.mkdir(parents=True, exist_ok=True)
            (ROOT / path).write_bytes(data)
    print(f"{len(files)} files, {sum(map(len, files.values()))} bytes", "checked" if check else "written")
    for line in wrong:
        print(line, file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
