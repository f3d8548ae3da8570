#!/usr/bin/env python3
"""tools/guard: what its comparison finds, and that a slower program is measured as slower.

    guard_test.py GUARD_FOLDER"""
import json
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

guard = Path(sys.argv.pop(1)).resolve()
sys.path.insert(0, str(guard))
sys.dont_write_bytecode = True

import compare_jobs  # noqa: E402
import measure_jobs  # noqa: E402


def job(name="extract", seconds=0.1, peak=100 << 20, read=10_000_000, instructions=500_000_000):
    """A row of which both sides are equal but for a noise that the test knows."""
    noise = (1.0, 1.3, 0.98, 1.02, 2.0, 1.01, 1.05)
    return {"name": name, "seconds": {"base": [seconds * n for n in noise], "head": [seconds * n for n in noise[::-1]]},
            "peak_bytes": {"base": [peak] * 7, "head": [peak] * 7}, "bytes_read": {"base": read, "head": read},
            "instructions": {"base": instructions, "head": instructions}}


def scaled(key, factor):
    row = job()
    head = row[key]["head"]
    row[key]["head"] = [factor * value for value in head] if isinstance(head, list) else factor * head
    return row


class Comparison(unittest.TestCase):
    def compare(self, *rows):
        table = {"names": ["1111111", "2222222"], "rounds": 7, "voxels": 64, "load": [1, 2], "jobs": list(rows)}
        with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
            json.dump(table, file)
            file.flush()
            done = subprocess.run([sys.executable, guard / "compare_jobs.py", file.name], capture_output=True, text=True,
                                  check=False)
        return done.returncode, done.stdout

    def test_equal_jobs_pass(self):
        status, text = self.compare(job("build"), job("info", 0.006))
        self.assertEqual(status, 0, text)
        self.assertIn("no job is worse", text)

    def test_each_measure_is_found_alone(self):
        for key, factor, word in (("seconds", 1.2, "time"), ("peak_bytes", 1.2, "memory"),
                                  ("bytes_read", 1.05, "bytes read"), ("instructions", 1.05, "instructions")):
            status, text = self.compare(job("build"), scaled(key, factor))
            self.assertEqual(status, 1, text)
            self.assertIn(f"WORSE: extract: {word}\n", text)
            self.assertIn("1 of 2 jobs are worse", text)

    def test_small_changes_and_better_ones_pass(self):
        for key, factor in (("seconds", 1.05), ("peak_bytes", 1.05), ("bytes_read", 1.01), ("instructions", 1.02),
                            ("seconds", 0.5), ("peak_bytes", 0.5), ("bytes_read", 0.5), ("instructions", 0.5)):
            status, text = self.compare(scaled(key, factor))
            self.assertEqual(status, 0, f"{key} {factor}\n{text}")

    def test_a_burst_of_others_work_is_no_slowdown(self):
        row = job()
        # Four of seven rounds of HEAD alone met a busy machine.
        row["seconds"] = {"base": [0.1] * 7, "head": [0.1, 0.2, 0.2, 0.1, 0.2, 0.2, 0.1]}
        self.assertEqual(compare_jobs.worse_figures(row), [])

    def test_a_failing_job_is_worse(self):
        status, text = self.compare(job("build"), {"name": "render", "failure": "no window"})
        self.assertEqual(status, 1)
        self.assertIn("failed: no window", text)

    def test_instructions_may_be_missing(self):
        row = job()
        row["instructions"] = {"base": 5, "head": None}
        other = job("info")
        del other["instructions"]
        self.assertEqual(self.compare(row, other)[0], 0)

    def test_what_is_no_table_is_refused(self):
        with tempfile.NamedTemporaryFile("w") as file:
            file.write('{"jobs": [1]}')
            file.flush()
            done = subprocess.run([sys.executable, guard / "compare_jobs.py", file.name], capture_output=True, text=True,
                                  check=False)
        self.assertEqual(done.returncode, 2)
        self.assertIn("is no table", done.stderr)


class Measuring(unittest.TestCase):
    def test_a_slower_program_is_found(self):
        sides = {"base": "0", "head": "0.5"}  # far more than a busy machine adds to each of three runs
        sleeping = measure_jobs.Job("sleep", lambda side: ["sleep", side])
        row = measure_jobs.measure(sleeping, sides, 3)
        self.assertIn("time", compare_jobs.worse_figures(row))
        # In turns: the other way round it is better, never worse.
        row["seconds"] = {"base": row["seconds"]["head"], "head": row["seconds"]["base"]}
        self.assertNotIn("time", compare_jobs.worse_figures(row))

    def test_memory_and_bytes_are_those_of_the_program(self):
        with tempfile.NamedTemporaryFile() as file:
            file.write(bytes(3_000_000))
            file.flush()
            reads = measure_jobs.run([sys.executable, "-c", f"open({file.name!r}, 'rb').read(); b = bytearray(64 << 20)"])
        self.assertGreaterEqual(reads["bytes_read"], 3_000_000)
        self.assertGreaterEqual(reads["peak_bytes"], 64 << 20)
        said = measure_jobs.run([sys.executable, "-c", "print('{\"bytes_read\": 12345}')"])
        self.assertEqual(said["bytes_read"], 12345)

    def test_a_program_that_fails_says_why(self):
        with self.assertRaisesRegex(measure_jobs.Failed, "no such thing"):
            measure_jobs.run([sys.executable, "-c", "import sys; sys.exit('no such thing')"])

    def test_a_seeming_slowdown_is_measured_again(self):
        row = {"name": "a", "seconds": {"base": [0.1] * 3, "head": [0.2] * 3}, "peak_bytes": {"base": [1], "head": [1]},
               "bytes_read": {"base": 1, "head": 1}, "measured_again": True}
        table = {"names": ["b", "h"], "rounds": 3, "voxels": 64, "load": [1], "jobs": [row]}
        self.assertIn("a (*)", compare_jobs.text_of(table))
        self.assertIn("twice as many rounds", compare_jobs.text_of(table))

    def test_there_are_fifteen_jobs(self):
        self.assertEqual(len({job.name for job in measure_jobs.jobs_of(64)}), 15)


class Script(unittest.TestCase):
    def test_wrong_words_are_refused_in_one_line(self):
        for words, expected in (([], "give the commit"), (["no-such-commit"], "'no-such-commit' is no commit")):
            done = subprocess.run([guard.parent / "bench_guard.sh", *words], capture_output=True, text=True, check=False)
            self.assertEqual(done.returncode, 2)
            self.assertIn(f"bench_guard.sh: {expected}", done.stderr)
            self.assertEqual(done.stderr.count("\n"), 1, done.stderr)


unittest.main()
