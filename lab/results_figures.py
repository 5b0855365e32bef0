#!/usr/bin/env python3
"""Draws the tables of docs/results: docs/pictures/results/PAGE.svg. A figure has the numbers of its page and no others.

    python lab/results_figures.py [--check]

--check writes nothing, and ends with 1 if a figure is out of date.
"""
import re
import sys
from html import escape
from math import log10
from pathlib import Path

DOCS = Path(__file__).parent.parent / "docs"
COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7"]
ROW, TOP, GAP, LETTER = 22, 58, 26, 6.1
NUMBER = r"(?:(?<=[\s|(])-)?\d[\d,]*(?:\.\d+)?(?:e-?\d+)?"
BOTH = ["grasp success rate", "declutter rate"]
WHOLE = (0, 100, False)

# Page: columns that name a row, (low, high, is logarithmic) of the axis, what the axis has, panels. A panel has a name,
# columns and names of the dots; a column with GSR / DR has two dots.
FIGURES = {
    "engine-speed": ([0], (1, 200, True), "times slower than ours", [("", [3], [])]),
    "finer-grid": ([0], (75, 100, False), "%", [("one, 7.5 mm", [1], BOTH), ("one, 2.5 mm", [2], BOTH), ("own, 7.5 mm", [3], BOTH),
                   ("own, 2.5 mm", [4], BOTH)]),
    "generating": ([0], (0, 12000, False), "attempts/s", [("", [3], [])]),
    "hands": ([0], (75, 100, False), "%", [("grasp success rate", [1, 3], ["one for many", "its own"]), ("declutter rate", [2, 4], ["one for many", "its own"])]),
    "other-simulators": ([0], WHOLE, "%", [("GIGA: packed", [1], BOTH), ("GIGA: piles", [2], BOTH), ("VGN: blocks", [3], BOTH), ("VGN: packed", [4], BOTH),
                         ("VGN: piles", [5], BOTH)]),
    "paper-network": ([0], WHOLE, "%", [("piles", [1, 2], BOTH), ("upright", [3, 4], BOTH)]),
    "paper-tables": ([0], WHOLE, "%", [("Table 1", [1], []), ("Table 2", [2], []), ("Table 3", [3], []), ("Table 4", [4], [])]),
    "planning": ([0, 1], (1, 100, True), "ms", [("", [2, 3, 4], ["run 1", "run 2", "run 3"])]),
    "side-view": ([0], WHOLE, "%", [("piles, fails", [1], BOTH), ("piles, halts", [2], BOTH), ("upright, fails", [3], BOTH), ("upright, halts", [4], BOTH)]),
    "training-speed": ([0, 1], (10, 10000, True), "ms", [("", [2], [])]),
}


def plain(cell):
    """The text of a cell without its marks."""
    cell = re.sub(r"\[\^\w+\]|[*`✗]", "", cell)
    return re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", cell).strip()


def table(page, picture):
    """The rows of the table above a picture of a page, without its head."""
    lines = page[: page.index(picture)].splitlines()
    first = max(number for number, line in enumerate(lines) if line.startswith("|") and not lines[number - 1].startswith("|")) + 2
    rows = []
    for line in lines[first:]:
        if not line.startswith("|"):
            break
        rows.append([plain(cell) for cell in line.strip("|").split("|")])
    return rows


def values(cell):
    """The numbers of a cell: (value, low, high), one or two of them."""
    found = []
    share = re.search(rf"\d+ of \d+, ({NUMBER}) %", cell)
    for part in [share[1]] if share else cell.split(" / "):
        numbers = [float(number.replace(",", "")) for number in re.findall(NUMBER, part)]
        if not numbers or re.fullmatch(r"\d+ of \d+", part):
            continue
        scale = 1000 if "kB" in part else 1
        has_interval = " to " in part and len(numbers) > 1
        low, high = numbers[-2:] if has_interval else (numbers[0], numbers[0])
        value = numbers[0] if len(numbers) != 2 or not has_interval else (low + high) / 2
        if len(numbers) > 2 and has_interval:
            low, high = numbers[1:3]
        found.append(tuple(scale * number for number in (value, low, high)))
    return found


def level(x, axis):
    """Where a number lies on the axis, 0 to 1."""
    low, high, is_log = axis
    x, low, high = (log10(n) for n in (max(x, low), low, high)) if is_log else (max(x, low), low, high)
    return min((x - low) / (high - low), 1)


def ticks(axis):
    low, high, is_log = axis
    if not is_log:
        parts = 5 if round(high - low) in (10, 25) else 4
        return [low + (high - low) * part / parts for part in range(parts + 1)]
    return [10**power for power in range(-9, 10) if 0.999 * low <= 10**power <= 1.001 * high]


def draw(name):
    label_columns, axis, unit, panels = FIGURES[name]
    rows = table((DOCS / "results" / f"{name}.md").read_text(), f"{name}.svg")
    rows = [row for row in rows if any(values(row[column]) for _, columns, _ in panels for column in columns)]
    labels = [", ".join(row[column] for column in label_columns if row[column]) for row in rows]
    labels = [label if len(label) <= 60 else label[:59] + "…" for label in labels]
    left = 16 + LETTER * max(map(len, labels))
    breadth = {1: 420, 2: 250, 3: 190}.get(len(panels), 150)
    width, bottom = left + len(panels) * (breadth + GAP), TOP + ROW * len(rows)
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {bottom + 44}" width="{width:.0f}" height="{bottom + 44}" '
             'font-family="DejaVu Sans, Verdana, sans-serif" font-size="10.5">', '<rect width="100%" height="100%" fill="#fff"/>']
    for number, label in enumerate(labels):
        y = TOP + ROW * (number + 0.5)
        parts.append(f'<text x="{left - 10:.1f}" y="{y + 4}" text-anchor="end">{escape(label)}</text>')
    names = []
    for number, (title, columns, dots) in enumerate(panels):
        start = left + number * (breadth + GAP)
        names += [dot for dot in dots if dot not in names]
        parts.append(f'<text x="{start + breadth / 2:.1f}" y="{TOP - 10}" text-anchor="middle" font-weight="bold">{escape(title)}</text>')
        for tick in ticks(axis):
            x = start + breadth * level(tick, axis)
            parts.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{TOP}" y2="{bottom}" stroke="#ddd"/>')
            parts.append(f'<text x="{x:.1f}" y="{bottom + 15}" text-anchor="middle" fill="#555">{tick:g}</text>')
        parts.append(f'<text x="{start + breadth / 2:.1f}" y="{bottom + 32}" text-anchor="middle" fill="#555">{escape(unit)}</text>')
        for place, row in enumerate(rows):
            most = 1 if len(columns) > 1 or not dots else 2
            found = [(kind + part, value) for kind, column in enumerate(columns) for part, value in enumerate(values(row[column])[:most])]
            for kind, (value, low, high) in found:
                y = TOP + ROW * (place + (kind + 1) / (max(len(columns), most) + 1))
                x, x_low, x_high = (start + breadth * level(n, axis) for n in (value, low, high))
                colour = COLOURS[kind]
                parts.append(f'<line x1="{x_low:.1f}" x2="{x_high:.1f}" y1="{y:.1f}" y2="{y:.1f}" stroke="{colour}" stroke-width="2"/>')
                parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.4" fill="{colour}"/>')
    x = left
    for kind, dot in enumerate(names):
        parts.append(f'<circle cx="{x:.1f}" cy="16" r="4" fill="{COLOURS[kind]}"/><text x="{x + 9:.1f}" y="20">{escape(dot)}</text>')
        x += 28 + LETTER * 1.1 * len(dot)
    return "\n".join(parts) + "\n</svg>\n"


def main():
    stale = []
    for name in FIGURES:
        path, drawn = DOCS / "pictures" / "results" / f"{name}.svg", draw(name)
        if not path.exists() or path.read_text() != drawn:
            stale.append(name)
            if "--check" not in sys.argv:
                path.write_text(drawn)
    print("drawn:" if "--check" not in sys.argv else "out of date:", ", ".join(stale) or "none")
    return 1 if stale and "--check" in sys.argv else 0


if __name__ == "__main__":
    sys.exit(main())
