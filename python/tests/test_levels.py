"""Levels are arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import isobrick
from conftest import ball


@pytest.fixture(scope="module")
def pyramid(tmp_path_factory: pytest.TempPathFactory) -> isobrick.Pyramid:
    path = tmp_path_factory.mktemp("levels") / "l.isb"
    array = np.arange(53 * 41 * 37, dtype=np.float32).reshape(53, 41, 37) % 251
    isobrick.build(array, path, brick_cells=16, codec="none")
    return isobrick.open(path)


@pytest.mark.parametrize("level", [0, 1, 2])
@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_slicing_is_that_of_numpy(pyramid: isobrick.Pyramid, level: int, data: st.DataObject) -> None:
    array = pyramid.level(level)
    whole = np.asarray(array)
    key = data.draw(hnp.basic_indices(array.shape, allow_newaxis=False))
    assert np.array_equal(array[key], whole[key])
    assert np.asarray(array[key]).shape == whole[key].shape


def test_lists_and_masks_pick_an_outer_product(pyramid: isobrick.Pyramid) -> None:
    level, whole = pyramid.level(0), np.asarray(pyramid.level(0))
    rows, mask = [5, -1, 5], np.arange(37) % 3 == 0
    assert np.array_equal(level[:, rows, mask], whole[:, rows][:, :, mask])
    assert level[3:3].shape == (0, 41, 37)
    for key in [99, (0, -42), (0, 0, 0, 0), ([53],), "x"]:
        with pytest.raises(IndexError):
            level[key]


def test_levels_are_the_average_of_the_finer_ones(pyramid: isobrick.Pyramid) -> None:
    fine, coarse = (np.asarray(pyramid.level(l), dtype=np.float64) for l in (0, 1))
    # (1 2 1)/4 along each axis at an inner sample.
    weights = np.array([1, 2, 1]) / 4
    block = fine[3:6, 3:6, 3:6]
    assert coarse[2, 2, 2] == pytest.approx(np.einsum("ijk,i,j,k", block, weights, weights, weights), rel=1e-6)
    assert [l.shape for l in pyramid.levels][:3] == [(53, 41, 37), (27, 21, 19), (14, 11, 10)]
    assert np.allclose(pyramid.level(2).affine[:3, :3], 4 * pyramid.affine[:3, :3])


def test_dask_and_zarr_take_levels_as_they_are(pyramid: isobrick.Pyramid, tmp_path: Path) -> None:
    import dask.array

    whole = np.asarray(pyramid.level(0))
    lazy = dask.array.from_array(pyramid.level(0), chunks=pyramid.level(0).chunks)
    assert np.array_equal((lazy[3:30] * 2).compute(), whole[3:30] * 2)
    lazy.to_zarr(tmp_path / "out.zarr")
    isobrick.build(dask.array.from_zarr(tmp_path / "out.zarr"), tmp_path / "again.isb")
    assert np.array_equal(np.asarray(isobrick.open(tmp_path / "again.isb").level(0)), whole)


def test_bricks_are_views_that_outlive_their_pyramid(tmp_path: Path) -> None:
    array = ball(70, "uint16")
    isobrick.build(array, tmp_path / "b.isb", codec="none")
    with isobrick.open(tmp_path / "b.isb") as pyramid:
        first, brick = pyramid.level(0).brick(0, 1, 0)
        with pytest.raises(IndexError):
            pyramid.level(0).brick(0, 2, 0)
    assert not brick.flags.writeable and not brick.flags.owndata
    box = tuple(slice(f, f + n) for f, n in zip(first, brick.shape))
    assert first == (0, 63, 0) and np.array_equal(brick, array[box])


def test_facts_of_a_pyramid(head: Path) -> None:
    with isobrick.open(head) as pyramid:
        assert pyramid.shape == (128, 128, 128) and pyramid.dtype == np.uint16
        voxels = np.asarray(pyramid.level(0))
        histogram = pyramid.histogram()
        values, counts = np.unique(voxels, return_counts=True)
        assert np.array_equal(histogram.least, values) and np.array_equal(histogram.counts, counts)
        assert pyramid.value_range == (voxels.min(), voxels.max())
        assert 400 < pyramid.isovalues()[0].value < 1324
        assert pyramid.noise > 0 and pyramid.verify() == []
        assert pyramid.provenance["source"]
    with pytest.raises(isobrick.Error, match="closed"):
        pyramid.shape


def test_a_copy_as_array_is_never_a_view(head: Path) -> None:
    with isobrick.open(head) as pyramid:
        with pytest.raises(ValueError):
            np.array(pyramid.level(3), copy=False)
        assert np.asarray(pyramid.level(3), dtype=np.float64).dtype == np.float64
