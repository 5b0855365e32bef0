#!/usr/bin/env python3
"""Prints a page of the reference, what the docstrings of the installed package say; scripts/reference.sh writes all pages."""

import importlib.util
import inspect
import re

HEAD = """# The Python package

Printed by `scripts/python_reference.py`. The guide is [docs/python.md](../python.md). Shapes are in brackets; lengths are metres, masses kilograms, angles radians;
`workspace_from_grasp` maps a grasp's coordinates to the workspace.
"""
SECTIONS = ("Args:", "Attributes:", "Returns:", "Raises:")


def described(text: str) -> str:
    """A docstring as Markdown: its sections become lists."""
    lines, section = [], ""
    for line in inspect.cleandoc(text).splitlines():
        line = re.sub(r":(?:class|func|meth|data):`~?([^`]*)`", r"`\1`", line.replace("``", "`"))
        if line in SECTIONS:
            section = line
            lines.extend([f"*{line[:-1]}*", ""])
        elif section and (entry := re.match(r" {4}(\*{0,2}\w+): (.*)", line)) and section != "Returns:":
            lines.append(f"- `{entry[1]}`: {entry[2]}")
        elif section and line.startswith("    "):
            lines.append(("  " if section != "Returns:" else "") + line.strip())
        else:
            section = "" if line else section
            lines.append(line)
    return "\n".join(lines).strip()


def signature(name: str, value: object) -> str:
    text = re.sub(r"'([\w\[\]|., ]+)'", r"\1", str(inspect.signature(value)))
    text = re.sub(r"\((?:self|cls)(?:, )?", "(", text, count=1)
    return f"{name}{text}".replace("'", "").replace('"', "").removesuffix(" -> None")


def members(value: type) -> list[str]:
    """Methods and properties that have docstrings, of a class and of what it extends in the package."""
    blocks, found = [], {}
    for one in reversed([base for base in value.__mro__ if base.__module__.startswith("graspmill")]):
        found |= vars(one)
    for name, member in found.items():
        is_own = not name.startswith("_") and getattr(member, "__doc__", None)
        if not is_own or name == "exit_code":
            continue
        if isinstance(member, property) or type(member).__name__ == "cached_property":
            blocks.append(f"**`{name}`** – {described(member.__doc__)}")
        else:
            function = getattr(member, "__func__", member)
            if inspect.isfunction(function):
                blocks.append(f"**`{signature(name, function)}`**\n\n{described(function.__doc__)}")
    return blocks


def page(module_name: str) -> str:
    if module_name == "graspmill.torch" and importlib.util.find_spec("torch") is None:
        return f"## {module_name}\n\nLeft out: PyTorch was missing where this page was made."
    module = importlib.import_module(module_name)
    blocks = [f"## {module_name}"]
    for name in module.__all__:
        value = getattr(module, name)
        if inspect.isclass(value):
            is_error = issubclass(value, Exception)
            is_made = value.__init__ is not object.__init__ and not is_error and "TypedDict" not in str(type(value))
            shown = signature(name, value.__init__) if is_made else name
            shown = name if "_native" in shown else shown  # only the package makes it
            blocks.extend([f"### {name}", f"`{shown}`", described(value.__doc__), *members(value)])
        elif callable(value):
            blocks.extend([f"### {name}", f"`{signature(name, value)}`", described(value.__doc__)])
        else:
            blocks.extend([f"### {name}", f"`{value!r}`"])
    return "\n\n".join(blocks)


if __name__ == "__main__":
    print("\n\n".join([HEAD.strip(), *map(page, ("graspmill", "graspmill.descriptions", "graspmill.torch"))]))
