"""DICOM series as pydicom writes them."""
import os

import numpy as np
from pydicom.dataset import FileDataset, FileMetaDataset
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, RLELossless

from common import ORIGIN, SPACING, rotation, run
from volumes import expect_placed, expect_same, raw_of


def test_turned_and_rescaled_series_in_any_order_of_names_are_read():
    direction, shape = rotation(), (5, 31, 22)
    for number, (kind, slope, intercept) in enumerate(
        (("<i2", 1, 0), ("<u2", 1, -1024), ("u1", 1, 0), ("<i2", 0.25, 3))
    ):
        info = np.iinfo(kind)
        values = np.random.default_rng(number).integers(info.min // 2, info.max // 2, shape)
        values = values.astype(kind)
        os.makedirs(f"series{number}")
        for z in range(shape[0]):
            about = FileMetaDataset()
            about.MediaStorageSOPClassUID = CTImageStorage
            about.MediaStorageSOPInstanceUID = f"1.2.3.{number}.{z + 1}"
            about.TransferSyntaxUID = ExplicitVRLittleEndian
            slice = FileDataset("", {}, file_meta=about, preamble=b"\0" * 128)
            slice.is_little_endian, slice.is_implicit_VR = True, False
            slice.SOPClassUID, slice.SOPInstanceUID = CTImageStorage, about.MediaStorageSOPInstanceUID
            slice.Modality, slice.SeriesInstanceUID = "CT", f"1.2.3.{number}"
            slice.StudyInstanceUID, slice.InstanceNumber = "1.2.3", z + 1
            slice.Rows, slice.Columns = shape[1:]
            slice.SamplesPerPixel, slice.PhotometricInterpretation = 1, "MONOCHROME2"
            slice.BitsAllocated = slice.BitsStored = 8 * values.itemsize
            slice.HighBit, slice.PixelRepresentation = slice.BitsStored - 1, int(kind == "<i2")
            slice.PixelSpacing = [f"{SPACING[1]:.12g}", f"{SPACING[0]:.12g}"]  # between rows first
            slice.ImageOrientationPatient = [f"{n:.12g}" for n in direction[:, :2].T.ravel()]
            position = ORIGIN + direction[:, 2] * SPACING[2] * z
            slice.ImagePositionPatient = [f"{n:.12g}" for n in position]
            slice.RescaleSlope, slice.RescaleIntercept = str(slope), str(intercept)
            slice.PixelData = values[z].tobytes()
            if number == 0:
                slice.compress(RLELossless)
            slice.save_as(f"series{number}/{(z * 3) % 5}.dcm", write_like_original=False)
        found, about = raw_of(f"series{number}")
        np.testing.assert_array_equal(found, values * float(slope) + intercept)
        assert about["voxel_type"] == ["int16", "int16", "uint8", "float32"][number], about
        expect_placed(about, direction, tolerance=1e-8)
        # The same voxels at the same places in every other format.
        run("convert", f"series{number}", "-o", f"{number}.nii.gz")
        again, place = raw_of(f"{number}.nii.gz")
        expect_same(again, found)
        expect_placed(place, direction, tolerance=1e-5)
