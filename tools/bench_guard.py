#!/usr/bin/env python3
"""Compares two builds of isobrick for tools/bench_guard.sh: jobs by both, in turns.

    bench_guard.py BASE_BUILD HEAD_BUILD [--work FOLDER] [--rounds N] [--voxels N] [--jobs NAME ...]

Each build works on pyramids that it made itself. Prints a table; ends with 1 if a job of HEAD is worse."""
import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

ISO = "600.5"
# A figure is worse if it is greater by this factor, and by this much: what is small is mostly noise.
THRESHOLDS = {"peak_bytes": (1.10, 4 << 20), "bytes_read": (1.02, 64 << 10), "instructions": (1.03, 1_000_000)}
# A time is worse if the median of the rounds' ratios is above the first, the difference above the second, most rounds
# were longer, and the least time too, by the last: others on the machine make times longer, never shorter.
TIME, DIFFERENCE, SHARE_OF_ROUNDS, LEAST_TIME = 1.10, 0.002, 2 / 3, 1.05
# A job that seems slower is measured again so often, and must seem so each time.
CONFIRMATIONS = 3
COLUMNS = {"seconds": ("ms", 1e-3), "peak_bytes": ("peak MiB", 1 << 20), "bytes_read": ("MB read", 1e6),
           "instructions": ("million instructions", 1e6)}


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

    def makes(command, file, ending, *words):
        return lambda side: side.isobrick(command, getattr(side, file), "-o", side.folder / f"built.{ending}", *words)

    def extract(file, *words):
        return lambda side: side.isobrick("extract", getattr(side, file), "--iso", ISO, *words, "--json")

    return [
        Job("build", makes("build", "volume", "isb", "--codec", "none", "--no-curvature"), remove_built),
        Job("build with curvature", makes("build", "volume", "isb"), remove_built),
        Job("convert", makes("convert", "lz4", "nrrd"), remove_built),
        Job("volume to mesh", makes("extract", "volume", "ply", "--iso", ISO), remove_built),
        Job("extract, 9 times", extract("none", "--repeat", "9")),
        Job("extract around a focus, 31 times", extract("none", *focus, "--repeat", "31")),
        Job("extract by curvature, 9 times", extract("none", *focus, "--curvature-radius", "20", "--repeat", "9")),
        Job("extract, packed, 9 times", extract("lz4", "--repeat", "9")),
        Job("cold query", extract("lz4"), drop_packed),
        Job("first query", extract("none")),
        Job("simplify", extract("none", "--simplify", "1")),
        Job("components", extract("none", "--components")),
        Job("render", makes("render", "none", "png", "--iso", ISO, "--size", "320x240"), remove_built, False),
        Job("info", lambda side: side.isobrick("info", side.none, "--json")),
    ]


def run(command):
    """Seconds, peak_bytes and bytes_read of a program. Throws Failed."""
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


def instructions(job, side):
    """Instructions of one thread, under callgrind; None if the job does not end well there."""
    job.before(side)
    words = list(map(str, job.command(side)))
    if "--repeat" in words:
        words[words.index("--repeat") + 1] = "1"  # enough, as the number hardly changes
    if words[1] != "info":
        words += ["--threads", "1"]
    done = subprocess.run(["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", "--trace-children=yes",
                           *words], capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
    collected = re.findall(r"Collected : (\d+)", done.stderr)
    return sum(map(int, collected)) if done.returncode == 0 and collected else None


def measure(job, sides, rounds):
    """{figure: [of base, of head]}. The sides take turns, and each goes first in every second round."""
    runs = [[], []]
    for number in range(-1, rounds):  # the first does not count: warm
        for side in (0, 1) if number % 2 == 0 else (1, 0):
            job.before(sides[side])
            found = run(job.command(sides[side]))
            if number >= 0:
                runs[side].append(found)
    return {"seconds": [[run["seconds"] for run in of] for of in runs],
            "peak_bytes": [median(run["peak_bytes"] for run in of) for of in runs],
            "bytes_read": [min(run["bytes_read"] for run in of) for of in runs]}


def time_is_worse(base, head):
    return (median(h / b for b, h in zip(base, head)) > TIME and median(head) > median(base) + DIFFERENCE
            and sum(h > b for b, h in zip(base, head)) >= SHARE_OF_ROUNDS * len(base)
            and min(head) > LEAST_TIME * min(base))


def worse_figures(row):
    found = ["seconds"] if time_is_worse(*row["seconds"]) else []
    for key, (factor, difference) in THRESHOLDS.items():
        base, head = row.get(key, (None, None))
        if None not in (base, head) and head > base * factor and head > base + difference:
            found.append(key)
    return found


def cells_of(row):
    cells = []
    for key, (_, unit) in COLUMNS.items():
        base, head = row.get(key, (None, None))
        if None in (base, head):
            cells += ["–", "–", ""]
            continue
        change = median(h / b for b, h in zip(base, head)) if key == "seconds" else head / base if base else 1
        if key == "seconds":
            base, head = median(base), median(head)
        cells += [f"{base / unit:.1f}", f"{head / unit:.1f}", f"{100 * (change - 1):+.1f} %"]
    return cells


def text_of(rows):
    """rows: {name of a job: figures, or a text that says why there are none}"""
    lines = [["job"] + [cell for title, _ in COLUMNS.values() for cell in (f"{title}: base", "head", "change")]]
    lines += [[name, *(cells_of(row) if isinstance(row, dict) else [])] for name, row in rows.items()]
    widths = [max(len(line[i]) for line in lines if i < len(line)) for i in range(len(lines[0]))]
    text = ["  ".join(f"{cell:<{w}}" if i == 0 else f"{cell:>{w}}" for i, (cell, w) in enumerate(zip(line, widths))).rstrip()
            for line in lines]
    worse = {name: worse_figures(row) if isinstance(row, dict) else [f"failed: {row}"] for name, row in rows.items()}
    text += [f"WORSE: {name}: {', '.join(found)}" for name, found in worse.items() if found]
    count = sum(map(bool, worse.values()))
    return "\n".join([*text, f"{count} of {len(rows)} jobs are worse" if count else "no job is worse"]), count


def main():
    parser = argparse.ArgumentParser(description="Compares two builds of isobrick.")
    parser.add_argument("builds", nargs=2, metavar="BUILD")
    parser.add_argument("--work", default="build/guard/work", type=Path)
    parser.add_argument("--rounds", default=7, type=int)
    parser.add_argument("--voxels", default=256, type=int)
    parser.add_argument("--jobs", nargs="+", default=[], help="only these")
    arguments = parser.parse_args()
    jobs = jobs_of(arguments.voxels)
    if unknown := set(arguments.jobs) - {job.name for job in jobs}:
        sys.exit(f"bench_guard.py: there is no job '{min(unknown)}'; they are: {'; '.join(job.name for job in jobs)}")

    def sides_of(folder, voxels):
        folder.mkdir(parents=True, exist_ok=True)
        volume = folder / f"head{voxels}.mhd"
        subprocess.run([str(Path(arguments.builds[0]) / "isobrick"), "phantom", "head", "--voxels", str(voxels), "-o",
                        str(volume), "--force"], check=True, stdout=subprocess.DEVNULL)
        return [Side(build, folder / name, volume) for build, name in zip(arguments.builds, ("base", "head"))]

    sides, small = sides_of(arguments.work / "large", arguments.voxels), None
    if shutil.which("valgrind"):
        # Under callgrind everything takes some fifty times as long.
        small = sides_of(arguments.work / "small", min(96, arguments.voxels))
    else:
        print("bench_guard.py: valgrind is missing, so instructions are not counted; 'apt-get install valgrind'", file=sys.stderr)
    before, rows = os.getloadavg()[0], {}
    for job in jobs:
        if arguments.jobs and job.name not in arguments.jobs:
            continue
        print(f"bench_guard.py: {job.name}", file=sys.stderr)
        try:
            row = measure(job, sides, arguments.rounds)
            for _ in range(CONFIRMATIONS):
                if time_is_worse(*row["seconds"]):
                    row = measure(job, sides, 2 * arguments.rounds)
            if small and job.counts_instructions:
                row["instructions"] = [instructions(job, side) for side in small]
        except (Failed, OSError, subprocess.CalledProcessError) as failure:
            row = str(failure)
        rows[job.name] = row
    text, worse = text_of(rows)
    print(f"{text}\nMedians of {arguments.rounds} rounds in turns (twice as many where a job seemed slower); head phantom, "
          f"{arguments.voxels} voxels per axis; load {before:.1f} to {os.getloadavg()[0]:.1f}.")
    sys.exit(bool(worse))


if __name__ == "__main__":
    try:
        main()
    except (subprocess.CalledProcessError, OSError) as failure:
        print(f"bench_guard.py: {failure}", file=sys.stderr)
        sys.exit(2)
