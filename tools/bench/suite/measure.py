#!/usr/bin/env python3
"""The measurements of tools/benchmark.sh.

  measure.py WORK BUILD DATA VENV --output FILE.json --commit C [--vtk VERSION] [--quick]

WORK keeps volumes and results, one JSON file a step: a step whose result is there is left out, so a run that was
stopped goes on. BUILD is a build folder of isobrick, DATA the folder of the real volumes (or none), VENV the Python with
the peers from PyPI (or none). FILE.json is written when all steps are done. Needs nothing but Python itself.
"""

import argparse
import json
import os
import platform
import re
import shutil
import statistics
import subprocess
import sys
import time

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

HERE = os.path.dirname(os.path.abspath(__file__))
MIB = 1 << 20
THREADS = 2
NOT_THERE = "not there"
# These take a second and more: each process makes one surface that counts, and one before.
SLOW = ("vtkSynchronizedTemplates3D", "vtkMarchingCubes", "skimage", "PyMCubes")


def load_average():
    return os.getloadavg()[0]


def write_json(path, value):
    with open(path + ".part", "w", encoding="utf-8") as file:
        json.dump(value, file, indent=1, ensure_ascii=False)
        file.write("\n")
    os.replace(path + ".part", path)


def read_json(path):
    with open(path, encoding="utf-8") as file:
        return json.load(file)


def drop_from_page_cache(path):
    descriptor = os.open(path, os.O_RDONLY)
    os.fsync(descriptor)
    os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
    os.close(descriptor)


class Failed(Exception):
    """A command that failed, in one line."""


def run(*words, env=None):
    words = [str(word) for word in words]
    done = subprocess.run(words, capture_output=True, text=True, env={**os.environ, **(env or {})}, check=False)
    if done.returncode != 0:
        lines = (done.stderr.strip() or f"exit {done.returncode}").splitlines()
        raise Failed(f"'{' '.join(words)}' failed: {lines[-1]}")
    return done.stdout


def run_json(*words, env=None):
    return json.loads(run(*words, env=env))


def spread(values):
    return {"median": statistics.median(values), "min": min(values), "max": max(values), "runs": len(values)}


class Suite:
    def __init__(self, options):
        self.work, self.build, self.data = options.work, options.build, options.data
        self.quick, self.vtk = options.quick, options.vtk
        self.rounds = 1 if self.quick else 3
        self.isobrick = f"{self.build}/isobrick"
        self.python = f"{options.venv}/bin/python" if options.venv != "none" else None
        self.loads = []
        self.begin = time.monotonic()
        os.makedirs(f"{self.work}/results", exist_ok=True)
        os.makedirs(f"{self.work}/volumes", exist_ok=True)

    def say(self, text):
        print(f"{time.monotonic() - self.begin:5.0f} s  {text}", flush=True)

    def step(self, name, make):
        """The result of a step: of its file, if there is one."""
        path = f"{self.work}/results/{name}.json"
        if not os.path.exists(path):
            self.say(name)
            before, begin = load_average(), time.monotonic()
            rows = make()
            write_json(path, {"rows": rows, "load": [round(before, 1), round(load_average(), 1)],
                              "seconds": round(time.monotonic() - begin, 1)})
        result = read_json(path)
        self.loads += result["load"]
        return result

    # ---- volumes -------------------------------------------------------------------------------------

    def volume(self, key, title, source, isovalue, focus):
        """A pyramid of a real volume (a path below DATA) or of a phantom, and its voxels without a header."""
        real = not source.startswith("phantom:")
        pyramid = f"{self.work}/volumes/{key}.isb"
        if not os.path.exists(pyramid):
            run(self.isobrick, "build", f"{self.data}/{source}" if real else source, "-o", pyramid)
        raw = f"{self.work}/volumes/{key}.raw"
        if not os.path.exists(raw):
            run(self.isobrick, "convert", pyramid, "-o", raw)
        info = run_json(self.isobrick, "info", pyramid, "--json")
        types = {"uint8": "<u1", "int8": "<i1", "uint16": "<u2", "int16": "<i2", "float32": "<f4"}
        layout = f"{self.work}/volumes/{key}.json"
        write_json(layout, {"raw": os.path.abspath(raw), "type": types[info["voxel_type"]],
                            "shape": info["dimensions"][::-1]})
        return {"key": key, "title": title, "source": source if real else source.replace("phantom:", "phantom "),
                "real": real, "dimensions": info["dimensions"], "type": info["voxel_type"], "isovalue": isovalue,
                "focus": focus, "pyramid": pyramid, "raw": raw, "layout": layout, "bytes": info["bytes"]["raw"]}

    def volumes(self):
        big, small = (128, 96) if self.quick else (512, 256)
        made = [self.volume("head", f"head phantom {big}³", f"phantom:head:{big}", 1324,
                            [big // 2, big // 5, big // 2]),
                self.volume("gyroid", f"gyroid {small}³", f"phantom:gyroid:{small}", 128, [small // 2] * 3)]
        if self.data != "none" and not self.quick:
            made.insert(0, self.volume("ct", "head CT", "vhf_head_ct/vhf_head.nrrd", 1250, [256, 256, 117]))
        return {volume["key"]: volume for volume in made}

    def simplified_volumes(self):
        if self.data == "none" or self.quick:
            size = 96 if self.quick else 192
            return [self.volume("small-head", f"head phantom {size}³", f"phantom:head:{size}", 1324, None),
                    self.volume("small-gyroid", f"gyroid {size}³", f"phantom:gyroid:{size}", 128, None)]
        return [self.volume("tooth", "tooth", "tooth_u16be/tooth.nhdr", 520, None),
                self.volume("mr", "MR", "mr_nifti/MR.nii.gz", 40, None),
                self.volume("engine", "engine", "engine/engine.vti", 80, None), self.all_volumes["ct"]]

    # ---- ways to a surface ---------------------------------------------------------------------------

    def bench(self, volume, rows, *more, rounds=1, threads=THREADS):
        """Rows of `isobrick bench`; those of peers that were not built have a failure."""
        peers = f"{self.build}/bench_peers"
        listed = [words.split()[0] for words in run(peers, "--list", *rows).splitlines()] if os.path.exists(peers) else []
        there = [row for row in rows if row.startswith(("isobrick", "simplify")) or row in listed]
        missing = [{"name": row, "failure": NOT_THERE} for row in rows if row not in there]
        return missing if not there else missing + run_json(self.isobrick, "bench", volume["pyramid"], "--iso", volume["isovalue"], "--threads", threads,
                        "--rounds", rounds, "--rows", ",".join(there), *more, "--json")["rows"]

    def python_row(self, row, volume, cache="warm", repeats=3):
        where = volume["pyramid"] if row == "isobrick" else volume["layout"]
        return run_json(self.python, f"{HERE}/python_peer.py", row, where, volume["isovalue"], THREADS, repeats, cache,
                        env={"GLIBC_TUNABLES": "glibc.malloc.hugetlb=1", "PYTHONPATH": "", "LD_LIBRARY_PATH": ""})

    def surface_rows(self, volume, rows, python_rows, cache="warm", threads=THREADS):
        """All rows in turns, each in a process of its own; medians of the times of all rounds."""
        times, kept = {}, {}
        for _ in range(self.rounds):
            quick, slow = ([row for row in rows if (row in SLOW) == is_slow] for is_slow in (False, True))
            measured = self.bench(volume, quick, "--no-distances", "--page-cache", cache, threads=threads)
            if slow:
                measured += self.bench(volume, slow, "--no-distances", "--page-cache", cache, "--repeat", 1, threads=threads)
            for row in measured:
                if "seconds" not in row:
                    kept[row["name"]] = {"name": row["name"], "failure": row.get("failure", "failed")}
                    continue
                times.setdefault(row["name"], []).extend(row["seconds"]["all"])
                kept[row["name"]] = {"name": row["name"], "triangles": row["triangles"], "first": row["first_seconds"]["median"]
                                     if "first_seconds" in row else None,
                                     "peak_bytes": row["peak_rss_bytes"], "note": row.get("note", "")}
            for name in python_rows:
                if not self.python:
                    kept[f"PyPI {name}"] = {"name": f"PyPI {name}", "failure": NOT_THERE}
                    continue
                if cache == "cold":
                    drop_from_page_cache(volume["raw"])
                title = f"PyPI {name}"
                try:
                    row = self.python_row(name, volume, cache, 1 if name in SLOW else 3)
                except Failed as failure:
                    kept[title] = {"name": title, "failure": str(failure)}
                    continue
                times.setdefault(title, []).extend(row["seconds"])
                kept[title] = {"name": title, "triangles": row["triangles"], "first": row["first"],
                               "peak_bytes": row["peak_bytes"], "note": row["note"]}
        return [{**row, **({"seconds": spread(times[name])} if name in times else {})} for name, row in kept.items()]

    def extraction(self, volume):
        old = ["vtkSynchronizedTemplates3D", "vtkMarchingCubes"] if volume == next(iter(self.all_volumes.values())) else []
        rows = self.surface_rows(volume, ["isobrick", "vtkFlyingEdges3D", *old, "openvdb-0"],
                                 ["vtkFlyingEdges3D", *old[1:], "skimage", "PyMCubes"])
        single = self.surface_rows(volume, ["isobrick", "vtkFlyingEdges3D"], [], threads=1)
        return rows + [{**row, "name": f"{row['name']}, one thread"} for row in single]

    # ---- what isobrick does with a pyramid -----------------------------------------------------------

    def queries(self, volume):
        edge = max(volume["dimensions"])
        focus = ["--focus", ",".join(map(str, volume["focus"]))]
        far = [volume["dimensions"][0] // 2, -edge, volume["dimensions"][2] // 2]
        kinds = [("everything", [])]
        kinds += [(f"radius {r}", [*focus, "--radius", r]) for r in ([10, 20] if self.quick else [20, 40, 80, 160])]
        kinds += [("radius 40, flatter than ρ = 20 coarse", [*focus, "--radius", 40, "--curvature-radius", 20]),
                  ("seen from afar, 4 pixels a cell", ["--eye", ",".join(map(str, far)), "--pixels", 4]),
                  ("level 1", ["--level", 1])]
        if self.quick:
            kinds = kinds[:3]
        times, reports = {name: [] for name, _ in kinds}, {}
        for _ in range(self.rounds):
            for name, words in kinds:
                report = run_json(self.isobrick, "extract", volume["pyramid"], "--iso", volume["isovalue"], *words,
                                  "--repeat", 11, "--threads", THREADS, "--json")
                times[name] += report["seconds"]["extract"][1:]
                reports[name] = report
        return [{"name": name, "triangles": reports[name]["triangles"], "seconds": spread(times[name]),
                 "bytes_read": reports[name]["bytes_read"], "bytes_active": reports[name]["bytes_active"],
                 "peak_bytes": reports[name]["peak_rss_bytes"]} for name, _ in kinds]

    def progressive(self, volume):
        program = f"{self.build}/tests/progressive_times"
        point = ",".join(map(str, volume["focus"]))
        radius = max(volume["dimensions"]) // 10
        kinds = [("everything", []), (f"focus, radius {radius}", [point, radius])]
        results = {name: [] for name, _ in kinds}
        for _ in range(3 * self.rounds):
            for name, words in kinds:
                drop_from_page_cache(volume["pyramid"])
                results[name].append(run_json(program, volume["pyramid"], volume["isovalue"], THREADS, *words))
        return [{"name": name, "first": spread([r["first"] for r in rows]), "last": spread([r["last"] for r in rows]),
                 "first_triangles": rows[0]["first_triangles"], "triangles": rows[0]["triangles"]}
                for name, rows in results.items()]

    def cold(self, volume):
        rows = self.surface_rows(volume, ["isobrick", "vtkFlyingEdges3D", "openvdb-0"],
                                 ["vtkFlyingEdges3D", "skimage"], cache="cold")
        made = {}
        for codec in ("none", "lz4", "zstd"):
            path = f"{self.work}/volumes/{volume['key']}-{codec}.isb"
            if not os.path.exists(path):
                run(self.isobrick, "convert", volume["pyramid"], "-o", path, "--codec", codec)
            made[codec] = path
        times, reads, sizes = {c: [] for c in made}, {c: [] for c in made}, {}
        for _ in range(3 * self.rounds):
            for codec, path in made.items():
                drop_from_page_cache(path)
                report = run_json(self.isobrick, "extract", path, "--iso", volume["isovalue"], "--threads", THREADS, "--json")
                times[codec].append(report["seconds"]["open"] + report["seconds"]["extract"][0])
                sizes[codec] = report["bytes_read"]
                drop_from_page_cache(path)
                reads[codec].append(read_seconds(path, report["bytes_read"]))
        return rows + [{"name": f"isobrick, codec {codec}", "seconds": spread(times[codec]), "read": spread(reads[codec]),
                        "bytes_read": sizes[codec]} for codec in made]

    def building(self, volume):
        raw = ["--raw-dims", ",".join(map(str, volume["dimensions"])), "--raw-type",
               {"uint16": "u16", "int16": "i16", "uint8": "u8"}[volume["type"]]]
        kinds = [(f"{codec}{'' if curvature else ', no curvature'}", ["--codec", codec] + ([] if curvature else ["--no-curvature"]))
                 for curvature in (True, False) for codec in ("lz4", "none", "zstd")]
        out = f"{self.work}/volumes/built.isb"
        times, writes, reports = {n: [] for n, _ in kinds}, {n: [] for n, _ in kinds}, {}
        read_seconds(volume["raw"], volume["bytes"])
        for _ in range(self.rounds):
            for name, words in kinds:
                if os.path.exists(out):
                    os.remove(out)
                reports[name] = run_json(self.isobrick, "build", volume["raw"], "-o", out, *raw, *words, "--threads", THREADS,
                                         "--json")
                times[name].append(reports[name]["seconds"]["total"])
                writes[name].append(copy_seconds(out, f"{self.work}/volumes/copied"))
        os.remove(out)
        rows = [{"name": f"isobrick, {name}", "seconds": spread(times[name]), "write": spread(writes[name]),
                 "bytes": reports[name]["bytes"]["total"], "peak_bytes": reports[name]["peak_rss_bytes"]} for name, _ in kinds]
        peers = f"{self.build}/bench_pyramid_peers"
        for name in run(peers).split() if os.path.exists(peers) else []:
            row = run_json(peers, volume["pyramid"], name, 5, THREADS, 1 if self.quick else 2)
            rows.append({"name": name, "seconds": spread(row["seconds"]), "bytes": row["bytes"], "peak_bytes": row["peak_rss_bytes"]})
        return rows

    def memory(self, volume):
        raw = ["--raw-dims", ",".join(map(str, volume["dimensions"])), "--raw-type",
               {"uint16": "u16", "int16": "i16", "uint8": "u8"}[volume["type"]]]
        out = f"{self.work}/volumes/memory"
        kinds = [("build", m, [volume["raw"], "-o", f"{out}.isb", *raw, "--force"]) for m in ("64M", "256M", "1G")]
        kinds += [("extract", m, [volume["pyramid"], "--iso", volume["isovalue"], "-o", f"{out}.ply", "--force"])
                  for m in ("8M", "64M", "1G")]
        times, peaks = {}, {}
        for _ in range(self.rounds):
            for command, bound, words in kinds:
                remove(f"{out}.isb")
                begin = time.monotonic()
                report = run_json(self.isobrick, command, *words, "--memory", bound, "--threads", THREADS, "--json")
                times.setdefault((command, bound), []).append(time.monotonic() - begin)
                peaks.setdefault((command, bound), []).append(report["peak_rss_bytes"])
        for path in (f"{out}.isb", f"{out}.ply"):
            remove(path)
        return [{"name": f"{command} --memory {bound}", "seconds": spread(times[command, bound]),
                 "peak_bytes": max(peaks[command, bound])} for command, bound, _ in kinds]

    def conversion(self):
        size = 96 if self.quick else 320
        source = self.volume("convert", f"head phantom {size}³", f"phantom:head:{size}", 1324, None)
        out = f"{self.work}/volumes/converted"
        formats = ["nrrd", "vti", "tif", "h5", "ome.zarr", "vdb", "nii.gz"]
        into, back, rows = {f: [] for f in formats}, {f: [] for f in formats}, {}
        copies, peers = [], {}
        for _ in range(self.rounds):
            for ending in formats:
                path = f"{out}.{ending}"
                remove(path)
                report = run_json(self.isobrick, "convert", source["pyramid"], "-o", path, "--threads", THREADS, "--json")
                into[ending].append(report["seconds"])
                rows[ending] = {"bytes": report["bytes"], "peak_bytes": report["peak_rss_bytes"]}
                report = run_json(self.isobrick, "convert", path, "-o", f"{out}.isb", "--no-curvature", "--force", "--threads",
                                  THREADS, "--json")
                back[ending].append(report["seconds"])
                remove(path)
                if ending in ("tif", "h5", "ome.zarr", "vdb", "nii.gz"):
                    self.format_peer(ending, source, path, peers)
            copies.append(copy_seconds(source["raw"], f"{out}.copy"))
        remove(f"{out}.isb")
        mark = {"name": "copy of the voxels, fsync", "seconds": spread(copies), "bytes": source["bytes"]}
        made = [mark]
        for ending in formats:
            made.append({"name": f".{ending}", "seconds": spread(into[ending]), "back": spread(back[ending]), **rows[ending]})
            if ending in peers:
                peer = peers[ending]
                made.append({**peer, "seconds": spread(peer["seconds"])} if peer["seconds"] else peer)
        return made

    def format_peer(self, ending, source, path, peers):
        """The voxels to the same format by a package of Debian's Python; its time is added to peers[ending]."""
        try:
            row = run_json("/usr/bin/python3", f"{HERE}/format_peer.py", ending, source["layout"], path)
        except Failed:
            peers[ending] = {"name": f"a package for .{ending} in Debian's Python", "failure": NOT_THERE, "seconds": []}
            return
        kept = peers.setdefault(ending, {"name": f".{ending} by {row['name']}", "seconds": []})
        kept["seconds"].append(row["seconds"])
        kept.update(bytes=size_of(path), peak_bytes=row["peak_bytes"])
        remove(path)

    def simplification(self, volume):
        rows = ["simplify-0.5", "simplify-1", "simplify-1.5", "openvdb-0.1", "openvdb-0.5"]
        measured = self.bench(volume, rows, "--repeat", 1, rounds=self.rounds)
        if not self.quick:  # these take seconds
            measured += self.bench(volume, ["vtkQuadricDecimation-0.7", "vtkQuadricDecimation-0.85", "vtkDecimatePro-0.7",
                                            "vtkDecimatePro-0.85"], "--repeat", 1, rounds=1)
        kept = []
        for row in measured:
            if "seconds" not in row:
                kept.append({"name": row["name"], "failure": row.get("failure", "failed")})
                continue
            ways = row["distance"].values()
            kept.append({"name": row["name"], "triangles": row["triangles"], "seconds": spread(row["seconds"]["all"]),
                         "mean": max(way["mean"] for way in ways), "greatest": max(way["max"] for way in ways)})
        return kept

    def in_python(self):
        size = 96 if self.quick else 256
        volume = self.volume("python", f"head phantom {size}³", f"phantom:head:{size}", 1324, None)
        if not self.python:
            return []
        rows = self.surface_rows(volume, ["isobrick"], ["isobrick", "vtkFlyingEdges3D", "skimage", "PyMCubes"])
        program = ("import isobrick, json, numpy as np, sys, time; layout = json.load(open(sys.argv[1])); "
                   "array = np.fromfile(layout['raw'], layout['type']).reshape(layout['shape']); out = sys.argv[2]\n"
                   "if sys.argv[3] == 'array': times = [isobrick.build(array, out, force=True).seconds for _ in range(3)]\n"
                   "else: times = [isobrick.build(layout['raw'], out, raw=isobrick.RawLayout(array.shape, 'u16'), force=True).seconds "
                   "for _ in range(3)]\n"
                   "print(json.dumps(times))")
        times = {"array": [], "raw file": []}
        for _ in range(self.rounds):
            for name, seconds in times.items():
                seconds += run_json(self.python, "-c", program, volume["layout"], f"{self.work}/volumes/numpy.isb", name,
                                    env={"PYTHONPATH": "", "LD_LIBRARY_PATH": ""})
        return rows + [{"name": f"build from {'a numpy array' if n == 'array' else 'a raw file'}", "seconds": spread(s)}
                       for n, s in times.items()]

    # ---- all of it -----------------------------------------------------------------------------------

    def versions(self):
        found = {"isobrick": run(self.isobrick, "--version").split()[-1], "compiler": run("c++", "--version").splitlines()[0]}
        for name, package in (("OpenVDB", "libopenvdb-dev"), ("ITK", "libinsighttoolkit5-dev"), ("TBB", "libtbb-dev")):
            done = subprocess.run(["dpkg-query", "-W", "-f=${Version}", package], capture_output=True, text=True, check=False)
            found[name] = done.stdout or "unknown"
        if self.vtk != "none":
            found["VTK of Debian"] = self.vtk
        if self.python:
            for line in run(self.python, "-m", "pip", "freeze").splitlines():
                name, _, version = line.partition("==")
                if name in ("vtk", "scikit-image", "PyMCubes", "numpy"):
                    found[f"PyPI {name}"] = version
            found["Python"] = run(self.python, "-c", "import platform; print(platform.python_version())").strip()
        return found

    def machine(self):
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            processor = re.search(r"^model name[^:]*: (.*)$", file.read(), re.MULTILINE)[1]
        with open("/proc/meminfo", encoding="utf-8") as file:
            memory = round(int(re.search(r"MemTotal: *(\d+)", file.read())[1]) / MIB)
        huge = "/sys/kernel/mm/transparent_hugepage/enabled"
        pages = open(huge, encoding="ascii").read().split("[")[1].split("]")[0] if os.path.exists(huge) else "unknown"
        disk = shutil.disk_usage(self.work).total >> 30
        return {"processor": processor.strip(), "cores": os.cpu_count(), "memory_gib": memory, "kernel": platform.release(),
                "system": platform.freedesktop_os_release()["PRETTY_NAME"], "huge_pages": pages, "disk_gib": disk}

    def measure(self):
        self.say("volumes")
        self.all_volumes = volumes = self.volumes()
        results = {}
        for key, volume in volumes.items():
            results[f"extraction-{key}"] = self.step(f"extraction-{key}", lambda volume=volume: self.extraction(volume))
        for key in [k for k in ("ct", "head") if k in volumes]:
            results[f"queries-{key}"] = self.step(f"queries-{key}", lambda key=key: self.queries(volumes[key]))
        results["progressive"] = self.step("progressive", lambda: self.progressive(volumes["head"]))
        results["cold"] = self.step("cold", lambda: self.cold(volumes["head"]))
        results["building"] = self.step("building", lambda: self.building(volumes["head"]))
        results["memory"] = self.step("memory", lambda: self.memory(volumes["head"]))
        results["conversion"] = self.step("conversion", self.conversion)
        simplified = self.simplified_volumes()
        for volume in simplified:
            name = f"simplification-{volume['key']}"
            results[name] = self.step(name, lambda volume=volume: self.simplification(volume))
        results["python"] = self.step("python", self.in_python)
        titles = {v["key"]: {k: v[k] for k in ("title", "source", "real", "dimensions", "type", "isovalue", "bytes")}
                  for v in [*volumes.values(), *simplified]}
        for key in ("convert", "python"):
            title = {"convert": (96, 320), "python": (96, 256)}[key][0 if self.quick else 1]
            titles[key] = {"title": f"head phantom {title}³", "source": f"phantom head:{title}", "real": False,
                           "dimensions": [title] * 3, "type": "uint16", "isovalue": 1324, "bytes": 2 * title**3}
        return results, titles


def size_of(path):
    if not os.path.isdir(path):
        return os.path.getsize(path)
    return sum(os.path.getsize(os.path.join(folder, name)) for folder, _, names in os.walk(path) for name in names)


def remove(path):
    if os.path.isdir(path):
        shutil.rmtree(path)
    elif os.path.exists(path):
        os.remove(path)


def read_seconds(path, length):
    """Reads so many bytes from the begin of the file in pieces of 8 MiB."""
    descriptor = os.open(path, os.O_RDONLY)
    buffer = bytearray(8 * MIB)
    begin, left = time.monotonic(), length
    while left > 0:
        read = os.preadv(descriptor, [memoryview(buffer)[:min(left, len(buffer))]], length - left)
        if read == 0:
            break
        left -= read
    seconds = time.monotonic() - begin
    os.close(descriptor)
    return seconds


def copy_seconds(source, target):
    """Copies a file that is in the page cache, as a yardstick, and waits for the disk. In pieces: what this process holds
    counts as the peak of those that it starts."""
    buffer = bytearray(8 * MIB)
    begin = time.monotonic()
    with open(source, "rb", buffering=0) as data, open(target, "wb", buffering=0) as file:
        while length := data.readinto(buffer):
            file.write(memoryview(buffer)[:length])
        os.fsync(file.fileno())
    seconds = time.monotonic() - begin
    os.remove(target)
    return seconds


def main():
    parser = argparse.ArgumentParser()
    for name in ("work", "build", "data", "venv"):
        parser.add_argument(name)
    parser.add_argument("--output", required=True)
    parser.add_argument("--commit", required=True)
    parser.add_argument("--vtk", default="none", help="version of Debian's VTK")
    parser.add_argument("--quick", action="store_true")
    options = parser.parse_args()
    suite = Suite(options)
    begin = time.strftime("%Y-%m-%d")
    try:
        results, volumes = suite.measure()
        versions, machine = suite.versions(), suite.machine()
    except Failed as failure:
        sys.exit(f"benchmark: {failure}; what was measured is kept, run it again to go on")
    except KeyboardInterrupt:
        print("benchmark: interrupted; what was measured is kept, run it again to go on", file=sys.stderr)
        sys.exit(130)
    write_json(options.output, {
        "format": 1, "mode": "quick" if suite.quick else "full", "date": begin, "commit": options.commit,
        "machine": machine, "versions": versions, "threads": THREADS,
        "load": {"least": min(suite.loads), "greatest": max(suite.loads), "median": statistics.median(suite.loads)},
        "minutes": round(sum(r["seconds"] for r in results.values()) / 60, 1),
        "volumes": volumes, "results": results})


if __name__ == "__main__":
    main()
