#!/usr/bin/env python3
"""What depth images of real or simulated sensors have of noise, holes and edges.

    python scripts/sensor_statistics.py FOLDER [--json OUT.json]

FOLDER has captures.json, a list of {name, sensor, fx_fy_cx_cy, table_normal, table_offset_m}, and for each name
NAME-depth.png (16 bit, 0.1 mm, 0 = not seen) and, where there are, NAME-label.png (1 table, 2 and more objects) and
NAME-color.jpg. A plane of 1/z is linear in the image, and the error of triangulation is the same everywhere in 1/z, so
what can be is measured in 1/z. Needs numpy and Pillow.

    noise     of blocks of 32 x 32 px of the table without a hole: standard deviation about their own plane, in 1/m and
              in mm by range, and the correlation of that residual along rows and columns, 1, 2, 4 and 8 px apart. A
              block does not show what is smooth over more than 32 px.
    step      distance of the levels of 1/z, in 1/m, where the image has levels wider than the file's.
    dropout   share of pixels without depth, by angle between ray and normal. Both come from planes through the pixels
              around, so holes beside edges and holes wider than about 12 px are not counted. hole_run_px is how long
              they are in a row.
    far_SIDE  where depth jumps by more than 30 mm along a row or column, by the side of the near surface on which the
              far one is: pixels without depth between them, as a line over the difference of 1/z (its slope over the
              focal length is a baseline), their spread about it, the share of pixels with a depth in between, and how
              far the near surface ends outside its outline in colour and outside its label.
"""
import argparse
import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image

BLOCK_PX, LAGS_PX = 32, (1, 2, 4, 8)
ANGLES_DEG = (0, 30, 45, 55, 65, 70, 75, 80, 85)
JUMP_M, STEP_PER_M, GAP_PX_MAX, OUTLINE_PX = 0.03, 0.02, 80, 10
SENSORS = {"mosd": "kinect", "rs": "d415?", "ycbv": "xtion", "bin": "sr300", "d435": "d435"}


def captures(folder):
    """Rows of captures.json with z_m, label and luminance of each pixel."""
    for row in json.loads((folder / "captures.json").read_text()):
        z_m = np.array(Image.open(folder / f"{row['name']}-depth.png")).astype(float) * 1e-4
        label, color = folder / f"{row['name']}-label.png", folder / f"{row['name']}-color.jpg"
        sensor = row.get("sensor") or SENSORS[row["name"].split("-")[0]]
        yield row | {
            "sensor": sensor,
            "z_m": z_m,
            "label": np.array(Image.open(label)) if label.exists() else None,
            "light": np.array(Image.open(color).convert("L")).astype(float) if color.exists() else None,
        }


def noise_of(row):
    """Blocks of the table: [range, std of 1/z, correlations along rows, along columns]."""
    z_m, (fx, fy, cx, cy) = row["z_m"], row["fx_fy_cx_cy"]
    v, u = np.mgrid[: z_m.shape[0], : z_m.shape[1]]
    points = np.dstack([(u - cx) / fx * z_m, (v - cy) / fy * z_m, z_m])
    table = (z_m > 0) & (abs(points @ np.array(row["table_normal"]) + row["table_offset_m"]) < 0.01)
    if row["label"] is not None:
        table &= row["label"] == 1
    y, x = np.mgrid[:BLOCK_PX, :BLOCK_PX]
    base, _ = np.linalg.qr(np.stack([np.ones(x.size), x.ravel(), y.ravel()], 1))
    blocks = []
    for v0 in range(0, z_m.shape[0] - BLOCK_PX + 1, BLOCK_PX):
        for u0 in range(0, z_m.shape[1] - BLOCK_PX + 1, BLOCK_PX):
            here = np.s_[v0 : v0 + BLOCK_PX, u0 : u0 + BLOCK_PX]
            if table[here].all():
                q = 1 / z_m[here].ravel()
                rest = (q - base @ (base.T @ q)).reshape(BLOCK_PX, BLOCK_PX)
                var = max(rest.var(), 1e-20)
                along = [(rest[:, lag:] * rest[:, :-lag]).mean() / var for lag in LAGS_PX]
                down = [(rest[lag:] * rest[:-lag]).mean() / var for lag in LAGS_PX]
                blocks.append([z_m[here].mean(), var**0.5, *along, *down])
    return blocks


def step_of(rows):
    """Distance of the levels of 1/z in 1/m, or None where every level of the file occurs.

    Where few pixels fall on each level some are missing, so only the half of the range with most pixels is asked.
    """
    steps = []
    for row in rows:
        seen = np.round(row["z_m"][row["z_m"] > 0] * 1e4).astype(int)
        lo, hi = np.quantile(seen, [0.1, 0.6])
        levels = np.unique(seen[(seen >= lo) & (seen <= hi)])
        unit = np.gcd.reduce(levels)
        if len(levels) > 20 and len(levels) * unit < 0.7 * (levels[-1] - levels[0]):
            steps.append((1e4 / levels[0] - 1e4 / levels[-1]) / (len(levels) - 1))
    return float(np.median(steps)) if steps else None


def box(image, half):
    """Sums over windows of 2 half + 1 px."""
    padded = np.pad(image, ((half + 1, half), (half + 1, half))).cumsum(0).cumsum(1)
    side = 2 * half + 1
    return padded[side:, side:] - padded[:-side, side:] - padded[side:, :-side] + padded[:-side, :-side]


def dropout_of(row, half=7):
    """Pixels around which depth is one plane: its angle in degrees, whether the pixel has no depth; runs of such."""
    z_m, (fx, fy, cx, cy) = row["z_m"], row["fx_fy_cx_cy"]
    seen = (z_m > 0).astype(float)
    v, u = np.mgrid[: z_m.shape[0], : z_m.shape[1]]
    x, y, q = (u - cx) / fx, (v - cy) / fy, np.where(z_m > 0, 1 / np.maximum(z_m, 1e-3), 0)
    count = box(seen, half)
    share = count / (2 * half + 1) ** 2
    mean = {key: box(seen * value, half) / np.maximum(count, 1) for key, value in dict(x=x, y=y, q=q).items()}
    moment = lambda a, b, i, j: box(seen * a * b, half) / np.maximum(count, 1) - mean[i] * mean[j]
    xx, xy, yy = moment(x, x, "x", "x"), moment(x, y, "x", "y"), moment(y, y, "y", "y")
    xq, yq, qq = moment(x, q, "x", "q"), moment(y, q, "y", "q"), moment(q, q, "q", "q")
    det = np.maximum(xx * yy - xy * xy, 1e-18)
    a, b = (xq * yy - yq * xy) / det, (yq * xx - xq * xy) / det
    here = mean["q"] + a * (x - mean["x"]) + b * (y - mean["y"])
    rest = np.sqrt(np.maximum(qq - a * xq - b * yq, 0))
    aside = np.hypot((mean["x"] - x) * fx, (mean["y"] - y) * fy)
    flat = (share > 0.5) & (rest < 0.006 * here) & (aside < 0.3 * half)
    inside = (v > half) & (v < z_m.shape[0] - half) & (u > half) & (u < z_m.shape[1] - half)
    level = 1e-12 + np.sqrt(a**2 + b**2 + (here - a * x - b * y) ** 2) * np.sqrt(x**2 + y**2 + 1)
    angle = np.degrees(np.arccos(np.clip(here / level, -1, 1)))
    flat &= inside & (here > 0)
    lost = flat & (seen == 0)
    runs = (lost[:, 1:] & ~lost[:, :-1]).sum()
    return angle[flat], lost[flat], runs


def edges_of(row, turned):
    """Jumps of depth along rows, or columns: one line each, see the columns below."""
    images = (row[key] for key in ("z_m", "label", "light"))
    z_m, label, light = (image.T if turned and image is not None else image for image in images)
    found = []
    for v in range(z_m.shape[0]):
        u = np.flatnonzero(z_m[v] > 0)
        depth = z_m[v, u]
        jump = -np.diff(1 / depth)
        k = 0
        while k < len(jump):
            end = k + 1
            if abs(jump[k]) > STEP_PER_M:
                while end < len(jump) and jump[end] * np.sign(jump[k]) > STEP_PER_M:
                    end += 1
                if (edge := one_edge(v, u, depth, k, end, label, light)) is not None:
                    found.append(edge)
            k = end
    return found


def one_edge(v, u, depth, first, last, label, light):
    """[1/near - 1/far, missing, between, far is before near, past the label, past the outline], or None."""
    missing = u[last] - u[first] - (last - first)
    smooth = lambda part: len(part) == 5 and np.ptp(1 / part) < 2 * STEP_PER_M
    if abs(depth[last] - depth[first]) < JUMP_M or missing > GAP_PX_MAX:
        return None
    if first < 4 or not (smooth(depth[first - 4 : first + 1]) and smooth(depth[last : last + 5])):
        return None
    near, far, out = (last, first, -1) if depth[last] < depth[first] else (first, last, 1)
    ends = u[near]
    past_label = past_outline = np.nan
    if label is not None and 15 <= ends < label.shape[1] - 15:
        # From within the object outwards: the first pixel that the label no longer calls an object.
        kinds = label[v, ends - 15 * out :: out][:30] if out > 0 else label[v, ends + 15 :: -1][:30]
        on = np.flatnonzero(kinds == 1)
        if len(on) and (kinds[: on[0]] > 1).sum() > 3:
            past_label = 15 - (np.flatnonzero(kinds[: on[0]] > 1)[-1])
    if light is not None and OUTLINE_PX + 2 <= ends < light.shape[1] - OUTLINE_PX - 2:
        part = light[v, ends - OUTLINE_PX - 1 : ends + OUTLINE_PX + 2]
        rise = abs(part[2:] - part[:-2])
        if rise.max() > 40 and rise.max() > 3 * np.median(rise):
            # Borders of pixels: half a pixel beyond the last near one, and in the middle of the rise.
            past_outline = 0.5 - out * (np.flatnonzero(rise > 0.9 * rise.max()).mean() - OUTLINE_PX)
    return [1 / depth[near] - 1 / depth[far], missing, last - first - 1, far == first, past_label, past_outline]


def line(x, y):
    """Slope and intercept: medians of y in ten equal parts of x, then least squares."""
    order = np.argsort(x)
    parts = [part for part in np.array_split(order, 10) if len(part)]
    mid = np.array([[np.median(x[part]), np.median(y[part])] for part in parts])
    slope, start = np.polyfit(mid[:, 0], mid[:, 1], 1) if np.ptp(mid[:, 0]) > 0 else (np.nan, np.nan)
    return float(slope), float(start)


def noise_told(rows):
    """Noise of the table, of all captures of a sensor."""
    blocks = np.array([block for row in rows for block in noise_of(row)])
    told = {"blocks": len(blocks)}
    if len(blocks) >= 8:
        told["noise_per_m"] = float(np.median(blocks[:, 1]))
        told["correlation_row"] = np.median(blocks[:, 2 : 2 + len(LAGS_PX)], 0).round(3).tolist()
        told["correlation_column"] = np.median(blocks[:, 2 + len(LAGS_PX) :], 0).round(3).tolist()
        parts = np.array_split(blocks[np.argsort(blocks[:, 0])], 4)
        std_mm = [1e3 * np.median(part[:, 1] * part[:, 0] ** 2) for part in parts]
        ranges_m = [np.median(part[:, 0]) for part in parts]
        told["noise_by_range"] = [
            {"z_m": round(float(z_m), 3), "std_mm": round(float(std), 3)} for z_m, std in zip(ranges_m, std_mm)
        ]
    return told


def dropout_told(rows):
    """Holes within surfaces, of all captures of a sensor."""
    angles, losts, runs = zip(*map(dropout_of, rows))
    angles, lost = np.concatenate(angles), np.concatenate(losts)
    told = {"hole_run_px": float(lost.sum() / max(sum(runs), 1)) if lost.sum() > 200 else None, "dropout": []}
    for lo, hi in zip(ANGLES_DEG, ANGLES_DEG[1:]):
        here = (angles >= lo) & (angles < hi)
        share = float(lost[here].mean()) if here.sum() > 2000 else None
        told["dropout"].append({"deg": [lo, hi], "pixels": int(here.sum()), "share": share})
    return told


def side_told(edges, focal_px):
    """Edges with the far surface on one side."""
    rise, missing = edges[:, 0], edges[:, 1]
    slope, start = line(rise, missing / focal_px)
    rest_px = missing - (start + slope * rise) * focal_px
    past = {}
    for name, column in (("past_label_px", 4), ("past_outline_px", 5)):
        known = edges[~np.isnan(edges[:, column]), column]
        past[name] = float(np.median(known)) if len(known) > 50 else None
    parts = np.array_split(np.argsort(rise), 5)
    return {
        "edges": len(edges),
        "baseline_mm": 1e3 * slope,
        "band_px": start * float(np.median(focal_px)),
        "ragged_px": float(0.5 * np.ptp(np.quantile(rest_px, [0.16, 0.84]))),
        "missing_px_by_rise": [[round(float(np.median(x[part])), 3) for x in (rise, missing)] for part in parts],
        "between": float(edges[:, 2].mean()),
        **past,
    }


def summary(rows):
    """All statistics of one sensor's captures."""
    told = {"captures": len(rows), "step_per_m": step_of(rows), **noise_told(rows), **dropout_told(rows)}
    for turned, sides in ((False, ("right", "left")), (True, ("below", "above"))):
        edges = [(row["fx_fy_cx_cy"][int(turned)], edge) for row in rows for edge in edges_of(row, turned)]
        focal_px = np.array([focal for focal, _ in edges])
        edges = np.array([edge for _, edge in edges], float).reshape(-1, 6)
        for side, far_first in zip(sides, (0, 1)):
            here = edges[:, 3] == far_first
            if here.sum() >= 200:
                told[f"far_{side}"] = side_told(edges[here], focal_px[here])
    return told


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--json", type=Path, help="write the numbers there, too")
    asked = parser.parse_args()
    by_sensor = {}
    for row in captures(asked.folder):
        by_sensor.setdefault(row["sensor"], []).append(row)
    told = {sensor: summary(rows) for sensor, rows in by_sensor.items()}
    for sensor, numbers in told.items():
        print(f"{sensor}:")
        for key, value in numbers.items():
            print(f"    {key}: {json.dumps(value)}")
    if asked.json:
        asked.json.write_text(json.dumps(told, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
