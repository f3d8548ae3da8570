"""Pyramids and surfaces by the workers of a Dask cluster.

    from dask.distributed import Client
    import isobrick.dask

    client = Client("scheduler:8786")
    isobrick.dask.build("scan.ome.zarr", "/shared/scan.isbs", client=client)
    isobrick.dask.extract("/shared/scan.isbs", 1324, "/shared/bone.ply", client=client)

Every task makes a file of its own, so a worker that dies costs its tasks alone, and what is there already is not
made again. All workers and the caller see the same folders.
"""

from __future__ import annotations

import os
import threading
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

import isobrick

from . import _core
from ._arrays import ArrayVolume, describe
from ._build import JoinReport, SuperBrick, _Builder, _BuildSettings, _FileInput
from ._errors import Error
from ._pyramid import MergeReport
from ._query import Choice, Isovalue, Query, Space, query_of
from ._sizes import DEFAULT_MEMORY, byte_size

#: Voxels around a super-brick that its coarser levels are made from, and more.
_RIM = 64


def build(
    source: Any,
    out: str | os.PathLike[str],
    *,
    client: Any = None,
    super_brick: int = 2048,
    retries: int = 2,
    memory: int | str | None = None,
    threads: int = 1,
    force: bool = False,
    direction: Any = None,
    codec: str = "lz4",
    filter: str = "average",
    curvature: bool = True,
    brick_cells: int = 64,
    nan_as: float | None = None,
    **place: Any,
) -> JoinReport:
    """Builds the pyramid ``out``, a folder ``.isbs`` that all workers see, of a volume: a task for each file of a
    super-brick, and one for the index. Files that are there stay, so the same call goes on after an end of any kind.

    Raises what the first failed task raised; then, and at Ctrl-C, the tasks that are left are cancelled.

    Parameters
    ----------
    source
        a path that all workers see, or an array as of ``isobrick.build``: dask arrays are read chunk by chunk
        by the task that needs them, persisted ones too; zarr and h5py arrays travel as what they are
    client
        of ``dask.distributed``; None: the current one
    super_brick
        cells along an edge of what one task makes, a power of two
    retries
        how often Dask repeats a task that failed; one whose worker died does not count
    memory
        of a task; None: half of the worker's limit over its threads
    threads
        of a task
    **place
        as of ``isobrick.build``
    """
    name = os.path.abspath(os.fspath(out))
    if not name.endswith(".isbs"):
        raise Error(f"'{name}' does not end with .isbs, the ending of a pyramid of many files")
    dask_client = _client_or_current(client)
    chosen = _FileInput(
        *(place.pop(key, default) for key, default in (
            ("raw", None), ("spacing", None), ("origin", None), ("series", ""), ("grid", ""), ("time", None),
            ("channel", None), ("image", None), ("component", None), ("label", None), ("denoise", 0.0), ("unit", None),
        ))
    )  # fmt: skip
    if place:
        raise TypeError(f"build() got unexpected arguments: {', '.join(place)}")
    settings = _BuildSettings(
        name, force, codec, filter, curvature, brick_cells, nan_as, byte_size(memory or DEFAULT_MEMORY), threads, None, None,
        super_brick,
    )  # fmt: skip
    source = os.path.abspath(os.fspath(source)) if _is_local_path(source) else source
    bricks = _Builder(source, direction, chosen, settings).super_bricks()
    os.makedirs(name, exist_ok=True)
    run = uuid.uuid4().hex[:8]
    futures = [
        dask_client.submit(
            _build_task, _part_of(source, brick), direction, chosen, settings, brick.number, memory,
            key=f"isobrick-build-{brick.name[:-4]}-{run}", retries=retries, pure=False,
        )
        for brick in bricks
    ]  # fmt: skip
    _wait_for(dask_client, futures)
    join = dask_client.submit(
        _join_task, name, memory, threads, key=f"isobrick-join-{run}", retries=retries, pure=False
    )
    report: JoinReport = _wait_for(dask_client, [join])[0]
    return report


@dataclass(frozen=True)
class MeshPart:
    """A share of a surface, open where others begin: the result of a delayed part."""

    #: (n, 3), world units, (x, y, z).
    points: NDArray[Any]
    #: (m, 3): numbers of points.
    faces: NDArray[np.uint32]
    #: (n, 3): unit, outward.
    normals: NDArray[np.float32]
    #: (m,): the level of the pyramid that each triangle comes from.
    levels: NDArray[np.uint8]


def extract(
    pyramid: str | os.PathLike[str] | isobrick.Pyramid,
    isovalue: Isovalue | Query,
    out: str | os.PathLike[str],
    *,
    parts: int | None = None,
    client: Any = None,
    retries: int = 2,
    memory: int | str | None = None,
    threads: int = 1,
    force: bool = False,
    zlib: bool = False,
    meshopt: bool = False,
    space: Space = "LPS",
    unit: str | None = None,
    shift: Sequence[float] = (0, 0, 0),
    keep_shares: bool = False,
    **choice: Unpack[Choice],
) -> MergeReport:
    """The isosurface as one closed mesh file, that of ``Pyramid.extract_to`` byte by byte: a task for each of
    ``parts`` shares (None: four for each thread of the cluster), and one that merges them. The shares lie in the folder
    ``out + '.shares'``, which goes at the end unless ``keep_shares``; those of another call that are there stay.

    Parameters
    ----------
    isovalue
        of the surface, or an ``isobrick.Query``
    **choice
        focus, radius, level, view, curvature, or_finer, box, cap, simplify, drop_small and inside, as of
        ``isobrick.Query``
    """
    name = os.path.abspath(os.fspath(out))
    if not force and os.path.exists(name):
        raise isobrick.ExistsError(f"'{name}' exists; give force=True to replace it", path=name)
    dask_client = _client_or_current(client)
    path, query = _path_and_query(pyramid, query_of(isovalue, choice))
    count = parts or 4 * max(1, sum(dask_client.nthreads().values()))
    folder = name + ".shares"
    os.makedirs(folder, exist_ok=True)
    shares = [os.path.join(folder, f"{number}-of-{count}.isbm") for number in range(1, count + 1)]
    run = uuid.uuid4().hex[:8]
    futures = [
        dask_client.submit(
            _share_task, path, query, share, (number, count), memory, threads,
            key=f"isobrick-extract-{number}-{run}", retries=retries, pure=False,
        )
        for number, share in enumerate(shares, 1)
    ]  # fmt: skip
    _wait_for(dask_client, futures)
    merge = dask_client.submit(
        isobrick.merge, shares, name, zlib=zlib, meshopt=meshopt, space=space, unit=unit,
        shift=shift, force=force, threads=threads, key=f"isobrick-merge-{run}", retries=retries, pure=False,
    )  # fmt: skip
    report: MergeReport = _wait_for(dask_client, [merge])[0]
    if not keep_shares:
        for share in shares:
            os.remove(share)
        with suppress(OSError):  # another call's are there
            os.rmdir(folder)
    return report


def delayed_parts(
    pyramid: str | os.PathLike[str] | isobrick.Pyramid,
    isovalue: Isovalue | Query,
    parts: int,
    *,
    threads: int = 1,
    **choice: Unpack[Choice],
) -> list[Any]:
    """The isosurface as a list of ``dask.delayed`` objects, each of which becomes a ``MeshPart``: for graphs of one's
    own. Together the parts have all triangles of the surface, each once.

    Parameters
    ----------
    pyramid
        open, or its name
    isovalue
        of the surface, or a ``Query``
    parts
        how many
    threads
        of each task
    **choice
        of ``Query``, as of ``extract``
    """
    from dask.delayed import delayed

    path, query = _path_and_query(pyramid, query_of(isovalue, choice))
    task = delayed(_mesh_part, pure=True)
    return [task(path, query, (number, parts), threads) for number in range(1, parts + 1)]


def _is_local_path(source: Any) -> bool:
    return isinstance(source, (str, os.PathLike)) and not os.fspath(source).startswith("phantom:")


def _client_or_current(client: Any) -> Any:
    if client is not None:
        return client
    from distributed import get_client

    try:
        return get_client()
    except ValueError:
        raise Error("there is no Dask cluster; make a dask.distributed.Client, or give one as client") from None


def _path_and_query(pyramid: Any, query: Query) -> tuple[str, Query]:
    """With a number as isovalue."""
    if isinstance(pyramid, isobrick.Pyramid):
        return pyramid.path, replace(query, isovalue=pyramid._isovalue(query.isovalue))
    with isobrick.open(pyramid, mmap=False) as opened:
        return _path_and_query(opened, query)


def _wait_for(client: Any, futures: Sequence[Any]) -> list[Any]:
    """Their results. What is left is cancelled if one fails, or at Ctrl-C."""
    import distributed

    as_completed: Any = distributed.as_completed
    try:
        for future in as_completed(futures, raise_errors=False):
            if future.status == "error":
                raise future.exception()
            if future.status == "cancelled":
                raise isobrick.Cancelled(f"the task '{future.key}' was cancelled")
        return [future.result() for future in futures]
    except BaseException:
        client.cancel(list(futures), force=True)
        raise


# ---- parts of dask arrays


@dataclass
class _DaskPart:
    """A dask array of which a task has the chunks around its super-brick alone."""

    whole: ArrayVolume  # without the means to read it
    array: Any
    first: tuple[int, int, int]


def _part_of(source: Any, brick: SuperBrick) -> Any:
    """The part of the source that a task gets: some chunks of a dask array, whose graph may be large."""
    import dask.base

    if isinstance(source, (str, os.PathLike)):
        return source
    volume = describe(source)
    array: Any = source if _is_dask(source) else getattr(source, "data", None)
    if not _is_dask(array) or array.shape != volume.shape:
        return source
    box = []
    for edges, first, count in zip(volume.edges, brick.first, brick.shape):
        begin = int(edges[max(0, int(np.searchsorted(edges, max(first - _RIM, 0), side="right")) - 1)])
        end = int(edges[int(np.searchsorted(edges, min(first + count + _RIM, int(edges[-1])), side="left"))])
        box.append(slice(begin, end))
    part = array[tuple(box)]
    if not _is_persisted(part):  # of futures dask would keep nothing
        optimize: Any = dask.base.optimize
        (part,) = optimize(part)
    return _DaskPart(replace(volume, fetch=None), part, (box[0].start, box[1].start, box[2].start))


def _is_dask(source: Any) -> bool:
    return type(source).__module__.split(".")[0] == "dask" and hasattr(source, "dask")


def _is_persisted(array: Any) -> bool:
    from distributed import Future

    return any(isinstance(value, Future) for value in dict(array.dask).values())


@contextmanager
def _opened(source: Any) -> Iterator[Any]:
    """The voxels that a task reads. Chunks that lie on workers come from there; all else is computed by this one."""
    if not isinstance(source, _DaskPart):
        yield source
        return
    part = source

    def inner(box: tuple[slice, slice, slice]) -> Any:
        return part.array[tuple(slice(s.start - f, s.stop - f) for s, f in zip(box, part.first))]

    if not _is_persisted(part.array):
        yield replace(part.whole, fetch=lambda box: inner(box).compute(scheduler="synchronous"))
        return
    from distributed import worker_client

    with worker_client() as client:
        yield replace(part.whole, fetch=lambda box: client.compute(inner(box)).result())


# ---- tasks, on a worker


def _memory_of_task(memory: int | str | None) -> int:
    if memory is not None:
        return byte_size(memory)
    from distributed import get_worker

    worker = get_worker()
    limit = worker.memory_manager.memory_limit
    if not limit:
        return byte_size(DEFAULT_MEMORY)
    return max(byte_size("128M"), int(limit / worker.state.nthreads / 2))


@contextmanager
def _cancelled_with_task() -> Iterator[_core.Cancel]:
    """A flag that is raised when Dask does not want this task any more."""
    from distributed import get_worker

    cancel, ended = _core.Cancel(), threading.Event()
    worker = get_worker()
    key = worker.get_current_task()

    def watch() -> None:
        while not ended.wait(0.2):
            task = worker.state.tasks.get(key)
            if task is None or task.state in ("cancelled", "released", "forgotten"):
                return cancel.request()

    watcher = threading.Thread(target=watch, name="isobrick-cancel", daemon=True)
    watcher.start()
    try:
        yield cancel
    finally:
        ended.set()
        watcher.join()


def _build_task(
    source: Any, direction: Any, chosen: _FileInput, settings: _BuildSettings, number: int, memory: int | str | None
) -> bool:
    with _cancelled_with_task() as cancel:
        here = replace(settings, memory_bytes=_memory_of_task(memory), cancel=cancel)
        with _opened(source) as opened:
            was_built, _ = _Builder(opened, direction, chosen, here).build_super_brick(number)
            return was_built


def _join_task(folder: str, memory: int | str | None, threads: int) -> JoinReport:
    with _cancelled_with_task() as cancel:
        return isobrick.join(folder, memory=_memory_of_task(memory), threads=threads, cancel=cancel)


def _share_task(
    path: str, query: Query, share: str, part: tuple[int, int], memory: int | str | None, threads: int
) -> None:
    with _cancelled_with_task() as cancel, isobrick.open(path, memory=_memory_of_task(memory), mmap=False) as pyramid:
        pyramid.extract_to(share, query, part=part, force=True, threads=threads, cancel=cancel)


def _mesh_part(path: str, query: Query, part: tuple[int, int], threads: int) -> MeshPart:
    with isobrick.open(path, mmap=False) as pyramid:
        mesh = pyramid.extract(query, part=part, threads=threads)
        return MeshPart(mesh.points, mesh.faces, mesh.normals, mesh.levels)
