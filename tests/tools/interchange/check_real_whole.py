"""Real scans through every format, all of their voxels; some minutes, so not among the tests of every day."""
from check_real import real_volumes, through_every_format


def test_all_voxels_of_real_scans():
    for path in real_volumes():
        through_every_format(path, 1 << 20)
