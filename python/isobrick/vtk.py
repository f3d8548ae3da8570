"""isobrick in VTK: meshes as ``vtkPolyData``, levels as ``vtkImageData``, and a source of a pipeline.

Points, focus and box are (x, y, z) in world units. Takes the package vtk, or ParaView's.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from vtkmodules.util.vtkAlgorithm import VTKPythonAlgorithmBase
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkPolyData
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
from vtkmodules.vtkCommonMath import vtkMatrix3x3

from ._poly_data import poly_data_of, vtk_array
from ._pyramid import Pyramid, Session

__all__ = ["ImageSource", "Source", "image_data_of", "poly_data_of"]


def _spacing_origin_direction(pyramid: Pyramid, level: int) -> tuple[list[float], list[float], list[float]]:
    affine = pyramid.level(level).affine
    spacing = np.linalg.norm(affine[:3, :3], axis=0)
    return spacing.tolist(), affine[:3, 3].tolist(), (affine[:3, :3] / spacing).ravel().tolist()


def image_data_of(pyramid: Pyramid, level: int = 0, into: Any = None) -> Any:
    """A level as ``vtkImageData`` in its place in the world, oblique directions too; the scalars are called
    ``voxels``. Reads the whole level into memory."""
    result = vtkImageData() if into is None else into
    samples = np.asarray(pyramid.level(level))
    result.SetDimensions(samples.shape[::-1])
    spacing, origin, direction = _spacing_origin_direction(pyramid, level)
    result.SetSpacing(spacing)
    result.SetOrigin(origin)
    matrix = vtkMatrix3x3()
    matrix.DeepCopy(direction)
    result.SetDirectionMatrix(matrix)
    result.GetPointData().SetScalars(vtk_array(samples.ravel(), "voxels", copy=True))
    return result


class Source(VTKPythonAlgorithmBase):
    """Isosurfaces of a pyramid as a source of VTK's pipeline.

    Points, focus and radius are (x, y, z) in world units. ``SetIsovalues`` takes one or several; their surfaces
    come as one ``vtkPolyData``, whose cells know theirs as ``isovalue``. Without a radius the surface is of the
    finest level everywhere, or of that of ``SetLevel``.
    """

    def __init__(self) -> None:
        super().__init__(nInputPorts=0, nOutputPorts=1, outputType="vtkPolyData")  # type: ignore[no-untyped-call]
        self._file_name = ""
        self._isovalues: list[float] = []
        self._focus = (0.0, 0.0, 0.0)
        self._radius = 0.0
        self._level = 0
        self._simplify = 0.0
        self._memory = "1G"
        self._session: Session | None = None

    def _set(self, name: str, value: Any) -> None:
        if getattr(self, name) != value:
            setattr(self, name, value)
            self.Modified()

    def SetFileName(self, name: str | None) -> None:
        """The pyramid, an ``.isb``."""
        if (name or "") != self._file_name:
            self._session = None
        self._set("_file_name", name or "")

    def GetFileName(self) -> str:
        return self._file_name

    def SetIsovalues(self, *isovalues: Any) -> None:
        """One, or several; none: the first that the pyramid suggests."""
        flat = isovalues[0] if len(isovalues) == 1 and not np.isscalar(isovalues[0]) else isovalues
        self._set("_isovalues", [float(v) for v in flat])

    def SetIsovalue(self, isovalue: float) -> None:
        self.SetIsovalues(isovalue)

    def GetIsovalues(self) -> list[float]:
        return self._isovalues

    def SetFocus(self, x: Any, y: Any = None, z: Any = None) -> None:
        """Centre of interest, (x, y, z) in world units; counts with a radius above 0."""
        self._set("_focus", tuple(float(v) for v in (x if y is None else (x, y, z))))

    def SetRadius(self, radius: float) -> None:
        """In world units: the finest level within it, coarser outside. 0: the same level everywhere."""
        self._set("_radius", float(radius))

    def SetLevel(self, level: int) -> None:
        """The level of the whole surface, if there is no radius; 0 is the finest."""
        self._set("_level", int(level))

    def SetSimplify(self, distance: float) -> None:
        """Fewer triangles, within this distance in world units; 0: all."""
        self._set("_simplify", float(distance))

    def SetMemory(self, memory: int | str) -> None:
        """The bound of the file's memory, as ``isobrick.open`` takes it."""
        self._session = None
        self._set("_memory", memory)

    def pyramid(self) -> Pyramid:
        """The pyramid of the file name, open."""
        return self._opened().pyramid

    def _opened(self) -> Session:
        if self._session is None:
            self._session = Pyramid(self._file_name, self._memory).session()
        return self._session

    def RequestData(self, request: Any, in_info: Any, out_info: Any) -> int:
        output = vtkPolyData.GetData(out_info, 0)
        session = self._opened()
        choice: dict[str, Any] = {}
        if self._radius > 0:
            choice.update(focus=self._focus, radius=self._radius)
        elif self._level > 0:
            choice.update(level=self._level)
        if self._simplify > 0:
            choice.update(simplify=self._simplify)
        surfaces = []
        for isovalue in self._isovalues or [session.pyramid._isovalue("auto")]:
            surface = poly_data_of(session.extract(isovalue, **choice), copy=True)
            values = np.full(surface.GetNumberOfPolys(), isovalue, np.float32)
            surface.GetCellData().AddArray(vtk_array(values, "isovalue", copy=True))
            surfaces.append(surface)
        if len(surfaces) == 1:
            output.ShallowCopy(surfaces[0])
            return 1
        from vtkmodules.vtkFiltersCore import vtkAppendPolyData

        append = vtkAppendPolyData()
        for surface in surfaces:
            append.AddInputData(surface)
        append.Update()
        output.ShallowCopy(append.GetOutput())
        return 1


class ImageSource(VTKPythonAlgorithmBase):
    """A level of a pyramid as ``vtkImageData``, in its place in the world: a reader of ``.isb``."""

    def __init__(self) -> None:
        super().__init__(nInputPorts=0, nOutputPorts=1, outputType="vtkImageData")  # type: ignore[no-untyped-call]
        self._file_name = ""
        self._level = 0
        self._pyramid: Pyramid | None = None

    def SetFileName(self, name: str | None) -> None:
        """The pyramid, an ``.isb``."""
        if (name or "") != self._file_name:
            self._file_name = name or ""
            self._pyramid = None
            self.Modified()

    def SetLevel(self, level: int) -> None:
        """0 is the finest."""
        if level != self._level:
            self._level = int(level)
            self.Modified()

    def pyramid(self) -> Pyramid:
        """The pyramid of the file name, open."""
        if self._pyramid is None:
            self._pyramid = Pyramid(self._file_name)
        return self._pyramid

    def _chosen(self) -> int:
        """The coarsest level if there is none so coarse."""
        return min(self._level, len(self.pyramid().levels) - 1)

    def RequestInformation(self, request: Any, in_info: Any, out_info: Any) -> int:
        level = self._chosen()
        spacing, origin, direction = _spacing_origin_direction(self.pyramid(), level)
        nz, ny, nx = self.pyramid().level(level).shape
        information = out_info.GetInformationObject(0)
        information.Set(vtkStreamingDemandDrivenPipeline.WHOLE_EXTENT(), (0, nx - 1, 0, ny - 1, 0, nz - 1), 6)
        information.Set(vtkImageData.SPACING(), spacing, 3)
        information.Set(vtkImageData.ORIGIN(), origin, 3)
        information.Set(vtkImageData.DIRECTION(), direction, 9)
        return 1

    def RequestData(self, request: Any, in_info: Any, out_info: Any) -> int:
        image_data_of(self.pyramid(), self._chosen(), vtkImageData.GetData(out_info, 0))
        return 1
