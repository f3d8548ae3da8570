#!/usr/bin/env python3
"""Isosurfaces by other libraries, a row in a process of its own, for 'isobrick bench --peers'.

  bench_peers.py --list [NAME ...]      the rows that can be measured here; of names with a number those that fit
  bench_peers.py VOXELS.raw --dims X,Y,Z --type uint16 --spacing X,Y,Z --iso V --threads N --row NAME [--repeat N]
                 [--cold] [--mesh PATH]   measures a row, as tools/bench/bench_rows.h says
"""

import argparse
import importlib.util
import json
import os
import resource
import subprocess
import sys
import time

SYSTEM_PYTHON = "/usr/bin/python3"
# Rows by module: the package, rows that are always listed, and those with a number from 0 to 1 behind their name.
PEERS = {
    "vtk_peer": ("vtkmodules", ["vtkFlyingEdges3D", "vtkSynchronizedTemplates3D", "vtkMarchingCubes"],
                 ["vtkQuadricDecimation", "vtkDecimatePro"]),
    "openvdb_peer": ("pyopenvdb", ["openvdb-0", "openvdb-0.1", "openvdb-0.5"], ["openvdb"]),
    "skimage_peer": ("skimage", ["skimage"], []),
    "pymcubes_peer": ("mcubes", ["PyMCubes"], []),
}
# These make the finest surface: its distance is of no interest.
EXACT = (*PEERS["vtk_peer"][1], "skimage", "PyMCubes")


def python_with(package):
    """The Python that has it: this one, the system's, or None."""
    if importlib.util.find_spec(package):
        return sys.executable
    asks = f"import importlib.util, sys; sys.exit(importlib.util.find_spec('{package}') is None)"
    is_there = os.path.exists(SYSTEM_PYTHON) and subprocess.run([SYSTEM_PYTHON, "-c", asks], check=False).returncode == 0
    return SYSTEM_PYTHON if is_there else None


def peer_of(row):
    """(module, number or None) of a row; None for another name."""
    name, _, number = row.rpartition("-")
    for module, (_, rows, numbered) in PEERS.items():
        if row in rows and name not in numbered:
            return module, None
        try:
            if name in numbered and 0 <= float(number) <= 1:
                return module, float(number)
        except ValueError:
            pass
    return None


def list_rows(names):
    there = [module for module, (package, _, _) in PEERS.items() if python_with(package)]
    rows = [row for module in there for row in PEERS[module][1]]
    rows += [name for name in names if name not in rows and (peer_of(name) or [None])[0] in there]
    for row in rows:
        print(row, "exact" if row in EXACT else "approximate")


def peak():
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def timed(call):
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin


def measure(peer, task):
    """Of the memory what comes on top of Python and the packages."""
    before = peak()
    processor = time.process_time()
    load, prepare = timed(peer.load), timed(peer.prepare)
    loaded = peak() - before
    first = timed(peer.extract)
    seconds = [load + prepare + first]
    if not task.cold:
        processor = time.process_time()
        seconds = [timed(peer.extract) for _ in range(task.repeat)]
    processor = (time.process_time() - processor) / len(seconds)
    most = peak() - before
    points, triangles = peer.mesh()
    if task.mesh:
        with open(task.mesh, "wb") as file:
            file.write(len(points).to_bytes(8, "little") + len(triangles).to_bytes(8, "little"))
            file.write(points.astype("<f4").tobytes() + triangles.astype("<u4").tobytes())
    return {"triangles": len(triangles), "vertices": len(points), "output_bytes": peer.output_bytes(),
            "load_seconds": load, "prepare_seconds": prepare, "first_seconds": first, "seconds": seconds,
            "processor_seconds": processor, "loaded_rss_bytes": loaded, "peak_rss_bytes": most, "note": peer.note}


def parsed():
    parser = argparse.ArgumentParser(prog="bench_peers", description="Isosurfaces by other libraries, for 'isobrick bench'.")
    parser.add_argument("volume")
    for name in ("--dims", "--type", "--iso", "--row"):
        parser.add_argument(name, required=True)
    parser.add_argument("--spacing", default="1,1,1")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--cold", action="store_true")
    parser.add_argument("--mesh")
    task = parser.parse_args()
    task.dims = [int(float(word)) for word in task.dims.split(",")]
    task.spacing = [float(word) for word in task.spacing.split(",")]
    task.iso = float(task.iso)
    return task


def main():
    if sys.argv[1:2] == ["--list"]:
        list_rows(sys.argv[2:])
        return
    task = parsed()
    found = peer_of(task.row)
    python = found and python_with(PEERS[found[0]][0])
    if not python:
        sys.exit(f"bench_peers: there is no row '{task.row}'; --list names them")
    if python != sys.executable:
        os.execv(python, [python, *sys.argv])
    try:
        peer = __import__(found[0]).Peer(task, found[1])
        text = json.dumps(measure(peer, task))
    except (OSError, ValueError, RuntimeError) as error:
        sys.exit(f"bench_peers: {error}")
    print(text, flush=True)
    os._exit(0)  # some packages take seconds to leave


if __name__ == "__main__":
    main()
