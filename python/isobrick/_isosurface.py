"""Surfaces of arrays in one call: no file, no folder, no pyramid."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _core
from ._arrays import describe
from ._build import _FileInput, readable_array
from ._errors import ArgumentError
from ._mesh import Mesh
from ._progress import Progress, told_progress
from ._query import FinestChoice, Query, Triple, settings_of
from ._sizes import DEFAULT_MEMORY, byte_size


def isosurface(
    volume: Any,
    level: float | None = None,
    *,
    label: int | None = None,
    denoise: float = 0.0,
    spacing: Triple | None = None,
    origin: Triple | None = None,
    direction: Any = None,
    unit: str | None = None,
    memory: int | str = DEFAULT_MEMORY,
    threads: int = 0,
    progress: Progress = None,
    cancel: _core.Cancel | None = None,
    **choice: Unpack[FinestChoice],
) -> Mesh:
    """The isosurface of an array, as a mesh in memory: ``points, faces, normals = isosurface(volume, level)``.

    The mesh is the one of ``build`` and ``extract``: closed but for the border of the volume, outward where values
    are below ``level``, or above it with ``inside='below'``.

    >>> z, y, x = np.mgrid[0:30, 0:40, 0:50]
    >>> ball = (12 - np.sqrt((x - 25) ** 2 + (y - 20) ** 2 + (z - 15) ** 2)).astype("f4")
    >>> mesh = isosurface(ball, 0, spacing=(0.1, 0.1, 0.1))
    >>> round(mesh.volume(), 1), len(mesh.components())  # 4/3 pi 1.2 ** 3
    (7.2, 1)

    For several surfaces of one volume, or coarser ones, ``build`` a pyramid. An array that does not lie in memory as
    float32 is read twice, once for the range of its values.

    Parameters
    ----------
    volume
        an array [z, y, x]: the last axis is x. numpy of any strides and byte order, and what shares memory with
        it (DLPack: torch on the CPU, SimpleITK, ITK), is read where it lies; zarr, h5py, dask, tensorstore and
        xarray are read by whole chunks, a slab at a time
    level
        values of at least this are inside
    label
        in place of a level: the surface of a label of an array of integers, half way between its voxels and all
        others; compared exactly up to 2**64 - 1
    denoise
        smooths the array, or the label, first: the sigma of a Gaussian in voxels, at most 10, that is sharpened so
        that round shapes keep their size; 0: not at all
    spacing, origin, direction
        the place of the voxels in the world, (x, y, z); images and xarray have their own
    unit
        of spacing, origin and so of the world: 'nm', 'um', 'mm', 'cm', 'm' or 'inch'; lengths become millimetres
    memory
        what is read at a time of an array that is not used where it lies (other than numpy's u1, i1, u2, i2 and
        f4 in rows, in this machine's byte order), at most: bytes, or a text such as '256M'
    threads
        0: all cores
    progress
        True for a bar of tqdm, a bar, or a callable of (phase, fraction)
    cancel
        ends the call when its ``request()`` is called
    **choice
        of ``Query``: box, mask, clip, sphere, cap, simplify, drop_small, keep_largest, drop_below, values, attributes
        and inside, in which 'auto' is 'above'; (x, y, z) in world units, or in voxels those that end with ``_voxels``.
        ``Thickness`` and ``Distance`` of an isovalue take a pyramid
    """
    described = describe(volume)
    if (level is None) == (label is None):
        raise ArgumentError("an isosurface is that of a level, or of a label; give one of them")
    if unknown := choice.keys() - FinestChoice.__annotations__.keys():
        raise TypeError(f"isosurface() got unexpected arguments: {', '.join(sorted(unknown))}")
    isovalue = 0.5 if level is None else float(level)
    query = Query(isovalue, **choice)
    chosen = _FileInput(
        None, spacing, origin, "", "", None, None, None, None, None if label is None else int(label), float(denoise), unit
    )
    memory_bytes = byte_size(memory)
    with (
        told_progress(progress, "extracting") as tell,
        readable_array(described, chosen, direction, memory_bytes, identify=False) as description,
    ):
        settings = settings_of(query, isovalue, threads, tell, cancel)
        return Mesh(_core.isosurface(description, settings, memory_bytes))


def marching_cubes(
    volume: ArrayLike,
    level: float | None = None,
    *,
    spacing: Sequence[float] = (1.0, 1.0, 1.0),
    gradient_direction: str = "descent",
    step_size: int = 1,
    allow_degenerate: bool = True,
    method: str = "lewiner",
    mask: NDArray[np.bool_] | None = None,
) -> tuple[NDArray[Any], NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]:
    """``skimage.measure.marching_cubes``, faster: the same parameters, order of axes and result
    ``(verts, faces, normals, values)``. Vertices, spacing and normals are in the order of the array's axes.

    Vertices lie on the edges of cells, within 1/4096 of an edge of scikit-image's. What differs: in cells that can be
    cut in several ways the triangles may be others (there are no vertices inside of cells), so that the surface never
    crosses itself; no triangle is degenerate, whatever ``allow_degenerate`` says; ``method`` makes no difference.
    ``values`` are what scikit-image gives: the contrast of the cells around a vertex. As there, normals are those of
    voxels of size one.

    Parameters
    ----------
    volume
        an array of three axes
    level
        the isovalue; None: the middle of the array's range
    spacing
        of the axes, in their order
    gradient_direction
        'descent' if the object is above ``level``, else 'ascent'
    step_size
        takes every so many voxels
    allow_degenerate, method
        for scikit-image's sake
    mask
        leaves out the cells whose last voxel is not in it
    """
    array = np.asarray(volume)
    if array.ndim != 3:
        raise ValueError("Input volume should be a 3D numpy array.")
    if min(array.shape) < 2:
        raise ValueError("Input array must be at least 2x2x2.")
    if method not in ("lewiner", "lorensen"):
        raise ValueError("method should be either 'lewiner' or 'lorensen'")
    if gradient_direction not in ("descent", "ascent"):
        raise ValueError(f"Incorrect input {gradient_direction} in `gradient_direction`, see docstring.")
    if len(spacing) != 3:
        raise ValueError("`spacing` must consist of three floats.")
    step = int(step_size)
    if step < 1:
        raise ValueError("step_size must be at least one.")
    if mask is not None and mask.shape != array.shape:
        raise ValueError("volume and mask must have the same shape.")
    if array.dtype.str[1:] not in ("u1", "i1", "u2", "i2", "f4") or not array.dtype.isnative:
        array = array.astype(np.float32)  # as scikit-image computes
    coarse = array[::step, ::step, ::step]
    least, greatest = array.min(), array.max()
    if level is None:
        level = 0.5 * (float(least) + float(greatest))
    level = float(level)
    if level < least or level > greatest:
        raise ValueError("Surface level must be within volume data range.")
    if min(coarse.shape) < 2:
        raise RuntimeError("No surface found at the given iso value.")
    # There a voxel of just this value is outside.
    above = float(np.nextafter(np.float32(level), np.float32(np.inf)))
    mesh = isosurface(coarse, above)
    points = mesh.index_points
    faces = mesh.faces.astype(np.int32)
    normals = mesh.normals
    if mask is not None:
        faces = faces[_in_mask(points, faces, np.asarray(mask)[::step, ::step, ::step])]
        used = np.unique(faces)
        number = np.zeros(len(points), np.int32)
        number[used] = np.arange(len(used), dtype=np.int32)
        points, normals, faces = points[used], normals[used], number[faces]
    if not len(faces):
        raise RuntimeError("No surface found at the given iso value.")
    verts = points[:, ::-1] * float(step)
    if not np.array_equal(spacing, (1, 1, 1)):
        verts *= np.asarray(spacing, dtype=np.float64)
    else:
        verts = verts.astype(np.float32)
    if gradient_direction == "ascent":
        faces = np.ascontiguousarray(faces[:, ::-1])
    return verts, faces, np.ascontiguousarray(normals[:, ::-1]), _values(coarse, points)


def _in_mask(
    points: NDArray[np.float64], faces: NDArray[np.int32], mask: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Of the cell that each triangle lies in."""
    middles = points[faces].mean(axis=1)
    z, y, x = (
        np.clip(middles[:, 2 - axis].astype(np.intp), 0, mask.shape[axis] - 2) for axis in range(3)
    )
    inside: NDArray[np.bool_] = mask[z + 1, y + 1, x + 1].astype(bool)
    return inside


def _values(volume: NDArray[Any], points: NDArray[np.float64]) -> NDArray[np.float32]:
    """scikit-image's: the greatest difference of values within a cell that the vertex is part of."""
    sz, sy, sx = volume.strides
    nz, ny, nx = volume.shape
    out = np.empty(len(points), np.float32)
    _core.cell_contrasts(
        volume.__array_interface__["data"][0], (sx, sy, sz), (nx, ny, nz), volume.dtype.str[1:],
        np.ascontiguousarray(points), out,
    )  # fmt: skip
    return out
