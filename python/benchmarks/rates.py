"""The cost of Python: extraction into arrays beside the command, building from an array beside a raw file, in turns;
and marching cubes of other packages on the same volume.

    python python/benchmarks/rates.py [VOXELS] [TURNS]
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import isobrick
from isobrick._command import EXECUTABLE


def command(*words: object) -> Any:
    done = subprocess.run([EXECUTABLE, *map(str, words), "--json"], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def in_turns(turns: int, ways: dict[str, Callable[[], float]]) -> dict[str, float]:
    """Medians."""
    times: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(turns):
        for name, way in ways.items():
            times[name].append(way())
    return {name: statistics.median(of) for name, of in times.items()}


def timed(call: Callable[[], object]) -> float:
    began = time.perf_counter()
    call()
    return time.perf_counter() - began


PEAK = """
def peak():
    return int(open("/proc/self/status").read().split("VmHWM:")[1].split()[0])
"""
PEER = """
import sys, time, numpy as np
array = np.load(sys.argv[2])
before = peak()
def run():
    if sys.argv[1] == "skimage":
        from skimage.measure import marching_cubes
        v, f, n, _ = marching_cubes(array, 1324)
        return len(f)
    if sys.argv[1] == "mcubes":
        import mcubes
        v, f = mcubes.marching_cubes(array, 1324)
        return len(f)
    import pyvista
    grid = pyvista.ImageData(dimensions=array.shape[::-1])
    grid.point_data["v"] = array.ravel()
    return grid.contour([1324], scalars="v", method=sys.argv[1], compute_normals=True).n_cells
run() if sys.argv[3] == "2" else None
began = time.perf_counter()
count = run()
print(time.perf_counter() - began, (peak() - before) / 1024, count)
"""
OURS = """
import sys, time, isobrick
pyramid = isobrick.open(sys.argv[1])
before = peak()
session = pyramid.session()
session.extract(1324).points
began = time.perf_counter()
mesh = session.extract(1324); mesh.points
print(time.perf_counter() - began, (peak() - before) / 1024, len(mesh.faces))
"""


def child(program: str, *words: object) -> tuple[float, float, int]:
    done = subprocess.run([sys.executable, "-c", PEAK + program, *map(str, words)], capture_output=True, text=True)
    if done.returncode != 0:
        print(done.stderr.splitlines()[-1], file=sys.stderr)
        return float("nan"), float("nan"), 0
    seconds, mib, count = done.stdout.split()[-3:]
    return float(seconds), float(mib), int(count)


def main() -> None:
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 256
    turns = int(sys.argv[2]) if len(sys.argv) > 2 else 7
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        isobrick.build(f"phantom:head:{n}", folder / "head.isb")
        with isobrick.open(folder / "head.isb") as pyramid:
            array = np.asarray(pyramid.level(0))
            session = pyramid.session()
            session.extract(1324).points

            def by_command() -> float:
                return command("bench", folder / "head.isb", "--iso", 1324)["rows"][0]["seconds"]["min"]

            def best_of(call: Callable[[], object]) -> float:
                return min(timed(call) for _ in range(15))

            made = in_turns(turns, {
                "C++ (isobrick bench)": by_command,
                "session.extract": lambda: best_of(lambda: session.extract(1324)),
                "session.extract, points": lambda: best_of(lambda: session.extract(1324).points),
            })  # fmt: skip
            triangles = len(session.extract(1324).faces)
        print(f"extraction, head {n}^3, {triangles:,} triangles")
        for way, seconds in made.items():
            print(f"| {way} | {1e3 * seconds:.1f} ms | {triangles / seconds / 1e6:.1f} M/s |")

        array.tofile(folder / "head.raw")
        raw = isobrick.RawLayout(array.shape, "u16")
        made = in_turns(turns, {
            "raw file": lambda: isobrick.build(folder / "head.raw", folder / "r.isb", raw=raw, force=True).seconds,
            "numpy": lambda: isobrick.build(array, folder / "n.isb", force=True).seconds,
        })  # fmt: skip
        print(f"build, {array.nbytes >> 20} MiB")
        for way, seconds in made.items():
            print(f"| {way} | {seconds:.3f} s | {array.nbytes / seconds / 1e6:.0f} MB/s |")

        np.save(folder / "head.npy", array)
        print("peers: the second call of a process; seconds, MiB beyond the array, triangles")
        peers = {"isobrick": lambda: child(OURS, folder / "head.isb")}
        for peer in ("flying_edges", "contour", "skimage", "mcubes"):
            peers[peer] = lambda peer=peer: child(PEER, peer, folder / "head.npy", 2)  # type: ignore[misc]
        for peer, run in peers.items():
            results = [run() for _ in range(3)]
            seconds, mib, count = (statistics.median(r[i] for r in results) for i in range(3))
            print(f"| {peer} | {seconds:.3f} | {mib:.0f} | {count:,} |", flush=True)


if __name__ == "__main__":
    main()
