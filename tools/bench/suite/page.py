#!/usr/bin/env python3
"""Writes the page of benchmarks from the JSON of a run: page.py benchmarks.json PAGE.md

The text is that of page.md beside this script. {{name}} there is a fact of the run (class Page), {{table STEPS: COLUMN; ...}} a
table of steps, side by side or, with `stack`, below each other. Needs nothing but Python.
"""

import fnmatch
import json
import math
import os.path
import re
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
MOST_WORDS = 2500


def fail(message):
    sys.exit(f"page.py: {message}")


def short(value):
    """Three digits: 0.0123, 4.56, 1,230."""
    if value >= 100:
        return f"{value:,.0f}"
    digits = 2 - math.floor(math.log10(value)) if value > 0 else 0
    return f"{value:.{max(digits, 0)}f}"


def joined(words):
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]


def median(row, key="seconds"):
    return row[key]["median"]


def times_isobrick(row, volume, rows):
    own = rows["isobrick, one thread" if row["name"].endswith("one thread") else "isobrick"]
    ratio = median(row) / median(own)
    return "" if row["name"].startswith("isobrick") else f"{ratio:.0f}" if ratio >= 10 else f"{ratio:.1f}"


# The cell of a row: a figure, or a text. A row that lacks what a column needs has an empty cell.
COLUMNS = {
    "ms": lambda row, volume, rows: 1000 * median(row),
    "s": lambda row, volume, rows: median(row),
    "× isobrick": times_isobrick,
    "triangles": lambda row, volume, rows: f"{row['triangles']:,}",
    "Mtri/s": lambda row, volume, rows: row["triangles"] / median(row) / 1e6,
    "MB/s": lambda row, volume, rows: volume["bytes"] / median(row) / 1e6,
    "peak MiB": lambda row, volume, rows: f"{row['peak_bytes'] / 2**20:,.0f}",
    "MB": lambda row, volume, rows: f"{row['bytes'] / 1e6:,.0f}",
    "bytes ÷ voxels": lambda row, volume, rows: f"{row['bytes'] / volume['bytes']:.2f}",
    "read ÷ active": lambda row, volume, rows: f"{row['bytes_read'] / row['bytes_active']:.2f}",
    "MiB read": lambda row, volume, rows: f"{row['bytes_read'] / 2**20:,.0f}",
    "reading alone, ms": lambda row, volume, rows: 1000 * median(row, "read"),
    "copy, s": lambda row, volume, rows: median(row, "write"),
    "back, s": lambda row, volume, rows: median(row, "back"),
    "first ms": lambda row, volume, rows: 1000 * median(row, "first"),
    "its triangles": lambda row, volume, rows: f"{row['first_triangles']:,}",
    "mean": lambda row, volume, rows: f"{row['mean']:.3f}",
    "greatest": lambda row, volume, rows: f"{row['greatest']:.2f}",
    "µs": lambda row, volume, rows: 1e6 * median(row),
    "GB/s": lambda row, volume, rows: row["bytes_per_second"] / 1e9,
    "M triangles/s": lambda row, volume, rows: row["items_per_second"] / 1e6,
}


class Page:
    def __init__(self, run):
        self.run, self.results, self.volumes = run, run["results"], run["volumes"]

    def steps(self, pattern):
        """(rows by name, volume) of each step of that name; without rows that failed."""
        return [({row["name"]: row for row in self.results[step]["rows"] if "failure" not in row},
                 self.volumes.get(step.partition("-")[2], {"title": ""}))
                for step in self.results if fnmatch.fnmatch(step, pattern)]

    # ---- facts ---------------------------------------------------------------------------------------

    def minutes(self):
        return f"{self.run['minutes']:.0f} minutes"

    def threads(self):
        return {1: "one", 2: "two"}.get(self.run["threads"], str(self.run["threads"]))

    def machine(self):
        m = self.run["machine"]
        other = {r["commit"] for r in self.results.values()} - {self.run["commit"]}
        by_commit = [f"{joined([s for s in self.results if self.results[s]['commit'] == c])} at {c}" for c in sorted(other)]
        return (f"*Machine:* {m['processor']}, {m['cores']} cores, {m['memory_gib']} GiB, {m['system']}, Linux {m['kernel']}, huge pages "
                f"`{m['huge_pages']}`. *isobrick* {self.run['versions']['isobrick']}, commit {self.run['commit']}, {self.run['date']}"
                + (f"; measured before: {'; '.join(by_commit)}." if other else "."))

    def load(self):
        load, cores = self.run["load"], self.run["machine"]["cores"]
        words = f"The load of the machine was {load['least']:.1f} to {load['greatest']:.1f}, {load['median']:.1f} in the middle"
        if load["median"] > cores:
            return (f"**Other work ran beside.** {words}, where {cores} would keep it busy: times are long and "
                    "scatter. Read ratios of rows of one table rather than times.")
        busy = [step for step, result in self.results.items() if max(result["load"]) > 1.5 * cores]
        return words + (f"; more than {1.5 * cores:g} beside {joined(busy)}, whose times are long." if busy else ".")

    def volumes_words(self):
        words = []
        for volume in self.volumes.values():
            real = "real, " if volume["real"] else ""
            words.append(f"{volume['title']} ({real}{'×'.join(map(str, volume['dimensions']))} {volume['type']}, isovalue "
                         f"{volume['isovalue']:g})")
        return joined(list(dict.fromkeys(words)))

    def versions(self):
        return ", ".join(f"{name} {version}" for name, version in self.run["versions"].items())

    def left_out(self):
        rows = [(step, row) for step, result in self.results.items() for row in result["rows"] if "failure" in row]
        missing = sorted({f"`{row['name']}`" for _, row in rows if row["failure"] == "not there"})
        failed = sorted({f"{row['name']} of {step} ({row['failure']})" for step, row in rows if row["failure"] != "not there"})
        words = f"Left out, as they were not here: {joined(missing)}. " if missing else ""
        return words + (f"Failed: {joined(failed)}." if failed else "") or "Nothing was left out."

    # ---- tables --------------------------------------------------------------------------------------

    def cell(self, column, row, volume, rows):
        try:
            value = COLUMNS[column](row, volume, rows)
        except KeyError:
            if column not in COLUMNS:
                fail(f"page.md has a column '{column}'; there are {', '.join(COLUMNS)}")
            return ""
        return value if isinstance(value, str) else short(value)

    def table(self, pattern, columns):
        steps = self.steps(pattern.removesuffix(" stack"))
        if not any(rows for rows, _ in steps):
            return "Not measured."
        if pattern.endswith(" stack"):
            head = ["", *columns]
            lines = [[f"{volume['title']}, {name}", *(self.cell(c, row, volume, rows) for c in columns)]
                     for rows, volume in steps for name, row in rows.items()]
        else:
            names = list(dict.fromkeys(name for rows, _ in steps for name in rows))
            titles = [f"{volume['title']}: " if len(steps) > 1 else "" for _, volume in steps]
            head = ["", *(title + column if column == columns[0] else column for title in titles for column in columns)]
            lines = [[name, *(self.cell(c, rows.get(name, {}), volume, rows) for rows, volume in steps for c in columns)]
                     for name in names]
        kept = [i for i in range(len(head)) if i == 0 or any(line[i] for line in lines)]
        made = ["| " + " | ".join(row[i] for i in kept) + " |" for row in (head, *lines)]
        return "\n".join([made[0], "|---" + "|--:" * (len(kept) - 1) + "|", *made[1:]])

    def text(self):
        with open(f"{HERE}/page.md", encoding="utf-8") as file:
            template = file.read()

        def filled(match):
            kind, _, rest = match[1].partition(" ")
            if kind != "table":
                return getattr(self, kind)()
            pattern, _, columns = rest.partition(": ")
            return self.table(pattern, columns.split("; "))

        page = re.sub(r"\{\{([^}]+)\}\}", filled, template)
        if len(page.split()) > MOST_WORDS:
            fail(f"the page has {len(page.split())} words, and may have {MOST_WORDS}: shorten page.md")
        return "<!-- tools/benchmark.sh made this page: edit tools/bench/suite/page.md, then run page.py beside it. -->\n" + page


def main():
    if len(sys.argv) != 3:
        print("usage: page.py benchmarks.json PAGE.md", file=sys.stderr)
        sys.exit(2)
    source, page = sys.argv[1:]
    try:
        with open(source, encoding="utf-8") as file:
            text = Page(json.load(file)).text()
    except OSError as error:
        fail(f"cannot read '{source}': {error.strerror}; make it with tools/benchmark.sh")
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        fail(f"'{source}' is no run of tools/benchmark.sh: {type(error).__name__} {error}; make it anew")
    with open(page, "w", encoding="utf-8") as file:
        file.write(text)


main()
