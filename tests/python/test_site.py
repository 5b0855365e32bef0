"""The page that scripts/site.py makes of a notebook, and links to it. scripts/site.sh checks the links of the whole site."""

import base64
import json
import sys

from programs import ROOT, ran

PICTURE = b"\x89PNG\r\n\x1a\n and what follows"
CELLS = [
    {"cell_type": "markdown", "source": ["# A title\n", "\n", "From [made.py](../../made.py), [a key](../README.md#settings)."]},
    {"cell_type": "code", "source": ["first = 1"], "outputs": []},
    {
        "cell_type": "code",
        "source": ["print(first)\n", "second"],
        "outputs": [
            {"output_type": "stream", "name": "stdout", "text": ["1\n"]},
            {"output_type": "stream", "name": "stdout", "text": "  indented\n"},
            {"output_type": "execute_result", "data": {"image/png": base64.b64encode(PICTURE).decode(), "text/plain": ["A plan"]}},
            {"output_type": "execute_result", "data": {"text/plain": "2"}},
        ],
    },
]
MADE = '''---
hide:
  - toc
---

# A title

From [made.py](../../made.py.md), [a key](../settings.md).

`````python
first = 1
`````

`````python
print(first)
second
`````

`````text title="Output"
1
  indented
2
`````

![A plan](one-2-0.png)

[This notebook as a file](one.ipynb)
'''


def test_a_notebook_becomes_a_page(tmp_path):
    root, out = tmp_path / "root", tmp_path / "pages"
    notebooks = root / "docs" / "notebooks"
    notebooks.mkdir(parents=True)
    text = json.dumps({"cells": CELLS})
    (notebooks / "one.ipynb").write_text(text)
    (root / "made.py").write_text("first = 1\n")
    (root / "docs" / "README.md").write_text("# [Settings](#settings)\n\nSee [it](notebooks/one.ipynb), [a list](#other).\n")
    made = out / "docs" / "notebooks"
    made.mkdir(parents=True)
    (out / "docs" / "settings.md").write_text("# Settings\n")  # as scripts/reference.sh does
    ran(sys.executable, ROOT / "scripts" / "site.py", "pages", root, out)
    assert (out / "docs" / "README.md").read_text() == "# [Settings](settings.md)\n\nSee [it](notebooks/one.md), [a list](README.md#other).\n"
    assert (made / "one.md").read_text() == MADE
    assert (made / "one-2-0.png").read_bytes() == PICTURE
    assert (made / "one.ipynb").read_text() == text
    assert (out / "made.py.md").is_file()
