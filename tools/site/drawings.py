"""The drawings of docs/explanation/how-it-works.md, as SVG.

    drawings.py [FOLDER]        default: docs/figures; writes how-NAME.svg

They are part of the repository, so that the pages show them everywhere; a test makes them again and compares.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable
from pathlib import Path

Point = tuple[float, float]

LEVELS = ("#c0392b", "#e08e0b", "#2e8b57", "#2f6db3")  # as --color-by-level: red is level 0
INK, SOFT, PALE, SURFACE = "#222222", "#888888", "#eef2f3", "#00796b"


class Drawing:
    def __init__(self, width: int, height: int) -> None:
        self.size = (width, height)
        self.parts: list[str] = []

    def line(self, *points: Point, color: str = INK, width: float = 1.5, dash: str = "", arrow: bool = False) -> None:
        ends = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        more = (f' stroke-dasharray="{dash}"' if dash else "") + (' marker-end="url(#tip)"' if arrow else "")
        self.parts.append(f'<polyline points="{ends}" fill="none" stroke="{color}" stroke-width="{width}"{more}/>')

    def polygon(self, points: Iterable[Point], fill: str, color: str = "none", opacity: float = 1) -> None:
        ends = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        self.parts.append(f'<polygon points="{ends}" fill="{fill}" fill-opacity="{opacity}" stroke="{color}"/>')

    def box(self, x: float, y: float, w: float, h: float, fill: str = "none", color: str = INK, width: float = 1) -> None:
        self.parts.append(
            f'<rect x="{x:.1f}" y="{y:.1f}" width="{w:.1f}" height="{h:.1f}" fill="{fill}" stroke="{color}" '
            f'stroke-width="{width}"/>'
        )

    def dot(self, x: float, y: float, r: float = 3, fill: str = INK, color: str = "none") -> None:
        self.parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{r}" fill="{fill}" stroke="{color}"/>')

    def text(self, x: float, y: float, words: str, size: int = 13, anchor: str = "middle", color: str = INK) -> None:
        words = words.replace("&", "&amp;").replace("<", "&lt;")
        self.parts.append(f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" text-anchor="{anchor}" fill="{color}">{words}</text>')

    def label(self, x: float, y: float, w: float, h: float, *words: str, fill: str = PALE) -> None:
        """A box with lines of text in its middle."""
        self.box(x, y, w, h, fill)
        for number, line in enumerate(words):
            self.text(x + w / 2, y + h / 2 + 5 + 17 * (number - (len(words) - 1) / 2), line)

    def svg(self) -> str:
        w, h = self.size
        tip = '<marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {w} {h}" width="{w}" height="{h}" '
            f'font-family="sans-serif">\n<defs>{tip}<path d="M0,0 L8,4 L0,8 z" fill="{INK}"/></marker></defs>\n'
            f'<rect width="{w}" height="{h}" fill="#ffffff"/>\n' + "\n".join(self.parts) + "\n</svg>\n"
        )


def pyramid() -> Drawing:
    d = Drawing(640, 230)
    x = 20.0
    for level in range(3):
        cells, side = 16 >> level, 170
        step = side / cells
        for i in range(cells + 1):
            d.line((x, 20 + i * step), (x + side, 20 + i * step), color=LEVELS[level], width=1)
            d.line((x + i * step, 20), (x + i * step, 20 + side), color=LEVELS[level], width=1)
        d.text(x + side / 2, 210, f"level {level}: spacing {1 << level}")
        x += side + 10
    d.text(596, 110, "… down to", 13)
    d.text(596, 128, "2 × 2 × 2", 13)
    return d


def low_pass() -> Drawing:
    d = Drawing(640, 190)
    xs = [50 + 60 * i for i in range(9)]
    for i, x in enumerate(xs):
        d.dot(x, 40, 5, LEVELS[0])
        d.text(x, 24, str(i), 11, color=SOFT)
    d.text(565, 45, "level 0", anchor="start")
    d.text(565, 145, "level 1", anchor="start")
    for j, x in enumerate(xs[::2]):
        d.dot(x, 140, 7, LEVELS[1])
        if j in (0, 4):
            d.line((x, 48), (x, 130), arrow=True)
            continue
        for k, weight in ((-60, "¼"), (0, "½"), (60, "¼")):
            d.line((x + k, 48), (x + k * 0.1, 130), arrow=True, width=1)
            d.text(x + k * 0.62 + (8 if k >= 0 else -8), 82, weight, 12)
    d.text(290, 178, "each sample of level 1 sits on one of level 0; at the border nothing is filtered", 13, color=SOFT)
    return d


def bricks() -> Drawing:
    d = Drawing(640, 290)
    step = 11
    for by in range(2):
        for bx in range(3):
            d.box(30 + bx * 88, 40 + by * 88, 88, 88, PALE, INK, 2)
    d.text(162, 28, "level 0, cut into bricks")
    d.box(118, 128, 88, 88, "#ffd9b0", LEVELS[1], 3)
    d.line((210, 172), (345, 130), arrow=True)
    x0, y0, n = 380, 45, 16
    d.box(x0 - step, y0 - step, (n + 2) * step, (n + 2) * step, "#fff3e2", SOFT)
    d.box(x0, y0, n * step, n * step, "#ffd9b0", LEVELS[1], 2)
    for i in range(0, n + 1):
        strong = i % 4 == 0
        color, width = (INK, 1.2) if strong else ("#d8b48c", 0.6)
        d.line((x0, y0 + i * step), (x0 + n * step, y0 + i * step), color=color, width=width)
        d.line((x0 + i * step, y0), (x0 + i * step, y0 + n * step), color=color, width=width)
    d.text(x0 + n * step / 2, y0 + n * step + 30, "one brick: cells, tiles of 4³ cells,")
    d.text(x0 + n * step / 2, y0 + n * step + 47, "and an apron of samples around them")
    return d


def ranges() -> Drawing:
    d = Drawing(640, 230)
    values = [(10, 40), (30, 90), (80, 140), (60, 130), (15, 60), (110, 180), (130, 160), (5, 30)]
    iso, base, scale = 100.0, 195.0, 0.85
    for i, (low, high) in enumerate(values):
        x = 60 + i * 62
        crossed = low < iso <= high
        d.box(x, base - high * scale, 34, (high - low) * scale, LEVELS[1] if crossed else PALE, INK)
        d.text(x + 17, base + 18, "read" if crossed else "culled", 12, color=INK if crossed else SOFT)
    d.line((40, base - iso * scale), (560, base - iso * scale), color=SURFACE, width=2, dash="6 4")
    d.text(570, base - iso * scale + 4, "isovalue", anchor="start", color=SURFACE)
    d.text(300, 22, "the range of values in each brick, or tile")
    return d


def focus_level(size: float, center: Point, focus: Point, radius: float) -> bool:
    """Whether a cell is refined: the rule of the paper, in cells of level 0."""
    d = math.sqrt(3)
    s = math.dist(center, focus) - radius
    return s < d * (3 * size / 2 - 1)


def focus() -> Drawing:
    d = Drawing(640, 430)
    unit, focus_at, radius = 6.0, (25.0, 37.0), 7.0

    def cells(x: float, y: float, size: int) -> Iterable[tuple[float, float, int]]:
        if size > 1 and focus_level(size, (x + size / 2, y + size / 2), focus_at, radius):
            for dx in (0, size // 2):
                for dy in (0, size // 2):
                    yield from cells(x + dx, y + dy, size // 2)
        else:
            yield x, y, size

    for x, y, size in cells(0, 0, 64):
        color = LEVELS[min(3, int(math.log2(size)))]
        d.box(20 + x * unit, 20 + y * unit, size * unit, size * unit, color + "30", color)
    cx, cy = 20 + focus_at[0] * unit, 20 + focus_at[1] * unit
    d.parts.append(f'<circle cx="{cx}" cy="{cy}" r="{radius * unit}" fill="none" stroke="{INK}" stroke-width="2"/>')
    d.dot(cx, cy, 4)
    for level, words in enumerate(("level 0: full resolution", "level 1", "level 2", "level 3 and coarser")):
        d.box(440, 60 + 40 * level, 22, 22, LEVELS[level] + "30", LEVELS[level])
        d.text(474, 76 + 40 * level, words, anchor="start")
    d.text(440, 250, "circle: focus point and radius", anchor="start")
    d.text(440, 270, "touching leaves differ", anchor="start")
    d.text(440, 287, "by one level at most", anchor="start")
    return d


def two_levels(d: Drawing, x: float, joined: bool) -> None:
    """Four fine cells beside a coarse one, and the contour through them."""
    for i in range(3):
        d.line((x, 30 + 80 * i), (x + 160, 30 + 80 * i), color=LEVELS[0])
        d.line((x + 80 * i, 30), (x + 80 * i, 190), color=LEVELS[0])
    d.box(x + 160, 30, 160, 160, color=LEVELS[1], width=2)
    fine = [(x + 34, 190), (x + 80, 128), (x + 122, 110), (x + 160, 86 if not joined else 100)]
    coarse = [(x + 160, 100), (x + 320, 72)]
    d.line(*fine, color=SURFACE, width=3)
    d.line(*coarse, color=SURFACE, width=3)
    if not joined:
        d.polygon([(x + 122, 110), (x + 160, 86), (x + 160, 100)], "#000000", opacity=0.15)
        d.line((x + 175, 60), (x + 163, 88), arrow=True)
        d.text(x + 190, 54, "crack", anchor="start")
    d.dot(x + 160, 110, 5, "#ffffff", INK)


def crack() -> Drawing:
    d = Drawing(720, 240)
    two_levels(d, 20, False)
    two_levels(d, 380, True)
    d.text(180, 220, "each cell on its own")
    d.text(540, 220, "one crossing for both sides")
    return d


def hanging() -> Drawing:
    d = Drawing(640, 240)
    x0, y0 = 60, 30
    for i in range(3):
        d.line((x0, y0 + 80 * i), (x0 + 160, y0 + 80 * i), color=LEVELS[0])
        d.line((x0 + 80 * i, y0), (x0 + 80 * i, y0 + 160), color=LEVELS[0])
    d.box(x0 + 160, y0, 160, 160, color=LEVELS[1], width=2)
    for y, words in ((0, "a"), (160, "b")):
        d.dot(x0 + 160, y0 + y, 7, LEVELS[1])
        d.text(x0 + 176, y0 + y + (18 if y == 0 else -8), words)
    d.dot(x0 + 160, y0 + 80, 7, "#ffffff", INK)
    d.text(x0 + 174, y0 + 85, "(a + b) / 2", anchor="start")
    d.text(400, 60, "The hollow sample hangs: it is a corner", anchor="start", size=13)
    d.text(400, 78, "of fine cells alone. Both sides use the", anchor="start")
    d.text(400, 96, "mean of the coarse edge's two ends.", anchor="start")
    d.text(x0 + 80, 215, "fine cells", color=SOFT)
    d.text(x0 + 240, 215, "a coarse cell", color=SOFT)
    return d


def fan() -> Drawing:
    d = Drawing(640, 320)

    def at(x: float, y: float, z: float) -> Point:
        return 20 + 190 * x + 170 * y, 300 - 170 * z - 105 * y

    corners = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    for a in corners:
        for b in corners:
            if sum(abs(p - q) for p, q in zip(a, b)) == 1 and a < b:
                d.line(at(*a), at(*b), color=LEVELS[1], width=1.5)
    for t in (0.5,):  # the face beside the finer cells
        d.line(at(1, t, 0), at(1, t, 1), color=LEVELS[0])
        d.line(at(1, 0, t), at(1, 1, t), color=LEVELS[0])
    loop = [at(0, 0, 0.3), at(1, 0, 0.62), at(1, 0.3, 0.5), at(1, 0.5, 0.72), at(1, 0.72, 0.5), at(1, 1, 0.25), at(0, 1, 0.5)]
    center = (sum(p[0] for p in loop) / len(loop), sum(p[1] for p in loop) / len(loop))
    for a, b in zip(loop, loop[1:] + loop[:1]):
        d.polygon([a, b, center], SURFACE, SURFACE, 0.25)
    d.line(*loop, loop[0], color=SURFACE, width=2.5)
    for p in loop:
        d.dot(*p, 4, SURFACE)
    d.dot(*center, 5, INK)
    d.text(410, 90, "A coarse cell whose right face", anchor="start")
    d.text(410, 108, "touches four finer ones.", anchor="start")
    d.text(410, 140, "There its loop takes the fine", anchor="start")
    d.text(410, 158, "side's line; the loop becomes a", anchor="start")
    d.text(410, 176, "fan around its centre.", anchor="start")
    return d


def paging() -> Drawing:
    d = Drawing(720, 250)
    d.label(10, 60, 110, 80, "file", "or URL", fill="#dfe8ea")
    d.label(190, 20, 140, 60, "mapped bricks,", "used in place")
    d.label(190, 125, 140, 60, "packed bricks,", "unpacked once")
    d.label(400, 60, 130, 80, "meshing", "threads", fill="#ffd9b0")
    d.label(600, 60, 110, 80, "sink:", "file, mesh", fill="#cfe8e4")
    d.line((120, 85), (186, 55), arrow=True)
    d.line((120, 115), (186, 150), arrow=True)
    d.line((330, 50), (396, 85), arrow=True)
    d.line((330, 155), (396, 115), arrow=True)
    d.line((530, 100), (596, 100), arrow=True)
    d.box(178, 8, 164, 190, color=SURFACE, width=2)
    d.text(260, 218, "--memory bounds this", color=SURFACE)
    d.text(563, 88, "in order", 12)
    d.line((465, 142), (465, 235), (66, 235), (66, 144), arrow=True, width=1, dash="5 4")
    d.text(400, 228, "asks ahead of use", 12, color=SOFT)
    return d


def build() -> Drawing:
    d = Drawing(720, 150)
    steps = [("scan", "rows or boxes"), ("window", "of some bricks"), ("bricks", "ranges, curvature"), ("writer", "checksums, journal")]
    for i, (name, more) in enumerate(steps):
        d.label(10 + 180 * i, 30, 140, 60, name, more, fill="#cfe8e4" if i == 3 else PALE)
        if i:
            d.line((10 + 180 * i - 40, 60), (10 + 180 * i - 4, 60), arrow=True)
    d.line((440, 92), (440, 125), (260, 125), (260, 94), arrow=True, width=1, dash="5 4")
    d.text(350, 142, "samples of the next level", 12, color=SOFT)
    return d


DRAWINGS = {
    "pyramid": pyramid, "low-pass": low_pass, "bricks": bricks, "build": build, "ranges": ranges, "focus": focus,
    "crack": crack, "hanging": hanging, "fan": fan, "paging": paging,
}


def main() -> None:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/figures")
    folder.mkdir(parents=True, exist_ok=True)
    for name, draw in DRAWINGS.items():
        (folder / f"how-{name}.svg").write_text(draw().svg())


if __name__ == "__main__":
    main()
