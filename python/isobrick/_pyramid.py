"""Open pyramids and queries."""

from __future__ import annotations

import json
import os
import re
import weakref
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Any, Literal, Unpack

import numpy as np
from numpy.typing import NDArray

from . import _core
from ._attributes import Colors
from ._awaiting import awaited
from ._errors import ArgumentError, Error, RangeError
from ._level import Level
from ._mesh import Mesh
from ._progress import Progress, told_progress
from ._query import (
    Choice,
    ExtractReport,
    Isovalue,
    Query,
    Space,
    Triple,
    _QuerySettings,
    make_report,
    placement_of,
    query_of,
    settings_of,
)
from ._sizes import byte_size

_alive: weakref.WeakSet[Pyramid | Session] = weakref.WeakSet()


def _abandon_all() -> None:
    for held in list(_alive):
        held._abandon()


# A child of fork() has neither the threads nor the locks of its parent's pyramids.
os.register_at_fork(after_in_child=_abandon_all)


def _whole_path(path: str) -> str:
    # Absolute, so that it is the same file after a change of folder, and in other processes.
    return path if _core.is_remote_path(path) or path.startswith("phantom:") else os.path.abspath(path)


def _default_cache_folder() -> str:
    base = os.environ.get("XDG_CACHE_HOME", "")
    return os.path.join(base if os.path.isabs(base) else os.path.expanduser("~/.cache"), "isobrick")


@dataclass(frozen=True)
class RemoteCounters:
    """The work of the network for an open pyramid."""

    requests: int
    #: Of these, those that were sent again.
    repeated: int
    #: That the server sent, without headers.
    bytes: int
    #: That came from the cache folder instead.
    cached_parts: int
    cached_bytes: int


@dataclass(frozen=True)
class Histogram:
    """How often which values occur among the voxels of level 0: bins that have any, in ascending order."""

    #: Least and greatest value of each bin; of integer types one value.
    least: NDArray[np.floating[Any]]
    greatest: NDArray[np.floating[Any]]
    counts: NDArray[np.uint64]


@dataclass(frozen=True)
class Suggestion:
    """An isovalue that shows something."""

    value: float
    #: Lattice edges that the surface crosses, estimated; 0: not known.
    area: float
    #: Their mean difference of values; 0: not known.
    gradient: float


@dataclass(frozen=True)
class Damage:
    """A fault of a pyramid; ``level`` and ``brick``, (x, y, z), are None outside of bricks."""

    level: int | None
    brick: tuple[int, int, int] | None
    what: str


@dataclass(frozen=True)
class MergeReport:
    """The result of a merge of shares."""

    shares: int
    triangles: int
    vertices: int


def merge(
    shares: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    zlib: bool = False,
    meshopt: bool = False,
    space: Space = "LPS",
    unit: str | None = None,
    shift: Sequence[float] = (0, 0, 0),
    force: bool = False,
    threads: int = 0,
    cancel: _core.Cancel | None = None,
) -> MergeReport:
    """Joins the shares of a surface to one closed mesh file, in bounded memory: the bytes of one ``extract_to``. A
    missing or foreign share is an Error that names it.

    Parameters
    ----------
    shares
        all ``.isbm`` of the surface, in any order
    out
        the mesh; its ending is the format
    zlib, meshopt, space, unit, shift
        as for ``Mesh.save``
    force
        replaces ``out`` if it exists
    threads
        0: all cores
    cancel
        ends the call when its ``request()`` is called
    """
    paths = [os.fspath(share) for share in shares]
    placement = placement_of(space, unit, shift)
    return MergeReport(**_core.merge_shares(paths, os.fspath(out), zlib, meshopt, placement, force, threads, cancel))


class Pyramid:
    """An open pyramid, a context manager. Open one with ``isobrick.open``.

    >>> report = isobrick.build("phantom:sphere:32", "sphere.isb")
    >>> with isobrick.open("sphere.isb") as pyramid:
    ...     mesh = pyramid.extract(0)
    >>> pyramid
    <isobrick.Pyramid '...sphere.isb', closed>
    >>> mesh.check().is_solid
    True

    Arrays are [z, y, x]; points, focus, spacing and origin are (x, y, z) in world units. May be used by any
    number of threads. Pickles as its path: a copy in another process opens the file itself, and so does a
    child of fork().
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        memory: int | str = "1G",
        mmap: bool = True,
        cache_folder: str | os.PathLike[str] | None = None,
        cache_size: int | str = 0,
    ) -> None:
        self._closed = False
        self._path = _whole_path(os.fspath(path))
        self._memory_bytes = byte_size(memory)
        self._mmap = mmap
        self._cache_bytes = byte_size(cache_size) if cache_size else 0
        self._cache_folder = ""
        if self._cache_bytes:
            self._cache_folder = os.path.abspath(os.fspath(cache_folder or _default_cache_folder()))
        self._opened: _core.PyramidHandle | None = None
        self._shown = self._handle.path()  # opens the file; of a URL without keys and passwords
        _alive.add(self)

    @property
    def _handle(self) -> _core.PyramidHandle:
        if self._closed:
            raise Error("the pyramid is closed; open it again with isobrick.open()", path=self._path)
        if self._opened is None:
            self._opened = _core.PyramidHandle(
                self._path, self._memory_bytes, self._mmap, self._cache_folder, self._cache_bytes
            )
        return self._opened

    def _abandon(self) -> None:
        if self._opened is not None:
            self._opened.abandon()
            self._opened = None

    def close(self) -> None:
        """Gives the file up. Meshes and bricks that are still held stay what they are."""
        if self._opened is not None:
            self._opened.close()
        self._opened = None
        self._closed = True

    def __enter__(self) -> Pyramid:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __reduce__(self) -> tuple[Any, ...]:
        return Pyramid, (self._path, self._memory_bytes, self._mmap, self._cache_folder, self._cache_bytes)

    def __repr__(self) -> str:
        if self._closed:
            return f"<isobrick.Pyramid '{self._shown}', closed>"
        return f"<isobrick.Pyramid '{self._shown}': {self.shape} {self.dtype}>"

    @property
    def path(self) -> str:
        """The absolute path of the file; or the URL."""
        return self._path

    @property
    def remote_counters(self) -> RemoteCounters:
        """The work of the network so far; all zero for a local file."""
        return RemoteCounters(*self._handle.remote_counters())

    @property
    def shape(self) -> tuple[int, int, int]:
        """Voxels of level 0, (z, y, x)."""
        x, y, z = self._handle.voxels()
        return z, y, x

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of the values in arrays: one that holds them, if bricks store them in another one with an offset."""
        scale, offset = self._handle.stored_values()
        stored = np.dtype(self._handle.voxel_type())
        if (scale, offset) == (1, 0):
            return stored
        if scale != 1 or offset != int(offset) or stored.kind == "f":
            return np.dtype(np.float64)
        least, greatest = self.value_range
        for name in ("int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64"):
            if np.iinfo(name).min <= least and greatest <= np.iinfo(name).max:
                return np.dtype(name)
        return np.dtype(np.float64)

    def _values_of(self, stored: NDArray[Any]) -> NDArray[Any]:
        """The values of samples as bricks store them."""
        scale, offset = self._handle.stored_values()
        if (scale, offset) == (1, 0):
            return stored
        if self.dtype.kind == "f":
            return stored.astype(np.float64) * scale + offset
        # Through all 64 bits, which wrap as the type does.
        return (stored.astype(np.int64) + np.int64((int(offset) + 2**63) % 2**64 - 2**63)).astype(self.dtype)

    @property
    def spacing(self) -> Triple:
        """From a voxel to the next, (x, y, z), in world units."""
        return self._handle.spacing()

    @property
    def origin(self) -> Triple:
        """The place of voxel (0, 0, 0), (x, y, z), in world units."""
        return self._handle.origin()

    @property
    def affine(self) -> NDArray[np.float64]:
        """4 x 4: from voxel indices (i, j, k) to (x, y, z) in world units, LPS as ITK and DICOM have it."""
        return np.array(self._handle.affine(), dtype=np.float64).reshape(4, 4)

    @property
    def unit(self) -> str:
        """The unit of the world: 'millimetres' or 'unknown'."""
        return self._handle.unit()

    @property
    def value_range(self) -> tuple[float, float]:
        """Least and greatest voxel."""
        return self._handle.value_range()

    @property
    def has_curvature(self) -> bool:
        """Whether queries may have a ``curvature``."""
        return self._handle.has_curvature()

    @property
    def noise(self) -> float:
        """Standard deviation of the voxels' noise, in their units; 0: none."""
        return self._handle.noise()

    @property
    def file_bytes(self) -> int:
        return self._handle.file_bytes()

    @property
    def provenance(self) -> dict[str, Any]:
        """Source, filter, version of the tool, notes."""
        result: dict[str, Any] = json.loads(self._handle.provenance())
        return result

    @property
    def levels(self) -> list[Level]:
        """All levels, the finest first; arrays [z, y, x]."""
        return [Level(self, level) for level in range(self._handle.levels())]

    def level(self, level: int) -> Level:
        """One level as an array [z, y, x].

        Parameters
        ----------
        level
            0 is the finest
        """
        count = self._handle.levels()
        if not 0 <= level < count:
            raise RangeError(f"level {level} is not one of 0 to {count - 1}", path=self._path, level=level)
        return Level(self, level)

    def histogram(self) -> Histogram:
        """The range of the voxels of level 0."""
        least, greatest, counts = self._handle.histogram()
        real = np.float32 if self._handle.stored_values() == (1, 0) else np.float64
        return Histogram(np.array(least, real), np.array(greatest, real), np.array(counts, np.uint64))

    def isovalues(self) -> list[Suggestion]:
        """Isovalues that show something, at most four, the best first; none if all voxels are equal."""
        return [Suggestion(*one) for one in self._handle.suggestions()]

    def verify(
        self, *, threads: int = 0, progress: Progress = None, cancel: _core.Cancel | None = None
    ) -> list[Damage]:
        """Reads the whole file and says what is wrong with it; nothing: an empty list.

        Parameters
        ----------
        threads
            0: all cores
        progress
            True for a bar of tqdm, a bar, or a callable of (phase, fraction)
        cancel
            ends the call when its ``request()`` is called
        """
        with told_progress(progress, "verifying") as tell:
            return [Damage(*one) for one in self._handle.verify(threads, tell, cancel)]

    def session(self) -> Session:
        """For several queries: memory of one is used by the next."""
        return Session(self)

    def extract(
        self,
        isovalue: Isovalue | Query = "auto",
        *,
        part: tuple[int, int] | None = None,
        memory: int | str | None = None,
        threads: int = 0,
        progress: Progress = None,
        cancel: _core.Cancel | None = None,
        **choice: Unpack[Choice],
    ) -> Mesh:
        """The isosurface, as a mesh in memory, with points (x, y, z) in world units.

        Parameters
        ----------
        isovalue
            of the surface, or a ``Query``
        part
            (i, n): only share i of n shares of the surface, i from 1, which is open where others begin
        memory
            bounds what stays of the file in memory, for this query alone
        threads
            0: all cores
        progress
            True for a bar of tqdm, a bar, or a callable of (phase, fraction)
        cancel
            ends the call when its ``request()`` is called
        **choice
            of ``Query``: focus, radius, level, view, curvature, or_finer, box, mask, clip, sphere, cap, simplify,
            triangles, drop_small, keep_largest, drop_below, values, attributes and inside; (x, y, z) in world units, or
            in voxels those that end with ``_voxels``
        """
        query = query_of(isovalue, choice)
        pyramid = self
        if memory is not None:
            pyramid = Pyramid(self._path, memory, self._mmap, self._cache_folder, self._cache_bytes)
        try:
            with told_progress(progress, "extracting") as tell:
                settings = self._settings(query, threads, tell, cancel, part)
                return Mesh(_core.SessionHandle(pyramid._handle).extract(settings, False))
        finally:
            if pyramid is not self:
                pyramid.close()

    def extract_each(
        self,
        isovalues: Sequence[Isovalue],
        *,
        threads: int = 0,
        progress: Progress = None,
        cancel: _core.Cancel | None = None,
        **choice: Unpack[Choice],
    ) -> Iterator[Mesh]:
        """The surfaces of several isovalues, one after the other.

        Parameters
        ----------
        isovalues
            of the surfaces, in their order
        threads
            0: all cores
        progress
            True for a bar of tqdm, a bar, or a callable of (phase, fraction)
        cancel
            ends the call when its ``request()`` is called
        **choice
            of ``Query``, as of ``extract``
        """
        session = self.session()
        for isovalue in isovalues:
            yield session.extract(isovalue, threads=threads, progress=progress, cancel=cancel, **choice)

    async def extract_async(self, isovalue: Isovalue | Query = "auto", **arguments: Any) -> Mesh:
        """``extract`` for coroutines: ``mesh = await pyramid.extract_async(1324)``. Others run meanwhile. If the task
        is cancelled, the extraction ends within some 50 ms.

        Parameters
        ----------
        isovalue
            of the surface, or a ``Query``
        **arguments
            of ``extract``
        """
        return await awaited(self.extract, isovalue, **arguments)

    async def extract_to_async(
        self, path: str | os.PathLike[str], isovalue: Isovalue | Query = "auto", **arguments: Any
    ) -> ExtractReport:
        """``extract_to`` for coroutines, as ``extract_async``.

        Parameters
        ----------
        path
            its ending is the format
        isovalue
            of the surface, or a ``Query``
        **arguments
            of ``extract_to``
        """
        return await awaited(self.extract_to, path, isovalue, **arguments)

    def extract_to(
        self,
        path: str | os.PathLike[str],
        isovalue: Isovalue | Query = "auto",
        *,
        part: tuple[int, int] | None = None,
        colors: Colors | None = None,
        zlib: bool = False,
        meshopt: bool = False,
        space: Space = "LPS",
        unit: str | None = None,
        shift: Sequence[float] = (0, 0, 0),
        force: bool = False,
        threads: int = 0,
        progress: Progress = None,
        cancel: _core.Cancel | None = None,
        **choice: Unpack[Choice],
    ) -> ExtractReport:
        """The isosurface, streamed to a file: for meshes larger than memory. The file has its name when it is whole.

        Parameters
        ----------
        path
            its ending is the format: ``.ply``, ``.stl``, ``.obj``, ``.glb``, ``.vtp`` or ``.3mf``; of a share ``.isbm``
        isovalue
            of the surface, or a ``Query``
        part
            (i, n): only share i of n shares of the surface, i from 1, which ``isobrick.merge`` joins with the others
        colors, zlib, meshopt, space, unit, shift
            as for ``Mesh.save``
        force
            replaces ``path`` if it exists
        threads
            0: all cores
        progress
            True for a bar of tqdm, a bar, or a callable of (phase, fraction)
        cancel
            ends the call when its ``request()`` is called
        **choice
            of ``Query``, as of ``extract``: (x, y, z) in world units, or in voxels those that end with ``_voxels``
        """
        query = query_of(isovalue, choice)
        with told_progress(progress, "extracting") as tell:
            settings = self._settings(query, threads, tell, cancel, part)
            placement = placement_of(space, unit, shift)
            session = _core.SessionHandle(self._handle)
            facts = session.extract_to(settings, os.fspath(path), colors, zlib, meshopt, placement, force)
            return make_report(facts)

    def _isovalue(self, isovalue: Isovalue) -> float:
        if isovalue != "auto":
            return float(isovalue)
        suggestions = self.isovalues()
        if not suggestions:
            raise Error(f"all voxels of '{self._shown}' are equal: no isovalue has a surface", path=self._path)
        return suggestions[0].value

    def _settings(
        self, query: Query, threads: int, tell: Any, cancel: _core.Cancel | None, part: tuple[int, int] | None = None
    ) -> _QuerySettings:
        settings = settings_of(query, self._isovalue(query.isovalue), threads, tell, cancel, part)
        if query.inside == "auto":
            settings.is_below = self.provenance.get("properties", {}).get("vdb.class") == "level set"
        return settings


class Session:
    """Queries on one pyramid, one at a time, that share memory: a mesh that is not held any more is written over by the
    next query, so a loop touches no fresh memory. A mesh, or an array of one, that is held stays what it is.

    Queries are those of ``Pyramid.extract``: (x, y, z) in world units, or in voxels those that end with ``_voxels``.
    """

    def __init__(self, pyramid: Pyramid) -> None:
        self._pyramid = pyramid
        self._opened: _core.SessionHandle | None = _core.SessionHandle(pyramid._handle)
        _alive.add(self)

    def _abandon(self) -> None:
        if self._opened is not None:
            self._opened.abandon()
            self._opened = None

    @property
    def _handle(self) -> _core.SessionHandle:
        if self._opened is None:
            self._opened = _core.SessionHandle(self._pyramid._handle)
        return self._opened

    @property
    def pyramid(self) -> Pyramid:
        return self._pyramid

    def extract(
        self,
        isovalue: Isovalue | Query = "auto",
        *,
        threads: int = 0,
        progress: Progress = None,
        cancel: _core.Cancel | None = None,
        **choice: Unpack[Choice],
    ) -> Mesh:
        """As ``Pyramid.extract``: (x, y, z) in world units, in voxels what ends with ``_voxels``.

        Parameters
        ----------
        isovalue
            of the surface, or a ``Query``
        threads
            0: all cores
        progress
            True for a bar of tqdm, a bar, or a callable of (phase, fraction)
        cancel
            ends the call when its ``request()`` is called
        **choice
            of ``Query``, as of ``extract``
        """
        query = query_of(isovalue, choice)
        with told_progress(progress, "extracting") as tell:
            return Mesh(self._handle.extract(self._pyramid._settings(query, threads, tell, cancel), False))

    def progressive(
        self,
        isovalue: Isovalue | Query = "auto",
        *,
        threads: int = 0,
        cancel: _core.Cancel | None = None,
        **choice: Unpack[Choice],
    ) -> Iterator[Mesh]:
        """Meshes of one surface: the first at once, from what is in memory, and finer ones as bricks come in, near
        the focus first. The last one is that of ``extract``, unless the pyramid's ``memory`` has no room for it;
        ``Mesh.is_complete`` says which. (x, y, z) in world units, in voxels what ends with ``_voxels``.

        Parameters
        ----------
        isovalue
            of the surface, or a ``Query``
        threads
            0: all cores
        cancel
            ends the call when its ``request()`` is called
        **choice
            of ``Query``, without ``values`` and ``attributes``; ``triangles`` counts for the last mesh
        """
        query = query_of(isovalue, choice)
        if query.values is not None or query.attributes:
            raise ArgumentError("a progressive query has no values; take those of extract()")
        settings = passes = self._pyramid._settings(query, threads, None, cancel)
        if query.triangles is not None:  # whose search takes the whole surface
            passes = replace(settings, triangles=None, drop_small=False)
        is_simplified = any(one is not None for one in (query.simplify, query.simplify_voxels, query.triangles))
        while True:
            mesh = Mesh(self._handle.extract(passes, True))
            is_complete = mesh.is_complete
            if is_complete and is_simplified:  # over the borders of bricks too, which passes leave
                mesh = Mesh(self._handle.extract(settings, False))
            yield mesh
            del mesh  # so that its memory may be used again
            if is_complete or not self._handle.wait_for_bricks(0.05):
                return


def open(
    path: str | os.PathLike[str],
    *,
    memory: int | str = "1G",
    mmap: bool = True,
    cache_folder: str | os.PathLike[str] | None = None,
    cache_size: int | str = 0,
    spacing: Triple | None = None,
    select: Mapping[str, Any] | None = None,
    label: int | None = None,
    denoise: float = 0.0,
) -> Pyramid:
    """Opens the pyramid ``path`` (``.isb``). Reads no brick, so it takes as long for any size.

    A volume of any format of ``build``, a folder of DICOM or OME-Zarr behind a URL becomes a pyramid first, by the
    command, which the wheel has, and is found there again. All channels are ``open_each``. Arrays of it are [z, y, x];
    points, focus and geometry are (x, y, z) in world units.

    Parameters
    ----------
    path
        a name, or a URL: ``https://…``, ``http://…``, ``s3://bucket/key`` or ``gs://bucket/key``
    memory
        bounds what stays of the file in memory: bytes, or a text such as '256M'
    mmap
        False reads the file instead of mapping it, for network file systems
    cache_folder
        for pyramids of volumes and parts of URLs, in place of the folder that ``isobrick cache`` lists
    cache_size
        keeps parts of a URL on disk, at most so much of all pyramids, such as '4G'; by default none stay
    spacing
        of a volume, (x, y, z), in place of what the file says
    select
        which volume of several in the file: ``{"series": 2, "time": 0}``
    label, denoise
        open the pyramid that ``build`` makes with them, of a volume or a pyramid
    """
    name = _whole_path(os.fspath(path))
    is_derived = label is not None or denoise != 0
    if not _is_volume(name):
        if spacing is not None or select is not None:
            raise ArgumentError("spacing and select say how to read a volume; give them to build()")
        if not is_derived:
            return Pyramid(name, memory, mmap, cache_folder, cache_size)
    from ._by_command import run_command

    folder = os.path.abspath(os.fspath(cache_folder or _default_cache_folder()))
    most = None if cache_folder else 8_000_000_000  # as of the command: the home folder is small
    options = {
        "into_cache": folder, "cache_most": most, "memory": byte_size(memory), "spacing": spacing, "select": select,
        "label": label, "denoise": denoise or None,
    }  # fmt: skip
    return Pyramid(run_command("build", [name], options)["output"], memory, mmap)


def open_each(
    path: str | os.PathLike[str],
    key: Literal["channel", "time"] = "channel",
    *,
    select: Mapping[str, Any] | None = None,
    **arguments: Any,
) -> list[Pyramid]:
    """Opens a pyramid of each channel, or of each step of time, of a volume, in their order.

    ``provenance["channel"]`` of each has its name and colour, if the file gives them.

    Parameters
    ----------
    path
        of the volume, or its URL
    key
        'channel' or 'time'
    select
        what else is chosen from the file: ``{"time": 3}``
    **arguments
        of ``open``
    """
    from ._by_command import facts_of_volume

    name = _whole_path(os.fspath(path))
    if not _is_volume(name):
        raise Error(
            f"{os.fspath(path)!r} is a pyramid, which holds a single {key}; build each with "
            f'isobrick.build(..., {key}="all")'
        )
    facts = facts_of_volume(name, _default_cache_folder(), select)
    count = len(facts["channels"]) if key == "channel" else facts["time_steps"]
    if count < 2:
        return [open(path, select=select, **arguments)]
    return [open(path, select={**(select or {}), key: number}, **arguments) for number in range(count)]


def _is_volume(path: str) -> bool:
    if path.startswith("phantom:") or _core.is_remote_volume(path):
        return True
    if os.path.exists(path):
        return not _core.is_pyramid_file(path)
    return re.search(r"\.(h5|hdf5|hdf|he5|nxs|nc|ims|mat):", path.lower()) is not None
