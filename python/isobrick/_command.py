"""The command `isobrick`, which lies in the package."""

from __future__ import annotations

import ctypes
import os
import sys
from pathlib import Path

PROGRAMS = Path(__file__).parent / "_programs"
EXECUTABLE = PROGRAMS / "bin" / "isobrick"
#: In a wheel: a software OpenGL, and all that it needs.
DRAWING = PROGRAMS / "drawing"

_DRAWING_LIBRARIES = ("libEGL.so.1", "libOpenGL.so.0", "libGL.so.1", "libX11.so.6")


def _is_here(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def environment() -> dict[str, str]:
    """For the command: the system's own drawing libraries, or those of the wheel if there are none."""
    result = dict(os.environ)
    if DRAWING.exists() and not all(_is_here(library) for library in _DRAWING_LIBRARIES):
        former = result.get("LD_LIBRARY_PATH")
        result["LD_LIBRARY_PATH"] = f"{DRAWING}:{former}" if former else str(DRAWING)
        result.setdefault("__EGL_VENDOR_LIBRARY_FILENAMES", str(DRAWING / "mesa.json"))
        result.setdefault("LIBGL_DRIVERS_PATH", str(DRAWING))
    return result


def main() -> None:
    """Becomes the command."""
    if not EXECUTABLE.exists():
        sys.exit("isobrick: this installation of the Python package has no command; install the wheel")
    os.execve(EXECUTABLE, ["isobrick", *sys.argv[1:]], environment())
