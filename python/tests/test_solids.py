"""TetGen and gmsh, which take no surface that passes through itself, fill closed and simplified ones."""

from __future__ import annotations

from pathlib import Path

import pytest

import isobrick
from filled_solids import NAMES, filled_by_gmsh, filled_by_tetgen, inner_field


@pytest.mark.parametrize("simplify", [None, 0.3])
@pytest.mark.parametrize("name", NAMES)
def test_closed_surfaces_are_filled(name: str, simplify: float | None, tmp_path: Path) -> None:
    isobrick.build(inner_field(name, tmp_path), tmp_path / "v.isb", brick_cells=16)
    with isobrick.Pyramid(tmp_path / "v.isb") as pyramid:
        mesh = pyramid.extract(0, simplify=simplify)
    quality = mesh.check()
    assert quality.is_solid, quality
    for filled, cells in (filled_by_tetgen(mesh), filled_by_gmsh(mesh)):
        assert cells > len(mesh.faces) / 4
        assert filled == pytest.approx(quality.volume, rel=1e-3)  # nearly flat pairs of triangles are flat to them
