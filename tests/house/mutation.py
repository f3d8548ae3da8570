#!/usr/bin/env python3
"""Breaks each rule of the algorithm and each promise of the format on purpose, one at a time: mutations.txt beside this
file has the changes, and the test that each of them turns red.

    tests/house/mutation.py FOLDER [ID...]

FOLDER: a copy of the tree, which is changed, built and put back (a git worktree of HEAD is made there if there is none).
ID: of the changes, default all. Ends with a table; 1 if a test stays green, a change does not compile, or its text is not
there exactly once. All take some hours on two cores. ISOBRICK_JOBS: compilers at once.
"""

import dataclasses
import os
import pathlib
import re
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
EXECUTABLES = {"S": "storage", "P": "preprocess", "E": "extract", "T": "format", "V": "viewer", "F": "fault"}
SECONDS = 900  # that a test may take; one that hangs is red


@dataclasses.dataclass
class Mutation:
    id: str
    rule: str
    file: str
    old: str
    new: str
    red: str

    @property
    def executable(self) -> str:
        return f"isobrick_{EXECUTABLES[self.red.split()[0]]}_tests"

    @property
    def filter(self) -> str:
        return self.red.split()[1]


def mutations(names: list[str]) -> list[Mutation]:
    table = []
    for block in (HERE / "mutations.txt").read_text().strip().split("\n\n"):
        name, *lines = block.splitlines()
        table.append(Mutation(name, **dict(line.split(maxsplit=1) for line in lines)))
    unknown = set(names) - {mutation.id for mutation in table}
    if unknown:
        sys.exit(f"no such change: {', '.join(sorted(unknown))}; mutations.txt has them")
    return [mutation for mutation in table if not names or mutation.id in names]


def build(folder: pathlib.Path, targets: set[str]) -> bool:
    jobs = os.environ.get("ISOBRICK_JOBS", str(os.cpu_count()))
    command = ["cmake", "--build", "build/release", "--parallel", jobs, "--target", *sorted(targets)]
    done = subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    if done.returncode != 0:
        print("\n".join(line for line in done.stdout.splitlines() if "error" in line) or done.stdout[-2000:])
    return done.returncode == 0


def failures(folder: pathlib.Path, executable: str, tests: str) -> list[str]:
    """The tests that fail, or the one in which the process ends or hangs."""
    command = [f"build/release/tests/{executable}", f"--gtest_filter={tests}", "--gtest_fail_fast"]
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace", timeout=SECONDS, check=False)
        output, status = done.stdout, done.returncode
    except subprocess.TimeoutExpired as hung:
        output, status = (hung.stdout or b"").decode(errors="replace"), 1
    if status == 0 and "[  PASSED  ] 0 tests" not in output:
        return []
    failed = re.findall(r"^\[  FAILED  \] ([\w/]+\.[\w/]+)", output, re.MULTILINE)
    begun = re.findall(r"^\[ RUN      \] ([\w./]+)", output, re.MULTILINE)
    return list(dict.fromkeys(failed)) or begun[-1:] or ["no test of that name"]


def main() -> int:
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    folder = pathlib.Path(sys.argv[1]).resolve()
    if (folder / "tests/house").exists() and (folder / "tests/house").samefile(HERE):
        sys.exit(f"'{folder}' is the tree of this script; name a copy of it, which may be changed")
    if not folder.exists():
        subprocess.run(["git", "worktree", "add", "--detach", str(folder)], cwd=HERE, check=True)
    if not (folder / "build/release/build.ninja").exists():
        subprocess.run(["cmake", "--preset", "release"], cwd=folder, check=True)
    table = mutations(sys.argv[2:])
    wrong = [m.id for m in table if (folder / m.file).read_text().count(m.old) != 1]
    if wrong:
        sys.exit(f"not there exactly once: the text of {', '.join(wrong)}")

    if not build(folder, {m.executable for m in table}):
        return 1
    for executable in sorted({m.executable for m in table}):
        for tests in sorted({m.filter for m in table if m.executable == executable}):
            if failed := failures(folder, executable, tests):
                sys.exit(f"red without a change: {executable} {failed[0]}")
    results = {}
    for m in sorted(table, key=lambda m: (m.executable, m.file)):  # so that few files are compiled twice
        path = folder / m.file
        text = path.read_text()
        try:
            path.write_text(text.replace(m.old, m.new))
            red = failures(folder, m.executable, m.filter) if build(folder, {m.executable}) else None
        finally:
            path.write_text(text)
        results[m.id] = "DOES NOT COMPILE" if red is None else "STAYS GREEN" if not red else red[0]
        print(f"{m.id:<30}{results[m.id]}", flush=True)
    print(f"\n{'change':<30}{'red test':<75}rule")
    for m in table:
        print(f"{m.id:<30}{results[m.id]:<75}{m.rule}")
    bad = sum(result.isupper() for result in results.values())
    print(f"{len(table) - bad} of {len(table)} changes turn a test red")
    return 1 if bad else 0


sys.exit(main())
