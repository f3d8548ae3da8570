"""One row of a conversion by another library: voxels in memory to a file, as JSON. Debian's Python has the packages.

  format_peer.py ENDING VOLUME OUT

VOLUME: a JSON file {"raw": PATH, "type": ..., "shape": [z, y, x]}.
"""

import json
import resource
import sys
import time

import numpy as np

ending, volume, out = sys.argv[1:]
with open(volume, encoding="utf-8") as file:
    layout = json.load(file)
array = np.fromfile(layout["raw"], dtype=layout["type"]).reshape(layout["shape"])


def write_h5():
    import h5py

    def write():
        with h5py.File(out, "w") as file:
            file.create_dataset("volume", data=array, chunks=(64, 64, 64), compression="gzip", shuffle=True)

    return "h5py, gzip", write


def write_zarr():
    import zarr

    return "zarr, Blosc", lambda: zarr.save_array(out, array, chunks=(64, 64, 64))


def write_nifti():
    import nibabel

    return "nibabel", lambda: nibabel.save(nibabel.Nifti1Image(array.T, np.eye(4)), out)


def write_vdb():
    import pyopenvdb

    def write():
        grid = pyopenvdb.FloatGrid()
        grid.copyFromArray(array.T.astype(np.float32))
        pyopenvdb.write(out, grids=[grid])

    return "pyopenvdb", write


def write_tiff():
    import tifffile

    return "tifffile", lambda: tifffile.imwrite(out, array)


name, write = {"h5": write_h5, "ome.zarr": write_zarr, "nii.gz": write_nifti, "vdb": write_vdb, "tif": write_tiff}[ending]()
begin = time.perf_counter()
write()
print(json.dumps({"name": name, "seconds": time.perf_counter() - begin,
                  "peak_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss}))
