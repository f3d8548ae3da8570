"""An extension of griffe: the columns `name   what it is` of this module's docstrings become lists."""

from __future__ import annotations

import re
from typing import Any

import griffe

_ENTRY = re.compile(r"^([a-z_][\w, ]*?)(?:  +|(?<=super_brick) )(\S.*)$")
_NAMES = re.compile(r"^[a-z_]\w*(?:, [a-z_]\w*)*,?$")


def as_lists(text: str) -> str:
    """Lines `name   text`, and the indented ones that go on with them, as items of Markdown."""
    lines: list[str] = []
    in_list = False
    for line in text.splitlines():
        entry = _ENTRY.match(line)
        names = entry[1] if entry else line if _NAMES.match(line) and "," in line else None
        if names is not None and _NAMES.match(names):
            if not in_list and lines and lines[-1]:
                lines.append("")
            what = f": {entry[2]}" if entry else ":"
            lines.append("- " + ", ".join(f"`{name}`" for name in names.strip(",").split(", ")) + what)
            in_list = True
        elif in_list and line.startswith("  "):
            lines[-1] += " " + line.strip()
        else:
            in_list = False
            lines.append(line)
    return "\n".join(lines)


class ParameterLists(griffe.Extension):
    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        if obj.docstring:
            obj.docstring.value = as_lists(obj.docstring.value)
