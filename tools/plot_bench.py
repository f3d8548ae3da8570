#!/usr/bin/python3
"""Plots of what `isobrick bench --json` printed.

  plot_bench.py bench.json -o bench.png                      times, rates, memory, errors of one run
  plot_bench.py r10.json r20.json r40.json --against radius  a curve of times over several runs
  plot_bench.py ct.json mr.json --against distance           triangles and times at a mean distance

The ending of the picture says its format: .png, .svg or .pdf. Reads nothing but the JSON.
"""
import argparse
import json
import os
import sys


def fail(message):
    sys.exit(f"plot_bench.py: {message}")


def read_bench(path):
    try:
        with open(path, encoding="utf-8") as file:
            bench = json.load(file)
    except OSError as error:
        fail(f"cannot read '{path}': {error.strerror}")
    except ValueError as error:
        fail(f"'{path}' is not JSON: {error}; make it with 'isobrick bench FILE --iso V --json'")
    rows = bench.get("rows") if isinstance(bench, dict) else None
    if not isinstance(rows, list):
        fail(f"'{path}' has no rows; make it with 'isobrick bench FILE --iso V --json'")
    measured = [row for row in rows if "seconds" in row]
    if not measured:
        fail(f"no row of '{path}' was measured")
    return bench, measured


def import_pyplot():
    try:
        import matplotlib
    except ImportError:
        fail("matplotlib is missing; install it with 'apt-get install python3-matplotlib'")
    matplotlib.use("Agg")  # no window
    from matplotlib import pyplot
    return pyplot


def setting_of(row):
    return f"{row['cache']}, {'with' if row['huge_pages'] else 'without'} huge pages"


def unique(values):
    return list(dict.fromkeys(values))


def plot_bars(axes, rows, value_of, spread_of, title, logarithmic):
    """A group of bars for each name, a bar for each setting of cache and pages."""
    names, settings = unique(r["name"] for r in rows), unique(map(setting_of, rows))
    thickness = 0.8 / len(settings)
    for s, setting in enumerate(settings):
        mine = [r for r in rows if setting_of(r) == setting]
        places = [names.index(r["name"]) + (s - (len(settings) - 1) / 2) * thickness for r in mine]
        values = [value_of(r) for r in mine]
        spreads = None
        if spread_of is not None:
            spreads = list(zip(*[(v - spread_of(r)[0], spread_of(r)[1] - v)
                                 for r, v in zip(mine, values)]))
        axes.barh(places, values, thickness, xerr=spreads, label=setting, error_kw={"lw": 0.8})
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()  # in the order of the rows
    if logarithmic:
        axes.set_xscale("log")
    axes.set_title(title)
    axes.grid(axis="x", alpha=0.3)


def plot_errors(axes, rows):
    """Triangles against the mean distance, so that counts are compared at equal error."""
    for name in unique(r["name"] for r in rows):
        row = next(r for r in rows if r["name"] == name)
        ways = row["distance"].values()
        mean, p99 = (max(way[key] for way in ways) for key in ("mean", "p99"))
        axes.plot([mean, p99], [row["triangles"]] * 2, "-", alpha=0.4, color="gray")
        axes.plot(mean, row["triangles"], "o", label=name)
        axes.plot(p99, row["triangles"], "|", color="gray")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("voxels: mean (dot) to 99 % (bar), the worse of both ways")
    axes.set_title("triangles at an error")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small")


def plot(bench, rows, output):
    pyplot = import_pyplot()
    approximating = [r for r in rows if "distance" in r]
    figure, axes = pyplot.subplots(2, 2, figsize=(13, 9), layout="constrained")
    plot_bars(axes[0][0], rows, lambda r: 1e3 * r["seconds"]["median"],
              lambda r: (1e3 * r["seconds"]["min"], 1e3 * r["seconds"]["max"]),
              "milliseconds (median, least, greatest)", True)
    plot_bars(axes[0][1], rows, lambda r: r["mtri_s"], None, "million triangles a second", False)
    plot_bars(axes[1][0], rows, lambda r: r["peak_rss_bytes"] / 2**20, None, "peak memory, MiB",
              False)
    axes[0][0].legend(fontsize="small")
    if approximating:
        plot_errors(axes[1][1], approximating)
    else:
        plot_bars(axes[1][1], rows, lambda r: r["mvoxel_s"], None, "million voxels a second", False)
    size = " x ".join(map(str, bench["dimensions"]))
    figure.suptitle(f"{bench['file']}: {size} {bench['voxel_type']}, isovalue {bench['isovalue']}, "
                    f"{bench['threads']} threads; {bench['processor']}, load "
                    f"{bench['load']['before']:.1f} to {bench['load']['after']:.1f}", fontsize=10)
    save(figure, output)


def save(figure, output):
    try:
        figure.savefig(output)
    except (OSError, ValueError) as error:
        fail(f"cannot write '{output}': {error}")


def option_of(bench, name):
    """The value of an option of the query, as a number; None if it was not given."""
    words = bench.get("query", [])
    return float(words[words.index(name) + 1]) if name in words[:-1] else None


def voxels_of(bench):
    x, y, z = bench["dimensions"]
    return x * y * z


# The variables of a curve: title, value of a run and its row, and whether the axis is logarithmic.
ABSCISSAS = {
    "triangles": ("triangles", lambda bench, row: row["triangles"], True),
    "voxels": ("voxels of the volume", lambda bench, row: voxels_of(bench), True),
    "radius": ("radius of the focus, voxels", lambda bench, row: option_of(bench, "--radius"), True),
    "isovalue": ("isovalue", lambda bench, row: bench["isovalue"], False),
    "threads": ("threads", lambda bench, row: row["threads"], False),
}


def plot_curves(runs, against, output):
    """A curve for each row's name and setting, with the range from the least to the greatest."""
    title, value_of, logarithmic = ABSCISSAS[against]
    curves = {}
    for bench, rows in runs:
        for row in rows:
            value = value_of(bench, row)
            if value is not None:
                curves.setdefault(f"{row['name']}, {setting_of(row)}", []).append(
                    (value, *(1e3 * row["seconds"][key] for key in ("median", "min", "max"))))
    if not curves:
        fail(f"no run has a value of '{against}'; give runs of 'isobrick bench' that differ in it")
    pyplot = import_pyplot()
    figure, axes = pyplot.subplots(figsize=(7, 5), layout="constrained")
    for name, points in curves.items():
        values, medians, least, greatest = zip(*sorted(points))
        axes.plot(values, medians, "o-", markersize=4, label=name)
        axes.fill_between(values, least, greatest, alpha=0.2)
    if logarithmic:
        axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(title)
    axes.set_ylabel("milliseconds (median; least to greatest)")
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize="small")
    names = unique(os.path.basename(bench["file"]) for bench, _ in runs)
    axes.set_title(", ".join(names), fontsize=9)
    save(figure, output)


def family_of(name):
    """simplify-0.5 and simplify-1 are one curve."""
    return name.rstrip("0123456789.").rstrip("-")


def plot_distances(runs, output):
    """A column for each run: triangles above, times below, against the mean distance to the finest surface."""
    columns = [(bench, rows, [r for r in rows if "distance" in r]) for bench, rows in runs]
    for bench, _, approximating in columns:
        if not approximating:
            fail(f"'{bench['file']}' has no row that approximates; name some with --rows, such as simplify-1")
    pyplot = import_pyplot()
    figure, axes = pyplot.subplots(2, len(runs), figsize=(3.6 * len(runs), 7), squeeze=False,
                                   sharex="col", layout="constrained")
    for column, (bench, rows, approximating) in enumerate(columns):
        for family in unique(family_of(r["name"]) for r in approximating):
            points = sorted((max(way["mean"] for way in r["distance"].values()), r["triangles"],
                             1e3 * r["seconds"]["median"])
                            for r in approximating if family_of(r["name"]) == family)
            distances, triangles, times = zip(*points)
            for axis, values in zip(axes[:, column], (triangles, times)):
                axis.plot(distances, values, "o-", markersize=4, label=family)
        for axis in axes[:, column]:
            axis.set_xscale("log")
            axis.set_yscale("log")
            axis.tick_params(axis="x", which="minor", labelbottom=False)
            axis.grid(alpha=0.3, which="both")
        name = os.path.basename(bench["file"]).removesuffix(".isb")
        axes[0][column].set_title(f"{name} at {bench['isovalue']:g}", fontsize=10)
        axes[1][column].set_xlabel("mean distance, voxels")
    axes[0][0].set_ylabel("triangles")
    axes[1][0].set_ylabel("milliseconds, with extraction")
    axes[0][-1].legend(fontsize="small")
    save(figure, output)


def main():
    parser = argparse.ArgumentParser(description="Plots of what 'isobrick bench --json' printed.")
    parser.add_argument("json", nargs="+", help="what 'isobrick bench --json' printed")
    parser.add_argument("--against", choices=[*ABSCISSAS, "distance"],
                        help="plot the times of several runs over this; distance: triangles, too")
    parser.add_argument("-o", "--output", default="bench.png", help="picture; default: bench.png")
    arguments = parser.parse_args()
    runs = [read_bench(path) for path in arguments.json]
    if arguments.against == "distance":
        plot_distances(runs, arguments.output)
    elif arguments.against:
        plot_curves(runs, arguments.against, arguments.output)
    elif len(runs) == 1:
        plot(*runs[0], arguments.output)
    else:
        fail("several runs need '--against' and what they are plotted over")


main()
