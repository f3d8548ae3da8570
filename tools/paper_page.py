#!/usr/bin/env python3
"""Writes the results of tools/reproduce.sh into docs/PAPER.md.

  paper_page.py FOLDER TEMPLATE PAGE

FOLDER has results/*.json and pictures/*.png. In the template, the lines between <!-- begin NAME --> and
<!-- end NAME --> are replaced by the table NAME of the results. Pictures that the page shows go into the folder
figures beside it. Needs nothing but Python itself.
"""

import json
import re
import shutil
import sys
from pathlib import Path

folder, template, page = map(Path, sys.argv[1:])


def result(name):
    return json.loads((folder / "results" / f"{name}.json").read_text())


def check(holds, what):
    if not holds:
        sys.exit(f"paper_page.py: this does not hold: {what}")


def table(head, rows):
    lines = ["| " + " | ".join(str(cell) for cell in line) + " |" for line in [head, *rows]]
    return "\n".join([lines[0], "|---" + "|--:" * (len(head) - 1) + "|", *lines[1:]])


def percent(part, whole, digits=0):
    return f"{100 * part / whole:.{digits}f} %"


def change(new, old):
    return f"{100 * (new / old - 1):+.1f} %".replace("-", "−")


def milliseconds(seconds):
    return f"{1000 * seconds:.2f}" if seconds < 0.01 else f"{1000 * seconds:.1f}"


def machine():
    m = result("machine")
    return (f"{m['processor']}, {m['cores']} cores, {m['memory_gib']} GiB; {m['version']}, commit {m['commit']}, "
            f"{m['date']}; pictures by {result('frames-fixed')['device']}.")


def figure2():
    rows = []
    for name, title, levels in (("ct", "head CT, bone", range(5)), ("phantom", "head phantom, bone", (1, 2))):
        for level in levels:
            row = [f"{title}, level {level}"]
            for filter_name in ("average", "subsample"):
                r = result(f"figure2-{name}-{filter_name}-{level}")
                areas = [component["area"] for component in r["components"]]
                row += [f"{r['triangles']:,}", len(areas), percent(max(areas), sum(areas))]
            rows.append(row)
    return table(["", "average: triangles", "pieces", "largest", "subsample: triangles", "pieces", "largest"], rows)


def figure3():
    r = result("figure3")
    check(r["fans"]["ok"] and not r["cracks"]["ok"], "figure 3: fans are closed, and leaves on their own are not")
    return table(["the sphere of the pictures", "triangles", "edges with one triangle"],
                 [["every leaf on its own", r["cracks"]["triangles"], r["cracks"]["open_edges"]],
                  ["fans", r["fans"]["triangles"], r["fans"]["open_edges"]]])


def figure5():
    rows = [["paper, Figure 5", "38,608", "", "42,343", "+9.7 %", ""]]
    for name, title in (("curvature100", "curvature, ρ = 100 voxels"), ("curvature40", "curvature, ρ = 40"),
                        ("curvature20", "curvature, ρ = 20"), ("focus40", "focus, radius 40"),
                        ("focus5", "focus, radius 5")):
        r, command = result(f"figure5-{name}"), result(f"figure5-{name}-command")
        check(r["fans"]["ok"] and r["split"]["ok"], f"{name}: both meshes are closed")
        check(r["fans"]["triangles"] == command["triangles"], f"{name}: the command has the reference's triangles")
        uniform, split, fans = (r[kind]["triangles"] for kind in ("uniform", "split", "fans"))
        rows.append([title, f"{uniform:,}", f"{fans:,}", f"{split:,}", change(split, uniform), change(fans, uniform)])
    return table(["adaptive by", "uniform", "fans", "conforming split", "split ÷ uniform", "fans ÷ uniform"], rows)


# ---- Figure 7 -------------------------------------------------------------------------------------


def bernstein(b, t):
    return b[0] * (1 - t) ** 2 + 2 * b[1] * t * (1 - t) + b[2] * t * t


CELLS = (("torus", "torus, the tube's outside"), ("marschner", "Marschner-Lobb"),
         ("bone", "head CT, edge of bone"), ("brain", "head CT, brain: noise"))


def figure7():
    rows = []
    for name, title in CELLS:
        cell = result(f"figure7-{name}")[0]
        low, high = cell["own_range"]
        ratios = [bernstein(cell["own"], (value - low) / (high - low)) / curvature
                  for value, curvature in cell["samples"] if curvature > 1e-9]
        total = len(cell["samples"]) + len(cell["left_out"])
        rows.append([title, percent(len(cell["left_out"]), total, 1), two_digits(median(ratios))])
    return table(["node", "samples left out", "bound ÷ curvature, median"], rows)


def two_digits(number):
    return f"{float(f'{number:.2g}'):g}"


def median(values):
    return sorted(values)[len(values) // 2]


def plot_figure7():
    """Four nodes: samples (v, k), those left out in grey, and the polynomial."""
    width, height, margin = 380, 260, 60
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {2 * width} {2 * height + 24}" '
             'font-family="sans-serif" font-size="12">',
             f'<rect width="{2 * width}" height="{2 * height + 24}" fill="#fff"/>']
    for number, (name, title) in enumerate(CELLS):
        cell = result(f"figure7-{name}")[0]
        x0, y0 = number % 2 * width + margin, number // 2 * height + 24
        w, h = width - margin - 14, height - 24 - 34
        low, high = cell["own_range"]
        polynomial = [bernstein(cell["own"], i / 60) for i in range(61)]
        top = 1.05 * max(max(curvature for _, curvature in cell["samples"]), max(polynomial))

        def place(value, curvature):
            return f"{x0 + w * (value - low) / (high - low):.1f} {y0 + h * (1 - min(curvature / top, 1)):.1f}"

        curve = "M" + "L".join(place(low + (high - low) * i / 60, k) for i, k in enumerate(polynomial))

        def dots(samples):
            return "".join(f"M{place(*sample)}h0" for sample in samples)

        dot = 'stroke-linecap="round" stroke-width="2.6" fill="none"'
        parts += [
            f'<rect x="{x0}" y="{y0}" width="{w}" height="{h}" fill="none" stroke="#888"/>',
            f'<path d="{dots(cell["left_out"])}" stroke="#bbb" {dot}/>',
            f'<path d="{dots(cell["samples"])}" stroke="#1f5fa8" {dot}/>',
            f'<path d="{curve}" stroke="#c0392b" stroke-width="1.6" fill="none"/>',
            f'<text x="{x0}" y="{y0 - 7}">{title}</text>',
            f'<text x="{x0 - 4}" y="{y0 + 10}" text-anchor="end">{top:.2g}</text>',
            f'<text x="{x0 - 4}" y="{y0 + h}" text-anchor="end">0</text>',
            f'<text x="{x0}" y="{y0 + h + 15}">{low:.4g}</text>',
            f'<text x="{x0 + w}" y="{y0 + h + 15}" text-anchor="end">{high:.4g}</text>',
            f'<text x="{x0 + w / 2}" y="{y0 + h + 15}" text-anchor="middle">value v</text>',
            f'<text transform="translate({x0 - 12} {y0 + h / 2}) rotate(-90)" text-anchor="middle">curvature k</text>']
    y = 2 * height + 12
    parts += [f'<path d="M44 {y}h0" stroke="#1f5fa8" {dot}/><text x="52" y="{y + 4}">sample</text>',
              f'<path d="M120 {y}h0" stroke="#bbb" {dot}/><text x="128" y="{y + 4}">left out: gradient &lt; ε</text>',
              f'<path d="M280 {y}h24" stroke="#c0392b" stroke-width="1.6"/><text x="310" y="{y + 4}">'
              'p over the node’s own range</text>',
              "</svg>"]
    (folder / "pictures/paper-figure7.svg").write_text("\n".join(parts) + "\n")


# ---- Figures 8 to 11 ------------------------------------------------------------------------------


def figure8():
    paper = ["46,000 (100 %)", "43,000 (93 %)", "32,000 (70 %)", "25,000 (54 %)"]
    rows, zero = [], result("figure8-0")["triangles"]
    for radius, said in zip((0, 18, 13, 12), paper):
        triangles = result(f"figure8-{radius}")["triangles"]
        rows.append(["0" if radius == 0 else f"ρ = {radius} voxels ({0.5 / radius**2:.2g})", f"{triangles:,}",
                     percent(triangles, zero), said])
    return table(["tolerance", "triangles", "of the first", "paper"], rows)


def focus_rows(name, radii):
    """For each radius, and for the finest surface: triangles, part of the finest, time, rate."""
    measured = [{row["name"]: row for row in result(f"{name}-{radius}")["rows"]} for radius in radii]
    finest = measured[0]["isobrick"]["triangles"]
    cases = [(f"radius {radius}", rows["isobrick-adaptive"]["triangles"], rows["isobrick-adaptive"]["seconds"]["median"])
             for radius, rows in zip(radii, measured)]
    # Each radius has measured the finest surface too: the median of the medians.
    cases.append(("everywhere", finest, median([rows["isobrick"]["seconds"]["median"] for rows in measured])))
    return [[title, f"{triangles:,}", percent(triangles, finest, 1), milliseconds(seconds),
             f"{triangles / seconds / 1e6:.1f}"] for title, triangles, seconds in cases]


HEAD = ["", "triangles", "of the finest", "ms, one thread", "million triangles/s"]


def figure9():
    return table(HEAD, [["paper, 9a", "32,000", "2.0 %", "", ""], ["paper, 9b (9c in its caption)", "88,000", "5.5 %", "", ""],
                        ["paper, plain marching cubes", "1,600,000", "100 %", "", ""],
                        *focus_rows("figure9", (10, 20, 40, 80))])


def figure11():
    paper = [["paper, 11a", "123,000", "2.1 %", "1,100", "0.11"],
             ["paper, 11b", "2,200,000", "36.7 %", "15,800", "0.14"],
             ["paper, 11c", "6,000,000", "100 %", "45,000", "0.13"]]
    ct = focus_rows("figure11", (15, 40, 80))
    gyroid = focus_rows("figure11-gyroid", (29, 97, 155))
    for title, rows in (("CT", ct), ("gyroid", gyroid)):
        for row in rows:
            row[0] = f"{title}, {row[0]}"
    return table(HEAD, paper + ct + gyroid)


def overheads():
    rows = []
    for name, title in (("u8", "8 bits a voxel"), ("u16", "16 bits a voxel")):
        r = result(f"overhead-{name}")
        samples = [x * y * z for x, y, z in (level["dimensions"] for level in r["levels"])]
        size = r["bytes"]
        rows.append([title, percent(sum(samples[1:]), samples[0], 1), percent(size["samples_coarser"], size["raw"], 1),
                     percent(size["curvature"], size["raw"], 1), percent(size["ranges"] + size["index"], size["raw"], 1),
                     percent(size["aprons_level0"], size["raw"], 1)])
    return table(["257³, no codec", "coarser samples", "their bytes", "curvature", "ranges and index", "aprons"],
                 [["paper", "15 %", "", "37.5 %", "", ""], *rows])


def frames():
    rows = [["paper", "50,000", "", "", "", "several"]]
    for name, title in (("fixed", "isovalue 1000"), ("changing", "isovalue 900 to 1300, another each frame")):
        r = result(f"frames-{name}")
        rows.append([title, f"{r['triangles']:,.0f}", f"{r['extract_ms']:.1f}", f"{r['extract_ms_p99']:.1f}",
                     f"{r['draw_ms']:.0f}", f"{1000 / (r['extract_ms'] + r['draw_ms']):.0f}"])
    return table(["100 frames", "triangles, median", "extraction, ms", "99 %", "drawing, ms", "frames/s"], rows)


# ---- The page -------------------------------------------------------------------------------------

TABLES = {make.__name__: make for make in (machine, figure2, figure3, figure5, figure7, figure8, figure9, figure11,
                                           overheads, frames)}


def filled(match):
    try:
        text = TABLES[match[1]]()
    except FileNotFoundError as missing:
        text = f"(Left out: the result {Path(missing.filename).stem} is missing.)"
    return f"<!-- begin {match[1]} -->\n{text}\n<!-- end {match[1]} -->"


text = re.sub(r"<!-- begin (\w+) -->\n.*?<!-- end \1 -->", filled, template.read_text(), flags=re.DOTALL)
try:
    plot_figure7()
except FileNotFoundError as missing:
    print(f"figure 7 is not drawn: {Path(missing.filename).stem} is missing")
figures = page.parent / "figures"
figures.mkdir(parents=True, exist_ok=True)
for picture in re.findall(r"\(figures/(paper-[^)]+)\)", text):
    if (folder / "pictures" / picture).exists():
        shutil.copyfile(folder / "pictures" / picture, figures / picture)
page.write_text(text)
