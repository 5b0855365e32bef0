"""HTML pages, for notebooks or files."""

from __future__ import annotations

import html
import os
from dataclasses import dataclass
from pathlib import Path

from . import _arrays, _native


@dataclass(frozen=True)
class Page:
    """A self-contained HTML page, whose text is ``html``. Notebooks show it."""

    html: str

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Writes the page to a file, for a browser. An existing file stays until it is replaced by the whole page."""
        file = Path(_arrays.path("path", path))
        _native.publish(file, _arrays.text("html", self.html))
        return file

    def __repr__(self) -> str:
        return f"Page({len(self.html):,} characters)"

    def _repr_html_(self) -> str:
        # In a frame of its own: the page's style and scripts stay inside.
        frame = '<iframe sandbox="allow-scripts" style="width: 100%; height: 640px; border: 0" srcdoc="{}"></iframe>'
        return frame.format(html.escape(self.html))
