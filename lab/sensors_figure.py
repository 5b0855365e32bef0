#!/usr/bin/env python3
"""Draws real and simulated statistics of sensors beside each other: docs/pictures/sensors.svg.

    python scripts/sensor_statistics.py REAL --json real.json
    python scripts/sensor_statistics.py SIMULATED --json simulated.json
    python lab/sensors_figure.py real.json simulated.json docs/pictures/sensors.svg
"""
import json
import sys
from pathlib import Path

import numpy as np

COLOURS = {"kinect": "#0072b2", "d435": "#d55e00"}
WIDTH, HEIGHT, LEFT, TOP, GAP = 250, 200, 50, 40, 70


def curves(told):
    """Of each panel the curves of one sensor: [name, [(x, y)]]."""
    noise = [(part["z_m"], part["std_mm"]) for part in told["noise_by_range"]]
    holes = [(np.mean(part["deg"]), 1e3 * part["share"]) for part in told["dropout"] if part["share"]]
    shadows = [told[side]["missing_px_by_rise"] for side in ("far_left", "far_right")]
    return [[noise], shadows, [holes]]


def panel(number, title, axes, limits, drawn, is_log):
    """One panel as SVG; `drawn` is [(colour, is simulated, points)]."""
    (x_lo, x_hi), (y_lo, y_hi) = limits
    start = LEFT + number * (WIDTH + GAP)
    level = np.log10 if is_log else lambda y: y
    place_x = lambda x: start + WIDTH * (x - x_lo) / (x_hi - x_lo)
    place_y = lambda y: TOP + HEIGHT * (1 - (level(y) - level(y_lo)) / (level(y_hi) - level(y_lo)))
    parts = [f'<rect x="{start}" y="{TOP}" width="{WIDTH}" height="{HEIGHT}" fill="none" stroke="#888"/>']
    parts.append(f'<text x="{start}" y="{TOP - 12}" font-weight="bold">{title}</text>')
    parts.append(f'<text x="{start + WIDTH / 2}" y="{TOP + HEIGHT + 32}" text-anchor="middle">{axes}</text>')
    for x in np.linspace(x_lo, x_hi, 4):
        parts.append(f'<text x="{place_x(x):.0f}" y="{TOP + HEIGHT + 15}" text-anchor="middle">{x:.3g}</text>')
    for y in np.geomspace(y_lo, y_hi, 6) if is_log else np.linspace(y_lo, y_hi, 4):
        parts.append(f'<text x="{start - 5}" y="{place_y(y) + 4:.0f}" text-anchor="end">{float(f"{y:.2g}"):g}</text>')
    for colour, is_simulated, points in drawn:
        kept = [(x, y) for x, y in points if x_lo <= x <= x_hi and y_lo <= y <= y_hi]
        line = " ".join(f"{place_x(x):.1f},{place_y(y):.1f}" for x, y in kept)
        dashes = ' stroke-dasharray="5 4"' if is_simulated else ""
        parts.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="2"{dashes}/>')
        if not is_simulated:
            parts += [f'<circle cx="{place_x(x):.1f}" cy="{place_y(y):.1f}" r="3" fill="{colour}"/>' for x, y in kept]
    return parts


def main():
    real, simulated = (json.loads(Path(name).read_text()) for name in sys.argv[1:3])
    panels = [[], [], []]
    for sensor, colour in COLOURS.items():
        for is_simulated, told in ((False, real[sensor]), (True, simulated[sensor])):
            for drawn, lines in zip(panels, curves(told)):
                drawn += [(colour, is_simulated, points) for points in lines]
    parts = panel(0, "noise, mm", "range, m", ((0.4, 1.36), (0, 3.6)), panels[0], False)
    parts += panel(1, "shadow left and right, px", "1/near − 1/far, 1/m", ((0, 0.6), (0, 36)), panels[1], False)
    parts += panel(2, "holes, 1/1000", "angle, degrees", ((0, 90), (0.01, 1000)), panels[2], True)
    size = f"{LEFT + 3 * (WIDTH + GAP)}", f"{TOP + HEIGHT + 70}"
    legend = " ".join(f'<tspan fill="{colour}">{sensor}</tspan>' for sensor, colour in COLOURS.items())
    parts.append(f'<text x="{LEFT}" y="{TOP + HEIGHT + 58}">{legend}; points: real, dashed: simulated</text>')
    box = f'viewBox="0 0 {size[0]} {size[1]}" font-family="sans-serif" font-size="12"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {box}>'
    background = f'<rect width="{size[0]}" height="{size[1]}" fill="white"/>'
    Path(sys.argv[3]).write_text("\n".join([head, background, *parts, "</svg>"]) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
