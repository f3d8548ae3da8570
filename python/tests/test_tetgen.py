"""TetGen, which takes no surface that passes through itself, fills isobrick's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tetgen

import isobrick


def noise(_: Path) -> Any:
    """Cells with any pattern of signs; below the isovalue at the border, where a surface would be open."""
    values = np.full((14, 14, 14), -1.0, np.float32)
    values[1:-1, 1:-1, 1:-1] = np.random.default_rng(7).uniform(-1, 1, (12, 12, 12))
    return values


def thin_shell(_: Path) -> Any:
    """A wall of 0.7 voxels: two sheets of the surface run through the same cells."""
    z, y, x = np.mgrid[:32, :32, :32] - 15.5
    return (0.35 - np.abs(np.sqrt(x * x + y * y + z * z) - 11.3)).astype(np.float32)


def head(folder: Path) -> Any:
    """Its neck leaves the volume, so air comes around it."""
    isobrick.build("phantom:head:64", folder / "head.isb")
    with isobrick.Pyramid(folder / "head.isb") as pyramid:
        return np.pad(pyramid.level(0)[...], 1)


@pytest.mark.parametrize("volume, isovalue", [(noise, 0.0), (thin_shell, 0.0), (head, 1290.0)])
def test_tetgen_fills_the_surface(volume: Any, isovalue: float, tmp_path: Path) -> None:
    isobrick.build(volume(tmp_path), tmp_path / "v.isb")
    with isobrick.Pyramid(tmp_path / "v.isb") as pyramid:
        mesh = pyramid.extract(isovalue)
    filler = tetgen.TetGen(mesh.points.astype(np.float64), mesh.faces.astype(np.int32))
    points, cells = filler.tetrahedralize(switches="pYQ")[:2]
    corners = points[cells]
    filled = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])).sum() / 6
    a, b, c = (mesh.points[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    enclosed = abs((a * np.cross(b, c)).sum()) / 6
    assert len(cells) > len(mesh.faces) / 4
    assert filled == pytest.approx(enclosed, rel=1e-4)  # nearly flat pairs of triangles are flat to TetGen
