#!/usr/bin/env python3
"""Measures the jobs of tools/bench_guard.sh with two builds of isobrick, in turns.

    measure_jobs.py BASE_BUILD HEAD_BUILD -o TABLE.json [--work FOLDER] [--rounds N] [--voxels N]
                    [--names BASE HEAD] [--jobs NAME ...]

Each build works on pyramids that it made itself. TABLE.json has for each job its `seconds` and `peak_bytes`
(a list for each build, a number for each round), `bytes_read` and `instructions` (a number for each build)."""
import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import compare_jobs

SIDES = ("base", "head")
# A job that seems slower is measured again so often, and must seem so each time: others' work may do that once.
CONFIRMATIONS = 3
ISO = "600.5"


class Failed(Exception):
    """A program that ended with another status than 0, and its last line."""


class Side:
    """A build, its folder, and its files there. The volume is the same for both."""

    def __init__(self, build, folder, volume):
        self.build, self.folder, self.volume = Path(build), folder, volume
        folder.mkdir(parents=True, exist_ok=True)
        self.none, self.lz4 = folder / "none.isb", folder / "lz4.isb"
        for codec, file in (("none", self.none), ("lz4", self.lz4)):
            subprocess.run(self.isobrick("build", volume, "-o", file, "--codec", codec, "--force", "--rebuild"),
                           check=True, stdout=subprocess.DEVNULL)

    def isobrick(self, *words):
        return [self.build / "isobrick", *words]


class Job:
    """The job of a side. Before each run, which is not measured, `before` may lay things out."""

    def __init__(self, name, command, before=lambda side: None, counts_instructions=True):
        self.name, self.command, self.before = name, command, before
        # Waits and drivers make the number of some jobs a matter of chance.
        self.counts_instructions = counts_instructions


def remove_built(side):
    for file in side.folder.glob("built*"):
        file.unlink()


def drop_packed(side):
    with open(side.lz4, "rb") as file:
        os.fsync(file.fileno())
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def jobs_of(voxels):
    focus = ["--focus", f"{voxels // 2},{voxels // 5},{voxels // 2}", "--radius", str(voxels // 8)]

    def build(*words):
        return lambda side: side.isobrick("build", side.volume, "-o", side.folder / "built.isb", *words)

    def extract(file, *words):
        return lambda side: side.isobrick("extract", getattr(side, file), "--iso", ISO, *words, "--json")

    def render(side):
        return side.isobrick("render", side.none, "--iso", ISO, "--size", "320x240", "-o", side.folder / "built.png",
                             "--force")

    return [
        Job("build", build("--codec", "none", "--no-curvature"), remove_built),
        Job("build with curvature", build(), remove_built),
        Job("convert", lambda side: side.isobrick("convert", side.lz4, "-o", side.folder / "built.nrrd"), remove_built),
        Job("volume to mesh", lambda side: side.isobrick("extract", side.volume, "--iso", ISO, "-o",
                                                         side.folder / "built.ply"), remove_built),
        Job("extract, 9 times", extract("none", "--repeat", "9")),
        Job("extract around a focus, 31 times", extract("none", *focus, "--repeat", "31")),
        Job("extract by curvature, 9 times", extract("none", *focus, "--curvature-radius", "20", "--repeat", "9")),
        Job("extract, packed, 9 times", extract("lz4", "--repeat", "9")),
        Job("cold query", extract("lz4"), drop_packed),
        Job("first query", extract("none")),
        Job("progressive query", lambda side: [side.build / "tests/progressive_times", side.lz4, ISO, "2"], drop_packed,
            counts_instructions=False),
        Job("simplify", extract("none", "--simplify", "1")),
        Job("components", extract("none", "--components")),
        Job("render", render, counts_instructions=False),
        Job("info", lambda side: side.isobrick("info", side.none, "--json")),
    ]


# ---- Measuring --------------------------------------------------------------------------------------------


def run(command):
    """A dict of seconds, peak_bytes and bytes_read of a program. Throws Failed."""
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as errors:
        began = time.perf_counter()
        process = subprocess.Popen(list(map(str, command)), stdin=subprocess.DEVNULL, stdout=output, stderr=errors)
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        seconds = time.perf_counter() - began
        with open(f"/proc/{process.pid}/io", encoding="ascii") as file:
            bytes_read = next(int(line.split()[1]) for line in file if line.startswith("rchar"))
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        output.seek(0)
        errors.seek(0)
        if process.returncode != 0:
            lines = errors.read().decode(errors="replace").strip().splitlines()
            raise Failed(lines[-1] if lines else f"{command[0]} ended with {process.returncode}")
        # isobrick counts its reads through the map, too; other programs and commands do not say.
        said = re.search(rb'"bytes_read": (\d+)', output.read())
        return {"seconds": seconds, "peak_bytes": 1024 * usage.ru_maxrss,
                "bytes_read": int(said[1]) if said else bytes_read}


def run_once(job, side):
    job.before(side)
    return run(job.command(side))


def instructions(job, side):
    """Instructions of one thread, under callgrind; None if the job does not end well there."""
    job.before(side)
    # Once is enough, as the number hardly changes.
    words = list(map(str, job.command(side)))
    if "--repeat" in words:
        words[words.index("--repeat") + 1] = "1"
    if words[1] != "info":
        words += ["--threads", "1"]
    done = subprocess.run(["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", "--trace-children=yes",
                           *words], capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
    collected = re.findall(r"Collected : (\d+)", done.stderr)
    return sum(map(int, collected)) if done.returncode == 0 and collected else None


def measure(job, sides, rounds):
    """The sides take turns, and each goes first in every second round."""
    runs = {name: [] for name in SIDES}
    for name in SIDES:
        run_once(job, sides[name])  # warm
    for number in range(rounds):
        for name in SIDES if number % 2 == 0 else reversed(SIDES):
            runs[name].append(run_once(job, sides[name]))
    row = {"name": job.name}
    for key in ("seconds", "peak_bytes"):
        row[key] = {name: [run[key] for run in runs[name]] for name in SIDES}
    row["bytes_read"] = {name: min(run["bytes_read"] for run in runs[name]) for name in SIDES}
    return row


def measured(job, sides, rounds, small):
    try:
        row = measure(job, sides, rounds)
        for _ in range(CONFIRMATIONS):
            if not compare_jobs.time_is_worse(*(row["seconds"][name] for name in SIDES)):
                break
            row = {**measure(job, sides, 2 * rounds), "measured_again": True}
        if small and job.counts_instructions:
            row["instructions"] = {name: instructions(job, small[name]) for name in SIDES}
        return row
    except (Failed, OSError, subprocess.CalledProcessError) as failure:
        return {"name": job.name, "failure": str(failure)}


def main():
    parser = argparse.ArgumentParser(description="Measures jobs with two builds of isobrick, in turns.")
    parser.add_argument("builds", nargs=2, metavar="BUILD")
    parser.add_argument("-o", "--output", required=True)
    parser.add_argument("--work", default="build/guard/work", type=Path)
    parser.add_argument("--rounds", default=7, type=int)
    parser.add_argument("--voxels", default=256, type=int)
    parser.add_argument("--names", nargs=2, default=list(SIDES))
    parser.add_argument("--jobs", nargs="+", default=[], help="only these")
    arguments = parser.parse_args()
    jobs = jobs_of(arguments.voxels)
    if unknown := set(arguments.jobs) - {job.name for job in jobs}:
        sys.exit(f"measure_jobs.py: there is no job '{min(unknown)}'; they are: {'; '.join(job.name for job in jobs)}")
    jobs = [job for job in jobs if not arguments.jobs or job.name in arguments.jobs]

    def both(folder, voxels):
        folder.mkdir(parents=True, exist_ok=True)
        volume = folder / f"head{voxels}.mhd"
        subprocess.run([str(Path(arguments.builds[0]) / "isobrick"), "phantom", "head", "--voxels", str(voxels), "-o",
                        str(volume), "--force"], check=True, stdout=subprocess.DEVNULL)
        return {name: Side(build, folder / name, volume) for name, build in zip(SIDES, arguments.builds)}

    sides, small, why = both(arguments.work / "large", arguments.voxels), None, None
    if shutil.which("valgrind"):
        # Under callgrind everything takes some fifty times as long.
        small = both(arguments.work / "small", min(96, arguments.voxels))
    else:
        why = "valgrind is missing; 'apt-get install valgrind' brings it"
        print(f"measure_jobs.py: instructions are not counted: {why}", file=sys.stderr)
    table = {"names": arguments.names, "rounds": arguments.rounds, "voxels": arguments.voxels,
             "load": [os.getloadavg()[0]], "instructions_left_out": why, "jobs": []}
    for job in jobs:
        print(f"measure_jobs.py: {job.name}", file=sys.stderr)
        table["jobs"].append(measured(job, sides, arguments.rounds, small))
    table["load"].append(os.getloadavg()[0])
    part = Path(arguments.output + ".part")
    part.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    part.replace(arguments.output)


if __name__ == "__main__":
    try:
        main()
    except (subprocess.CalledProcessError, OSError) as failure:
        sys.exit(f"measure_jobs.py: {failure}")
