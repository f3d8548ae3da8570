"""VTK: a class by its name, or the surface of vtkFlyingEdges3D made smaller by one; the number is the part of the
triangles that goes. As a program: vtk_peer.py IN.nrrd ISOVALUE OUT.ply THREADS, from file to mesh."""

import sys

import numpy as np
from peer import ArrayPeer
from vtkmodules import vtkFiltersCore
from vtkmodules.util import numpy_support
from vtkmodules.vtkCommonCore import vtkSMPTools
from vtkmodules.vtkCommonDataModel import vtkImageData


def contour_of(name, isovalue, threads, normals=True):
    for backend in ("STDThread", "TBB"):  # packages of PyPI begin with a sequential one
        if vtkSMPTools.SetBackend(backend):
            break
    vtkSMPTools.Initialize(threads)
    contour = getattr(vtkFiltersCore, name)()
    contour.SetValue(0, isovalue)
    contour.SetComputeNormals(normals)
    contour.ComputeGradientsOff()
    contour.ComputeScalarsOff()
    return contour


class Peer(ArrayPeer):
    def __init__(self, task, number):
        super().__init__(task, number)
        if number is None:
            self.contour = self.last = contour_of(task.row, task.iso, task.threads)
            self.note = f"threads of {vtkSMPTools.GetBackend()}" if "Flying" in task.row else "always one thread"
            return
        self.contour = contour_of("vtkFlyingEdges3D", task.iso, task.threads, normals=False)
        self.last = getattr(vtkFiltersCore, task.row.rpartition("-")[0])()
        self.last.SetInputConnection(self.contour.GetOutputPort())
        self.last.SetTargetReduction(number)
        if task.row.startswith("vtkDecimatePro"):
            self.last.PreserveTopologyOn()
        self.note = "decimated by one thread, without normals"

    def load(self):
        super().load()
        image = vtkImageData()
        image.SetDimensions(self.task.dims)
        image.SetSpacing(self.task.spacing)
        image.GetPointData().SetScalars(numpy_support.numpy_to_vtk(self.array.ravel()))
        self.contour.SetInputData(image)

    def extract(self):
        self.contour.Modified()
        self.last.Update()

    def mesh(self):
        found = self.last.GetOutput()
        points = numpy_support.vtk_to_numpy(found.GetPoints().GetData()) / np.array(self.task.spacing)
        triangles = numpy_support.vtk_to_numpy(found.GetPolys().GetConnectivityArray())
        return points, triangles.reshape(-1, 3)

    def output_bytes(self):
        return 1024 * self.last.GetOutput().GetActualMemorySize()


if __name__ == "__main__":
    from vtkmodules.vtkIOImage import vtkNrrdReader
    from vtkmodules.vtkIOPLY import vtkPLYWriter

    reader = vtkNrrdReader()
    reader.SetFileName(sys.argv[1])
    contour = contour_of("vtkFlyingEdges3D", float(sys.argv[2]), int(sys.argv[4]))
    contour.SetInputConnection(reader.GetOutputPort())
    writer = vtkPLYWriter()
    writer.SetInputConnection(contour.GetOutputPort())
    writer.SetFileTypeToBinary()
    writer.SetFileName(sys.argv[3])
    sys.exit(writer.Write() != 1)
