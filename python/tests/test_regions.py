"""Surfaces of a part of a volume."""

from __future__ import annotations

from pathlib import Path

import isobrick
import numpy as np
import pytest

RADIUS = 15.0
CENTER = np.array([23.3, 22.7, 24.1])  # x, y, z


def ball() -> np.ndarray:
    z, y, x = np.meshgrid(*(np.arange(48.0),) * 3, indexing="ij")
    return (RADIUS - np.sqrt((x - CENTER[0]) ** 2 + (y - CENTER[1]) ** 2 + (z - CENTER[2]) ** 2)).astype(np.float32)


def volume_of(mesh: isobrick.Mesh) -> float:
    a, b, c = (mesh.points[mesh.faces[:, i]].astype(float) for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def area_of(mesh: isobrick.Mesh) -> float:
    a, b, c = (mesh.points[mesh.faces[:, i]].astype(float) for i in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_a_plane_and_a_sphere_cut_an_array() -> None:
    half = 2 * np.pi * RADIUS**2
    plane = (CENTER, (1.0, 0.0, 0.0))
    assert area_of(isobrick.isosurface(ball(), 0, clip=plane)) == pytest.approx(half, rel=0.01)
    solid = isobrick.isosurface(ball(), 0, clip=[1, 0, 0, CENTER[0]], cap=True)
    assert volume_of(solid) == pytest.approx(2 / 3 * np.pi * RADIUS**3, rel=0.01)
    inner = isobrick.isosurface(ball(), 0, sphere=(*CENTER, 9.0), cap=True, spacing=(1, 1, 1))
    assert volume_of(inner) == pytest.approx(4 / 3 * np.pi * 9**3, rel=0.01)
    both = isobrick.isosurface(ball(), 0, clip=[(1, 0, 0, CENTER[0]), (0, 1, 0, CENTER[1])], cap=True)
    assert volume_of(both) == pytest.approx(1 / 3 * np.pi * RADIUS**3, rel=0.01)


@pytest.mark.parametrize("dtype", [np.bool_, np.uint8, np.int32, np.uint64])
def test_masks_are_arrays_of_any_type(dtype: type) -> None:
    mask = np.zeros((48, 48, 48), dtype)
    label = 1 if dtype in (np.bool_, np.uint8) else np.iinfo(dtype).max - 1
    mask[:, :, 24:] = label
    if dtype in (np.int32, np.uint64):
        mask[:, :, :24] = np.iinfo(dtype).max  # no float tells the two apart
    solid = isobrick.isosurface(ball(), 0, mask=(mask, label), cap=True)
    h = RADIUS - (23.5 - CENTER[0])
    assert volume_of(solid) == pytest.approx(np.pi * h**2 * (3 * RADIUS - h) / 3, rel=0.01)


def test_masks_of_pyramids(tmp_path: Path) -> None:
    isobrick.build(ball(), tmp_path / "ball.isb")
    coarse = np.zeros((24, 24, 24), np.uint8)
    coarse[:, :, 12:] = 7
    isobrick.build(coarse, tmp_path / "mask.isb", spacing=(2, 2, 2), origin=(0.5, 0.5, 0.5))
    with isobrick.open(tmp_path / "ball.isb") as pyramid, isobrick.open(tmp_path / "mask.isb") as mask:
        whole = pyramid.extract(0)
        cut = pyramid.extract(0, mask=(mask, 7))
        assert set(map(tuple, cut.points)) <= set(map(tuple, whole.points))
        assert cut.index_points[:, 0].min() >= 24
        same = pyramid.extract(0, mask=np.repeat(np.repeat(np.repeat(coarse, 2, 0), 2, 1), 2, 2))
        assert np.array_equal(cut.points, same.points)
        with pytest.raises(isobrick.Error, match="shape"):
            pyramid.extract(0, mask=coarse)
        with pytest.raises(isobrick.Error, match="clip"):
            pyramid.extract(0, clip=(1, 2, 3))
