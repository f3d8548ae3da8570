"""Runs a page of the documents as a reader does: its blocks of code, in order, in one folder and one shell.

    ```sh                     runs; the first command that fails fails the page
    ```python title="a.py"    becomes the file a.py (any language with a title)
    ```text                   after a ```sh: each of its lines is in what that block printed, in this order;
                              a line may have … for what differs from run to run
What follows <!-- runs first --> runs before the rest: how a reader without a scan gets one.
Other blocks are for reading alone.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
from contextlib import suppress
from pathlib import Path

_BLOCK = re.compile(r"^```(\w+)?(?: title=\"([^\"]+)\")?[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_FIRST = "<!-- runs first -->"


def _one_space(line: str) -> str:
    return " ".join(line.split())


def missing_line(expected: str, printed: str) -> str | None:
    """The first line of `expected` that does not come in `printed`, in order."""
    lines = iter([_one_space(line) for line in printed.splitlines()])
    for wanted in filter(None, map(_one_space, expected.splitlines())):
        if wanted == "…":
            continue
        pattern = re.compile(".*".join(re.escape(part) for part in wanted.split("…")))
        if not any(pattern.fullmatch(line) for line in lines):
            return wanted
    return None


def run_page(page: Path, folder: Path, environment: dict[str, str], seconds: float = 120) -> int:
    """Raises AssertionError with the place in the page; returns how many blocks ran."""
    text = page.read_text()
    first = text.index(_FIRST) if _FIRST in text else len(text)
    blocks = sorted(_BLOCK.finditer(text), key=lambda block: block.start() < first)
    outputs = [folder / f".output{number}" for number in range(len(blocks))]
    script = ["set -euo pipefail"]
    for block, output in zip(blocks, outputs, strict=True):
        output.unlink(missing_ok=True)
        language, title, code = block.groups()
        if title:
            source = output.with_name(output.name + ".source")
            source.write_text(code)
            script.append(f"mkdir -p \"$(dirname '{title}')\"; cp {source} '{title}'")
        elif language == "sh":
            script += [f"exec >{output} 2>&1", code]
    # A session of its own: servers that a page starts end with it.
    shell = subprocess.Popen(
        ["bash", "-c", "\n".join(script)], cwd=folder, env={**os.environ, **environment}, stdin=subprocess.DEVNULL,
        start_new_session=True,
    )  # fmt: skip
    try:
        why = "fails" if shell.wait(timeout=seconds) else ""
    except subprocess.TimeoutExpired:
        why = "takes too long"
    finally:
        with suppress(ProcessLookupError):
            os.killpg(shell.pid, signal.SIGKILL)
        shell.wait()
    last_printed = None
    ran = [number for number, output in enumerate(outputs) if output.exists()]
    for number, block in enumerate(blocks):
        place = f"{page}:{text.count(chr(10), 0, block.start()) + 1}"
        if why and number == ran[-1]:
            raise AssertionError(f"{place}: the block {why}:\n{block[3]}\n{outputs[number].read_text()}")
        if block[1] == "text" and not block[2] and last_printed is not None:
            missing = missing_line(block[3], last_printed)
            assert missing is None, f"{place}: not printed: {missing}\nbut:\n{last_printed}"
        if not block[2]:
            last_printed = outputs[number].read_text() if number in ran else None
    return len(ran)
