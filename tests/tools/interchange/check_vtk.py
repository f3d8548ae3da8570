"""VTI, MetaImage and NRRD against VTK's own."""
import itertools

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkIOImage import vtkMetaImageReader, vtkMetaImageWriter, vtkNrrdReader
from vtkmodules.vtkIOXML import vtkXMLImageDataReader, vtkXMLImageDataWriter

from common import ORIGIN, SPACING, rotation, run, write_nrrd
from volumes import TYPES, expect_placed, expect_same, raw_of, voxels


def test_our_files_are_the_same_for_vtk():
    for kind in TYPES:
        values = voxels(kind)
        for direction in (np.eye(3), rotation()):
            write_nrrd("in.nrrd", values, direction)
            for name, reader in (("a.vti", vtkXMLImageDataReader()), ("a.mha", vtkMetaImageReader()),
                                 ("a.mhd", vtkMetaImageReader()), ("a.nrrd", vtkNrrdReader())):
                run("convert", "in.nrrd", "-o", name, "--force")
                reader.SetFileName(name)
                reader.Update()
                image = reader.GetOutput()
                found = vtk_to_numpy(image.GetPointData().GetScalars()).reshape(values.shape)
                expect_same(found, values)
                if name == "a.vti":
                    np.testing.assert_allclose(image.GetSpacing(), SPACING)
                    np.testing.assert_allclose(image.GetOrigin(), ORIGIN)
                    matrix = image.GetDirectionMatrix()
                    found = [[matrix.GetElement(i, j) for j in range(3)] for i in range(3)]
                    np.testing.assert_allclose(found, direction, atol=1e-12)


def test_their_files_are_read():
    for kind, direction in itertools.product(TYPES, (np.eye(3), rotation())):
        values = voxels(kind)
        image = vtkImageData()
        image.SetDimensions(*values.shape[::-1])
        image.SetSpacing(*SPACING)
        image.SetOrigin(*ORIGIN)
        image.SetDirectionMatrix(*direction.ravel())
        image.GetPointData().SetScalars(numpy_to_vtk(values.ravel(), deep=True))
        for mode, packs in itertools.product(("Appended", "Binary"), (True, False)):
            writer = vtkXMLImageDataWriter()
            writer.SetFileName("theirs.vti")
            writer.SetInputData(image)
            getattr(writer, f"SetDataModeTo{mode}")()
            writer.SetEncodeAppendedData(packs)
            if not packs:
                writer.SetCompressorTypeToNone()
            writer.Write()
            found, about = raw_of("theirs.vti")
            expect_same(found, values)
            expect_placed(about, direction)
        image.SetDirectionMatrix(*np.eye(3).ravel())
        writer = vtkMetaImageWriter()
        writer.SetInputData(image)
        writer.SetFileName("theirs.mhd")
        writer.Write()
        found, about = raw_of("theirs.mhd")
        expect_same(found, values)
        expect_placed(about, tolerance=1e-5)
