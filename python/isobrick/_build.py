"""From a volume to a pyramid."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from . import _core
from ._arrays import ArrayVolume, ChunkReader, describe
from ._errors import Error
from ._progress import Progress, told_progress
from ._sizes import byte_size
from ._version import __version__

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class RawLayout:
    """How to read a file that has no header: ``shape`` is (z, y, x), ``offset`` counts bytes."""

    shape: tuple[int, int, int]
    dtype: str
    big_endian: bool = False
    offset: int = 0


@dataclass(frozen=True)
class BuildReport:
    """What a build did."""

    seconds: float
    #: What all threads spent in a phase, by its name; phases overlap.
    busy_seconds: dict[str, float]
    file_bytes: int
    bricks: int
    #: Voxels that were not finite and became ``nan_as``.
    replaced_voxels: int
    #: Every conversion on the way in, a line each.
    notes: list[str]


@dataclass
class _BuildSettings:
    out: str
    force: bool
    codec: str
    filter: str
    with_curvature: bool
    brick_cells: int
    nan_as: float | None
    memory_bytes: int
    threads: int
    progress: Any
    cancel: Any
    tool_version: str = __version__


@dataclass
class _FileInput:
    raw: RawLayout | None
    spacing: Triple | None
    origin: Triple | None
    series: str
    grid: str
    time: int | None
    channel: int | None
    component: int | None


@dataclass
class _ArrayDescription:
    voxels: tuple[int, int, int]
    spacing: Triple
    origin: Triple
    direction: tuple[float, ...]
    is_millimetres: bool
    source: str
    format: str
    type: str
    identity: str
    notes: list[str] = field(default_factory=list)


def build(
    source: Any,
    out: str | os.PathLike[str],
    *,
    spacing: Triple | None = None,
    origin: Triple | None = None,
    direction: Any = None,
    codec: str = "lz4",
    filter: str = "average",
    curvature: bool = True,
    brick_cells: int = 64,
    nan_as: float | None = None,
    memory: int | str = "512M",
    threads: int = 0,
    progress: Progress = None,
    cancel: _core.Cancel | None = None,
    force: bool = False,
    raw: RawLayout | None = None,
    series: str = "",
    grid: str = "",
    time: int | None = None,
    channel: int | None = None,
    component: int | None = None,
) -> BuildReport:
    """Builds the pyramid ``out`` (``.isb``) of a volume.

    Arrays are [z, y, x]: the last axis is x. ``spacing``, ``origin`` and the columns of ``direction`` are
    (x, y, z) in world units.

    ``source`` is a path of any format that the command reads (a folder of DICOM too, ``phantom:NAME:SIZE``),
    or an array with three axes: numpy of any strides and byte order, memmaps too; zarr, h5py, dask,
    tensorstore; xarray, whose evenly spaced coordinates become geometry; images of SimpleITK and ITK with
    theirs. numpy's memory is read where it lies. Everything else is read by whole chunks, several at once.

    uint8, int8, uint16, int16 and float32 stay what they are, bool becomes uint8, all other numbers float32.
    Voxels that are not finite are an error, unless ``nan_as`` is the value that takes their place.

    codec       'none', 'lz4' or 'zstd': how bricks are packed
    filter      'average' or 'subsample': from a level to the next coarser one
    curvature   stores bounds, so that ``extract`` may have a ``curvature``
    memory      what the build holds at most, with what it reads: bytes, or a text such as '256M'
    threads     0: all cores
    progress    True for a bar of tqdm, a bar, or a callable of (phase, fraction)
    force       replaces ``out`` if it exists
    raw, series, grid, time, channel, component
                of files: a layout without a header, and what to take from a file with several volumes

    The file appears under its name when it is whole; Ctrl-C, ``cancel`` and errors leave nothing.
    """
    name = os.fspath(out)
    memory_bytes = byte_size(memory)
    is_path = isinstance(source, (str, os.PathLike))
    volume = None if is_path else describe(source)
    with told_progress(progress, f"building {os.path.basename(name)}") as tell:
        settings = _BuildSettings(
            name, force, codec, filter, curvature, brick_cells, nan_as, memory_bytes, threads, tell, cancel
        )
        if volume is None:
            from . import _volumes

            if direction is not None:
                raise Error("a direction can be given for arrays only; files have their own")
            chosen = _FileInput(raw, spacing, origin, series, grid, time, channel, component)
            return BuildReport(**_volumes.build_file(os.fspath(source), chosen, settings))
        return BuildReport(**_build_array(volume, spacing, origin, direction, settings))


def _build_array(
    volume: ArrayVolume, spacing: Triple | None, origin: Triple | None, direction: Any, settings: _BuildSettings
) -> dict[str, Any]:
    place = volume.place
    if spacing is not None:
        place.spacing = spacing
    if origin is not None:
        place.origin = origin
    if direction is not None:
        place.direction = tuple(float(v) for v in np.asarray(direction, dtype=float).ravel())
    _check_place(place.spacing, place.origin, place.direction)
    type_ = f"{'u' if volume.dtype.kind == 'b' else volume.dtype.kind}{volume.dtype.itemsize}"
    delivered = np.dtype(_core.delivered_type(type_))
    if delivered != volume.dtype.newbyteorder("=") and volume.dtype.kind != "b":
        volume.notes.append(f"{volume.dtype.name} voxels were converted to {delivered.name}")
    nz, ny, nx = volume.shape
    description = _ArrayDescription(
        (nx, ny, nz), place.spacing, place.origin, place.direction, place.is_millimetres,
        volume.format if volume.memory is not None else volume.name or volume.format, volume.format, type_, "", volume.notes,
    )  # fmt: skip
    description.identity = (
        f"{volume.format} {volume.dtype.str} {volume.shape} {place.spacing} {place.origin} "
        f"{place.direction} {volume.name}"
    )
    if volume.memory is not None:
        array = volume.memory
        sz, sy, sx = array.strides
        is_swapped = not array.dtype.isnative
        return _core.build_strided(
            description, array.__array_interface__["data"][0], (sx, sy, sz), is_swapped, settings
        )
    reader = ChunkReader(volume, delivered, settings.memory_bytes)
    try:
        return _core.build_read(description, reader, reader.budget_bytes, settings)
    finally:
        reader.close()


def _check_place(spacing: Triple, origin: Triple, direction: tuple[float, ...]) -> None:
    if len(spacing) != 3 or not all(np.isfinite(spacing)) or min(spacing) <= 0:
        raise Error(f"the spacing {spacing} is not three finite numbers above 0, (x, y, z)")
    if len(origin) != 3 or not all(np.isfinite(origin)):
        raise Error(f"the origin {origin} is not three finite numbers, (x, y, z)")
    matrix = np.asarray(direction, dtype=float)
    if matrix.size != 9 or not np.allclose(matrix.reshape(3, 3).T @ matrix.reshape(3, 3), np.eye(3), atol=1e-4):
        raise Error("the direction is not a 3 x 3 matrix whose columns are at right angles and of length 1")
