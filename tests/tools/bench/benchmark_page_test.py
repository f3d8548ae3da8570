"""docs/BENCHMARKS.md is what docs/benchmarks.json gives, and shows a regression; measure.py goes on.

  benchmark_page_test.py SOURCE WORK
"""

import copy
import json
import os
import shutil
import subprocess
import sys

source, work = sys.argv[1:]
page_maker = f"{source}/tools/bench/suite/page.py"
committed = f"{source}/docs/benchmarks.json"
sys.dont_write_bytecode = True
sys.path.insert(0, f"{source}/tools/bench/suite")
import measure


def make(*words):
    return subprocess.run([sys.executable, "-B", page_maker, *words], capture_output=True, text=True, check=False)


def expect_failure(words, *arguments):
    done = make(*arguments)
    assert done.returncode == 1 and words in done.stderr and done.stderr.count("\n") == 1, (arguments, done.stderr)


def page_of(run):
    path = f"{work}/run.json"
    with open(path, "w", encoding="utf-8") as file:
        json.dump(run, file)
    done = make(path, f"{work}/page.md")
    assert done.returncode == 0, done.stderr
    with open(f"{work}/page.md", encoding="utf-8") as file:
        return file.read()


shutil.rmtree(work, ignore_errors=True)
os.makedirs(work)
with open(committed, encoding="utf-8") as file:
    run = json.load(file)

# The committed page is the one that is made: an edit of it, of page.md or of the JSON is found.
with open(f"{source}/docs/BENCHMARKS.md", encoding="utf-8") as file:
    page = file.read()
assert page_of(run) == page, f"docs/BENCHMARKS.md is not what its JSON gives: run {page_maker} {committed} docs/BENCHMARKS.md"
changed = copy.deepcopy(run)
changed["results"]["building-head"]["rows"][0]["seconds"]["median"] *= 1.5
assert page_of(changed) != page, "the page does not show a regression"

# Input that is none gets one line.
expect_failure("cannot read", f"{work}/missing.json", work)
for name, words in (("half", '{"results": '), ("list", "[]"), ("empty", "{}")):
    with open(f"{work}/{name}.json", "w", encoding="utf-8") as file:
        file.write(words)
    expect_failure("is no run of tools/benchmark.sh", f"{work}/{name}.json", work)
assert make(committed).returncode == 2

# A peer that could not be had, and one that failed, are named.
gone = copy.deepcopy(run)
rows = gone["results"]["cold-head"]["rows"]
rows += [{"name": "absent", "failure": measure.NOT_THERE}, {"name": "broken", "failure": "no memory"}]
words = page_of(gone)
assert "`absent`" in words and "broken of cold-head (no memory)" in words

# A table whose step is missing says so.
del gone["results"]["memory-head"]
assert "Not measured." in page_of(gone)

# Rows are measured in turns, medians of all rounds; one that fails does not end the others.
calls = []
def way(name, seconds):
    return lambda: calls.append(name) or {"seconds": [seconds.pop(0)], "bytes": len(calls)}
def fail():
    raise measure.Failed("broken")
rows = measure.turns(3, {"a": way("a", [3, 1, 2]), "b": fail, "c": way("c", [5, 5, 5])})
assert calls == ["a", "c"] * 3
assert rows[0] == {"name": "a", "seconds": {"median": 2, "min": 1, "max": 3, "runs": 3}, "bytes": 5}
assert rows[1] == {"name": "b", "failure": "broken"} and rows[2]["seconds"]["median"] == 5

# A step whose result is there is not measured again, and its file has a line for each row.
calls.clear()
for _ in range(2):
    suite = measure.Suite(measure.argparse.Namespace(work=f"{work}/steps", build="", data="none", venv="none", quick=True))
    result = suite.step("once", lambda: calls.append(1) or rows)
    assert result["rows"] == rows
assert len(calls) == 1
with open(f"{work}/steps/results/once.json", encoding="utf-8") as file:
    assert '\n  {"name": "b", "failure": "broken"},\n' in file.read()
print("the page is what its JSON gives")
