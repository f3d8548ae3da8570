"""One row of the suite in a Python process of its own, as JSON: seconds and peak memory.

  python_rows.py NAME VOLUME.json THREADS OUT

The voxels are in memory before the time counts. A name that begins with a dot writes a file of that format.
"""

import json
import resource
import sys
import time

import numpy as np

name, volume, threads, out = sys.argv[1:]
threads = int(threads)
with open(volume, encoding="utf-8") as file:
    layout = json.load(file)
array = np.fromfile(layout["raw"], dtype=layout["type"]).reshape(layout["shape"])


def isobrick_row():
    import isobrick

    if name == "isobrick.isosurface":
        return lambda: isobrick.isosurface(array, layout["isovalue"], threads=threads)
    if name == "isobrick.marching_cubes":
        return lambda: isobrick.marching_cubes(array, layout["isovalue"])
    if name == "isobrick session":
        session = isobrick.open(layout["pyramid"]).session()
        return lambda: session.extract(layout["isovalue"])
    if name == "build of an array":
        return lambda: isobrick.build(array, out, force=True)
    raw = isobrick.RawLayout(array.shape, layout["raw_type"])
    return lambda: isobrick.build(layout["raw"], out, raw=raw, force=True)


def simpleitk_pyramid():
    """Five levels of floats in memory."""
    import SimpleITK as sitk

    sitk.ProcessObject.SetGlobalDefaultNumberOfThreads(threads)
    image = sitk.GetImageFromArray(array.astype(np.float32))

    def make():
        levels = [image]
        for level in range(1, 5):
            levels.append(sitk.BinShrink(levels[-1], [2] * 3) if "Bin" in name else
                          sitk.Shrink(sitk.SmoothingRecursiveGaussian(image, 2.0**level / 2), [2**level] * 3))
        return levels

    return make


def write_file():
    if name == ".h5":
        import h5py

        def write():
            with h5py.File(out, "w") as file:
                file.create_dataset("volume", data=array, chunks=(64, 64, 64), compression="gzip", shuffle=True)

        return write
    if name == ".ome.zarr":
        import zarr

        return lambda: zarr.save_array(out, array, chunks=(64, 64, 64))
    if name == ".nii.gz":
        import nibabel

        return lambda: nibabel.save(nibabel.Nifti1Image(array.T, np.eye(4)), out)
    if name == ".vdb":
        import pyopenvdb

        def write_grid():
            grid = pyopenvdb.FloatGrid()
            grid.copyFromArray(array.T.astype(np.float32))
            pyopenvdb.write(out, grids=[grid])

        return write_grid
    import tifffile

    return lambda: tifffile.imwrite(out, array)


way = write_file() if name.startswith(".") else simpleitk_pyramid() if name.startswith("SimpleITK") else isobrick_row()
repeats = 1 if name.startswith((".", "SimpleITK")) else 3
before = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
seconds, row = [], {}
for i in range(repeats if repeats == 1 else repeats + 1):
    begin = time.perf_counter()
    found = way()
    seconds.append(time.perf_counter() - begin)
if repeats > 1:
    del seconds[0]  # as everywhere, the first surface does not count
row["seconds"], row["peak_bytes"] = seconds, 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
if not name.startswith("."):
    row["peak_bytes"] -= before  # on top of Python, its packages and the array
if name.startswith("SimpleITK"):
    row["bytes"] = sum(4 * int(np.prod(level.GetSize())) for level in found)
elif name.startswith("isobrick"):
    row["triangles"] = len(found[1])
print(json.dumps(row))
