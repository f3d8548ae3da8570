"""A plugin for ParaView 5.11 and later: surfaces and levels of pyramids.

Load it with Tools > Manage Plugins > Load New, or ``LoadPlugin(isobrick.paraview_plugin.__file__)`` in pvpython
and pvbatch; ParaView's Python has to find isobrick. An ``.isb`` or ``.isbs`` (in a file dialog: the ``index.isb``
in that folder) opens as "Isobrick Surface", with isovalues, focus, radius, simplification and level in the
properties panel, or as "Isobrick Level": an image of a chosen level in its place in the world. Coordinates are
(x, y, z) in world units.
"""

from __future__ import annotations

import os
import sys
from typing import Any

from paraview.util.vtkAlgorithm import smdomain, smhint, smproperty, smproxy

# ParaView runs this file by its path: the package is where it lies.
if "isobrick" not in sys.modules:
    sys.path.append(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))

from isobrick.vtk import ImageSource, Source  # noqa: E402

EXTENSIONS = "isb isbs"
DESCRIPTION = "isobrick pyramids"


@smproxy.reader(
    name="IsobrickSurface", label="Isobrick Surface", extensions=EXTENSIONS, file_description=DESCRIPTION
)
class IsobrickSurface(Source):
    """Isosurfaces of a pyramid."""

    @smproperty.stringvector(name="FileName")
    @smdomain.filelist()
    @smhint.filechooser(extensions=EXTENSIONS, file_description=DESCRIPTION)
    def SetFileName(self, name: str) -> None:
        super().SetFileName(name)

    @smproperty.xml(
        """
        <DoubleVectorProperty name="Isovalues" command="AddIsovalue" clean_command="ClearIsovalues"
                              repeat_command="1" number_of_elements_per_command="1" animateable="1">
          <Documentation>Values of at least this are inside. None: the first that the pyramid suggests.</Documentation>
        </DoubleVectorProperty>
        """
    )
    def AddIsovalue(self, isovalue: float) -> None:
        self.SetIsovalues([*self.GetIsovalues(), isovalue])

    def ClearIsovalues(self) -> None:
        self.SetIsovalues([])

    @smproperty.xml(
        """
        <DoubleVectorProperty name="Focus" command="SetFocus" number_of_elements="3" default_values="0 0 0"
                              animateable="1">
          <DoubleRangeDomain name="range"/>
          <Documentation>Centre of interest, (x, y, z) in world units; counts if the radius is above 0.</Documentation>
        </DoubleVectorProperty>
        <PropertyGroup panel_widget="InteractiveHandle" label="Focus">
          <Property function="WorldPosition" name="Focus"/>
        </PropertyGroup>
        """
    )
    def SetFocus(self, x: Any, y: Any = None, z: Any = None) -> None:
        super().SetFocus(x, y, z)

    @smproperty.doublevector(name="Radius", default_values=0.0)
    @smdomain.doublerange(min=0)
    def SetRadius(self, radius: float) -> None:
        super().SetRadius(radius)

    @smproperty.intvector(name="Level", default_values=0)
    @smdomain.intrange(min=0, max=19)
    def SetLevel(self, level: int) -> None:
        super().SetLevel(level)

    @smproperty.doublevector(name="Simplify", default_values=0.0)
    @smdomain.doublerange(min=0)
    def SetSimplify(self, distance: float) -> None:
        super().SetSimplify(distance)


@smproxy.reader(name="IsobrickLevel", label="Isobrick Level", extensions=EXTENSIONS, file_description=DESCRIPTION)
class IsobrickLevel(ImageSource):
    """One level of a pyramid as an image."""

    @smproperty.stringvector(name="FileName")
    @smdomain.filelist()
    @smhint.filechooser(extensions=EXTENSIONS, file_description=DESCRIPTION)
    def SetFileName(self, name: str) -> None:
        super().SetFileName(name)

    @smproperty.intvector(name="Level", default_values=1)
    @smdomain.intrange(min=0, max=19)
    def SetLevel(self, level: int) -> None:
        super().SetLevel(level)
