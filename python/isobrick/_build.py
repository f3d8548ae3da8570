"""From a volume to a pyramid."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from . import _core
from ._arrays import ArrayVolume, ChunkReader, content_sample, describe
from ._errors import ArgumentError
from ._progress import Progress, told_progress
from ._sizes import DEFAULT_MEMORY, byte_size
from ._version import __version__

Triple = tuple[float, float, float]


#: Of a unit of length.
MILLIMETRES = {"nm": 1e-6, "um": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1e3, "inch": 25.4}


@dataclass(frozen=True)
class RawLayout:
    """How to read a file that has no header: ``shape`` is (z, y, x), ``offset`` counts bytes."""

    shape: tuple[int, int, int]
    dtype: str
    big_endian: bool = False
    offset: int = 0


@dataclass(frozen=True)
class BuildReport:
    """The result of a build."""

    seconds: float
    #: The time that all threads spent in a phase, by its name; phases overlap.
    busy_seconds: dict[str, float]
    file_bytes: int
    bricks: int
    #: Voxels that were not finite and became ``nan_as``.
    replaced_voxels: int
    #: Every conversion on the way in, a line each.
    notes: list[str]
    #: Voxels without data: ``mask_nan``.
    missing_voxels: int = 0
    #: For a pyramid of many files (``.isbs``): files of super-bricks that were built, and that were there.
    super_bricks_built: int = 0
    super_bricks_up_to_date: int = 0
    #: The pyramids of ``channel="all"`` or ``time="all"``, in the order of the channels, step by step.
    outputs: tuple[str, ...] = ()


@dataclass(frozen=True)
class JoinReport:
    """The result of a join."""

    super_bricks: int
    #: In all levels and all files.
    bricks: int
    index_bytes: int
    #: The sum over all files, the index among them.
    file_bytes: int
    seconds: float


@dataclass(frozen=True)
class SuperBrick:
    """A file of a pyramid of many files."""

    number: int
    name: str
    #: The voxels of level 0 that no other one has: the first, and how many, [z, y, x].
    first: tuple[int, int, int]
    shape: tuple[int, int, int]


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
    super_cells: int = 0
    super_brick: int | None = None
    tool_version: str = __version__
    mask_nan: bool = False
    index: bool = False


@dataclass
class _FileInput:
    raw: RawLayout | None
    spacing: Triple | None
    origin: Triple | None
    series: str
    grid: str
    time: int | Literal["all"] | None
    channel: int | Literal["all"] | None
    image: int | None
    component: int | None
    label: int | None = None
    denoise: float = 0.0
    unit: str | None = None

    def __post_init__(self) -> None:
        if self.unit is not None and self.unit not in MILLIMETRES:
            raise ArgumentError(f"the unit {self.unit!r} is none of {', '.join(MILLIMETRES)}")
        if self.label is not None and not 0 <= self.label < 2**64:
            raise ArgumentError(f"the label {self.label} is not within 0 and 2**64 - 1")
        if not 0 <= self.denoise <= 10:
            raise ArgumentError(f"denoise={self.denoise} is not within 0 and 10 voxels")


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
    label: int | None = None
    denoise: float = 0.0
    #: Where the voxels lie: address, strides (x, y, z), and whether they have the other byte order.
    memory: tuple[int, tuple[int, int, int], bool] | None = None
    #: In its place, what gives boxes, and the bytes that it holds.
    read: Any = None
    buffer_bytes: int = 0


def build(
    source: Any,
    out: str | os.PathLike[str],
    *,
    spacing: Triple | None = None,
    origin: Triple | None = None,
    direction: Any = None,
    unit: str | None = None,
    codec: str = "lz4",
    filter: str = "average",
    curvature: bool = True,
    brick_cells: int = 64,
    nan_as: float | None = None,
    mask_nan: bool = False,
    memory: int | str = DEFAULT_MEMORY,
    threads: int = 0,
    progress: Progress = None,
    cancel: _core.Cancel | None = None,
    force: bool = False,
    raw: RawLayout | None = None,
    series: str = "",
    grid: str = "",
    time: int | Literal["all"] | None = None,
    channel: int | Literal["all"] | None = None,
    image: int | None = None,
    component: int | None = None,
    label: int | None = None,
    denoise: float = 0.0,
    super_brick: int = 2048,
    part: tuple[int, int] | None = None,
    index: bool = False,
) -> BuildReport:
    """Builds the pyramid ``out`` (``.isb``) of a volume; one whose name ends with ``.isbs`` is a folder of many
    files, which several processes may build together.

    Arrays are [z, y, x]: the last axis is x. ``spacing``, ``origin`` and the columns of ``direction`` are
    (x, y, z) in world units.

    ``source`` is a path of any format that the command reads (a folder of DICOM too, ``phantom:NAME:SIZE``),
    or an array with three axes: numpy of any strides and byte order, memmaps too; zarr, h5py, dask,
    tensorstore; xarray, whose evenly spaced coordinates become geometry; images of SimpleITK and ITK with
    theirs. numpy's memory is read where it lies. Everything else is read by whole chunks, several at once.

    uint8, int8, uint16, int16 and float32 stay what they are, bool becomes uint8. Other integers whose range fits
    16 bits are stored so, less an offset, and all other numbers as float32 around an offset: they are read once
    more for that, and a note says how many values change, and by how much at most.
    Voxels that are not finite are an error, unless ``nan_as`` is the value that takes their place, or, of NaN,
    ``mask_nan`` is set: then they have no data, and surfaces are open beside them (not in a ``.isbs``).

    The file appears under its name when it is whole; Ctrl-C, ``cancel`` and errors leave nothing.

    Parameters
    ----------
    source
        a path or an array, as above
    out
        the pyramid's name
    spacing, origin, direction
        the place of the voxels in the world, in place of what ``source`` says; a direction of arrays only
    unit
        of spacing and origin, and of the lengths in a file, whatever it says: 'nm', 'um', 'mm', 'cm', 'm' or 'inch';
        lengths become millimetres
    codec
        'none', 'lz4' or 'zstd': how bricks are packed
    filter
        'average' or 'subsample': from a level to the next coarser one
    curvature
        stores bounds, so that ``extract`` may have a ``curvature``
    brick_cells
        cells along an edge of a brick, a power of two from 4 to 256
    nan_as, mask_nan
        what becomes of voxels that are not finite, as above
    memory
        what the build holds at most, with what it reads: bytes, or a text such as '256M'
    threads
        0: all cores
    progress
        True for a bar of tqdm, a bar, or a callable of (phase, fraction)
    cancel
        ends the build when its ``request()`` is called
    force
        replaces ``out`` if it exists; of ``.isbs``: builds files again that are there. Without it those of the
        same source stay: an array is known by its name and some of its voxels
    raw, series, grid, time, channel, image, component
        of files: a layout without a header, and what to take from a file with several volumes. 'all' channels or times
        are a pyramid each, with ``{channel}`` and ``{time}`` in ``out`` for their names: the command builds them, which
        the wheel has; those that are up to date stay
    label
        of integers: 1 where a voxel is this label and 0 elsewhere, in place of the volume, compared exactly up to
        2**64 - 1; the surface at 0.5 is that of the label
    denoise
        smooths the volume, or the label, first: the sigma of a Gaussian in voxels, at most 10, that is sharpened so
        that round shapes keep their size; the pyramid is float32. 0: not at all. A file may be a pyramid then, or with
        ``label``: its finest level is taken
    super_brick
        of ``.isbs``: cells along an edge of what one file holds, a power of two
    part
        of ``.isbs``: (i, n), only share i of n shares of the files, i from 1, in any order and on any machine;
        files that are there stay. ``join`` makes the index. Without it all are built and joined
    index
        of files: leaves the finest level where it is, in ``source``, and stores the rest beside it, in a seventh of
        the bytes. All that takes a pyramid takes it, as long as the source is there and does not change; one in the
        folder of ``out``, or below it, may move with it. Of OME-Zarr (behind a URL too), raw files, NRRD, TIFF and
        VTI without packing, and VDB
    """
    name = os.fspath(out)
    if "all" in (time, channel):
        return _build_each(source, name, locals())
    is_divided = name.rstrip("/").endswith(".isbs")
    if part is not None and not is_divided:
        raise ArgumentError("a part is of a pyramid of many files; name it with the ending .isbs")
    if index and not isinstance(source, (str, os.PathLike)):
        raise ArgumentError("an index leaves its finest level in a file; save the array, or build without index=True")
    with told_progress(progress, f"building {os.path.basename(name.rstrip('/'))}") as tell:
        builder = _Builder(
            source, direction,
            _FileInput(
                raw, spacing, origin, series, grid, time, channel, image, component,
                None if label is None else int(label), float(denoise), unit,
            ),
            _BuildSettings(
                name, force, codec, filter, curvature, brick_cells, nan_as, byte_size(memory), threads, tell, cancel,
                super_brick if is_divided else 0, mask_nan=mask_nan, index=index,
            ),
        )  # fmt: skip
        if not is_divided:
            return builder.build()
        report = builder.build_part(part or (1, 1))
    if part is None:
        join(name, memory=memory, threads=threads, progress=progress, cancel=cancel)
    return report


def _build_each(source: Any, out: str, arguments: dict[str, Any]) -> BuildReport:
    """A pyramid of each channel or time, by the command. ``arguments``: of ``build``."""
    from ._by_command import run_command

    if not isinstance(source, (str, os.PathLike)):
        raise ArgumentError("'all' channels and times are those of a file; build one pyramid of each array")
    for name in ("raw", "direction", "part", "progress", "cancel"):
        if arguments[name] is not None:
            raise ArgumentError(f"{name} does not go with 'all' channels or times; leave it out, or choose one")
    selected = {name: arguments[name] for name in ("series", "grid", "time", "channel", "image", "component")}
    same = ("spacing", "origin", "codec", "filter", "nan_as", "mask_nan", "memory", "force", "label", "index")
    options = {
        "output": out, "select": {key: value for key, value in selected.items() if value not in (None, "")},
        "no_curvature": not arguments["curvature"], "brick": arguments["brick_cells"],
        "denoise": arguments["denoise"] or None, "threads": arguments["threads"] or None,
        "input_unit": arguments["unit"],
        **{name: arguments[name] for name in same},
    }  # fmt: skip
    done = run_command("build", [source], options)
    return replace(
        _sum_of([(True, BuildReport(
            one["seconds"]["total"], {name: phase["busy_seconds"] for name, phase in one["phases"].items()},
            one["bytes"]["total"], one["bricks"], 0, one["notes"],
        )) for one in done["volumes"]]),
        super_bricks_built=0, outputs=tuple(one["output"] for one in done["volumes"]),
    )  # fmt: skip


def join(
    folder: str | os.PathLike[str],
    *,
    memory: int | str = DEFAULT_MEMORY,
    threads: int = 0,
    progress: Progress = None,
    cancel: _core.Cancel | None = None,
) -> JoinReport:
    """Makes the coarser levels and the index of a pyramid of many files (``.isbs``), whose super-bricks are all
    there; after that ``isobrick.open`` opens it. May be repeated. Raises Error that names files that are missing,
    damaged, or of another build.

    Parameters
    ----------
    folder
        the ``.isbs``
    memory
        what the call holds at most: bytes, or a text such as '256M'
    threads
        0: all cores
    progress
        True for a bar of tqdm, a bar, or a callable of (phase, fraction)
    cancel
        ends the call when its ``request()`` is called
    """
    with told_progress(progress, f"joining {os.path.basename(os.fspath(folder))}") as tell:
        return JoinReport(**_core.join(os.fspath(folder), byte_size(memory), threads, tell, cancel))


class _Builder:
    """A volume, and how its pyramid is built."""

    def __init__(self, source: Any, direction: Any, chosen: _FileInput, settings: _BuildSettings) -> None:
        self._path = os.fspath(source) if isinstance(source, (str, os.PathLike)) else None
        self._volume = None if self._path is not None else describe(source)
        if self._path is not None and direction is not None:
            raise ArgumentError("a direction can be given for arrays only; files have their own")
        self._direction = direction
        self._chosen = chosen
        self._settings = settings

    def build(self) -> BuildReport:
        facts = self._run(self._settings)
        del facts["was_built"]
        return BuildReport(**facts)

    def super_bricks(self) -> list[SuperBrick]:
        """All of them, in the order of their numbers."""
        if self._path is not None:
            from . import _volumes

            found = _volumes.super_bricks(self._path, self._chosen, self._settings)
        else:
            assert self._volume is not None
            found = _core.super_bricks(
                _describe_array(self._volume, self._chosen, self._direction)[0], self._settings
            )
        return [
            SuperBrick(number, name, (f[2], f[1], f[0]), (n[2], n[1], n[0]))
            for number, (name, f, n) in enumerate(found)
        ]

    def build_super_brick(self, number: int, progress: Any = None) -> tuple[bool, BuildReport]:
        """Builds it unless it is there. Returns whether it was built, too."""
        facts = self._run(replace(self._settings, super_brick=number, progress=progress))
        was_built = facts.pop("was_built")
        return was_built, BuildReport(**facts)

    def build_part(self, part: tuple[int, int]) -> BuildReport:
        number, of = part
        if not 1 <= number <= of:
            raise ArgumentError(f"there is no part {number} of {of}; they count from 1")
        bricks = self.super_bricks()
        mine = bricks[len(bricks) * (number - 1) // of : len(bricks) * number // of]
        os.makedirs(self._settings.out, exist_ok=True)
        reports: list[tuple[bool, BuildReport]] = []
        tell = self._settings.progress
        for done, brick in enumerate(mine):
            step = None
            if tell is not None:

                def step(phase: str, fraction: float, done: int = done) -> None:
                    tell(phase, (done + fraction) / len(mine))

            reports.append(self.build_super_brick(brick.number, step))
        return _sum_of(reports)

    def _run(self, settings: _BuildSettings) -> dict[str, Any]:
        if self._path is not None:
            from . import _volumes

            return _volumes.build_file(self._path, self._chosen, settings)
        assert self._volume is not None
        with readable_array(self._volume, self._chosen, self._direction, settings.memory_bytes) as described:
            return _core.build_array(described, settings)


def _sum_of(reports: list[tuple[bool, BuildReport]]) -> BuildReport:
    busy: dict[str, float] = {}
    notes: list[str] = []
    for _, report in reports:
        for phase, seconds in report.busy_seconds.items():
            busy[phase] = busy.get(phase, 0.0) + seconds
        notes += [note for note in report.notes if note not in notes]
    built = sum(was_built for was_built, _ in reports)
    return BuildReport(
        sum(r.seconds for _, r in reports), busy, sum(r.file_bytes for _, r in reports),
        sum(r.bricks for _, r in reports), sum(r.replaced_voxels for _, r in reports), notes,
        super_bricks_built=built, super_bricks_up_to_date=len(reports) - built,
    )  # fmt: skip


def _describe_array(
    volume: ArrayVolume, chosen: _FileInput, direction: Any, identify: bool = True
) -> tuple[_ArrayDescription, np.dtype[Any]]:
    """The facts of an array for the library, and the type in which its voxels come. ``identify``: a text too that
    differs for arrays that differ, from some voxels."""
    place = replace(volume.place)
    if chosen.spacing is not None:
        place.spacing = chosen.spacing
    if chosen.origin is not None:
        place.origin = chosen.origin
    if direction is not None:
        place.direction = tuple(float(v) for v in np.asarray(direction, dtype=float).ravel())
    if chosen.unit is not None:
        scale = MILLIMETRES[chosen.unit]
        place.spacing = (scale * place.spacing[0], scale * place.spacing[1], scale * place.spacing[2])
        place.origin = (scale * place.origin[0], scale * place.origin[1], scale * place.origin[2])
        place.is_millimetres = True
    _check_place(place.spacing, place.origin, place.direction)
    type_ = f"{'u' if volume.dtype.kind == 'b' else volume.dtype.kind}{volume.dtype.itemsize}"
    delivered = np.dtype(_core.delivered_type(type_))
    notes = list(volume.notes)
    if delivered != volume.dtype.newbyteorder("=") and volume.dtype.kind != "b":
        notes.append(f"{volume.dtype.name} voxels were converted to {delivered.name}")
    nz, ny, nx = volume.shape
    description = _ArrayDescription(
        (nx, ny, nz), place.spacing, place.origin, place.direction, place.is_millimetres,
        volume.format if volume.memory is not None else volume.name or volume.format, volume.format, type_, "", notes,
        chosen.label, chosen.denoise,
    )  # fmt: skip
    if not identify:
        return description, delivered
    description.identity = (
        f"{volume.format} {volume.dtype.str} {volume.shape} {place.spacing} {place.origin} "
        f"{place.direction} {volume.name} {content_sample(volume)}"
    )
    return description, delivered


@contextmanager
def readable_array(
    volume: ArrayVolume, chosen: _FileInput, direction: Any, memory_bytes: int, identify: bool = True
) -> Iterator[_ArrayDescription]:
    """The facts of an array, and what the library reads it by as long as it has them."""
    description, delivered = _describe_array(volume, chosen, direction, identify)
    if volume.memory is not None:
        array = volume.memory
        sz, sy, sx = array.strides
        description.memory = array.__array_interface__["data"][0], (sx, sy, sz), not array.dtype.isnative
        yield description
        return
    reader = ChunkReader(volume, delivered, memory_bytes)
    description.read, description.buffer_bytes = reader, reader.budget_bytes
    try:
        yield description
    finally:
        reader.close()


def _check_place(spacing: Triple, origin: Triple, direction: tuple[float, ...]) -> None:
    if len(spacing) != 3 or not all(np.isfinite(spacing)) or min(spacing) <= 0:
        raise ArgumentError(f"the spacing {spacing} is not three finite numbers above 0, (x, y, z)")
    if len(origin) != 3 or not all(np.isfinite(origin)):
        raise ArgumentError(f"the origin {origin} is not three finite numbers, (x, y, z)")
    matrix = np.asarray(direction, dtype=float)
    if matrix.size != 9 or not np.allclose(matrix.reshape(3, 3).T @ matrix.reshape(3, 3), np.eye(3), atol=1e-4):
        raise ArgumentError("the direction is not a 3 x 3 matrix whose columns are at right angles and of length 1")
