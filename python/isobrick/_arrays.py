"""Arrays of all kinds as volumes: their axes, their places in the world, and boxes of them."""

from __future__ import annotations

import os
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._errors import ArgumentError

Box = tuple[slice, slice, slice]

_IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
_TO_MILLIMETRES = {
    "mm": 1.0, "millimeter": 1.0, "millimetre": 1.0, "millimeters": 1.0, "millimetres": 1.0,
    "um": 1e-3, "µm": 1e-3, "micrometer": 1e-3, "micrometre": 1e-3, "micrometers": 1e-3, "micron": 1e-3,
    "nm": 1e-6, "nanometer": 1e-6, "nanometre": 1e-6,
    "cm": 10.0, "centimeter": 10.0, "centimetre": 10.0,
    "m": 1000.0, "meter": 1000.0, "metre": 1000.0, "meters": 1000.0, "metres": 1000.0,
}  # fmt: skip


@dataclass
class Place:
    """The place of voxels in the world: (x, y, z), and the direction by rows."""

    spacing: tuple[float, float, float] = (1.0, 1.0, 1.0)
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    direction: tuple[float, ...] = _IDENTITY
    is_millimetres: bool = False


@dataclass
class ArrayVolume:
    """A three-dimensional array [z, y, x] that is read box by box."""

    shape: tuple[int, int, int]
    dtype: np.dtype[Any]
    place: Place
    format: str
    name: str
    #: The whole as a numpy array, if it lies in memory or in a map.
    memory: NDArray[Any] | None = None
    #: Reads a box; by several threads at once.
    fetch: Callable[[Box], Any] | None = None
    #: The begins and ends of chunks, along z, y, x.
    edges: tuple[NDArray[np.int64], ...] = ()
    notes: list[str] = field(default_factory=list)
    #: Of some voxels, once content_sample() has read them.
    sample: str | None = None


def _checked(shape: Sequence[int], dtype: np.dtype[Any], kind: str) -> tuple[int, int, int]:
    if dtype.kind == "O":
        raise ArgumentError(f"the {kind} holds Python objects; convert it to numbers with astype()")
    if dtype.kind not in "buif" or dtype.itemsize > 8:
        raise ArgumentError(f"the {kind} has voxels of type {dtype}, which are no real numbers; convert it with astype()")
    if len(shape) != 3:
        raise ArgumentError(f"the {kind} has {len(shape)} axes; a volume has three, [z, y, x]: pick one with an index")
    if min(shape) < 2:
        raise ArgumentError(f"the {kind} has the shape {tuple(shape)}; a volume has at least 2 voxels along every axis")
    return int(shape[0]), int(shape[1]), int(shape[2])


def _regular_edges(shape: Sequence[int], chunks: Sequence[int]) -> tuple[NDArray[np.int64], ...]:
    return tuple(
        np.append(np.arange(0, length, chunk, dtype=np.int64), length) for length, chunk in zip(shape, chunks)
    )


def _module_of(source: object) -> str:
    return type(source).__module__.split(".")[0]


def _is_a(source: object, module: str, name: str) -> bool:
    return any(base.__name__ == name and base.__module__.split(".")[0] == module for base in type(source).__mro__)


def describe(source: Any) -> ArrayVolume:
    """The volume of an array-like. Raises Error for what is none."""
    if isinstance(source, ArrayVolume):
        return source
    if isinstance(source, (str, os.PathLike)):
        raise ArgumentError(f"'{os.fspath(source)}' is a path and no array; isobrick.open() takes paths")
    if isinstance(source, np.ma.MaskedArray):
        raise ArgumentError("the array is masked; give source.filled(value), with a value for the masked voxels")
    if isinstance(source, np.ndarray):
        return _of_numpy(source, Place(), "numpy array")
    if _is_a(source, "xarray", "DataArray"):
        return _of_xarray(source)
    if _is_a(source, "SimpleITK", "Image"):
        return _of_simpleitk(source)
    if _is_a(source, "itk", "DataObject") or _is_a(source, "itk", "Image") or hasattr(source, "GetLargestPossibleRegion"):
        return _of_itk(source)
    if _is_a(source, "torch", "Tensor"):
        return _of_torch(source)
    if _is_a(source, "dask", "Array"):
        return _of_dask(source)
    if _module_of(source) == "tensorstore":
        return _of_tensorstore(source)
    if hasattr(source, "shape") and hasattr(source, "dtype") and hasattr(source, "__getitem__"):
        return _of_chunked(source)
    if hasattr(source, "__array__"):
        return _of_numpy(np.asarray(source), Place(), f"{type(source).__name__}")
    raise ArgumentError(
        f"a {type(source).__name__} is no volume; give a path, or an array with shape, dtype and slicing"
    )


def _of_numpy(array: NDArray[Any], place: Place, kind: str) -> ArrayVolume:
    shape = _checked(array.shape, array.dtype, kind)
    memory = array.view(np.uint8) if array.dtype.kind == "b" else array
    return ArrayVolume(shape, memory.dtype, place, kind, _content_name(memory), memory=memory)


def _content_name(array: NDArray[Any]) -> str:
    """A name that differs for arrays whose voxels are likely to: by some of them."""
    from hashlib import blake2b

    digest = blake2b(digest_size=16)
    for corner in product((0.0, 0.5, 1.0), repeat=3):
        first = [int(at * max(length - 8, 0)) for at, length in zip(corner, array.shape)]
        block = array[tuple(slice(f, f + 8) for f in first)]
        digest.update(np.ascontiguousarray(block).tobytes())
    return digest.hexdigest()


def content_sample(volume: ArrayVolume) -> str:
    """A text that differs for arrays on disk whose voxels are likely to: by a corner of some chunks. Nothing for
    those in memory, whose name says it, and of dask, whose chunks may take hours to compute."""
    if volume.fetch is None or volume.format.endswith("dask array"):
        return ""
    if volume.sample is None:
        from hashlib import blake2b

        digest = blake2b(digest_size=16)
        firsts = [sorted({int(e[0]), int(e[(len(e) - 1) // 2]), int(e[-2])}) for e in volume.edges]
        for z, y, x in product(*firsts):
            block = volume.fetch((slice(z, z + 8), slice(y, y + 8), slice(x, x + 8)))
            digest.update(np.ascontiguousarray(block).tobytes())
        volume.sample = digest.hexdigest()
    return volume.sample


def _of_simpleitk(image: Any) -> ArrayVolume:
    import SimpleITK

    if image.GetDimension() != 3 or image.GetNumberOfComponentsPerPixel() != 1:
        raise ArgumentError(
            f"the SimpleITK image has {image.GetDimension()} axes and {image.GetNumberOfComponentsPerPixel()} "
            "numbers a voxel; a volume has three axes and one number: pick a slice or a component"
        )
    place = Place(
        tuple(image.GetSpacing()), tuple(image.GetOrigin()), tuple(image.GetDirection()), is_millimetres=True
    )
    return _of_numpy(SimpleITK.GetArrayViewFromImage(image), place, "SimpleITK image")


def _of_torch(tensor: Any) -> ArrayVolume:
    if tensor.device.type != "cpu":
        raise ArgumentError(f"the tensor lies on {tensor.device}; give tensor.cpu()")
    return _of_numpy(np.from_dlpack(tensor.detach()), Place(), "torch tensor")


def _of_itk(image: Any) -> ArrayVolume:
    import itk

    direction = np.asarray(itk.array_from_matrix(image.GetDirection()), dtype=float)
    if direction.shape != (3, 3):
        raise ArgumentError(f"the ITK image has {direction.shape[0]} axes; a volume has three")
    spacing, origin = ([float(v) for v in values] for values in (image.GetSpacing(), image.GetOrigin()))
    place = Place(
        (spacing[0], spacing[1], spacing[2]),
        (origin[0], origin[1], origin[2]),
        tuple(float(v) for v in direction.ravel()),
        is_millimetres=True,
    )
    return _of_numpy(itk.array_view_from_image(image), place, "ITK image")


def _of_dask(source: Any) -> ArrayVolume:
    if _is_a(source._meta, "numpy", "MaskedArray"):
        raise ArgumentError("the dask array is masked; give dask.array.ma.filled(source, value)")
    shape = _checked(source.shape, source.dtype, "dask array")
    if any(np.isnan(length) for lengths in source.chunks for length in lengths):
        raise ArgumentError("the dask array has chunks of unknown size; give source.compute_chunk_sizes()")
    edges = tuple(np.cumsum((0, *lengths), dtype=np.int64) for lengths in source.chunks)
    return ArrayVolume(
        shape, source.dtype, Place(), "dask array", source.name, fetch=lambda box: source[box].compute(), edges=edges
    )


def _of_tensorstore(source: Any) -> ArrayVolume:
    dtype = source.dtype.numpy_dtype
    shape = _checked(source.shape, dtype, "tensorstore")
    chunks = source.chunk_layout.read_chunk.shape or (64, 64, 64)
    if any(origin != 0 for origin in source.domain.origin):
        source = source[tuple(slice(None) for _ in shape)].translate_to[0, 0, 0]
    return ArrayVolume(
        shape,
        dtype,
        Place(),
        "tensorstore",
        repr(source.spec(retain_context=False)) if source.kvstore else "memory",
        fetch=lambda box: source[box].read().result(),
        edges=_regular_edges(shape, chunks),
    )


def _of_chunked(source: Any) -> ArrayVolume:
    """zarr 2 and 3, h5py, and whatever else is cut into equal chunks, or into none."""
    kind = f"{_module_of(source)} {type(source).__name__}"
    dtype = np.dtype(source.dtype)
    shape = _checked(source.shape, dtype, kind)
    # The chunks within the shards of a sharded zarr can be read alone.
    chunks = getattr(source, "chunks", None)
    if not (isinstance(chunks, tuple) and len(chunks) == 3 and all(isinstance(c, int) for c in chunks)):
        chunks = (64, 256, 256)
    name = "; ".join(
        str(part) for part in (getattr(source, "store", None), getattr(getattr(source, "file", None), "filename", None),
                               getattr(source, "path", None), getattr(source, "name", None)) if part
    )  # fmt: skip
    return ArrayVolume(
        shape, dtype, Place(), kind, name, fetch=lambda box: source[box], edges=_regular_edges(shape, chunks)
    )


def _coordinate(source: Any, name: str) -> tuple[float, float, float]:
    """First coordinate, step, and factor to millimetres (0: unknown unit) of a dimension."""
    if name not in source.coords:
        return 0.0, 1.0, 0.0
    values = np.asarray(source.coords[name].values)
    if values.dtype.kind not in "buif":
        raise ArgumentError(f"the coordinates '{name}' are no numbers; drop them, or give spacing and origin")
    values = values.astype(np.float64)
    steps = np.diff(values)
    step = float((values[-1] - values[0]) / (len(values) - 1))
    if step == 0 or not np.allclose(steps, step, rtol=1e-3, atol=0):
        raise ArgumentError(
            f"the coordinates '{name}' are not evenly spaced ({steps.min():g} to {steps.max():g}); "
            "interpolate the array onto even ones"
        )
    unit = str(source.coords[name].attrs.get("units", ""))
    return float(values[0]), step, _TO_MILLIMETRES.get(unit, 0.0)


def _of_xarray(source: Any) -> ArrayVolume:
    _checked(source.shape, source.dtype, "xarray DataArray")
    names = [str(dim) for dim in source.dims]
    if set(names) == {"x", "y", "z"}:
        source = source.transpose("z", "y", "x")
        names = ["z", "y", "x"]
    first, step, factor = zip(*(_coordinate(source, name) for name in reversed(names)))  # x, y, z
    is_millimetres = all(f > 0 for f in factor)
    scale = factor if is_millimetres else (1.0, 1.0, 1.0)
    volume = describe(source.data)
    volume.format = f"xarray of {volume.format}"
    volume.place = Place(
        tuple(abs(s) * f for s, f in zip(step, scale)),
        tuple(v * f for v, f in zip(first, scale)),
        tuple((1.0 if s > 0 else -1.0) if row == column else 0.0 for row in range(3) for column, s in enumerate(step)),
        is_millimetres,
    )
    return volume


def _ranges(edges: NDArray[np.int64], first: int, end: int) -> range:
    """Which chunks along an axis have indices in [first, end)."""
    return range(
        int(np.searchsorted(edges, first, side="right")) - 1, int(np.searchsorted(edges, end, side="left"))
    )


class ChunkReader:
    """Boxes of a chunked array, by whole chunks, several at once, within a number of bytes.

    Chunks stay as long as there is room for them: neighbouring boxes share some. ``budget_bytes`` bounds
    those that stay and those that are on their way together; it is at least two chunks.
    """

    THREADS = 8

    def __init__(self, volume: ArrayVolume, dtype: np.dtype[Any], memory_bytes: int) -> None:
        assert volume.fetch is not None
        self._fetch = volume.fetch
        self._dtype = dtype
        self._edges = volume.edges
        self._cached: OrderedDict[tuple[int, ...], NDArray[Any]] = OrderedDict()
        self._cached_bytes = 0
        self._lock = threading.Lock()
        largest = [int(np.diff(edges).max()) for edges in volume.edges]
        # As read and as delivered.
        self._chunk_bytes = int(np.prod(largest)) * max(dtype.itemsize, volume.dtype.itemsize)
        self.budget_bytes = max(memory_bytes // 4, 2 * self._chunk_bytes)
        if self.budget_bytes > memory_bytes // 2:
            raise ArgumentError(
                f"a chunk of the {volume.format} takes {self._chunk_bytes >> 20} MiB, and two of them more than half "
                f"of memory={memory_bytes >> 20}M; give memory='{(4 * self._chunk_bytes >> 20) + 1}M' or rechunk the array"
            )
        at_once = max(1, min(self.THREADS, self.budget_bytes // (2 * self._chunk_bytes)))
        self._at_once = int(at_once)
        self._pool = ThreadPoolExecutor(self._at_once, thread_name_prefix="isobrick-chunks")

    def close(self) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)

    def __call__(self, x: int, y: int, z: int, nx: int, ny: int, nz: int) -> NDArray[Any]:
        first, count = (z, y, x), (nz, ny, nx)
        out = np.empty(count, self._dtype)
        wanted = list(product(*(_ranges(e, f, f + n) for e, f, n in zip(self._edges, first, count))))
        missing = [chunk for chunk in wanted if not self._copy_cached(chunk, first, out)]
        for i in range(0, len(missing), self._at_once):
            wave = missing[i : i + self._at_once]
            self._make_room(len(wave))
            for chunk, voxels in zip(wave, self._pool.map(self._read, wave)):
                self._copy(chunk, voxels, first, out)
                self._keep(chunk, voxels)
        return out

    def _box(self, chunk: Iterable[int]) -> Box:
        z, y, x = (slice(int(e[i]), int(e[i + 1])) for e, i in zip(self._edges, chunk))
        return z, y, x

    def _read(self, chunk: tuple[int, ...]) -> NDArray[Any]:
        voxels = self._fetch(self._box(chunk))
        if isinstance(voxels, np.ma.MaskedArray):
            raise ArgumentError("a chunk of the array is masked; fill the array first")
        return np.ascontiguousarray(voxels, dtype=self._dtype)

    def _copy_cached(self, chunk: tuple[int, ...], first: tuple[int, ...], out: NDArray[Any]) -> bool:
        with self._lock:
            voxels = self._cached.get(chunk)
            if voxels is None:
                return False
            self._cached.move_to_end(chunk)
        self._copy(chunk, voxels, first, out)
        return True

    def _copy(self, chunk: tuple[int, ...], voxels: NDArray[Any], first: tuple[int, ...], out: NDArray[Any]) -> None:
        into: list[slice] = []
        part: list[slice] = []
        for box, f, n in zip(self._box(chunk), first, out.shape):
            begin, end = max(box.start, f), min(box.stop, f + n)
            into.append(slice(begin - f, end - f))
            part.append(slice(begin - box.start, end - box.start))
        out[tuple(into)] = voxels[tuple(part)]

    def _make_room(self, chunks: int) -> None:
        with self._lock:
            while self._cached and self._cached_bytes + chunks * self._chunk_bytes > self.budget_bytes:
                _, old = self._cached.popitem(last=False)
                self._cached_bytes -= old.nbytes

    def _keep(self, chunk: tuple[int, ...], voxels: NDArray[Any]) -> None:
        with self._lock:
            if chunk not in self._cached:
                self._cached[chunk] = voxels
                self._cached_bytes += voxels.nbytes
