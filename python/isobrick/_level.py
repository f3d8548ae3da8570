"""Levels of a pyramid as arrays."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from . import _core


class _Owner(Protocol):
    """A pyramid, as far as its levels know it."""

    @property
    def _handle(self) -> _core.PyramidHandle: ...
    @property
    def dtype(self) -> np.dtype[Any]: ...
    @property
    def affine(self) -> NDArray[np.float64]: ...
    def _values_of(self, stored: NDArray[Any]) -> NDArray[Any]: ...


class _Pick(NamedTuple):
    """Samples first .. end - 1 are read along an axis; ``of_box`` picks from these what the key asks for."""

    first: int
    end: int
    of_box: Any


def _pick(key: Any, length: int) -> _Pick:
    if isinstance(key, slice):
        picked = range(*key.indices(length))
        if not picked:
            return _Pick(0, 0, slice(0, 0))
        low, high = min(picked[0], picked[-1]), max(picked[0], picked[-1])
        start = picked.start - low
        stop = start + len(picked) * picked.step
        return _Pick(low, high + 1, slice(start, stop if stop >= 0 else None, picked.step))
    if isinstance(key, (int, np.integer)):
        at = int(key) + (length if key < 0 else 0)
        if not 0 <= at < length:
            raise IndexError(f"index {key} is out of range for an axis of {length} samples")
        return _Pick(at, at + 1, 0)
    indices = np.asarray(key)
    if indices.dtype == bool:
        indices = np.flatnonzero(indices)
    if indices.ndim != 1 or (indices.size and indices.dtype.kind not in "iu"):
        raise IndexError("a level takes integers, slices and lists of integers as indices")
    indices = np.where(indices < 0, indices + length, indices).astype(np.int64)
    if not indices.size:
        return _Pick(0, 0, indices)
    if not (0 <= indices.min() and indices.max() < length):
        raise IndexError(f"an index is out of range for an axis of {length} samples")
    return _Pick(int(indices.min()), int(indices.max()) + 1, indices - int(indices.min()))


class Level:
    """One level of a pyramid as an array [z, y, x]: ``shape``, ``dtype``, ``chunks``, slicing, ``numpy.asarray``.
    Sample [k, j, i] of level l sits at voxel index (i, j, k) * 2^l; ``affine`` leads from (i, j, k) to (x, y, z)
    in world units. ``dask.array.from_array`` takes it as it is.
    """

    ndim = 3

    def __init__(self, pyramid: _Owner, level: int) -> None:
        self._pyramid = pyramid
        self.level = level
        x, y, z = pyramid._handle.samples(level)
        self.shape: tuple[int, int, int] = (z, y, x)
        self.dtype: np.dtype[Any] = pyramid.dtype
        edge = pyramid._handle.brick_cells()
        self.chunks: tuple[int, int, int] = (min(z, edge), min(y, edge), min(x, edge))

    @property
    def size(self) -> int:
        return self.shape[0] * self.shape[1] * self.shape[2]

    @property
    def nbytes(self) -> int:
        return self.size * self.dtype.itemsize

    @property
    def affine(self) -> NDArray[np.float64]:
        """4 x 4: from (i, j, k) of this level to (x, y, z) in world units."""
        scale = float(1 << self.level)
        scaled: NDArray[np.float64] = self._pyramid.affine * np.array([scale, scale, scale, 1.0])
        return scaled

    @property
    def bricks(self) -> tuple[int, int, int]:
        """How many there are along z, y, x."""
        x, y, z = self._pyramid._handle.bricks(self.level)
        return z, y, x

    def __len__(self) -> int:
        return self.shape[0]

    def __repr__(self) -> str:
        return f"<isobrick.Level {self.level}: {self.shape} {self.dtype}>"

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        if copy is False:
            raise ValueError("the samples of a level are not in memory as one array: they have to be copied")
        array: NDArray[Any] = self[...]
        return array if dtype is None else array.astype(dtype)

    def __getitem__(self, key: Any) -> Any:
        keys = list(key) if isinstance(key, tuple) else [key]
        if Ellipsis in [k for k in keys if k is Ellipsis]:
            at = next(i for i, k in enumerate(keys) if k is Ellipsis)
            keys[at : at + 1] = [slice(None)] * (4 - len(keys))
        if len(keys) > 3:
            raise IndexError(f"a level has three axes, and {len(keys)} indices were given")
        keys += [slice(None)] * (3 - len(keys))
        picks = [_pick(k, length) for k, length in zip(keys, self.shape)]
        count = [pick.end - pick.first for pick in picks]
        if min(count) <= 0:
            box: NDArray[Any] = np.empty([max(n, 0) for n in count], self.dtype)
        else:
            z, y, x = (pick.first for pick in picks)
            nz, ny, nx = count
            box = self._pyramid._values_of(self._pyramid._handle.read_box(self.level, x, y, z, nx, ny, nz))
        # One axis after the other, from the last, so that lists on several axes pick an outer product.
        for axis in (2, 1, 0):
            box = box[(slice(None),) * axis + (picks[axis].of_box,)]
        return box if box.ndim else box[()]

    def brick(self, z: int, y: int, x: int) -> tuple[tuple[int, int, int], NDArray[Any]]:
        """The samples of one brick with its apron, and the index [z, y, x] of the first of them. Read-only, and
        the file's own memory if bricks are stored as they are (codec 'none').

        Parameters
        ----------
        z, y, x
            the number of the brick along each axis, from 0
        """
        if not all(0 <= i < n for i, n in zip((z, y, x), self.bricks)):
            raise IndexError(f"brick [{z}, {y}, {x}] is not one of {self.bricks}")
        (fx, fy, fz), array = self._pyramid._handle.read_brick(self.level, x, y, z)
        return (fz, fy, fx), self._pyramid._values_of(array)
