"""Meshes in memory."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import _core
from ._attributes import Colors
from ._errors import ArgumentError
from ._query import Component, ExtractReport, MeshQuality, Space, make_report, placement_of

if TYPE_CHECKING:
    import meshio
    import pyvista
    import trimesh


class Mesh:
    """A triangle mesh. Its arrays are the library's own memory, read-only and alive as long as one of them is.

    Points are (x, y, z) in world units; ``index_points`` has them in voxel indices. Triangles wind
    counter-clockwise seen from outside, and normals point there: where values are below the isovalue, or above it if
    the query says ``inside='below'``.
    """

    def __init__(self, handle: _core.MeshHandle) -> None:
        self._handle = handle

    def __iter__(self) -> Iterator[NDArray[Any]]:
        """``points, faces, normals = mesh``."""
        return iter((self.points, self.faces, self.normals))

    @property
    def points(self) -> NDArray[Any]:
        """(n, 3), world units, (x, y, z): float32, or float64 where the volume lies so far from the world's
        origin that float32 cannot tell neighbouring points apart. Made when it is first asked for."""
        return self._handle.points()

    @property
    def index_points(self) -> NDArray[np.float64]:
        """(n, 3): the points in voxel indices, (x, y, z). A new array for every call."""
        return self._handle.index_points()

    @property
    def faces(self) -> NDArray[np.uint32]:
        """(m, 3): three numbers of points each."""
        return self._handle.faces()

    @property
    def normals(self) -> NDArray[np.float32]:
        """(n, 3): unit, in the world, outward."""
        return self._handle.normals()

    @property
    def levels(self) -> NDArray[np.uint8]:
        """(m,): the level of the pyramid that each triangle comes from."""
        return self._handle.levels()

    @property
    def caps(self) -> NDArray[np.bool_]:
        """(m,): whether each triangle closes the surface at the border of the volume or of the box
        (``Query.cap``)."""
        return self._handle.caps()

    @property
    def values(self) -> NDArray[np.float32] | None:
        """(n,): of the other pyramid that the query named as ``values``, NaN outside of it; None without one."""
        return self.attributes.get("value")

    @property
    def attributes(self) -> dict[str, NDArray[Any]]:
        """(n,) each, by name: the numbers of the points that the query asked for, ``values`` as "value". Labels are
        int32 or uint32, others float32; float64 for labels that are not whole. Made when first asked for."""
        return self._handle.attributes()

    @property
    def report(self) -> ExtractReport:
        """The report of the extraction."""
        return make_report(self._handle.report())

    @property
    def is_complete(self) -> bool:
        """False: coarser than asked for, as the query took what was in memory (``Session.progressive``)."""
        return bool(self._handle.report()["is_complete"])

    @property
    def unit(self) -> str:
        """The unit of the points: 'millimetres' or 'unknown'."""
        return self._handle.unit()

    def __repr__(self) -> str:
        return f"<isobrick.Mesh: {len(self.faces):,} triangles, {len(self.normals):,} points>"

    def area(self) -> float:
        """The area of the surface, in world units squared."""
        a, b, c = (self.points[self.faces[:, i]].astype(np.float64) for i in range(3))
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)

    def volume(self) -> float:
        """Inside of a closed surface, in world units cubed. What the volume's border cuts open is closed with
        ``cap=True``."""
        middle = self.points.mean(axis=0, dtype=np.float64) if len(self.points) else 0.0
        a, b, c = (self.points[self.faces[:, i]].astype(np.float64) - middle for i in range(3))
        return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)

    def components(self) -> list[Component]:
        """The connected pieces of the surface, the largest area first."""
        return [Component(*one) for one in self._handle.components()[0]]

    def component_of_faces(self) -> NDArray[np.uint32]:
        """(m,): of each triangle the place of its piece in ``components()``."""
        return self._handle.components()[1]

    def check(self) -> MeshQuality:
        """Whether the mesh is closed, manifold and oriented, triangles that cross or have no area, angles and
        more."""
        return MeshQuality(**self._handle.check())

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        colors: Colors | None = None,
        zlib: bool = False,
        meshopt: bool = False,
        space: Space = "LPS",
        unit: str | None = None,
        shift: Sequence[float] = (0, 0, 0),
    ) -> None:
        """Writes a file, to the byte that of ``extract_to``, but for ``meshopt``, whose chunks are cut elsewhere. One
        of that name is replaced.

        Parameters
        ----------
        path
            its ending is the format: ``.ply``, ``.stl``, ``.obj``, ``.glb``, ``.vtp`` or ``.3mf``
        colors
            of the points, by an attribute
        zlib, meshopt
            pack ``.vtp``; ``.glb``
        space, unit, shift
            where the points lie, (x, y, z), in place of the world: 'RAS', or 'index' for voxel indices; in 'nm', 'um',
            'mm', 'cm', 'm', 'inch' or 'ft'; moved by this last
        """
        self._handle.save(os.fspath(path), colors, zlib, meshopt, placement_of(space, unit, shift))

    def to_vtk(self) -> Any:
        """A ``vtkPolyData`` on this memory: points (x, y, z) in world units, with ``Normals``, ``level`` of the
        cells, ``cap`` of the cells if there are any, and the attributes of the points. Takes the package vtk."""
        from ._poly_data import poly_data_of

        return poly_data_of(self)

    def to_pyvista(self) -> pyvista.PolyData:
        """``to_vtk()`` as a ``pyvista.PolyData``, points (x, y, z) in world units. Takes the package pyvista."""
        import pyvista

        return pyvista.PolyData(self.to_vtk())

    def to_trimesh(self) -> trimesh.Trimesh:
        """A ``trimesh.Trimesh``, points (x, y, z) in world units. Takes the package trimesh."""
        import trimesh

        return trimesh.Trimesh(
            self.points, self.faces, vertex_normals=self.normals, process=False, metadata={"units": self.unit}
        )

    def to_meshio(self) -> meshio.Mesh:
        """A ``meshio.Mesh``, points (x, y, z) in world units. Takes the package meshio."""
        import meshio

        point_data: dict[str, Any] = {"Normals": self.normals}
        point_data.update(self.attributes)
        return meshio.Mesh(
            self.points, [("triangle", self.faces)], point_data=point_data, cell_data={"level": [self.levels]}
        )

    def to_open3d(self) -> Any:
        """An ``open3d.geometry.TriangleMesh``, points (x, y, z) in world units; copied. Takes the package
        open3d."""
        import open3d

        mesh = open3d.geometry.TriangleMesh(
            open3d.utility.Vector3dVector(self.points.astype(np.float64)),
            open3d.utility.Vector3iVector(self.faces.astype(np.int32)),
        )
        mesh.vertex_normals = open3d.utility.Vector3dVector(self.normals.astype(np.float64))
        return mesh


def save_together(
    path: str | os.PathLike[str],
    meshes: Mapping[str, Mesh] | Mapping[int, Mesh],
    *,
    mesh_colors: Mapping[Any, Sequence[float]] | None = None,
    zlib: bool = False,
    meshopt: bool = False,
    space: Space = "LPS",
    unit: str | None = None,
    shift: Sequence[float] = (0, 0, 0),
    colors: Mapping[Any, Sequence[float]] | None = None,
) -> None:
    """Writes several meshes to one file: ``save_together("head.glb", {"skin": skin, "bone": bone})``.

    A ``.glb`` or ``.3mf`` has an object for each. Meshes of labels go into one mesh as well, of ``.ply``, ``.vtp`` or
    ``.obj``: ``save_together("parts.ply", {i: isobrick.isosurface(ids, label=i) for i in (3, 7)})``. A mesh without
    triangles is left out, and so are attributes. A file of that name is replaced.

    Parameters
    ----------
    path
        its ending is the format
    meshes
        by name; or by label, a whole number, whose name is "label 3". In ``.ply`` and ``.vtp`` the points of labels,
        below 2**32, have a whole number ``label``, in ``.obj`` the triangles are groups of these names
    mesh_colors
        of some or all of the meshes in ``.glb`` and ``.3mf``, by the same keys: (red, green, blue), sRGB, 0 to 1
    zlib, meshopt, space, unit, shift
        as for ``Mesh.save``
    colors
        the old name of ``mesh_colors``, until 0.4
    """
    if colors is not None:
        warnings.warn("colors= is mesh_colors= now; the old name ends with version 0.4", FutureWarning, stacklevel=2)
        mesh_colors = colors
    if not meshes:
        raise ArgumentError("there is no mesh to write; give one")
    are_labels = all(isinstance(key, int | np.integer) for key in meshes)
    objects = []
    for key, mesh in meshes.items():
        color = (mesh_colors or {}).get(key)
        name, label = (f"label {key}", int(key)) if are_labels else (str(key), 0)
        objects.append((mesh._handle, name, label, None if color is None else tuple(map(float, color))))
    _core.save_together(objects, os.fspath(path), are_labels, zlib, meshopt, placement_of(space, unit, shift))
