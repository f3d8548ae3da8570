"""Surfaces that leave the volume are closed by caps, and filled as they are. Goes to python/tests/test_capped_solids.py."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import isobrick
from filled_solids import NAMES, field, filled_by_gmsh, filled_by_tetgen


@pytest.mark.parametrize("simplify", [None, 0.3])
@pytest.mark.parametrize("name", NAMES)
def test_capped_surfaces_are_filled(name: str, simplify: float | None, tmp_path: Path) -> None:
    isobrick.build(field(name, tmp_path), tmp_path / "v.isb", brick_cells=16)
    with isobrick.Pyramid(tmp_path / "v.isb") as pyramid:
        mesh = pyramid.extract(0, cap=True, simplify=simplify)
        assert pyramid.extract(0).check().open_edges > 0
    quality = mesh.check()
    assert quality.is_solid, quality
    for filled, cells in (filled_by_tetgen(mesh), filled_by_gmsh(mesh)):
        assert cells > len(mesh.faces) / 4
        assert filled == pytest.approx(quality.volume, rel=1e-3)


def test_a_cap_ends_a_wall(tmp_path: Path) -> None:
    """A half space: from the surface to the border of the volume, and back."""
    z = np.mgrid[:20, :20, :20][0].astype(np.float32)
    isobrick.build(z - 5.5, tmp_path / "v.isb")
    with isobrick.Pyramid(tmp_path / "v.isb") as pyramid:
        mesh = pyramid.extract(0, cap=True, attributes={"wall": isobrick.Thickness()})
    flat = np.abs(np.abs(mesh.normals[:, 2]) - 1) < 1e-3
    assert flat.sum() > 600
    np.testing.assert_allclose(mesh.attributes["wall"][flat], 13.5, atol=1e-4)
