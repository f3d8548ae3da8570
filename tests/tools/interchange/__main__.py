"""Volumes that isobrick wrote, read by other programs' libraries, and the other way round.

    interchange ISOBRICK nifti|components|zarr|zarr3|hdf5|vdb|dicom|enhanced|tiff|others|vtk|real|real_whole

Every voxel of every level is compared, and what the libraries make of spacing, origin and direction. The
checks of a format are the functions test_... of check_FORMAT.py; each runs in a folder of its own.
"""
import importlib
import os
import sys
import tempfile

sys.dont_write_bytecode = True  # beside the sources

for name, test in vars(importlib.import_module("check_" + sys.argv[2])).items():
    if name.startswith("test_"):
        print(name[len("test_"):].replace("_", " "), flush=True)
        with tempfile.TemporaryDirectory(prefix="isobrick-interchange-") as folder:
            os.chdir(folder)
            test()
            os.chdir("/")
print("all voxels and places are the same")
