"""What the command does for Python: pictures, conversions, and pyramids of volumes."""

from __future__ import annotations

import json
import os
import re
import subprocess
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from ._command import environment, executable, without_urls
from ._errors import ArgumentError, error_of
from ._pyramid import Pyramid
from ._query import IN_SPACE

Source = Pyramid | str | os.PathLike[str]


def _word_of(value: Any) -> str:
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ",".join(map(_word_of, value))
    return os.fspath(value) if isinstance(value, os.PathLike) else str(value)


def words_of(options: Mapping[str, Any]) -> list[str]:
    """Options of the command: ``{"iso": [500, 1324], "cap": True, "select": {"time": 3}}`` are
    ``--iso=500,1324 --cap --select=time=3``. None and False leave one out; a list of lists gives it several times.

    >>> words_of({"iso": [500, 1324], "cap": True, "select": {"time": 3}, "level": None})
    ['--iso=500,1324', '--cap', '--select=time=3']
    """
    words: list[str] = []
    for name, value in options.items():
        option = "--" + name.replace("_", "-")
        if value is None or value is False:
            continue
        if value is True:
            words.append(option)
        elif isinstance(value, Mapping):
            words += [f"{option}={key}={one}" for key, one in value.items()]
        elif isinstance(value, list) and value and isinstance(value[0], (list, tuple)):
            words += [f"{option}={_word_of(one)}" for one in value]
        else:
            words.append(f"{option}={_word_of(value)}")
    return words


def _in_one_space(options: Mapping[str, Any]) -> dict[str, Any]:
    """Places by the command's names, voxels unless it has ``--world``.

    >>> _in_one_space({"focus": (75, 30, 75), "radius": 20, "azimuth": 40})
    {'focus': (75, 30, 75), 'radius': 20, 'azimuth': 40, 'world': True}
    >>> _in_one_space({"box_voxels": ((0, 0, 0), (9, 9, 9))})
    {'box': (0, 0, 0, 9, 9, 9)}
    """
    result: dict[str, Any] = {}
    in_world = set()
    for given, value in options.items():
        name = given.removesuffix("_voxels")
        if name in IN_SPACE and value is not None and not isinstance(value, str):
            if given == "simplify":
                raise ArgumentError("give simplify_voxels, or the distance with its unit as a text, '0.2mm'")
            if name != "simplify":
                in_world.add(given == name)
            if name == "box":
                value = tuple(np.ravel(value).tolist())
        result[name if name in IN_SPACE else given] = value
    if len(in_world) > 1:
        raise ArgumentError("some places are in world units and some in voxels; give all in one of them")
    return {**result, "world": True} if True in in_world else result


def run_command(command: str, inputs: Sequence[Source], options: Mapping[str, Any]) -> dict[str, Any]:
    """What ``isobrick COMMAND --json`` says."""
    paths, urls = without_urls([one.path if isinstance(one, Pyramid) else os.fspath(one) for one in inputs])
    words = [str(executable()), command, *words_of(options), "--json", "--", *paths]
    done = subprocess.run(
        words, env=environment() | urls, stdin=subprocess.DEVNULL, capture_output=True, text=True
    )  # fmt: skip
    said = [line.removeprefix("isobrick: ") for line in done.stderr.splitlines() if line.strip()]
    for line in said:
        if line.startswith("warning: "):
            warnings.warn(line.removeprefix("warning: "), RuntimeWarning, stacklevel=3)
    if done.returncode == 0:
        answer: dict[str, Any] = json.loads(done.stdout)
        return answer
    last = said[-1] if said else f"isobrick {command} ended with {done.returncode}"
    if done.returncode == 2:
        raise ArgumentError(last)
    named = re.search(r"'([^']+)'", last.removeprefix(f"'isobrick {command}' says: "))
    raise error_of(last, named[1] if named else None)


def facts_of_volume(path: str, folder: str, select: Mapping[str, Any] | None) -> dict[str, Any]:
    """Its grid, channels and times, whether it has a pyramid, beside it or in the cache, or not. Builds none."""
    answer = run_command("build", [path], {"into_cache": folder, "only_facts": True, "select": select})
    facts: dict[str, Any] = answer.get("facts") or answer
    return facts


@overload
def render(
    source: Source | Sequence[Source], isovalue: Any = ..., out: None = None, *, size: tuple[int, int] = ...,
    color: Any = ..., opacity: Any = ..., background: Any = ..., force: bool = ..., **options: Any,
) -> NDArray[np.uint8]: ...  # fmt: skip
@overload
def render(
    source: Source | Sequence[Source], isovalue: Any, out: str | os.PathLike[str], *, size: tuple[int, int] = ...,
    color: Any = ..., opacity: Any = ..., background: Any = ..., force: bool = ..., **options: Any,
) -> None: ...  # fmt: skip
def render(
    source: Source | Sequence[Source],
    isovalue: Any = "auto",
    out: str | os.PathLike[str] | None = None,
    *,
    size: tuple[int, int] = (1024, 1024),
    color: Any = None,
    opacity: Any = None,
    background: Any = None,
    force: bool = False,
    **options: Any,
) -> NDArray[np.uint8] | None:
    """A picture of surfaces: an array, or a file.

    It takes the command, which the wheel has, and for an array the package Pillow.

    Parameters
    ----------
    source
        a pyramid, or the path or URL of one or of a volume; or several, in one scene
    isovalue
        of the surface, or a list of several; 'auto': the first suggestion
    out
        a file, ``.png`` or ``.exr``; with ``frames``, ``folder/%04d.png`` or ``.mp4``
    size
        width and height in pixels
    color, opacity
        of the surface: "#ffcc88", a name or (r, g, b) from 0 to 1, and 0 to 1; of several a list, one of each
    background
        'dark', 'light', 'white', or a colour
    force
        replaces ``out`` if it exists
    **options
        all others of ``isobrick render`` by their names: ``azimuth=40``, ``scale_bar=True``. focus, radius, box, clip
        and sphere are (x, y, z) in world units, or all of them in voxels, ``focus_voxels=(150, 60, 150)``; simplify
        is ``simplify_voxels``. Texts are as the command takes them, "75,30,75mm"

    Returns
    -------
    numpy.ndarray
        (height, width, 3), sRGB, 8 bits; nothing if ``out`` is given
    """
    inputs = list(source) if isinstance(source, Sequence) and not isinstance(source, str) else [source]
    options = _in_one_space(options)
    given = {
        "iso": isovalue, "size": f"{size[0]}x{size[1]}", "background": background, "force": force,
        "color": [[one] if isinstance(one, str) else one for one in color] if isinstance(color, list) else color,
        "opacity": [[one] for one in opacity] if isinstance(opacity, list) else opacity, **options,
    }  # fmt: skip
    if "state" in options or "label" in options:
        del given["iso"]
    if out is not None:
        run_command("render", inputs, {**given, "output": out})
        return None
    try:
        from PIL import Image
    except ImportError as missing:
        raise ImportError("a picture as an array takes the package Pillow; install it, or give out=") from missing
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "picture.png"
        run_command("render", inputs, {**given, "output": file})
        with Image.open(file) as image:
            return np.asarray(image.convert("RGB"))


def convert(
    source: Source,
    out: str | os.PathLike[str],
    *,
    level: int | None = None,
    all_levels: bool = False,
    box_voxels: Sequence[Sequence[float]] | None = None,
    select: Mapping[str, Any] | None = None,
    force: bool = False,
    **options: Any,
) -> dict[str, Any]:
    """Writes a volume or a pyramid in another format, by the ending of ``out``: ``.nrrd``, ``.nii.gz``, ``.vdb``,
    ``.ome.zarr``, ``.h5``, ``.tif`` and more. It takes the command, which the wheel has.

    Parameters
    ----------
    source
        a pyramid, or the path or URL of one or of a volume
    out
        the file or folder to write; its ending is the format
    level, all_levels
        of a pyramid: this level, or all of them in one ``.vdb`` or ``.ome.zarr``
    box_voxels
        ((x, y, z), (x, y, z)): only these voxels of level 0, both corners included
    select
        which volume of several in the file: ``{"channel": 1, "time": 3}``
    force
        replaces ``out`` if it exists
    **options
        all others of ``isobrick convert`` by their names: ``type="u8", window=(0, 3000)``, ``zarr_version=2``

    Returns
    -------
    dict
        what ``isobrick convert --json`` says
    """
    if options.get("box") is not None:
        warnings.warn("box= of convert is box_voxels= now; the old name ends with version 0.4", FutureWarning, stacklevel=2)
        box_voxels = options.pop("box")
    corners = None if box_voxels is None else [*box_voxels[0], *box_voxels[1]]
    return run_command(
        "convert", [source],
        {"output": out, "level": level, "all_levels": all_levels, "box": corners, "select": select, "force": force,
         **options},
    )  # fmt: skip
