"""Run by ParaView, in pvbatch and in its client: the plugin's readers, a picture, and the state as Python."""

import os
import sys

import isobrick
from paraview import smstate
from paraview.simple import *  # noqa: F403

pyramid, out = os.environ["TRY_PYRAMID"], os.environ["TRY_OUT"]
with isobrick.open(pyramid) as opened:
    wanted = sum(len(opened.extract(v, focus=(64, 40, 64), radius=25).faces) for v in (500, 1324))
    shape = opened.level(2).shape

surface = IsobrickSurface(FileName=pyramid)  # noqa: F405
surface.Isovalues = [500.0, 1324.0]
surface.Focus = [64, 40, 64]
surface.Radius = 25
surface.UpdatePipeline()
assert surface.GetDataInformation().GetNumberOfCells() == wanted
surface.Isovalues = [1324.0]
surface.UpdatePipeline()
assert surface.GetDataInformation().GetNumberOfCells() < wanted

level = IsobrickLevel(FileName=pyramid)  # noqa: F405
level.Level = 2
level.UpdatePipeline()
assert tuple(level.GetDataInformation().GetExtent()[1::2]) == tuple(n - 1 for n in reversed(shape))

view = GetActiveViewOrCreate("RenderView")  # noqa: F405
view.ViewSize = [500, 500]
display = Show(surface, view)  # noqa: F405
ColorBy(display, ("CELLS", "level"))  # noqa: F405
ResetCamera(view)  # noqa: F405
view.CameraPosition, view.CameraFocalPoint, view.CameraViewUp = [64, -260, 64], [64, 64, 64], [0, 0, 1]
Render(view)  # noqa: F405
SaveScreenshot(f"{out}.png", view)  # noqa: F405
state = smstate.get_state()
assert "IsobrickSurface(" in state and "Isovalues = [1324.0]" in state
with open(f"{out}.py", "w") as file:
    file.write(state)
print("plugin: works", flush=True)
if "paraview" in os.path.basename(sys.executable) or os.environ.get("TRY_CLIENT"):
    os._exit(0)
