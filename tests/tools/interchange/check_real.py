"""Real scans through every format: boxes of their middle."""
import itertools
import os

import numpy as np

from common import run
from volumes import expect_same, raw_of


def real_volumes():
    data = os.environ["ISOBRICK_DATA"]
    known = (".nrrd", ".nhdr", ".mhd", ".nii", ".nii.gz", ".vti", ".vdb")
    paths = [os.path.join(data, "vhf_head_ct", "dicom")]
    for folder, _, names in os.walk(data):
        paths += [os.path.join(folder, name) for name in names if name.endswith(known)]
    paths = sorted(filter(os.path.exists, paths))
    assert len(paths) >= 5, paths
    return paths


def through_every_format(path, most_voxels):
    """The voxels of a scan's middle, at most so many an axis, and where they are."""
    volume = os.path.relpath(path, os.environ["ISOBRICK_DATA"])
    about = run("convert", path, "-o", "whole.isb", "--force", "--json", "--no-curvature")
    low = [max(0, n // 2 - most_voxels // 2) for n in about["dimensions"]]
    high = [min(n, first + most_voxels) - 1 for n, first in zip(about["dimensions"], low)]
    box = ",".join(str(n) for n in low + high)
    run("convert", "whole.isb", "-o", "cut.isb", "--box", box, "--force", "--no-curvature")
    values, place = raw_of("cut.isb")
    direct, _ = raw_of(path, "--box", box)
    expect_same(values, direct)
    for name in ("a.nrrd", "a.mhd", "a.mha", "a.nii.gz", "a.vti", "a.h5",
                 "a.ome.zarr", "slices/%04d.exr", "a.vdb", "a.tif"):
        run("convert", "cut.isb", "-o", name, "--force", "--memory", "1G")
        found, found_place = raw_of(os.path.dirname(name) or name)
        if name == "a.vdb":
            np.testing.assert_array_equal(found, values.astype("f4"))
        else:
            expect_same(found, values)
        if name.endswith(".tif"):
            continue  # it has no places
        # The same places in the world, to a thousandth of the spacing.
        for corner in itertools.product((0, 1), repeat=3):
            index = np.array(corner) * (np.array(values.shape[::-1]) - 1)
            world = lambda p: np.array(p["origin"]) + np.array(p["direction"]).T @ (
                np.array(p["spacing"]) * index
            )
            error = np.abs(world(found_place) - world(place)).max()
            assert error < 1e-3 * min(place["spacing"]), (volume, name, error)
    print(f"{volume}: {' x '.join(str(n) for n in values.shape[::-1])} voxels of "
          f"{' x '.join(str(n) for n in about['dimensions'])} are the same in every format", flush=True)


def test_the_middle_of_real_scans():
    for path in real_volumes():
        through_every_format(path, 92)
