"""Volumes whose surfaces programs of simulations fill, and the programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import tetgen
from numpy.typing import NDArray

import isobrick

#: Solids by their fields, which are 0 on the surface: some leave the volume.
NAMES = ["ball", "plate", "gyroid", "noise", "head"]


def field(name: str, folder: Path, n: int = 40) -> NDArray[np.float32]:
    """[z, y, x], in voxels from the surface where that is known; "head" is a CT-like phantom."""
    z, y, x = np.mgrid[:n, :n, :n].astype(np.float64)
    middle = (n - 1) / 2
    if name == "ball":  # leaves by one face
        values = 0.45 * n - np.sqrt((x - middle) ** 2 + (y - 0.3 * n) ** 2 + (z - middle) ** 2)
    elif name == "plate":  # leaves by four
        values = 0.1 * n - np.abs(z - middle + 0.2 * (x - middle))
    elif name == "gyroid":
        a, b, c = (0.35 * w for w in (x, y, z))
        values = np.sin(a) * np.cos(b) + np.sin(b) * np.cos(c) + np.sin(c) * np.cos(a)
    elif name == "noise":
        values = np.random.default_rng(5).uniform(-1, 1, (n // 3, n // 3, n // 3))
    else:
        isobrick.build(f"phantom:head:{n}", folder / "head.isb")
        with isobrick.Pyramid(folder / "head.isb") as pyramid:
            values = pyramid.level(0)[...].astype(np.float64) - 1290
    return values.astype(np.float32)


def inner_field(name: str, folder: Path, n: int = 40) -> NDArray[np.float32]:
    """The same with nothing outside, so that the surface is closed without caps."""
    values = field(name, folder, n)
    return np.pad(values, 1, constant_values=float(-np.abs(values).max()))


def filled_by_tetgen(mesh: isobrick.Mesh) -> tuple[float, int]:
    """The volume of the tetrahedra, and how many there are."""
    filler = tetgen.TetGen(mesh.points.astype(np.float64), mesh.faces.astype(np.int32))
    points, cells = filler.tetrahedralize(switches="pYQ")[:2]
    return _volume(points, cells), len(cells)


def filled_by_gmsh(mesh: isobrick.Mesh) -> tuple[float, int]:
    """The same."""
    import gmsh

    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        # It takes facets for overlapping that meet at less than 0.1 degrees; these do not overlap.
        gmsh.option.setNumber("Mesh.AngleToleranceFacetOverlap", 1e-4)
        gmsh.model.add("solid")
        surface = gmsh.model.addDiscreteEntity(2)
        numbers = np.arange(1, len(mesh.points) + 1)
        gmsh.model.mesh.addNodes(2, surface, numbers, mesh.points.astype(np.float64).ravel())
        gmsh.model.mesh.addElementsByType(surface, 2, [], (mesh.faces.astype(np.int64) + 1).ravel())
        gmsh.model.geo.addVolume([gmsh.model.geo.addSurfaceLoop([surface])])
        gmsh.model.geo.synchronize()
        gmsh.model.mesh.generate(3)
        tags, places, _ = gmsh.model.mesh.getNodes()
        at = np.zeros(int(tags.max()) + 1, np.int64)
        at[tags.astype(np.int64)] = np.arange(len(tags))
        _, corners = gmsh.model.mesh.getElementsByType(4)
        return _volume(places.reshape(-1, 3), at[corners.astype(np.int64)].reshape(-1, 4)), len(corners) // 4
    finally:
        gmsh.finalize()


def _volume(points: Any, cells: Any) -> float:
    corners = points[cells]
    return float(np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])).sum() / 6)
