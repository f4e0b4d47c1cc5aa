"""Reads our docstrings, which are written to be read as they are, as what autodoc expects: reStructuredText."""

import dataclasses
import inspect
import re
from typing import Any

from sphinx.application import Sphinx

FIELDS = {"Args:": "param", "Raises:": "raises"}  # sections, and what reStructuredText calls each of their entries


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the extension with Sphinx."""
    app.connect("autodoc-process-docstring", _process)
    app.connect("autodoc-skip-member", _skip)
    return {"parallel_read_safe": True}


def _process(app: Sphinx, what: str, name: str, value: Any, options: object, lines: list[str]) -> None:
    del app, name, options
    lines[:] = restructured(lines)
    if what == "class":
        lines.extend(["", *(f":ivar {field}: {inline(told)}" for field, told in fields_of(value)), ""])


def _skip(app: Sphinx, what: str, name: str, value: object, skip: bool, options: object) -> bool | None:
    """Leaves out the fields of named tuples, which stand with the class."""
    del app, what, name, skip, options
    return True if (inspect.getdoc(value) or "").startswith("Alias for field number") else None


def fields_of(kind: Any) -> list[tuple[str, str]]:
    """Returns the fields of a dataclass or a named tuple, each with the comment beside it; empty of other classes."""
    names = [each.name for each in dataclasses.fields(kind)] if dataclasses.is_dataclass(kind) else []
    names = names or list(getattr(kind, "_fields", ()))
    if not names:
        return []
    lines = [line for each in kind.__mro__[:-1] if each is not tuple for line in inspect.getsource(each).splitlines()]
    found = []
    for name in names:
        there = next((line for line in lines if re.match(rf"    {name}: ", line)), "")
        found.append((name, there.partition("  # ")[2] or there.partition(": ")[2].partition(" = ")[0]))
    return found


def restructured(lines: list[str]) -> list[str]:
    """Returns a docstring with code in double backticks, formulas set apart as blocks, and sections as fields."""
    found: list[str] = []
    field = ""
    block = False
    for k, line in enumerate(lines):
        if line.strip() and not line.startswith(" "):
            field, block = FIELDS.get(line, ""), False
            if field:
                continue
        if field and line.startswith("    "):
            entry = re.match(r"    (\*{0,2}\w+(?:, \w+)*): (.*)", line)
            if entry:
                names = entry[1].lstrip("*").split(", ")
                found.extend(f":{field} {name}: {inline(entry[2])}" for name in names)
            else:
                found.append(f"    {inline(line.strip())}")
            continue
        apart = line.startswith("    ") and (block or k == 0 or not lines[k - 1].strip())
        if apart and not block:
            found.extend(["::", ""])
        block = apart or (block and not line.strip())
        found.append(line if block else inline(line))
    return found


def inline(line: str) -> str:
    """Returns a line of text whose single backticks are code and whose other marks mean nothing."""
    parts = line.split("`")
    for k, part in enumerate(parts):
        if k % 2:
            parts[k] = f"``{part}``"
        else:
            bullet = re.match(r"\s*\* ", part) if k == 0 else None
            head = bullet[0] if bullet else ""
            parts[k] = head + re.sub(r"([*|])|_(?=\W|$)", lambda mark: "\\" + mark[0], part[len(head) :])
    return "".join(parts)
