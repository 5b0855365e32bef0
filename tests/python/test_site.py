"""The page that scripts/site.py makes of a notebook. scripts/site.sh checks the links of the whole site."""

import base64
import json
import sys

from programs import ROOT, ran

PICTURE = b"\x89PNG\r\n\x1a\n and what follows"
NOTEBOOK = {
    "cells": [
        {"cell_type": "markdown", "source": ["# A title\n", "\n", "From [made.py](../../made.py)."]},
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
}
MADE = '''---
hide:
  - toc
---

# A title

From [made.py](../../made.py.md).

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
    text = json.dumps(NOTEBOOK)
    (notebooks / "one.ipynb").write_text(text)
    (root / "made.py").write_text("first = 1\n")
    (root / "docs" / "page.md").write_text("See [it](notebooks/one.ipynb).\n")
    ran(sys.executable, ROOT / "scripts" / "site.py", "pages", root, out)
    assert (out / "docs" / "page.md").read_text() == "See [it](notebooks/one.md).\n"
    made = out / "docs" / "notebooks"
    assert (made / "one.md").read_text() == MADE
    assert (made / "one-2-0.png").read_bytes() == PICTURE
    assert (made / "one.ipynb").read_text() == text
    assert (out / "made.py.md").is_file()
