"""What scripts/site.sh does before and after the generator, which takes pages from one folder only and does not check
what it made.

    site.py pages ROOT STAGE    copies the repository's pages, and what they link to, to STAGE with the same paths
    site.py check STAGE SITE    every link of the made pages leads somewhere; none asks another server for its parts

A link to a setting, a program or a folder leads to a page with its text or its list of files, because the site has no
other copy of the repository to point to. A notebook becomes a page with its code, what that printed and its pictures.
A link to docs/reference/README.md#settings leads to docs/reference/settings.md if STAGE has that page already.
Exit code: 0; 1 with the faults on standard error; 2 for other arguments.
"""

import base64
import json
import os
import re
import shutil
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

FIRST = ("*.md", "docs/**/*.md", "docs/notebooks/*.ipynb", "models/*.md", "ros2/*/README.md", "docs/site.css")
SHOWN = {".toml": "toml", ".py": "python", ".yaml": "yaml", ".cff": "yaml", "": "text"}  # others are copied as they are
LINK = re.compile(r"(?<=\]\()[^)\s]+")
WIDE = "---\nhide:\n  - toc\n---\n\n"  # without a list of headings
UNLISTED = "---\nsearch:\n  exclude: true\nhide:\n  - toc\n---\n\n"  # beside the navigation and the search


def notebook(source: Path, to: Path) -> str:
    """The Markdown of a notebook, whose pictures and file are written beside the page."""
    shutil.copyfile(source, to.with_suffix(".ipynb"))
    parts = []
    for number, cell in enumerate(json.loads(source.read_text())["cells"]):
        text = "".join(cell["source"])
        if cell["cell_type"] != "code":
            parts.append(text)
            continue
        parts.append(f"`````python\n{text}\n`````")
        printed, pictures = "", []
        for output in cell["outputs"]:
            data = output.get("data", {})
            plain = "".join(output.get("text", data.get("text/plain", "")))
            if "image/png" in data:
                picture = to.with_name(f"{to.stem}-{number}-{len(pictures)}.png")
                picture.write_bytes(base64.b64decode("".join(data["image/png"])))
                pictures.append(f"![{plain}]({picture.name})")
            else:
                printed += plain if plain.endswith("\n") else f"{plain}\n"
        if printed.strip():
            parts.append(f'`````text title="Output"\n{printed.rstrip()}\n`````')
        parts += pictures
    return "\n\n".join(parts) + "\n"


def stage(root: Path, out: Path) -> None:
    """Copies the first pages, and everything that these and other copied pages link to."""
    made = {root / path.relative_to(out) for path in out.rglob("*.md")}
    todo = sorted({path for pattern in FIRST for path in root.glob(pattern)})
    done = set(todo)

    def staged(target: Path) -> str:
        """The path of the page for what a link names; it is queued."""
        if target.is_dir() and (target / "README.md").is_file():
            target /= "README.md"
        if target not in done:
            done.add(target)
            todo.append(target)
        path = os.path.relpath(target, root)
        if target.is_dir():
            return f"{path}/index.md"
        if target.suffix == ".ipynb":
            return str(Path(path).with_suffix(".md"))
        return f"{path}.md" if target.suffix in SHOWN else path

    def relinked(page: Path, link: str) -> str:
        """A link to the page made for its target. One that leads out of the repository or nowhere stays for `check`."""
        parts = urlsplit(link)
        target = Path(os.path.normpath(page.parent / unquote(parts.path))) if parts.path else page
        if parts.scheme or not target.is_relative_to(root) or not target.exists():
            return link
        if target.name == "README.md" and (instead := target.parent / f"{parts.fragment}.md") in made:
            return os.path.relpath(instead, page.parent)
        path = os.path.relpath(root / staged(target), page.parent)
        return f"{path}#{parts.fragment}" if parts.fragment else path

    while todo:
        source = todo.pop()
        to = out / staged(source)
        to.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            files = sorted(path for path in source.iterdir() if not path.name.startswith((".", "__")))
            rows = (f"- [{path.name}]({os.path.relpath(root / staged(path), source)})\n" for path in files)
            to.write_text(f"{UNLISTED}# {source.relative_to(root)}\n\n{''.join(rows)}")
        elif source.suffix == ".md":
            to.write_text(LINK.sub(lambda match: relinked(source, match[0]), source.read_text()))
        elif source.suffix == ".ipynb":
            text = LINK.sub(lambda match: relinked(source, match[0]), notebook(source, to))
            to.write_text(f"{WIDE}{text}\n[This notebook as a file]({source.name})\n")
        elif source.suffix in SHOWN:
            text = f"`````{SHOWN[source.suffix]}\n{source.read_text().rstrip()}\n`````\n"
            to.write_text(f"{UNLISTED}# {source.relative_to(root)}\n\n{text}")
        else:
            shutil.copyfile(source, to)


class Made(HTMLParser):
    """The anchors of a made page, its links, and the parts that a browser loads with it."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.parts: list[str] = []
        self.feed(page.read_text())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {name: value for name, value in attrs if value is not None}
        self.anchors.update(values[name] for name in ("id", "name") if name in values)
        loaded = tag == "link" and values.get("rel") not in ("canonical", "prev", "next")
        if "href" in values:
            (self.parts if loaded else self.links).append(values["href"])
        if "src" in values:
            self.parts.append(values["src"])


def faults(sources: Path, site: Path) -> list[str]:
    """What is wrong with the site made of these pages."""
    pages = {path: Made(path) for path in sorted(site.rglob("*.html")) if path.name != "404.html"}
    found = []
    for page, made in pages.items():
        name = page.relative_to(site)
        for link in made.links + made.parts:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                if link in made.parts and parts.scheme != "data":
                    found.append(f"{name} loads {link} from elsewhere")
                continue
            target = Path(os.path.normpath(page.parent / unquote(parts.path))) if parts.path else page
            if not target.is_file() and not (target / "index.html").is_file():
                found.append(f"{name}: there is no {link}")
            elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].anchors:
                found.append(f"{name}: {target.relative_to(site)} has no anchor for {link}")
    for sheet in sorted(site.rglob("*.css")):
        for url in re.findall(r"url\(['\"]?((?:https?:)?//[^)'\"]+)", sheet.read_text()):
            found.append(f"{sheet.relative_to(site)} loads {url} from elsewhere")
    listed = {os.path.normpath(site / urlsplit(link).path) for link in pages[site / "index.html"].links}
    for page in sorted(sources.rglob("*.md")):
        path = page.relative_to(sources)
        html = site / path.parent / ("index.html" if path.name == "README.md" else f"{path.stem}.html")
        if str(html) not in listed and not page.read_text().startswith(UNLISTED):
            found.append(f"{path} is not in the navigation: name it in docs/zensical.toml")
    return found


def main() -> int:
    match sys.argv[1:]:
        case ["pages", root, out]:
            stage(Path(root).resolve(), Path(out))
            return 0
        case ["check", out, site]:
            found = faults(Path(out), Path(site).resolve())
            print("\n".join(found), file=sys.stderr, end="\n" if found else "")
            return 1 if found else 0
    print(__doc__, file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
