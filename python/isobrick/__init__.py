"""Adaptive crack-free isosurfaces of volumes larger than memory.

    isobrick.build(array, "scan.isb", spacing=(0.5, 0.5, 1.0))
    with isobrick.open("scan.isb") as pyramid:
        mesh = pyramid.extract(1324, focus=(75, 30, 75), radius=20)
    mesh.save("bone.ply")

Or, of an array, without a file: ``points, faces, normals = isobrick.isosurface(array, 1324)``.

Arrays are [z, y, x]: the last axis is x. Points, focus, spacing and origin are (x, y, z) in world units. Arguments
whose names end with ``_voxels``, as ``focus_voxels=(150, 60, 150), radius_voxels=40``, are in voxel indices,
(x, y, z) too, and voxels.
"""

from ._attributes import Colors, Distance, Nearest, Thickness
from ._build import BuildReport, JoinReport, RawLayout, build, join
from ._core import Cancel
from ._by_command import convert, render
from ._errors import ArgumentError, Cancelled, Error, ExistsError, NotFoundError, RangeError
from ._isosurface import isosurface, marching_cubes
from ._level import Level
from ._mesh import Mesh, save_together
from ._pyramid import (
    Damage,
    Histogram,
    MergeReport,
    Pyramid,
    RemoteCounters,
    Session,
    Suggestion,
    merge,
    open,
    open_each,
)
from ._query import Component, Detail, ExtractReport, LevelCounts, MeshQuality, Query, View
from ._show import BrowserView, show
from ._version import __version__

__all__ = [
    "ArgumentError",
    "BrowserView",
    "BuildReport",
    "Cancel",
    "Cancelled",
    "Colors",
    "Component",
    "Damage",
    "Detail",
    "Distance",
    "Error",
    "ExistsError",
    "ExtractReport",
    "Histogram",
    "JoinReport",
    "Level",
    "LevelCounts",
    "MergeReport",
    "Mesh",
    "MeshQuality",
    "Nearest",
    "NotFoundError",
    "Pyramid",
    "Query",
    "RangeError",
    "RawLayout",
    "RemoteCounters",
    "Session",
    "Suggestion",
    "Thickness",
    "View",
    "__version__",
    "build",
    "convert",
    "isosurface",
    "join",
    "marching_cubes",
    "merge",
    "open",
    "open_each",
    "render",
    "save_together",
    "show",
]
