"""The command `isobrick`, which lies in the package."""

from __future__ import annotations

import os
import sys
from pathlib import Path

EXECUTABLE = Path(__file__).parent / "_programs" / "bin" / "isobrick"


def main() -> None:
    """Becomes the command."""
    if not EXECUTABLE.exists():
        sys.exit("isobrick: this installation of the Python package has no command; install the wheel")
    os.execv(EXECUTABLE, ["isobrick", *sys.argv[1:]])
