"""One row of tools/benchmark.sh in a Python process of its own, as JSON.

  python_peer.py ROW VOLUME ISOVALUE THREADS REPEATS warm|cold

ROW: vtkFlyingEdges3D, vtkMarchingCubes, skimage, PyMCubes, or isobrick. VOLUME: a pyramid for isobrick; for the others
a JSON file {"raw": PATH, "type": ..., "shape": [z, y, x]}. warm: the volume is in memory, and the first surface does
not count. cold: one time, from opening the file to the mesh, without that of importing a package.
"""

import json
import os
import sys
import time

row, volume, isovalue, threads, repeats, cache = sys.argv[1:]
isovalue, threads, repeats = float(isovalue), int(threads), int(repeats)


def status(key):
    with open("/proc/self/status", encoding="ascii") as file:
        return 1024 * int(file.read().split(key + ":")[1].split()[0])


def array_of(path):
    import numpy as np

    with open(path, encoding="utf-8") as file:
        layout = json.load(file)
    return np.fromfile(layout["raw"], dtype=layout["type"]).reshape(layout["shape"])


def vtk_row(name):
    import vtkmodules.util.numpy_support as support
    from vtkmodules import vtkFiltersCore
    from vtkmodules.vtkCommonCore import vtkSMPTools, vtkVersion
    from vtkmodules.vtkCommonDataModel import vtkImageData

    vtkSMPTools.SetBackend("STDThread")  # the default of PyPI is Sequential
    vtkSMPTools.Initialize(threads)

    def load():
        array = array_of(volume)
        image = vtkImageData()
        image.SetDimensions(*array.shape[::-1])
        image.GetPointData().SetScalars(support.numpy_to_vtk(array.ravel()))
        contour = getattr(vtkFiltersCore, name)()
        contour.SetInputData(image)
        contour.SetValue(0, isovalue)
        contour.ComputeNormalsOn()
        contour.ComputeGradientsOff()
        contour.ComputeScalarsOff()

        def extract():
            contour.Modified()
            contour.Update()
            return contour.GetOutput().GetNumberOfPolys()

        extract.keeps = (array, image)
        return extract

    return load, f"VTK {vtkVersion().GetVTKVersion()}", f"threads of {vtkSMPTools.GetBackend()}"


def skimage_row():
    import skimage
    from skimage.measure import marching_cubes

    def load():
        array = array_of(volume)
        return lambda: len(marching_cubes(array, isovalue)[1])

    return load, f"scikit-image {skimage.__version__}", "one thread"


def mcubes_row():
    from importlib.metadata import version

    import mcubes

    def load():
        array = array_of(volume)
        return lambda: len(mcubes.marching_cubes(array, isovalue)[1])

    return load, f"PyMCubes {version('PyMCubes')}", "one thread, no normals"


def isobrick_row():
    import isobrick

    def load():
        session = isobrick.open(volume).session()
        return lambda: len(session.extract(isovalue).faces)

    return load, f"isobrick {isobrick.__version__}", "arrays of a session"


rows = {"skimage": skimage_row, "PyMCubes": mcubes_row, "isobrick": isobrick_row}
load, version, note = rows[row]() if row in rows else vtk_row(row)
import numpy  # before memory is counted

before = status("VmRSS")
seconds, first = [], None
begin = time.perf_counter()
extract = load()
if cache == "cold":
    triangles = extract()
    seconds.append(time.perf_counter() - begin)
else:
    for i in range(repeats + 1):
        begin = time.perf_counter()
        triangles = extract()
        seconds.append(time.perf_counter() - begin)
    first = seconds.pop(0)
print(json.dumps({"row": row, "triangles": triangles, "seconds": seconds, "first": first, "version": version, "note": note,
                  "peak_bytes": status("VmHWM") - before}))
sys.stdout.flush()
os._exit(0)  # some packages take seconds to leave
