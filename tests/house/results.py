#!/usr/bin/env python3
"""What the steps of tools/test.sh took and counted, as a table; its last line is the sum of all tests.

    results.py FOLDER STEP...

FOLDER has for each step: STEP.tsv (step, part, seconds, exit status), STEP.xml (JUnit, of ctest or pytest), and
STEP.shards/TEST.xml (of gtest, for each test of ctest that is a shard). Ends with 1 if there is nothing to count."""

from __future__ import annotations

import sys
import xml.etree.ElementTree as xml
from dataclasses import dataclass, field
from pathlib import Path

SLOWEST = 20


@dataclass
class Step:
    name: str
    seconds: dict[str, float] = field(default_factory=dict)
    passed: int = 0
    failed: int = 0
    skipped: int = 0
    times: list[tuple[float, str]] = field(default_factory=list)
    broken: list[str] = field(default_factory=list)

    def add(self, name: str, seconds: float, is_failed: bool, is_skipped: bool) -> None:
        self.times.append((seconds, name))
        if is_failed:
            self.failed += 1
            self.broken.append(name)
        elif is_skipped:
            self.skipped += 1
        else:
            self.passed += 1


def add_shard(step: Step, file: Path, is_failed: bool, shard: str) -> None:
    """All tests of a process of gtest; one failure more if it ended otherwise than its tests say, as by a crash."""
    before = step.failed
    for case in xml.parse(file).iter("testcase"):
        name = f"{case.get('classname')}.{case.get('name')}"
        failed = case.find("failure") is not None
        skipped = case.get("result") == "skipped" or case.find("skipped") is not None
        step.add(name, float(case.get("time", 0)), failed, skipped)
    if is_failed and step.failed == before:
        step.add(shard, 0, True, False)


def read_step(folder: Path, name: str) -> Step:
    step = Step(name)
    timing = folder / f"{name}.tsv"
    failed_part = ""
    if timing.exists():
        for line in timing.read_text().splitlines():
            _, part, seconds, status = line.split("\t")
            step.seconds[part] = float(seconds)
            if status != "0":
                failed_part = part
    report = folder / f"{name}.xml"
    if report.exists():
        for case in xml.parse(report).iter("testcase"):
            title = case.get("name", "")
            failed = case.find("failure") is not None or case.find("error") is not None
            failed = failed or case.get("status") == "fail"
            skipped = case.find("skipped") is not None or case.get("status") in ("notrun", "disabled")
            shard = folder / f"{name}.shards" / f"{title}.xml"
            if shard.exists():
                add_shard(step, shard, failed, title)
            else:
                step.add(title, float(case.get("time", 0)), failed, skipped)
    if failed_part and step.failed == 0:
        step.add(f"{name}: {failed_part}", 0, True, False)
    return step


def main(folder: Path, names: list[str]) -> int:
    steps = [read_step(folder, name) for name in names]
    slowest = sorted((time for step in steps for time in step.times), reverse=True)[:SLOWEST]
    print(f"\nthe {len(slowest)} slowest tests, in seconds")
    for seconds, name in slowest:
        print(f"{seconds:8.1f}  {name}")
    parts = ["configure", "build", "tests"]
    print(f"\n{'step':<14}{'configure':>11}{'build':>9}{'tests':>9}{'all':>9}  {'passed':>8}{'failed':>8}{'skipped':>9}")
    for step in steps:
        cells = "".join(f"{step.seconds.get(part, 0):>{width},.0f}" for part, width in zip(parts, (11, 9, 9)))
        total = sum(step.seconds.values())
        print(f"{step.name:<14}{cells}{total:>9,.0f}  {step.passed:>8}{step.failed:>8}{step.skipped:>9}")
    print(f"{'':<14}{'':>29}{sum(sum(step.seconds.values()) for step in steps):>9,.0f} s")
    for step in steps:
        for name in step.broken:
            print(f"failed: {step.name}: {name}")
    passed, failed, skipped = (sum(getattr(step, key) for step in steps) for key in ("passed", "failed", "skipped"))
    print(f"\n{passed} passed, {failed} failed" + (f", {skipped} skipped" if skipped else ""))
    return 0 if passed + failed else 1


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2:]))
