"""One row of the suite in a Python process of its own, as JSON: seconds and peak memory.

  python_rows.py NAME VOLUME.json THREADS OUT

The voxels are in memory before the time counts.
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
        return lambda: session.extract(layout["isovalue"], threads=threads)
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


def progressive_query():
    """From opening the pyramid to its first surface, and to the last one."""
    import isobrick

    point = {"focus_voxels": layout["focus"], "radius_voxels": max(layout["shape"]) // 10} if "focus" in name else {}
    begin, row = time.perf_counter(), {}
    session = isobrick.open(layout["pyramid"]).session()
    for mesh in session.progressive(layout["isovalue"], threads=threads, **point):
        row["triangles"] = len(mesh.faces)
        row["seconds"] = [time.perf_counter() - begin]
        row.setdefault("first", row["seconds"])
        row.setdefault("first_triangles", row["triangles"])
    return row


if name.startswith("progressive"):
    print(json.dumps(progressive_query()))
    sys.exit()
repeats, way = (1, simpleitk_pyramid()) if name.startswith("SimpleITK") else (4, isobrick_row())
before = 0 if repeats == 1 else 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
seconds = []
for _ in range(repeats):
    begin = time.perf_counter()
    found = way()
    seconds.append(time.perf_counter() - begin)
# As everywhere, the first surface of isobrick does not count, and memory is what comes on top of Python and the array.
row = {"seconds": seconds[-3:], "peak_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before}
if name.startswith("SimpleITK"):
    row["bytes"] = sum(4 * int(np.prod(level.GetSize())) for level in found)
elif name.startswith("isobrick"):
    row["triangles"] = len(tuple(found)[1])
print(json.dumps(row))
