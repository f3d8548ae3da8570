"""Peak memory of a build from a dask array that is larger than it: beside that of dask alone, which computes every chunk
once and drops it.

    python python/benchmarks/dask_memory.py [VOXELS] [MEMORY]
"""

from __future__ import annotations

import subprocess
import sys
import tempfile

PROGRAM = """
import sys, time, numpy as np, dask.array as da
n, memory, out = int(sys.argv[1]), sys.argv[2], sys.argv[3]
def block(block_info=None):
    z, y, x = (np.arange(a, b, dtype=np.float32) * 0.05 for a, b in block_info[None]["array-location"])
    field = np.sin(x) + np.sin(y)[:, None] + np.sin(z)[:, None, None]
    return (1000 + 300 * field).astype(np.uint16)
chunks = da.core.normalize_chunks((128, 128, 128), (n, n, n))
lazy = da.map_blocks(block, chunks=chunks, dtype=np.uint16, meta=np.empty((0, 0, 0), np.uint16))
began = time.perf_counter()
if memory == "0":
    from concurrent.futures import ThreadPoolExecutor
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda at: lazy.blocks[at].compute().max(), np.ndindex(lazy.numblocks)))
else:
    import isobrick
    isobrick.build(lazy, out, memory=memory, curvature=False)
peak = int(open("/proc/self/status").read().split("VmHWM:")[1].split()[0])
print(peak // 1024, time.perf_counter() - began, lazy.nbytes >> 20)
"""


def main() -> None:
    n = sys.argv[1] if len(sys.argv) > 1 else "1024"
    memory = sys.argv[2] if len(sys.argv) > 2 else "256M"
    print("| | peak MiB | seconds | array MiB |\n|---|--:|--:|--:|")
    with tempfile.TemporaryDirectory() as folder:
        for name, given in (("dask alone", "0"), (f"build, memory={memory}", memory)):
            done = subprocess.run(
                [sys.executable, "-c", PROGRAM, n, given, f"{folder}/d.isb"], capture_output=True, text=True, check=True
            )
            peak, seconds, size = done.stdout.split()
            print(f"| {name} | {peak} | {float(seconds):.1f} | {size} |", flush=True)


if __name__ == "__main__":
    main()
