"""Pyramids as multiscale layers of napari."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import isobrick

LayerData = tuple[Any, dict[str, Any], str]


def napari_affine(pyramid: isobrick.Pyramid) -> NDArray[np.float64]:
    """4 x 4: from voxel indices to the world, both (z, y, x)."""
    swap = np.zeros((4, 4))
    swap[[0, 1, 2, 3], [2, 1, 0, 3]] = 1
    result: NDArray[np.float64] = swap @ pyramid.affine @ swap
    return result


def get_reader(path: str | list[str]) -> Callable[[str | list[str]], list[LayerData]] | None:
    """The entry point for npe2: a function that reads `path`, or None."""
    paths = [path] if isinstance(path, str) else path
    if not all(p.lower().rstrip("/").endswith((".isb", ".isbs")) for p in paths):
        return None
    return read


def read(path: str | list[str]) -> list[LayerData]:
    """A multiscale image of every pyramid, with its affine and units. Reads nothing of the voxels."""
    return [layer_of(isobrick.open(p)) for p in ([path] if isinstance(path, str) else path)]


def _without_last_samples(level: isobrick.Level, voxels: tuple[int, int, int]) -> isobrick.Level:
    """napari takes the quotient of shapes for the distance between samples. Without the samples beyond the last
    voxel that is 2^level, as it should be, for all numbers of voxels that 2^level divides; for others the last
    samples are shown at most one sample off."""
    z, y, x = (-(-n // 2**level.level) for n in voxels)
    result = copy.copy(level)
    result.shape = (z, y, x)
    return result


def layer_of(pyramid: isobrick.Pyramid) -> LayerData:
    """The layer of an open pyramid."""
    # A level of fewer than some 32 voxels shows nothing.
    levels = [
        _without_last_samples(level, pyramid.shape)
        for level in pyramid.levels
        if level.level == 0 or max(level.shape) >= 32
    ]
    low, high = pyramid.value_range
    options = {
        "name": pyramid.path.rstrip("/").rsplit("/", 1)[-1].removesuffix(".isbs").removesuffix(".isb"),
        "multiscale": len(levels) > 1,
        "affine": napari_affine(pyramid),
        "contrast_limits": (low, max(high, low + 1e-6)),
        "units": ("mm" if pyramid.unit == "millimetres" else "pixel",) * 3,
        "metadata": {"isobrick": pyramid},
    }
    return (levels if len(levels) > 1 else levels[0]), options, "image"
