"""Runs a page of the documents as a reader does: its blocks of code, in order, in one folder and one shell.

    ```sh                     runs; the first command that fails fails the page
    ```python title="a.py"    becomes the file a.py (any language with a title)
    ```text                   after a ```sh: each of its lines is in what that block printed, in this order;
                              a line may have … for what differs from run to run
Other blocks are for reading alone.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
from dataclasses import dataclass
from pathlib import Path

_BLOCK = re.compile(r"^```(\w+)?(?: title=\"([^\"]+)\")?[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@dataclass
class Block:
    language: str
    title: str
    text: str
    line: int


def blocks_of(page: Path) -> list[Block]:
    text = page.read_text()
    return [
        Block(found[1] or "", found[2] or "", found[3], text.count("\n", 0, found.start()) + 1)
        for found in _BLOCK.finditer(text)
    ]


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
    blocks = blocks_of(page)
    script = ["set -euo pipefail"]
    for number, block in enumerate(blocks):
        if block.title:
            (folder / ".blocks").mkdir(exist_ok=True)
            (folder / ".blocks" / str(number)).write_text(block.text)
            script.append(f"mkdir -p \"$(dirname '{block.title}')\"; cp .blocks/{number} '{block.title}'")
        elif block.language == "sh":
            script += [f"exec >.output{number} 2>&1; echo {number} >.at", block.text]
    script.append("echo end >.at")
    # A session of its own: servers that a page starts end with it.
    shell = subprocess.Popen(
        ["bash", "-c", "\n".join(script)],
        cwd=folder,
        env={**os.environ, **environment},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        shell.wait(timeout=seconds)
    except subprocess.TimeoutExpired:
        pass
    finally:
        try:
            os.killpg(shell.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        shell.wait()
    at = (folder / ".at").read_text().strip() if (folder / ".at").exists() else "start"
    if at != "end":
        block = blocks[int(at)]
        printed = (folder / f".output{at}").read_text()
        why = "takes too long" if shell.returncode == -signal.SIGKILL else "fails"
        raise AssertionError(f"{page}:{block.line}: the block {why}:\n{block.text}\n{printed}")
    ran = 0
    last_printed = None
    for number, block in enumerate(blocks):
        if block.title:
            continue
        if block.language == "sh":
            ran += 1
            last_printed = (folder / f".output{number}").read_text()
        elif block.language == "text" and last_printed is not None:
            missing = missing_line(block.text, last_printed)
            assert missing is None, f"{page}:{block.line}: not printed: {missing}\nbut:\n{last_printed}"
            last_printed = None
        else:
            last_printed = None
    return ran
