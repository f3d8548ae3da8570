"""Meshes as VTK has them. Takes the package vtk."""

from __future__ import annotations

import gc
import weakref
from functools import cache
from typing import Any

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkPoints, vtkTypeInt32Array, vtkTypeInt64Array
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData


def vtk_array(array: Any, name: str | None = None, copy: bool = False) -> Any:
    """On the array's own memory, which it keeps alive; or a copy."""
    result = numpy_to_vtk(array, deep=copy)
    if name is not None:
        result.SetName(name)
    return result


def _index_array(array: Any, copy: bool) -> Any:
    """Of the very type that cells store: they would share the memory of another one, and not its owner."""
    result: Any = (vtkTypeInt32Array if array.itemsize == 4 else vtkTypeInt64Array)()
    result.SetVoidArray(array, array.size, 1)
    if copy:
        copied = result.NewInstance()
        copied.DeepCopy(result)
        return copied
    result._numpy_reference = array
    return result


@cache
def _cells_keep_memory() -> bool:
    """Whether cells keep the memory of arrays that they were given; those of VTK 9.2 do not."""

    class Watched(np.ndarray):
        """An array with weak references."""

    numbers = np.arange(0, 4, 3, dtype=np.int32).view(Watched)
    watch = weakref.ref(numbers)
    cells = vtkCellArray()
    cells.SetData(_index_array(numbers, False), _index_array(np.arange(3, dtype=np.int32), True))
    del numbers
    gc.collect()
    return watch() is not None


def poly_data_of(mesh: Any, copy: bool = False) -> Any:
    """A ``vtkPolyData``, points (x, y, z) in world units: with ``Normals``, ``level`` of the cells, ``cap`` of the
    cells if there are any, and the attributes of the points. On the memory of the mesh, which lives as long as the
    arrays of this object do; arrays that are
    made of these by ``vtkDataArray.ShallowCopy`` do not keep it, so that a pipeline gets a ``copy``."""
    result = vtkPolyData()
    points = vtkPoints()
    points.SetData(vtk_array(mesh.points, copy=copy))
    result.SetPoints(points)
    # VTK has signed numbers: the same bits below 2^31.
    faces = mesh.faces
    is_small = 3 * len(faces) < 2**31
    signed = faces.view(np.int32) if is_small else faces.astype(np.int64)
    offsets = np.arange(0, 3 * len(faces) + 1, 3, dtype=signed.dtype)
    copies_cells = copy or not _cells_keep_memory()
    cells = vtkCellArray()
    cells.SetData(_index_array(offsets, copies_cells), _index_array(signed.ravel(), copies_cells))
    result.SetPolys(cells)
    result.GetPointData().SetNormals(vtk_array(mesh.normals, "Normals", copy))
    result.GetCellData().AddArray(vtk_array(mesh.levels, "level", copy))
    if mesh.caps.any():
        result.GetCellData().AddArray(vtk_array(mesh.caps.view(np.uint8), "cap", copy))
    for name, values in mesh.attributes.items():
        result.GetPointData().AddArray(vtk_array(values, name, copy))
        if result.GetPointData().GetScalars() is None:
            result.GetPointData().SetActiveScalars(name)
    return result
