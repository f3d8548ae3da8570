#!/usr/bin/env python3
"""Measures the jobs of tools/bench_guard.sh with two builds of isobrick, in turns.

    measure_jobs.py BASE_BUILD HEAD_BUILD -o TABLE.json [--work FOLDER] [--rounds N] [--voxels N]
                    [--names BASE HEAD] [--jobs NAME ...] [--no-instructions]

Each build works on pyramids that it made itself. TABLE.json has for each job its `seconds` and `peak_bytes`
(a list for each build, a number for each round), `bytes_read` and `instructions` (a number for each build)."""
import argparse
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import compare_jobs
import timed_run

SIDES = ("base", "head")
# A job that seems slower is measured again so often, and must seem so each time: others' work may do that once.
CONFIRMATIONS = 3
ISO = "600.5"


class Side:
    """A build, its folder, and its files there. The volume is the same for both."""

    def __init__(self, build, folder, volume, voxels):
        self.build, self.folder, self.volume, self.voxels = Path(build), folder, volume, voxels
        folder.mkdir(parents=True, exist_ok=True)
        self.none, self.lz4 = folder / "none.isb", folder / "lz4.isb"

    def isobrick(self, *words):
        return [self.build / "isobrick", *words]

    def prepare(self):
        for codec, file in (("none", self.none), ("lz4", self.lz4)):
            subprocess.run(self.isobrick("build", self.volume, "-o", file, "--codec", codec, "--force", "--rebuild"),
                           check=True, stdout=subprocess.DEVNULL)


class Job:
    """The job of a side. Before each run, which is not measured, `before` may lay things out."""

    def __init__(self, name, command, before=None, environment=None, counts_instructions=True):
        self.name, self.command, self.before, self.environment = name, command, before, environment
        # Waits and drivers make the number of some jobs a matter of chance.
        self.counts_instructions = counts_instructions


def remove_built(side):
    for file in side.folder.glob("built*"):
        file.unlink()


class NotComparable(Exception):
    """Both builds work, and chance did not let them do the same."""


# ---- Resume: a build that was killed in the middle, with as many good bricks on both sides ----------------


def kill_in_the_middle(side):
    """Leaves what a build has when it is killed half-way, in the folder `killed`."""
    killed = side.folder / "killed"
    shutil.rmtree(killed, ignore_errors=True)
    killed.mkdir()
    process = subprocess.Popen(list(map(str, side.isobrick("build", side.volume, "-o", killed / "built.isb", "--codec",
                                                           "none", "--threads", "1"))), stdout=subprocess.DEVNULL)
    half = side.none.stat().st_size / 2
    while process.poll() is None and timed_run.bytes_by_calls(process.pid, "wchar") < half:
        time.sleep(0.001)
    process.send_signal(signal.SIGKILL)
    process.wait()


def lay_out_killed(side):
    remove_built(side)
    for file in (side.folder / "killed").iterdir():
        shutil.copyfile(file, side.folder / file.name)


def resume_command(side):
    return side.isobrick("build", side.volume, "-o", side.folder / "built.isb", "--codec", "none", "--resume", "--json")


def bricks_resumed(side):
    lay_out_killed(side)
    done = subprocess.run(resume_command(side), check=True, capture_output=True, text=True)
    return json.loads(done.stdout)["bricks_resumed"]


def prepare_resume(sides):
    """The moment of a kill is a matter of chance: it is tried until both sides have the same number."""
    tries = {side: {} for side in SIDES}
    for _ in range(12):
        for name in SIDES:
            kill_in_the_middle(sides[name])
            number = bricks_resumed(sides[name])
            if number > 0 and number not in tries[name]:
                kept = sides[name].folder / f"killed-{number}"
                shutil.rmtree(kept, ignore_errors=True)
                shutil.copytree(sides[name].folder / "killed", kept)
                tries[name][number] = kept
        if both := set(tries["base"]) & set(tries["head"]):
            number = max(both)
            for name in SIDES:
                shutil.rmtree(sides[name].folder / "killed")
                shutil.copytree(tries[name][number], sides[name].folder / "killed")
            return
    raise NotComparable("no two killed builds had the same number of bricks")


# ---- The jobs ---------------------------------------------------------------------------------------------


def jobs_of(voxels):
    focus = ["--iso", ISO, "--focus", f"{voxels // 2},{voxels // 5},{voxels // 2}", "--radius", str(voxels // 8)]

    def build(*words):
        return lambda side: side.isobrick("build", side.volume, "-o", side.folder / "built.isb", *words)

    def extract(file, *words):
        return lambda side: side.isobrick("extract", getattr(side, file), *words, "--json")

    def drop(side):
        timed_run.drop_from_page_cache(side.lz4)

    uniform = ["--iso", ISO]
    return [
        Job("build", build("--codec", "none", "--no-curvature"), remove_built),
        Job("build with curvature", build(), remove_built),
        Job("resume", resume_command, lay_out_killed, counts_instructions=False),
        Job("convert", lambda side: side.isobrick("convert", side.lz4, "-o", side.folder / "built.nrrd"), remove_built),
        Job("extract, 9 times", extract("none", *uniform, "--repeat", "9")),
        Job("extract around a focus, 31 times", extract("none", *focus, "--repeat", "31")),
        Job("extract by curvature, 9 times", extract("none", *focus, "--curvature-radius", "20", "--repeat", "9")),
        Job("extract, packed, 9 times", extract("lz4", *uniform, "--repeat", "9")),
        Job("cold query", extract("lz4", *uniform), drop),
        Job("first query", extract("none", *uniform)),
        Job("progressive query, 9 times",
            lambda side: [side.build / "tests/isobrick_benchmarks", "--benchmark_filter=firstAndLastSurface/0"],
            environment=lambda side: {"ISOBRICK_BENCHMARK_PYRAMID": str(side.lz4), "ISOBRICK_BENCHMARK_ISOVALUE": ISO},
            counts_instructions=False),
        Job("simplify", extract("none", *uniform, "--simplify", "1")),
        Job("components", extract("none", *uniform, "--components")),
        Job("render", lambda side: side.isobrick("render", side.none, "--iso", ISO, "--size", "320x240", "-o",
                                                 side.folder / "built.png", "--force"), counts_instructions=False),
        Job("info", lambda side: side.isobrick("info", side.none, "--json")),
    ]


# ---- Measuring --------------------------------------------------------------------------------------------


def run_once(job, side):
    if job.before:
        job.before(side)
    return timed_run.run(job.command(side), job.environment and job.environment(side))


def instructions(job, side):
    """Instructions of one thread, under callgrind; None if the job does not end well there."""
    if job.before:
        job.before(side)
    # Once is enough, as the number hardly changes.
    words = list(map(str, job.command(side)))
    if "--repeat" in words:
        words[words.index("--repeat") + 1] = "1"
    if words[1] not in ("info", "bench"):
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


def main():
    parser = argparse.ArgumentParser(description="Measures jobs with two builds of isobrick, in turns.")
    parser.add_argument("builds", nargs=2, metavar="BUILD")
    parser.add_argument("-o", "--output", required=True)
    parser.add_argument("--work", default="build/guard/work", type=Path)
    parser.add_argument("--rounds", default=7, type=int)
    parser.add_argument("--voxels", default=256, type=int)
    parser.add_argument("--names", nargs=2, default=list(SIDES))
    parser.add_argument("--jobs", nargs="+", default=[], help="only these")
    parser.add_argument("--no-instructions", action="store_true")
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
        sides = {name: Side(build, folder / name, volume, voxels) for name, build in zip(SIDES, arguments.builds)}
        for side in sides.values():
            side.prepare()
        return sides

    sides = both(arguments.work / "large", arguments.voxels)
    small = None
    counts, why = not arguments.no_instructions, "as --no-instructions says"
    if counts and not shutil.which("valgrind"):
        counts, why = False, "valgrind is missing; 'apt-get install valgrind' brings it"
    if counts:
        # Under callgrind everything takes some fifty times as long.
        small = both(arguments.work / "small", min(96, arguments.voxels))
    else:
        print(f"measure_jobs.py: instructions are not counted: {why}", file=sys.stderr)
    table = {"names": arguments.names, "rounds": arguments.rounds, "voxels": arguments.voxels,
             "load": [os.getloadavg()[0]], "instructions_left_out": None if counts else why, "jobs": []}
    for job in jobs:
        print(f"measure_jobs.py: {job.name}", file=sys.stderr)
        row = {"name": job.name}
        try:
            if job.name == "resume":
                prepare_resume(sides)
            row = measure(job, sides, arguments.rounds)
            for _ in range(CONFIRMATIONS):
                if not compare_jobs.time_is_worse(*(row["seconds"][name] for name in SIDES)):
                    break
                row = {**measure(job, sides, 2 * arguments.rounds), "measured_again": True}
            if counts and job.counts_instructions:
                row["instructions"] = {name: instructions(job, small[name]) for name in SIDES}
        except NotComparable as reason:
            row["left_out"] = str(reason)
        except (timed_run.Failed, OSError, subprocess.CalledProcessError) as failure:
            row["failure"] = str(failure)
        table["jobs"].append(row)
    table["load"].append(os.getloadavg()[0])
    part = Path(arguments.output + ".part")
    part.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    part.replace(arguments.output)


if __name__ == "__main__":
    try:
        main()
    except (subprocess.CalledProcessError, OSError) as failure:
        sys.exit(f"measure_jobs.py: {failure}")
