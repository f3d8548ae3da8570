"""The command `isobrick`, which lies in the package, or else on PATH."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from . import _core
from ._errors import Error

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


def without_urls(paths: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """The words for these paths, and the environment that has the URLs among them: what a URL asks with may be a
    secret, and ``ps`` shows words to everybody.

    >>> without_urls(["a.isb", "https://example.org/b.isb?key=1"])
    (['a.isb', 'env:ISOBRICK_URL_1'], {'ISOBRICK_URL_1': 'https://example.org/b.isb?key=1'})
    """
    urls = {f"ISOBRICK_URL_{i}": path for i, path in enumerate(paths) if _core.is_remote_path(path)}
    names = {path: f"env:{name}" for name, path in urls.items()}
    return [names.get(path, path) for path in paths], urls


def _is_program(path: Path) -> bool:
    # Not the script of this package, which would look for the program again.
    if not os.access(path, os.X_OK) or not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(2) != b"#!"


def executable() -> Path:
    """The command. Raises Error if there is none."""
    folders = os.environ.get("PATH", os.defpath).split(os.pathsep)
    for path in [EXECUTABLE, *(Path(folder) / "isobrick" for folder in folders)]:
        if _is_program(path):
            return path
    raise Error(
        "there is no command isobrick beside this Python package nor on PATH; install the wheel of "
        "tools/build_wheel.sh, or the .deb"
    )


def main() -> None:
    """Becomes the command."""
    try:
        program = executable()
    except Error as error:
        sys.exit(f"isobrick: {error}")
    os.execve(program, ["isobrick", *sys.argv[1:]], environment())
