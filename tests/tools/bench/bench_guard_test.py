"""tools/bench_guard: what its comparison finds, and that a slower program is measured as slower.

    bench_guard_test.py TOOLS"""
import copy
import subprocess
import sys
import tempfile
import unittest

tools = sys.argv.pop(1)
sys.path.insert(0, tools)
sys.dont_write_bytecode = True
import bench_guard  # noqa: E402

# Both sides are equal but for a noise that the test knows.
NOISE = (1.0, 1.3, 0.98, 1.02, 2.0, 1.01, 1.05)
EQUAL = {"seconds": [[0.1 * n for n in NOISE], [0.1 * n for n in NOISE[::-1]]], "peak_bytes": [100 << 20] * 2,
         "bytes_read": [10_000_000] * 2, "instructions": [500_000_000] * 2}


def scaled(key, factor):
    row = copy.deepcopy(EQUAL)
    head = row[key][1]
    row[key][1] = [factor * value for value in head] if isinstance(head, list) else factor * head
    return row


class Comparison(unittest.TestCase):
    def test_equal_jobs_pass(self):
        text, count = bench_guard.text_of({"build": EQUAL, "info": EQUAL})
        self.assertEqual(count, 0)
        self.assertIn("no job is worse", text)

    def test_each_figure_is_found_alone(self):
        for key, factor in (("seconds", 1.2), ("peak_bytes", 1.2), ("bytes_read", 1.05), ("instructions", 1.05)):
            text, count = bench_guard.text_of({"build": EQUAL, "extract": scaled(key, factor)})
            self.assertEqual(count, 1, text)
            self.assertIn(f"WORSE: extract: {key}\n1 of 2 jobs are worse", text)

    def test_small_changes_and_better_ones_pass(self):
        for key, factor in (("seconds", 1.05), ("peak_bytes", 1.05), ("bytes_read", 1.01), ("instructions", 1.02),
                            ("seconds", 0.5), ("peak_bytes", 0.5), ("bytes_read", 0.5), ("instructions", 0.5)):
            self.assertEqual(bench_guard.worse_figures(scaled(key, factor)), [], f"{key} {factor}")

    def test_a_burst_of_others_work_is_no_slowdown(self):
        # Four of seven rounds of HEAD alone met a busy machine.
        self.assertFalse(bench_guard.time_is_worse([0.1] * 7, [0.1, 0.2, 0.2, 0.1, 0.2, 0.2, 0.1]))

    def test_a_failing_job_is_worse_and_instructions_may_be_missing(self):
        row = {**EQUAL, "instructions": [5, None]}
        text, count = bench_guard.text_of({"build": row, "render": "no window"})
        self.assertEqual(count, 1)
        self.assertIn("WORSE: render: failed: no window", text)


class Measuring(unittest.TestCase):
    def test_a_slower_program_is_found(self):
        # Far more than a busy machine adds to each of three runs.
        row = bench_guard.measure(bench_guard.Job("sleep", lambda side: ["sleep", side]), ["0", "0.5"], 3)
        self.assertEqual([len(of) for of in row["seconds"]], [3, 3])
        self.assertTrue(bench_guard.time_is_worse(*row["seconds"]))
        self.assertFalse(bench_guard.time_is_worse(*row["seconds"][::-1]))

    def test_memory_and_bytes_are_those_of_the_program(self):
        with tempfile.NamedTemporaryFile() as file:
            file.write(bytes(3_000_000))
            file.flush()
            found = bench_guard.run([sys.executable, "-c", f"open({file.name!r}, 'rb').read(); b = bytearray(64 << 20)"])
        self.assertGreaterEqual(found["bytes_read"], 3_000_000)
        self.assertGreaterEqual(found["peak_bytes"], 64 << 20)
        said = bench_guard.run([sys.executable, "-c", "print('{\"bytes_read\": 12345}')"])
        self.assertEqual(said["bytes_read"], 12345)

    def test_a_program_that_fails_says_why(self):
        with self.assertRaisesRegex(bench_guard.Failed, "no such thing"):
            bench_guard.run([sys.executable, "-c", "import sys; sys.exit('no such thing')"])

    def test_there_are_fourteen_jobs(self):
        self.assertEqual(len({job.name for job in bench_guard.jobs_of(64)}), 14)

    def test_wrong_words_are_refused_in_one_line(self):
        for words, expected in (([], "give the commit"), (["no-such-commit"], "'no-such-commit' is no commit")):
            done = subprocess.run([f"{tools}/bench_guard.sh", *words], capture_output=True, text=True, check=False)
            self.assertEqual(done.returncode, 2)
            self.assertIn(f"bench_guard.sh: {expected}", done.stderr)
            self.assertEqual(done.stderr.count("\n"), 1, done.stderr)


unittest.main()
