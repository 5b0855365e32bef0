"""Changes datasets as an attacker would who also mends every checksum, id and seal."""

import copy
import hashlib
import json
import os
import shutil
import socket
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

TABLES = ("attempts", "scenes", "objects")
INFO, MANIFEST, CARD, LAST = "meta/info.json", "meta/manifest.json", "README.md", "_SUCCESS"
CONTROL = "\x1b[31mred\x1b]0;title\x07\x08\r\x9b"
NUMBERS = [0, -1, 1, 2, 255, 1000, 2**31 - 1, 2**31, 2**32, 2**53, 2**63 - 1, 2**64 - 1]
REALS = [0.0, -0.0, -1.0, 1e-45, 1e-9, 0.5, 3.0, 1e3, 1e6, 3.4e38, 1e300]
OTHERS = [None, True, "", "x", CONTROL, "x" * 100_000, [], {}, [[]], [1, 2, 3], {"a": 1}]
NON_FINITE = [float("nan"), float("inf"), -float("inf")]


def sha256(data):
    return hashlib.sha256(data).hexdigest()


def sealed(value):
    """The text of a marker or of the manifest, as `shards` writes it, with a matching seal."""
    value = {key: item for key, item in value.items() if key != "seal"}
    body = json.dumps(value, indent=2, ensure_ascii=False).removesuffix("\n}")
    return body + f',\n  "seal": "{sha256(body.encode())}"\n}}\n'


def leaves(value, path=()):
    """The paths of all values that are no object or list, and of all objects and lists."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield (*path, key)
        yield from leaves(item, (*path, key))


def changed(value, rng):
    """Another value in the place of one of JSON: of its own type more often than of another."""
    if isinstance(value, bool) or value is None or rng.random() < 0.2:
        return copy.deepcopy(rng.choice(OTHERS))  # a later change may put something into it
    if isinstance(value, int | float):
        factor = rng.choice([0.1, 0.9, 1.1, 2, 10, 100, -1])
        scaled = value * factor
        return rng.choice([scaled if isinstance(value, float) else int(scaled), rng.choice(NUMBERS), rng.choice(REALS)])
    if isinstance(value, str):
        return rng.choice([value + CONTROL, value[:-1], value.upper(), "../" + value, "/etc/passwd", "x\n" * 9, ""])
    if isinstance(value, list):
        return rng.choice([value * 2, value[:1], value[::-1], value * 1000, []])
    return rng.choice([{}, {**value, "unknown": 1}, {**value, CONTROL: 1}, list(value.values())])


def change_json(value, rng):
    """A copy with one to three values changed, removed or added, and what was changed."""
    value, done = copy.deepcopy(value), []
    for _ in range(rng.choice([1, 1, 2, 3])):
        paths = list(leaves(value))
        if not paths:
            break
        path = rng.choice(paths)
        holder = value
        for key in path[:-1]:
            holder = holder[key]
        if rng.random() < 0.1:
            del holder[path[-1]]
        else:
            holder[path[-1]] = changed(holder[path[-1]], rng)
        shown = "removed" if path[-1] not in holder and isinstance(holder, dict) else "changed"
        done.append(f"{'.'.join(map(str, path))} {shown}")
    return value, ", ".join(done)


def with_column(table, name, values):
    """A table with other values in one of its columns, of the same type."""
    field = table.schema.field(name)
    return table.set_column(table.schema.get_field_index(name), field, values.cast(field.type))


def multiplied(counts, times):
    return {name: multiplied(one, times) if isinstance(one, dict) else one * times for name, one in counts.items()}


class Mutant:
    """A copy of a dataset to be changed, then mended."""

    def __init__(self, source, folder):
        shutil.copytree(source, folder)
        self.folder = Path(folder)
        self.markers = sorted((self.folder / "meta/shards").glob("*.json"))

    def mend(self):
        """Sizes, rows, checksums, ids and seals as the changed files need them."""
        info = sha256((self.folder / INFO).read_bytes())
        manifest = json.loads((self.folder / MANIFEST).read_text())
        manifest["dataset_id"] = info
        for marker, entry in zip(self.markers, manifest["shards"], strict=True):
            value = json.loads(marker.read_text())
            value["dataset_id"] = info
            for table in TABLES:
                path = self.folder / value[table]["path"]
                value[table].update(bytes=path.stat().st_size, sha256=sha256(path.read_bytes()))
            marker.write_text(sealed(value))
            entry.update({key: item for key, item in value.items() if key != "seal"})
        (self.folder / MANIFEST).write_text(sealed(manifest))

    def change(self, rng):
        """Changes one thing and mends what depends on it; says what was changed."""
        return rng.choice([self.info, self.cells, self.cells, self.rows, self.bytes, self.promises, self.special])(rng)

    def info(self, rng):
        value, what = change_json(json.loads((self.folder / INFO).read_text()), rng)
        (self.folder / INFO).write_text(json.dumps(value, indent=2, ensure_ascii=False) + "\n")
        self.mend()
        return f"{INFO}: {what}"

    def table(self, rng):
        path = rng.choice(sorted((self.folder / rng.choice(TABLES)).glob("*.parquet")))
        return path, pq.read_table(path)

    def write(self, path, table):
        # As `shards` writes it: zstd, no dictionary for floats, statistics.
        pq.write_table(table, path, compression="zstd", version="2.6", write_page_index=True)

    def cells(self, rng):
        """One to five cells of one column become other values of its type."""
        path, table = self.table(rng)
        names = [field.name for field in table.schema if not pa.types.is_nested(field.type)]
        name = rng.choice(names)
        field, values = table.schema.field(name), table.column(name).to_pylist()
        for _ in range(rng.randint(1, 5)):
            values[rng.randrange(len(values))] = self.cell(field, values, rng)
        column = pa.array(values, pa.string() if pa.types.is_dictionary(field.type) else field.type)
        column = column.dictionary_encode() if pa.types.is_dictionary(field.type) else column
        self.write(path, with_column(table, name, column))
        self.mend()
        return f"{path.name}: cells of {name}"

    def cell(self, field, values, rng):
        if field.nullable and rng.random() < 0.3:
            return None
        if pa.types.is_floating(field.type):
            return rng.choice([*NON_FINITE, *(real for real in REALS if real < 1e39), rng.uniform(-7, 7)])
        if pa.types.is_integer(field.type):
            bits = field.type.bit_width - (not str(field.type).startswith("u"))
            low = 0 if str(field.type).startswith("u") else -(2**bits)
            return rng.choice([number for number in [low, *NUMBERS] if low <= number < 2**bits])
        return rng.choice([*[value for value in values if value], "", "x", CONTROL, "y" * 10_000])

    def rows(self, rng):
        path, table = self.table(rng)
        order = list(range(table.num_rows))
        at = rng.randrange(len(order))
        ways = {"fewer": order[:at] + order[at + 1 :], "none": [], "doubled": [*order[:at], rng.choice(order), *order[at:]]}
        ways |= {"exchanged": rng.sample(order, len(order)), "many": order * 200}
        kind, order = rng.choice(list(ways.items()))
        self.write(path, table.take(pa.array(order, pa.int64())))
        if rng.random() < 0.5:
            self.promise_rows(path, len(order))
        self.mend()
        return f"{path.name}: {kind} rows"

    def promise_rows(self, path, count):
        marker = self.markers[int(path.name.split("-")[1])]
        value = json.loads(marker.read_text())
        value[path.parent.name]["rows"] = count
        marker.write_text(sealed(value))

    def bytes(self, rng):
        path, _ = self.table(rng)
        data = bytearray(path.read_bytes())
        for _ in range(rng.choice([1, 1, 4, 16])):
            # Footers decide more than values: half of the flips are there.
            first = max(0, len(data) - 4000) if rng.random() < 0.5 else 0
            data[rng.randrange(first, len(data))] ^= 1 << rng.randrange(8)
        if rng.random() < 0.1:
            data = data[: rng.randrange(len(data))]
        path.write_bytes(data)
        self.mend()
        return f"{path.name}: bytes"

    def promises(self, rng):
        path = rng.choice([*self.markers, self.folder / MANIFEST])
        value, what = change_json(json.loads(path.read_text()), rng)
        path.write_text(sealed(value) if isinstance(value, dict) and value else json.dumps(value))
        return f"{path.name}: {what}"

    def special(self, rng):
        """Something else than a file stands in a file's place, or a strange name beside it."""
        names = [INFO, MANIFEST, CARD, LAST, *(str(marker.relative_to(self.folder)) for marker in self.markers)]
        names += [str(path.relative_to(self.folder)) for path in sorted(self.folder.rglob("*.parquet"))]
        path = self.folder / rng.choice(names)
        kind = rng.choice(["name", *MAKERS])
        if kind == "name":
            (path.parent / rng.choice([f"a{CONTROL}", "b\nc", "\udcff", "n" * 255])).write_bytes(b"")
            return f"strange name beside {path.name}"
        self.replace(path, kind)
        return f"{path.name}: {kind}"

    def many_attempts(self, times):
        """Every attempt so many times, in the one shard that is there; all else is consistent."""
        info, [marker] = json.loads((self.folder / INFO).read_text()), self.markers
        info |= {name: info[name] * times for name in ("attempt_count", "attempts_per_scene")}
        (self.folder / INFO).write_text(json.dumps(info, indent=2) + "\n")
        value = json.loads(marker.read_text())
        paths = [self.folder / value[table]["path"] for table in ("attempts", "scenes")]
        attempts, scenes = map(pq.read_table, paths)
        numbers = np.repeat(attempts["attempt_id"].to_numpy() * times, times) + np.tile(np.arange(times), len(attempts))
        attempts = attempts.take(pa.array(np.repeat(np.arange(len(attempts)), times)))
        scenes = with_column(scenes, "attempt_count", pa.array(scenes["attempt_count"].to_numpy() * times))
        for rows, path in zip((with_column(attempts, "attempt_id", pa.array(numbers)), scenes), paths):
            pq.write_table(rows, path, compression="zstd", version="2.6", row_group_size=len(rows))
        counts = value["counts"]
        counts |= {name: multiplied(counts[name], times) for name in ("labels", "outcomes", "rules")}
        value["attempts"]["rows"] = len(attempts)
        marker.write_text(sealed(value))
        manifest = json.loads((self.folder / MANIFEST).read_text())
        (self.folder / MANIFEST).write_text(sealed({**manifest, "totals": counts}))
        self.mend()

    def replace(self, name, kind):
        path = self.folder / name
        path.unlink()
        MAKERS[kind](path)


def bound(path):
    with socket.socket(socket.AF_UNIX) as server:
        here = os.open(path.parent, os.O_PATH)
        server.bind(f"/proc/self/fd/{here}/{path.name}")
        os.close(here)


#: What may stand in a file's place.
MAKERS = {
    "fifo": os.mkfifo, "socket": bound, "zero": lambda path: path.symlink_to("/dev/zero"), "loop": lambda path: path.symlink_to(path.name),
    "folder": Path.mkdir, "sparse": lambda path: (path.touch(), os.truncate(path, 1 << 40)), "gone": lambda path: None,
    "binary": lambda path: path.write_bytes(os.urandom(100_000)),
}  # fmt: skip
