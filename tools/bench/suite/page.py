#!/usr/bin/env python3
"""Writes the page of benchmarks and its plots from the JSON of a run.

  page.py benchmarks.json DOCS            writes DOCS/BENCHMARKS.md and DOCS/figures/bench-*.svg
  page.py benchmarks.json DOCS --check    writes nothing; fails if they are not what it would write

The text is that of page.md beside this script, with {{name}} for what comes from the JSON. Needs nothing but Python itself.
"""

import json
import math
import os
import re
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import plots

HERE = os.path.dirname(os.path.abspath(__file__))
MOST_WORDS = 2500


def fail(message):
    sys.exit(f"page.py: {message}")


def table(head, rows):
    lines = [head, ["---"] + ["--:"] * (len(head) - 1), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)


def ms(seconds):
    return "" if seconds is None else plots.short(1000 * seconds)


def sec(seconds):
    return "" if seconds is None else plots.short(seconds)


def mib(size):
    return f"{size / 2**20:,.0f}"


def times(number):
    return f"{number:.0f}" if number >= 10 else f"{number:.1f}"


def joined(words):
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]


def between(numbers):
    low, high = times(min(numbers)), times(max(numbers))
    return low if low == high else f"{low} to {high}"


class Page:
    def __init__(self, run):
        self.run, self.results, self.volumes = run, run["results"], run["volumes"]
        self.plots = {}

    def rows(self, step):
        return [row for row in self.results[step]["rows"] if "failure" not in row]

    def row(self, step, name):
        return next((row for row in self.rows(step) if row["name"] == name), None)

    def median(self, step, name, key="seconds"):
        row = self.row(step, name)
        return row[key]["median"] if row and key in row else None

    def steps(self, kind):
        """(step, volume) of every volume that was measured so."""
        return [(step, self.volumes[step.split("-", 1)[1]]) for step in self.results if step.startswith(kind + "-")]

    # ---- words ---------------------------------------------------------------------------------------

    def minutes(self):
        return f"{self.run['minutes']:.0f} minutes"

    def threads(self):
        return {1: "one", 2: "two"}.get(self.run["threads"], str(self.run["threads"]))

    def machine(self):
        m = self.run["machine"]
        return (f"*Machine:* {m['processor']}, {m['cores']} cores, {m['memory_gib']} GiB, {m['system']}, Linux {m['kernel']}, huge pages "
                f"`{m['huge_pages']}`. *isobrick* {self.run['versions']['isobrick']}, commit {self.run['commit']}, {self.run['date']}.")

    def load(self):
        load = self.run["load"]
        low, high = load["least"], load["greatest"]
        words = f"The load of the machine was {low:.1f} to {high:.1f}, {load['median']:.1f} in the middle"
        if load["median"] > self.run["machine"]["cores"]:
            return (f"**Other work ran beside.** {words}, where {self.run['machine']['cores']} would keep it busy: times are long and "
                    "scatter. Read ratios of rows of one table rather than times.")
        cores = self.run["machine"]["cores"]
        busy = [step for step, result in self.results.items() if max(result["load"]) > 1.5 * cores]
        return words + (f"; more than {1.5 * cores:g} beside {joined(busy)}, whose times are long." if busy else ".")

    def volumes_words(self):
        words = []
        for volume in self.volumes.values():
            x, y, z = volume["dimensions"]
            words.append(f"{volume['title']} ({'real, ' if volume['real'] else ''}{x}×{y}×{z} {volume['type']}, isovalue {volume['isovalue']:g})")
        unique = list(dict.fromkeys(words))
        return joined(unique) + (". Phantoms are made by `isobrick phantom`; real ones come from "
                                 "`ISOBRICK_DATA`" if any(v["real"] for v in self.volumes.values()) else ", all made by `isobrick phantom`, as no real "
                                 "volumes were at hand")

    def versions(self):
        return ", ".join(f"{name} {version}" for name, version in self.run["versions"].items())

    def left_out(self):
        rows = [(step, row) for step, result in self.results.items() for row in result["rows"] if "failure" in row]
        missing = sorted({f"`{row['name']}`" for _, row in rows if row["failure"] == "not there"})
        failed = sorted({f"{row['name']} of {step} ({row['failure']})" for step, row in rows if row["failure"] != "not there"})
        words = "" if not missing else f"Left out, as they could not be had here: {joined(missing)}. "
        return words + ("" if not failed else f"Failed: {joined(failed)}. ") or "Nothing was left out."

    # ---- sections ------------------------------------------------------------------------------------

    def extraction(self):
        steps = self.steps("extraction")
        names = list(dict.fromkeys(row["name"] for step, _ in steps for row in self.rows(step)))
        head, rows = [""], []
        for _, volume in steps:
            head += [volume["title"]]
        for name in names:
            line = [title_of(name)]
            for step, _ in steps:
                seconds = self.median(step, name)
                ours = self.median(step, "isobrick, one thread" if name.endswith("one thread") else "isobrick")
                ratio = "" if seconds is None or name.startswith("isobrick") else f" ({times(seconds / ours)}×)"
                line += [ms(seconds) + ratio]
            peak = self.row(steps[0][0], name)
            rows.append([*line, mib(peak["peak_bytes"]) if peak else ""])
        triangles = [f"{self.row(step, 'isobrick')['triangles']:,} ({volume['title']})" for step, volume in steps]
        self.plots["extraction"] = plots.bars(
            [(f"{volume['title']}, {self.row(step, 'isobrick')['triangles']:,} triangles", self.bars_of(step)) for step, volume in steps], "ms")
        return table([*head, "peak MiB, first volume"], rows) + f"\n\nTriangles by isobrick: {joined(triangles)}."

    def throughput(self):
        steps = self.steps("extraction")
        head, rows = [""], []
        for _, volume in steps:
            head += [f"{volume['title']}: Mtri/s", "Mvoxel/s"]
        for name in ("isobrick", "vtkFlyingEdges3D", "openvdb-0"):
            line = [title_of(name)]
            for step, volume in steps:
                seconds, x_y_z = self.median(step, name), volume["dimensions"]
                line += ["", ""] if seconds is None else [f"{self.row(step, name)['triangles'] / seconds / 1e6:,.3g}",
                                                         f"{math.prod(x_y_z) / seconds / 1e6:,.0f}"]
            rows.append(line)
        return table(head, rows)

    def extraction_words(self):
        words = []
        for names, title in ((("vtkFlyingEdges3D", "PyPI vtkFlyingEdges3D"), "VTK's Flying Edges"), (("openvdb-0",), "OpenVDB"),
                             (("PyPI skimage",), "scikit-image"), (("PyPI PyMCubes",), "PyMCubes")):
            ratios = [self.median(step, name) / self.median(step, "isobrick") for step, _ in self.steps("extraction")
                      for name in names if self.median(step, name)]
            if ratios:
                words.append(f"{title} {'' if words else 'takes '}{between(ratios)} times{'' if words else ' as long as isobrick'}")
        return f"{joined(words)}." if words else "No other library was at hand."

    def bars_of(self, step, key="seconds", scale=1000.0, names=None):
        rows = [row for row in self.rows(step) if key in row and (names is None or row["name"] in names)]
        return [(title_of(row["name"]), scale * row[key]["median"], is_ours(step, row["name"])) for row in rows]

    def queries(self):
        steps = self.steps("queries")
        head, rows = [""], []
        for _, volume in steps:
            head += [f"{volume['title']}: triangles", "ms", "read ÷ active"]
        for name in dict.fromkeys(row["name"] for step, _ in steps for row in self.rows(step)):
            line = [name]
            for step, _ in steps:
                row = self.row(step, name)
                line += [f"{row['triangles']:,}", ms(row["seconds"]["median"]),
                         f"{row['bytes_read'] / row['bytes_active']:.2f}"]
            rows.append(line)
        def radii(step, value):
            return [(float(row["name"].split()[1]), value(row)) for row in self.rows(step) if re.fullmatch(r"radius \d+", row["name"])]
        self.plots["queries"] = plots.curves(
            [("milliseconds", {v["title"]: radii(s, lambda row: 1000 * row["seconds"]["median"]) for s, v in steps}),
             ("triangles", {v["title"]: radii(s, lambda row: row["triangles"]) for s, v in steps})], "radius, voxels", "")
        return table(head, rows)

    def progressive(self):
        title = self.volumes["head"]["title"]
        rows = [[f"{title}, {row['name']}", f"{row['first_triangles']:,}", ms(row["first"]["median"]),
                 f"{row['triangles']:,}", ms(row["last"]["median"])] for row in self.rows("progressive")]
        return table(["", "first surface: triangles", "ms", "whole: triangles", "ms"], rows)

    def cold_words(self):
        return f"The finest surface of the {self.volumes['head']['title']} after its files were dropped from the page cache."

    def cold(self):
        rows = [[title_of(row["name"]), ms(row["seconds"]["median"]),
                 mib(row["bytes_read"]) if "bytes_read" in row else "", ms(row["read"]["median"]) if "read" in row else ""]
                for row in self.rows("cold")]
        self.plots["cold"] = plots.bars([(f"{self.volumes['head']['title']}, cold", self.bars_of("cold"))], "ms")
        return table(["", "ms", "MiB read", "reading alone, ms"], rows)

    def building_words(self):
        volume = self.volumes["head"]
        return f"A pyramid of the {volume['title']} ({volume['bytes'] / 1e6:,.0f} MB of voxels, in the page cache), with curvature if nothing else is said."

    def building(self):
        raw = self.volumes["head"]["bytes"]
        rows = []
        for row in self.rows("building"):
            seconds = row["seconds"]["median"]
            rows.append([row["name"], sec(seconds), f"{raw / seconds / 1e6:,.0f}",
                         sec(row["write"]["median"]) if "write" in row else "", f"{row['bytes'] / raw:.2f}", mib(row["peak_bytes"])])
        self.plots["building"] = plots.bars([(self.volumes["head"]["title"], self.bars_of("building", scale=1.0))], "s")
        return table(["", "s", "MB/s", "copy, s", "bytes ÷ voxels", "peak MiB"], rows)

    def memory_words(self):
        volume = self.volumes["head"]
        return f"The {volume['title']} has {mib(volume['bytes'])} MiB of voxels; *extract* writes its finest surface into a PLY."

    def memory(self):
        rows = [[f"`{row['name']}`", mib(row["peak_bytes"]), sec(row["seconds"]["median"])] for row in self.rows("memory")]
        def peaks(step, keep):
            return [(title_of(row["name"]), row["peak_bytes"] / 2**20, is_ours(step, row["name"]))
                    for row in self.rows(step) if keep(row["name"])]
        title = self.volumes["head"]["title"]
        self.plots["memory"] = plots.bars(
            [(f"{title}, bounded", peaks("memory", lambda name: True)),
             (f"{title}, the finest surface into memory", peaks("extraction-head", lambda name: not name.endswith("one thread"))),
             (f"{title}, a pyramid", peaks("building", lambda name: "none" not in name and "zstd" not in name))],
            "MiB", logarithmic=False)
        return table(["", "peak MiB", "s"], rows)

    def conversion_words(self):
        volume = self.volumes["convert"]
        return f"From a pyramid of the {volume['title']} ({volume['bytes'] / 1e6:,.0f} MB of voxels, lz4) to other formats."

    def conversion(self):
        rows = [[row["name"], sec(row["seconds"]["median"]), sec(row["back"]["median"]) if "back" in row else "",
                 f"{row['bytes'] / 1e6:,.0f}", mib(row["peak_bytes"]) if "peak_bytes" in row else ""] for row in self.rows("conversion")]
        self.plots["conversion"] = plots.bars([("from a pyramid", self.bars_of("conversion", scale=1.0)),
                                               ("to a pyramid", self.bars_of("conversion", "back", 1.0))], "s")
        return table(["", "into: s", "back: s", "MB", "peak MiB"], rows)

    def simplification(self):
        kinds = ("simplify-1", "openvdb-0.5", "vtkQuadricDecimation-0.85", "vtkDecimatePro-0.85")
        rows, panels = [], []
        for step, volume in self.steps("simplification"):
            for name in kinds:
                row = self.row(step, name)
                if row:
                    rows.append([f"{volume['title']}, {name}", f"{row['triangles']:,}", f"{row['mean']:.3f}", f"{row['greatest']:.2f}",
                                 sec(row["seconds"]["median"])])
            families = {}
            for row in self.rows(step):
                families.setdefault(row["name"].rsplit("-", 1)[0], []).append((row["mean"], row["triangles"]))
            panels.append((f"{volume['title']} at {volume['isovalue']:g}", families))
        self.plots["simplification"] = plots.curves(panels, "mean distance, voxels", "triangles")
        return table(["", "triangles", "mean", "greatest", "s"], rows)

    def python_words(self):
        if not self.rows("python"):
            return "Not measured: the packages from PyPI could not be installed."
        ours, command = self.median("python", "PyPI isobrick"), self.median("python", "isobrick")
        return (f"The finest surface of the {self.volumes['python']['title']} as arrays, and builds of it. The module takes "
                f"{ours / command:.2f} of the time of `isobrick bench`.")

    def python(self):
        rows = []
        for row in self.rows("python"):
            name = "isobrick from Python" if row["name"] == "PyPI isobrick" else "`isobrick bench`" if row["name"] == "isobrick" else title_of(row["name"])
            rows.append([name, f"{row['triangles']:,}" if "triangles" in row else "", ms(row["seconds"]["median"]),
                         mib(row["peak_bytes"]) if "peak_bytes" in row else ""])
        surfaces = [row["name"] for row in self.rows("python") if "triangles" in row]
        named = [(name.replace("isobrick (PyPI)", "isobrick from Python"), *rest) for name, *rest in self.bars_of("python", names=surfaces)]
        if named:
            self.plots["python"] = plots.bars([(self.volumes["python"]["title"], named)], "ms")
        return table(["", "triangles", "ms", "peak MiB"], rows) if rows else ""

    # ---- all of it -----------------------------------------------------------------------------------

    def files(self):
        """{path below the folder of documents: text}"""
        with open(f"{HERE}/page.md", encoding="utf-8") as file:
            template = file.read()
        makers = {"volumes": self.volumes_words}
        def filled(match):
            name = match[1]
            return makers.get(name) or getattr(self, name)
        page = re.sub(r"\{\{(\w+)\}\}", lambda match: filled(match)(), template)
        for plot in re.findall(r"!\[[^]]*\]\(figures/bench-(\w+)\.svg\)\n\n?", page):
            if plot not in self.plots:
                page = re.sub(r"!\[[^]]*\]\(figures/bench-" + plot + r"\.svg\)\n\n?", "", page)
        note = "<!-- tools/benchmark.sh made this page: edit tools/bench/suite/page.md, then run page.py beside it. -->\n"
        words = len(page.split())
        if words > MOST_WORDS:
            fail(f"the page has {words} words, and may have {MOST_WORDS}: shorten page.md")
        return {"BENCHMARKS.md": note + page, **{f"figures/bench-{name}.svg": svg for name, svg in self.plots.items()}}


def title_of(name):
    return f"{name[5:]} (PyPI)" if name.startswith("PyPI ") else name


def is_ours(step, name):
    """Whether a row measures isobrick."""
    if step == "conversion":
        return name.startswith(".") and " by " not in name
    if step.startswith("queries") or step in ("memory", "progressive"):
        return True
    return "isobrick" in name or name.startswith(("simplify", "build from"))


def write(path, words):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path + ".part", "w", encoding="utf-8") as file:
        file.write(words)
    os.replace(path + ".part", path)


def differing(path, words):
    try:
        with open(path, encoding="utf-8") as file:
            return file.read() != words
    except FileNotFoundError:
        return True


def main():
    arguments = [word for word in sys.argv[1:] if word != "--check"]
    if len(arguments) != 2:
        print("usage: page.py benchmarks.json DOCS [--check]", file=sys.stderr)
        sys.exit(2)
    source, docs = arguments
    try:
        with open(source, encoding="utf-8") as file:
            run = json.load(file)
        files = Page(run).files()
    except OSError as error:
        fail(f"cannot read '{source}': {error.strerror}; make it with tools/benchmark.sh")
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        fail(f"'{source}' is no run of tools/benchmark.sh: {type(error).__name__} {error}; make it anew")
    if "--check" not in sys.argv:
        for name, words in files.items():
            write(f"{docs}/{name}", words)
        return
    wrong = [name for name, words in files.items() if differing(f"{docs}/{name}", words)]
    if wrong:
        fail(f"{', '.join(wrong)} in '{docs}' is not what '{source}' gives; change page.md or page.py, and run page.py {source} {docs}")


main()
