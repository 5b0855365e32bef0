"""Datasets for the programs of others: what VGN's and GIGA's code trains on, scenes for simulators.
A format is a file: of a dataset in ``datasets``, of simulators in ``scenes``; its docstring becomes the export's page.
The same dataset gives the same bytes. Each file gets its name when it is whole, so an interrupted export continues with
the missing ones; ``export-begun.json`` identifies it meanwhile. ``export.json`` comes last."""

import fcntl
import inspect
import json
import os
import re
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path
from typing import Any, Callable, Iterator

from .. import _arrays, _native
from ..dataset import Dataset
from ..errors import InputError, OutsideError
from . import scenes
from ._files import as_json, outside, part, write
from .datasets import vgn

FORMATS: dict[str, Any] = {"vgn": vgn, **scenes.FORMATS}
#: The files that describe a complete export, identify an incomplete one, and keep others out meanwhile.
DONE, BEGUN, LOCK = "export.json", "export-begun.json", ".lock"
SOURCE = "Exported by Graspmill {exporter_version} from dataset `{dataset_id}` (made by {dataset_code_version} from seed {dataset_seed})."
COUNTS = ("attempts", "grasps", "positives", "left_out", "scenes", "scenes_left_out")


def selected(text: str) -> list[range]:
    ranges = []
    for some in text.split(","):
        if (found := re.fullmatch(r"\s*([0-9]{1,18})\s*(?:-\s*([0-9]{1,18})\s*)?", some)) is None:
            raise InputError(f"scenes must be numbers and ranges, such as 0-9,17, got `{some}`")
        ranges.append(range(int(found[1]), int(found[2] or found[1]) + 1))
        _arrays.must(ranges[-1], f"scenes must be ranges that are not empty, got `{some}`")
    return ranges


def export(dataset: Dataset, form: str, out: str, chosen: list[range] | None = None, done: Callable[[int], None] = lambda _: None) -> dict[str, Any]:
    """Writes a dataset in one of :data:`FORMATS` to an empty or new folder, or continues an equal export; a complete
    one is not changed. Returns the content of ``export.json``. Of formats for simulators some scenes may be chosen;
    ``done`` is called with numbers of scenes that are done. Raises InputError if the dataset does not fit the format,
    or the folder holds something else; OutsideError if another process writes there."""
    folder, info, is_of_scenes = Path(out), dataset.info, form in scenes.FORMATS
    last = max((some[-1] for some in chosen or ()), default=-1)
    _arrays.must("://" not in out, f"the export must go to a folder on a disk, got {out}: export there, then copy the files")
    _arrays.must(not folder.is_file(), f"the export must go to a folder, got a file: {out}")
    _arrays.must(last < dataset.scene_count, f"scenes must be below the number of scenes, {dataset.scene_count}, got {last}")
    _arrays.must(is_of_scenes or not chosen, f"scenes may be selected of mjcf, urdf and usda, got {form}")
    if form == "vgn":
        vgn.check(info)
    numbers = sorted({number for some in chosen or [range(dataset.scene_count)] for number in some})
    origin = {"format": form, "exporter_version": _native.__version__, "dataset_id": dataset.id}
    origin |= {"dataset_code_version": info["code_version"], "dataset_seed": info["seed"]}
    if chosen:
        runs = [[number for _, number in run] for _, run in groupby(enumerate(numbers), lambda entry: entry[1] - entry[0])]
        origin["scenes"] = ",".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]) for run in runs)
    with outside(folder), _locked(folder):
        told = _begun(folder, origin)
        if told is None:
            rows = (dataset._native, info, form, numbers) if is_of_scenes else (dataset,)
            modules = [FORMATS[form], *[scenes] * is_of_scenes]
            counts = modules[-1].write(*rows, folder, done)
            pages = [inspect.getdoc(module) or "" for module in modules]
            write(folder / "README.md", "# " + "\n\n".join([*pages, SOURCE.format(**origin)]) + "\n")
            told = {"origin": origin, "counts": {key: counts.get(key, 0) for key in COUNTS}}
            write(folder / DONE, as_json(told) + "\n")
        (folder / BEGUN).unlink(missing_ok=True)
    return told


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / LOCK, "w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise OutsideError(f"another process writes in this folder: {folder}") from error
        except OSError:
            pass  # without support for locks, trust the user
        try:
            yield
        finally:
            (folder / LOCK).unlink(missing_ok=True)


def _begun(folder: Path, origin: dict[str, Any]) -> dict[str, Any] | None:
    """Begins an export in an empty or new folder, or continues this export. Returns it if it is complete."""
    names = sorted(set(os.listdir(folder)) - {"lost+found", LOCK, part(folder / BEGUN).name})
    mark = next((name for name in (DONE, BEGUN) if name in names), None)
    why = f"it holds {json.dumps(names[0], ensure_ascii=False)}, which is no export" if names else ""
    read: dict[str, Any] = {}
    if mark:
        try:
            read = json.loads((folder / mark).read_bytes())
            there = read["origin"] if mark == DONE else read
            some = f"scenes {there['scenes']} of " if "scenes" in there else ""
            other = f"it holds an export as {there['format']} of {some}dataset {there['dataset_id']} by version {there['exporter_version']}"
            why = "" if there == origin else other
        except (ValueError, KeyError, TypeError):
            why = "what it says about its export is damaged"
    _arrays.must(not why, f"{why}: give an empty or a new folder: {folder}")
    if not mark:
        write(folder / BEGUN, as_json(origin) + "\n")
    return read if mark == DONE else None
