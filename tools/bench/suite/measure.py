#!/usr/bin/env python3
"""The measurements of tools/benchmark.sh.

  measure.py WORK BUILD DATA VENV --output FILE.json --commit C [--quick] [--steps NAME,...]

WORK keeps volumes and results, one JSON file a step: a step whose result is there is left out, so a run that was
stopped goes on. BUILD is a build folder of isobrick, DATA the folder of the real volumes (or none), VENV the Python with
isobrick and the peers from PyPI (or none). FILE.json is written when all steps are done; of an older FILE.json it keeps
the steps that --steps does not name. Needs nothing but Python itself.
"""

import argparse
import contextlib
import json
import os
import platform
import re
import shutil
import statistics
import subprocess
import sys
import time

HERE = os.path.dirname(os.path.abspath(__file__))
PEERS = os.path.join(os.path.dirname(HERE), "peers")
MIB = 1 << 20
THREADS = 2
NOT_THERE = "not there"
# These take a second and more: each process makes one surface that counts, and one before.
SLOW = ("vtkSynchronizedTemplates3D", "vtkMarchingCubes", "skimage", "PyMCubes")
RAW_TYPES = {"uint8": "u8", "int8": "i8", "uint16": "u16", "int16": "i16", "float32": "f32"}


def text_of(value, indent="\n"):
    """JSON with a line for each row, so that changes can be read."""
    def height(part):
        inner = part.values() if isinstance(part, dict) else part if isinstance(part, list) else None
        return 0 if inner is None else 1 + max(map(height, inner), default=0)

    if height(value) <= 2:
        return json.dumps(value, ensure_ascii=False)
    inner = indent + " "
    if isinstance(value, list):
        return f"[{inner}{f',{inner}'.join(text_of(part, inner) for part in value)}{indent}]"
    parts = [f"{json.dumps(key)}: {text_of(part, inner)}" for key, part in value.items()]
    return "{" + inner + f",{inner}".join(parts) + indent + "}"


def write_json(path, value):
    with open(path + ".part", "w", encoding="utf-8") as file:
        file.write(text_of(value) + "\n")
    os.replace(path + ".part", path)


def read_json(path):
    with open(path, encoding="utf-8") as file:
        return json.load(file)


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


def whole_process(*words, env=None):
    """Seconds and peak memory of a process from its start to its end."""
    begin = time.monotonic()
    process = subprocess.Popen([str(word) for word in words], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
                               env={**os.environ, **(env or {})})
    errors = process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise Failed((errors.strip() or f"exit {process.returncode}").splitlines()[-1])
    return {"seconds": [time.monotonic() - begin], "peak_bytes": 1024 * usage.ru_maxrss}


def spread(values):
    return {"median": statistics.median(values), "min": min(values), "max": max(values), "runs": len(values)}


def turns(rounds, ways):
    """Rows of {name: function}, which are called in turns. What a function returns becomes the row: lists of times of all
    rounds become medians, of other figures the last one counts. One that fails is left out from then on."""
    rows, times = {}, {}
    for _ in range(rounds):
        for name, way in ways.items():
            if "failure" in rows.get(name, {}):
                continue
            try:
                found = way()
            except (Failed, OSError) as failure:
                rows[name] = {"name": name, "failure": str(failure)}
                continue
            for key, value in found.items():
                if isinstance(value, list):
                    times.setdefault((name, key), []).extend(value)
                    found[key] = spread(times[name, key])
            rows[name] = {"name": name, **found}
    return list(rows.values())


class Suite:
    def __init__(self, options):
        self.work, self.build, self.data, self.quick = options.work, options.build, options.data, options.quick
        self.rounds = 1 if self.quick else 3
        self.isobrick = f"{self.build}/isobrick"
        self.peers = f"{PEERS}/bench_peers.py"
        self.python = f"{options.venv}/bin/python" if options.venv != "none" else None
        # Peers begin with `env python3`.
        self.python_env = {"PYTHONPATH": "", "LD_LIBRARY_PATH": "", "GLIBC_TUNABLES": "glibc.malloc.hugetlb=1",
                           "PATH": f"{options.venv}/bin:{os.environ['PATH']}"}
        self.begin = time.monotonic()
        os.makedirs(f"{self.work}/results", exist_ok=True)
        os.makedirs(f"{self.work}/volumes", exist_ok=True)

    def step(self, name, make):
        """The result of a step: of its file, if there is one."""
        path = f"{self.work}/results/{name}.json"
        if not os.path.exists(path):
            print(f"{time.monotonic() - self.begin:5.0f} s  {name}", flush=True)
            before, begin = os.getloadavg()[0], time.monotonic()
            rows = make()
            write_json(path, {"rows": rows, "load": [round(before, 1), round(os.getloadavg()[0], 1)],
                              "seconds": round(time.monotonic() - begin, 1)})
        return read_json(path)

    def report(self, command, *words):
        return run_json(self.isobrick, command, *words, "--threads", THREADS, "--json")

    def file(self, name):
        path = f"{self.work}/volumes/{name}"
        remove(path)
        return path

    # ---- volumes -------------------------------------------------------------------------------------

    def volume(self, key, title, source, isovalue, focus=None):
        """A pyramid of a real volume (a path below DATA) or of a phantom, its voxels without a header, and a NRRD file."""
        real = not source.startswith("phantom:")
        paths = {ending: f"{self.work}/volumes/{key}.{ending}" for ending in ("isb", "raw", "nrrd", "json")}
        if not os.path.exists(paths["isb"]):
            run(self.isobrick, "build", f"{self.data}/{source}" if real else source, "-o", paths["isb"])
        for ending in ("raw", "nrrd"):
            if not os.path.exists(paths[ending]):
                run(self.isobrick, "convert", paths["isb"], "-o", paths[ending])
        info = run_json(self.isobrick, "info", paths["isb"], "--json")
        write_json(paths["json"], {"raw": os.path.abspath(paths["raw"]), "type": info["voxel_type"],
                                   "raw_type": RAW_TYPES[info["voxel_type"]], "shape": info["dimensions"][::-1],
                                   "pyramid": os.path.abspath(paths["isb"]), "isovalue": isovalue, "focus": focus})
        return {"key": key, "title": title, "real": real, "dimensions": info["dimensions"], "type": info["voxel_type"],
                "isovalue": isovalue, "focus": focus, "bytes": info["bytes"]["raw"], "pyramid": paths["isb"],
                "raw": paths["raw"], "layout": paths["json"],
                "raw_words": [paths["raw"], "--raw-dims", ",".join(map(str, info["dimensions"])), "--raw-type",
                              RAW_TYPES[info["voxel_type"]]],
                "nrrd": f"{self.data}/{source}" if source.endswith(".nrrd") else paths["nrrd"]}

    def volumes(self):
        big, small, other = (128, 96, 96) if self.quick else (512, 256, 320)
        made = [self.volume("head", f"head phantom {big}³", f"phantom:head:{big}", 1324, [big // 2, big // 5, big // 2]),
                self.volume("gyroid", f"gyroid {small}³", f"phantom:gyroid:{small}", 128),
                self.volume("convert", f"head phantom {other}³", f"phantom:head:{other}", 1324),
                self.volume("python", f"head phantom {small}³", f"phantom:head:{small}", 1324)]
        if self.data != "none" and not self.quick:
            made.insert(0, self.volume("ct", "head CT", "vhf_head_ct/vhf_head.nrrd", 1250, [256, 256, 117]))
            made += [self.volume("tooth", "tooth", "tooth_u16be/tooth.nhdr", 520),
                     self.volume("mr", "MR", "mr_nifti/MR.nii.gz", 40),
                     self.volume("engine", "engine", "engine/engine.vti", 80)]
        return {volume["key"]: volume for volume in made}

    # ---- surfaces ------------------------------------------------------------------------------------

    def bench(self, volume, rows, *more, threads=THREADS):
        """Rows of `isobrick bench`; peers that are not here have a failure. Slow ones make fewer surfaces."""
        listed = [words.split()[0] for words in run(self.peers, "--list", *rows, env=self.python_env).splitlines()]
        kept = []
        for is_slow in (False, True):
            there = [row for row in rows if (row in SLOW) == is_slow and (row in listed or is_ours(row))]
            if not there:
                continue
            repeat = ["--repeat", 1] if is_slow else []
            kept += run_json(self.isobrick, "bench", volume["pyramid"], "--iso", volume["isovalue"], "--threads", threads,
                             "--rounds", self.rounds, "--rows", ",".join(there), "--peers", self.peers, *repeat, *more,
                             "--json", env=self.python_env)["rows"]
        made = [{"name": row, "failure": NOT_THERE} for row in rows if row not in listed and not is_ours(row)]
        for row in kept:
            if "seconds" not in row:
                made.append({"name": row["name"], "failure": row["failure"]})
                continue
            ways = row.get("distance", {}).values()
            made.append({"name": row["name"], "triangles": row["triangles"],
                         "seconds": spread(row["seconds"]["all"]), "peak_bytes": row["peak_rss_bytes"],
                         **({"mean": max(way["mean"] for way in ways), "greatest": max(way["max"] for way in ways)}
                            if ways else {})})
        return made

    def extraction(self, volume):
        old = ["vtkSynchronizedTemplates3D", "vtkMarchingCubes"] if volume["key"] == self.first else []
        rows = self.bench(volume, ["isobrick", "vtkFlyingEdges3D", *old, "openvdb-0", "skimage", "PyMCubes"],
                          "--no-distances")
        single = self.bench(volume, ["isobrick", "vtkFlyingEdges3D"], threads=1)
        return rows + [{**row, "name": f"{row['name']}, one thread"} for row in single]

    def simplification(self, volume):
        return self.bench(volume, ["simplify-0.5", "simplify-1", "openvdb-0.5", "vtkQuadricDecimation-0.85",
                                   "vtkDecimatePro-0.85"], "--repeat", 1)

    def file_to_mesh(self, volume):
        """Whole processes, from a file of voxels to a PLY."""
        out = f"{self.work}/volumes/mesh.ply"

        extract = ["--iso", volume["isovalue"], "-o", out, "--threads", THREADS]
        script = [volume["nrrd"], volume["isovalue"], out, THREADS]
        ways = {"isobrick extract, of the NRRD": [self.isobrick, "extract", volume["nrrd"], *extract],
                "isobrick extract, of its pyramid": [self.isobrick, "extract", volume["pyramid"], *extract]}
        if self.python:
            ways["vtkFlyingEdges3D, a script"] = [self.python, f"{PEERS}/vtk_peer.py", *script]
            ways["scikit-image, a script"] = [self.python, f"{PEERS}/skimage_peer.py", *script]

        def process(words):
            remove(out)
            return {**whole_process(*words, env=self.python_env), "bytes": os.path.getsize(out)}

        return turns(self.rounds, {name: lambda words=words: process(words) for name, words in ways.items()})

    def array_to_mesh(self, volume):
        rows = self.bench(volume, ["isobrick", "vtkFlyingEdges3D", "skimage", "PyMCubes"])
        return rows + self.python_rows(volume, "isobrick.isosurface", "isobrick.marching_cubes", "isobrick session",
                                       "build of an array", "build of a raw file")

    def python_row(self, name, volume):
        return run_json(self.python, f"{HERE}/python_rows.py", name, volume["layout"], THREADS,
                        f"{self.work}/volumes/python.isb", env=self.python_env)

    def python_rows(self, volume, *names):
        ways = {name: lambda name=name: self.python_row(name, volume) for name in names}
        return turns(self.rounds, ways) if self.python else []

    # ---- what isobrick does with a pyramid -----------------------------------------------------------

    def queries(self, volume):
        focus = ["--focus", ",".join(map(str, volume["focus"]))]
        far = ",".join(map(str, [volume["dimensions"][0] // 2, -max(volume["dimensions"]), volume["dimensions"][2] // 2]))
        kinds = {"everything": [], **{f"radius {r}": [*focus, "--radius", r] for r in (20, 40, 80, 160)},
                 "radius 40, flatter than ρ = 20 coarse": [*focus, "--radius", 40, "--curvature-radius", 20],
                 "seen from afar, 4 pixels a cell": ["--eye", far, "--pixels", 4], "level 1": ["--level", 1]}

        def query(words):
            def way():
                report = self.report("extract", volume["pyramid"], "--iso", volume["isovalue"], *words, "--repeat", 11)
                return {"seconds": report["seconds"]["extract"][1:], "triangles": report["triangles"],
                        "bytes_read": report["bytes_read"], "bytes_active": report["bytes_active"]}
            return way

        return turns(self.rounds, {name: query(words) for name, words in kinds.items()})

    def first_query(self, volume):
        def cold(name):
            def way():
                drop_from_page_cache(volume["pyramid"])
                return self.python_row(name, volume)
            return way

        names = ("progressive, everything", f"progressive, focus, radius {max(volume['dimensions']) // 10}")
        return turns(3 * self.rounds, {name: cold(name) for name in names}) if self.python else []

    def cold(self, volume):
        rows = self.bench(volume, ["isobrick", "vtkFlyingEdges3D", "openvdb-0", "skimage"], "--no-distances", "--page-cache",
                          "cold")

        def codec(name):
            path = self.file(f"{volume['key']}-{name}.isb")
            run(self.isobrick, "convert", volume["pyramid"], "-o", path, "--codec", name)

            def way():
                drop_from_page_cache(path)
                report = self.report("extract", path, "--iso", volume["isovalue"])
                drop_from_page_cache(path)
                return {"seconds": [report["seconds"]["open"] + report["seconds"]["extract"][0]],
                        "read": [dd_seconds(path, "/dev/null", f"count={report['bytes_read']}", "iflag=count_bytes")], "bytes_read": report["bytes_read"]}
            return way

        return rows + turns(3 * self.rounds, {f"isobrick, codec {name}": codec(name) for name in ("none", "lz4", "zstd")})

    def building(self, volume):
        dd_seconds(volume["raw"], "/dev/null")  # now in the page cache

        def build(*words):
            def way():
                out = self.file("built.isb")
                report = self.report("build", *volume["raw_words"], "-o", out, *words)
                return {"seconds": [report["seconds"]["total"]], "write": [dd_seconds(out, f"{out}.copy", "conv=fsync")],
                        "bytes": report["bytes"]["total"], "peak_bytes": report["peak_rss_bytes"]}
            return way

        rows = turns(self.rounds, {
            f"isobrick, {codec}{', no curvature' if bare else ''}": build("--codec", codec, *bare)
            for bare in ([], ["--no-curvature"]) for codec in ("lz4", "none", "zstd")})
        return rows + self.python_rows(volume, "SimpleITK BinShrink", "SimpleITK Gaussians and Shrink")

    def memory(self, volume):
        kinds = {"build": (volume["raw_words"], "bounded.isb", ("64M", "256M", "1G")),
                 "extract": ([volume["pyramid"], "--iso", volume["isovalue"]], "bounded.ply", ("8M", "64M", "1G"))}
        return turns(self.rounds, {
            f"{command} --memory {bound}": lambda c=command, w=words, o=out, b=bound: whole_process(
                self.isobrick, c, *w, "-o", self.file(o), "--memory", b, "--threads", THREADS)
            for command, (words, out, bounds) in kinds.items() for bound in bounds})

    def conversion(self, volume):
        def convert(ending):
            def way():
                path = self.file(f"converted.{ending}")
                into = self.report("convert", volume["pyramid"], "-o", path)
                back = self.report("convert", path, "-o", self.file("back.isb"), "--no-curvature")
                remove(path)
                return {"seconds": [into["seconds"]], "back": [back["seconds"]], "bytes": into["bytes"],
                        "peak_bytes": into["peak_rss_bytes"]}
            return way

        copy = {"copy of the voxels, fsync": lambda: {"seconds": [dd_seconds(volume["raw"], self.file("copy"), "conv=fsync")],
                                                      "bytes": volume["bytes"]}}
        formats = {f".{e}": convert(e) for e in ("nrrd", "vti", "tif", "h5", "ome.zarr", "vdb", "nii.gz")}
        return turns(self.rounds, copy) + turns(self.rounds, formats)

    def kernels(self):
        program = f"{self.build}/tests/house/isobrick_benchmarks"
        if not os.path.exists(program):
            return [{"name": "kernels", "failure": NOT_THERE}]
        least = "0.1" if self.quick else "0.5"
        found = run_json(program, "--benchmark_format=json", f"--benchmark_min_time={least}")["benchmarks"]
        scale = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3}
        return [{"name": row["name"], "seconds": spread([row["cpu_time"] * scale[row["time_unit"]]]),
                 **{key: row[key] for key in ("bytes_per_second", "items_per_second") if key in row}} for row in found]

    # ---- all of it -----------------------------------------------------------------------------------

    def versions(self):
        packages = run(self.python, "-m", "pip", "freeze").splitlines() if self.python else []
        named = re.compile(r"(vtk|scikit-image|pymcubes|numpy|simpleitk)==(.*)", re.IGNORECASE)
        return {"isobrick": run(self.isobrick, "--version").split()[-1], "compiler": run("c++", "--version").splitlines()[0],
                **{found[1]: found[2] for found in map(named.match, packages) if found}}

    def machine(self):
        def fact(path, pattern):
            with open(path, encoding="utf-8") as file:
                return re.search(pattern, file.read(), re.MULTILINE)[1].strip()

        return {"processor": fact("/proc/cpuinfo", r"^model name[^:]*: (.*)$"), "cores": os.cpu_count(),
                "memory_gib": round(int(fact("/proc/meminfo", r"MemTotal: *(\d+)")) / MIB), "kernel": platform.release(),
                "system": platform.freedesktop_os_release()["PRETTY_NAME"],
                "huge_pages": fact("/sys/kernel/mm/transparent_hugepage/enabled", r"\[(\w+)\]")}

    def measure(self, only=()):
        """(results, volumes)"""
        volumes = self.volumes()
        self.first = next(iter(volumes))
        steps = [("extraction", self.extraction, ("ct", "head", "gyroid")), ("file", self.file_to_mesh, ("ct", "head")),
                 ("queries", self.queries, ("ct", "head")), ("first", self.first_query, ("head",)),
                 ("cold", self.cold, ("head",)), ("building", self.building, ("head",)), ("memory", self.memory, ("head",)),
                 ("conversion", self.conversion, ("convert",)),
                 ("simplification", self.simplification, ("tooth", "mr", "engine", "ct") if "tooth" in volumes else ("gyroid",)),
                 ("array", self.array_to_mesh, ("python",))]
        results = {}
        for kind, make, keys in steps:
            for key in keys:
                if key in volumes and (not only or kind in only):
                    results[f"{kind}-{key}"] = self.step(f"{kind}-{key}", lambda make=make, key=key: make(volumes[key]))
        if not only or "kernels" in only:
            results["kernels"] = self.step("kernels", self.kernels)
        return results, {key: {k: v[k] for k in ("title", "real", "dimensions", "type", "isovalue", "bytes")}
                         for key, v in volumes.items()}


def is_ours(row):
    return row.startswith(("isobrick", "simplify"))


def remove(path):
    if os.path.isdir(path):
        shutil.rmtree(path)
    with contextlib.suppress(FileNotFoundError):
        os.remove(path)


def drop_from_page_cache(path):
    with open(path, "rb") as file:
        os.fsync(file.fileno())
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def dd_seconds(source, target, *words):
    """A yardstick: reading, or copying until it is on the disk."""
    begin = time.monotonic()
    run("dd", f"if={source}", f"of={target}", "bs=8M", *words)
    return time.monotonic() - begin


def main():
    parser = argparse.ArgumentParser()
    for name in ("work", "build", "data", "venv"):
        parser.add_argument(name)
    parser.add_argument("--output", required=True)
    parser.add_argument("--commit", required=True)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--steps", default="")
    options = parser.parse_args()
    suite = Suite(options)
    try:
        results, volumes = suite.measure([kind for kind in options.steps.split(",") if kind])
        versions, machine = suite.versions(), suite.machine()
    except Failed as failure:
        sys.exit(f"benchmark: {failure}; what was measured is kept, run it again to go on")
    except KeyboardInterrupt:
        print("benchmark: interrupted; what was measured is kept, run it again to go on", file=sys.stderr)
        sys.exit(130)
    for result in results.values():
        result["commit"] = options.commit
    if options.steps and os.path.exists(options.output):
        results = {**read_json(options.output)["results"], **results}
    loads = [load for result in results.values() for load in result["load"]]
    write_json(options.output, {
        "format": 2, "mode": "quick" if suite.quick else "full", "date": time.strftime("%Y-%m-%d"), "commit": options.commit,
        "machine": machine, "versions": versions, "threads": THREADS,
        "load": {"least": min(loads), "greatest": max(loads), "median": statistics.median(loads)},
        "minutes": round(sum(r["seconds"] for r in results.values()) / 60, 1), "volumes": volumes, "results": results})


if __name__ == "__main__":
    main()
