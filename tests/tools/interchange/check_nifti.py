"""NIfTI against nibabel: values, affines and units."""
import itertools

import nibabel
import numpy as np

from common import ORIGIN, SPACING, rotation, run, write_nrrd
from volumes import TYPES, expect_placed, expect_same, raw_of, voxels


def test_values_places_and_units_are_the_same_for_nibabel_and_for_us():
    places = (np.eye(3), rotation(), rotation() * [1, 1, -1], np.diag([-1.0, -1.0, 1.0]))
    for kind, direction in itertools.chain(
        zip(TYPES, itertools.cycle(places)), (("i16", place) for place in places)
    ):
        values = voxels(kind)
        write_nrrd("in.nrrd", values, direction)
        lps_to_ras = np.diag([-1.0, -1.0, 1.0])
        expected = np.eye(4)
        expected[:3, :3] = lps_to_ras @ direction @ np.diag(SPACING)
        expected[:3, 3] = lps_to_ras @ ORIGIN
        for name in ("out.nii", "out.nii.gz"):
            run("convert", "in.nrrd", "-o", name, "--force")
            image = nibabel.load(name)
            expect_same(np.asanyarray(image.dataobj).T, values)
            np.testing.assert_allclose(image.get_sform(), expected, atol=1e-4)
            np.testing.assert_allclose(image.get_qform(), expected, atol=1e-4)
            assert image.header.get_xyzt_units()[0] == "mm"
        # Theirs, read by us, in each of its units.
        for unit, scale in (("micron", 1e3), ("meter", 1), ("mm", 1), ("unknown", 1)):
            places = expected.copy()
            places[:3] *= scale
            image = nibabel.Nifti1Image(values.T, places)
            image.header.set_xyzt_units(unit)
            image.to_filename("theirs.nii.gz")
            found, about = raw_of("theirs.nii.gz")
            expect_same(found, values)
            in_mm = 1e3 if unit == "meter" else 1
            expect_placed(about, direction, SPACING * in_mm, ORIGIN * in_mm, tolerance=1e-5)
            assert about["length_unit"] == ("unknown" if unit == "unknown" else "millimetres"), about
        run("convert", "theirs.nii.gz", "-o", "out.nii.gz", "--force")
        assert nibabel.load("out.nii.gz").header.get_xyzt_units()[0] == "unknown"
    # A gzipped file can only be read in order; these formats want boxes.
    for name in ("boxes.ome.zarr", "boxes.h5", "boxes.vdb"):
        run("convert", "theirs.nii.gz", "-o", name)
        found, about = raw_of(name)
        np.testing.assert_array_equal(found, values)
        expect_placed(about, direction, tolerance=1e-5)
