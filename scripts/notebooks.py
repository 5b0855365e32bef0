#!/usr/bin/env python3
"""Makes docs/notebooks from python/examples: the same code, executed, with its outputs.

    pip install WHEEL nbclient==0.10.2 ipykernel==6.30.1 torch mujoco && python scripts/notebooks.py [NAME…]

train_in_pytorch reads what first_dataset has made: name both.

tests/python/test_examples.py fails if a notebook's code is not that of its example.
"""

import ast
import json
import os
import re
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
EXAMPLES, NOTEBOOKS = ROOT / "python" / "examples", ROOT / "docs" / "notebooks"
#: The arguments that a notebook's script has, and what it shows at the end.
MADE = {
    "first_dataset": ([], ""),
    "label_your_grasps": ([], ""),
    "train_in_pytorch": (["first-dataset/grasps"], ""),
    "plan_from_realsense": ([], "from IPython.display import Image\n\nImage(plan.overlay())"),
    "mujoco_loop": (["1"], ""),
}


def cells(name: str) -> list[tuple[str, str]]:
    """Kinds and sources: the docstring, how the script is called, then its code, cut before comments that begin a paragraph."""
    text = (EXAMPLES / f"{name}.py").read_text()
    words, shown = MADE[name]
    docstring = ast.get_docstring(ast.parse(text), clean=False) or ""
    code = text.split('"""', 2)[2].strip()
    title, _, rest = docstring.partition("\n")
    rest = re.sub(r"^    .*\n?", "", rest, flags=re.M).strip()
    made_by = f"Made by `scripts/notebooks.py` from [{name}.py](../../python/examples/{name}.py)."
    told = "\n\n".join(part for part in (f"# {title.rstrip('.')}", rest, made_by) if part)
    argv = [f"{name}.py", *words]
    # As a script has them.
    called = f'import sys\n\nsys.argv, __file__ = {json.dumps(argv)}, "../../python/examples/{name}.py"'
    parts = re.split(r"\n\n+(?=# )", code)
    return [("markdown", told), ("code", called), *(("code", part) for part in [*parts, shown] if part)]


def made(name: str) -> dict:
    """The notebook, not yet executed."""
    rows = [
        {"cell_type": kind, "id": f"{name.replace('_', '-')}-{number}", "metadata": {}, "source": source.splitlines(keepends=True)}
        | ({"execution_count": None, "outputs": []} if kind == "code" else {})
        for number, (kind, source) in enumerate(cells(name))
    ]
    kernel = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}, "language_info": {"name": "python"}}
    return {"cells": rows, "metadata": kernel, "nbformat": 4, "nbformat_minor": 5}


def main() -> None:
    import nbformat
    from nbclient import NotebookClient

    NOTEBOOKS.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        # __file__ is relative to docs/notebooks.
        at = Path(folder) / "docs" / "notebooks"
        at.mkdir(parents=True)
        (Path(folder) / "python").symlink_to(ROOT / "python")
        os.environ["TQDM_DISABLE"] = "1"
        for name in [name for name in MADE if name in (sys.argv[1:] or MADE)]:
            notebook = nbformat.reads(json.dumps(made(name)), as_version=4)
            NotebookClient(notebook, timeout=900, resources={"metadata": {"path": str(at)}}, record_timing=False).execute()
            (NOTEBOOKS / f"{name}.ipynb").write_text(nbformat.writes(notebook).replace(f"{at}/", "") + "\n")
            print(name, (NOTEBOOKS / f"{name}.ipynb").stat().st_size)


if __name__ == "__main__":
    main()
