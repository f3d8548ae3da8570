"""Plots as SVG, written by hand so that the same figures give the same bytes on every machine."""

import math

OURS, PEER, GRID = "#1f5fa8", "#b9bec6", "#dddddd"
CURVES = ["#1f5fa8", "#d58a00", "#2e8b57", "#8e44ad", "#c0392b", "#555555"]


def escaped(text):
    return str(text).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def text(x, y, words, anchor="start", size=12, color="#222222", bold=False):
    weight = ' font-weight="bold"' if bold else ""
    return (f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="{size}" fill="{color}"{weight}>'
            f"{escaped(words)}</text>")


def line(x1, y1, x2, y2, color=GRID, width=1.0):
    return f'<path d="M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}" stroke="{color}" stroke-width="{width}" fill="none"/>'


def picture(width, height, parts):
    head = (f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
            'font-family="sans-serif">')
    return "\n".join([head, f'<rect width="{width}" height="{height}" fill="#ffffff"/>', *parts, "</svg>"]) + "\n"


def short(value):
    """Three digits, as a label of an axis or a bar: 0.0123, 4.56, 1,230."""
    if value >= 100:
        return f"{value:,.0f}"
    digits = 2 - math.floor(math.log10(value)) if value > 0 else 0
    return f"{value:.{max(digits, 0)}f}"


class LinearScale:
    """From values to pixels, from 0."""

    def __init__(self, values, begin, end):
        self.high, self.begin, self.end = 1.04 * max(values), begin, end

    def __call__(self, value):
        return self.begin + (self.end - self.begin) * value / self.high

    def marks(self):
        step = 10.0 ** math.floor(math.log10(self.high))
        step = next(step * part for part in (0.2, 0.5, 1, 2) if self.high / (step * part) <= 6)
        return [i * step for i in range(int(self.high / step) + 1)]


class Scale:
    """From values to pixels, logarithmic."""

    def __init__(self, values, begin, end):
        low, high = math.log10(min(values)), math.log10(max(values))
        pad = 0.06 * max(high - low, 0.3)
        self.low, self.high, self.begin, self.end = low - pad, high + pad, begin, end

    def __call__(self, value):
        return self.begin + (self.end - self.begin) * (math.log10(value) - self.low) / (self.high - self.low)

    def marks(self):
        """As many of each decade as are some five in all."""
        decades = range(math.floor(self.low) - 1, math.ceil(self.high) + 1)
        for choice in ((1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9), (1, 2, 3, 5, 7), (1, 2, 5), (1,)):
            found = [m * 10.0**d for d in decades for m in choice if self.low <= math.log10(m * 10.0**d) <= self.high]
            if len(found) <= 6:
                break
        return found


BAR, NAMES, PANEL, FOOT = 20, 210, 430, 34


def bars(panels, unit, logarithmic=True):
    """Panels of bars below each other: [(title, [(name, value, is ours)])]. A logarithmic axis begins
    at half of the least value."""
    parts, y = [], 8
    for title, rows in panels:
        values = [value for _, value, _ in rows]
        scale = (Scale([*values, min(values) / 2], NAMES, NAMES + PANEL) if logarithmic
                 else LinearScale(values, NAMES, NAMES + PANEL))
        parts.append(text(NAMES, y + 14, title, bold=True))
        top, y = y + 22, y + 22
        bottom = top + BAR * len(rows)
        for mark in scale.marks():
            parts += [line(scale(mark), top, scale(mark), bottom + 4),
                      text(scale(mark), bottom + 17, short_mark(mark), "middle", 11, "#555555")]
        parts.append(text(NAMES + PANEL + 40, bottom + 17, unit, size=11, color="#555555"))
        for name, value, ours in rows:
            parts.append(text(NAMES - 8, y + 14, name, "end"))
            parts.append(f'<rect x="{NAMES}" y="{y + 3}" width="{max(scale(value) - NAMES, 1):.1f}" height="{BAR - 6}" '
                         f'fill="{OURS if ours else PEER}"/>')
            parts.append(text(scale(value) + 5, y + 14, short(value), size=11))
            y += BAR
        y += FOOT
    parts += [f'<rect x="{NAMES}" y="{y}" width="14" height="12" fill="{OURS}"/>', text(NAMES + 20, y + 10, "isobrick", size=11),
              f'<rect x="{NAMES + 90}" y="{y}" width="14" height="12" fill="{PEER}"/>', text(NAMES + 110, y + 10, "others", size=11)]
    if logarithmic:
        parts.append(text(NAMES + 180, y + 10, "logarithmic axis", size=11, color="#555555"))
    y += 22
    return picture(NAMES + PANEL + 70, y, parts)


def short_mark(mark):
    for unit, name in ((1e6, " M"), (1e3, " k")):
        if mark >= unit and mark >= 10000:
            return f"{mark / unit:g}{name}"
    return f"{mark:g}"


def curves(panels, x_title, y_title, columns=2):
    """Panels of curves on logarithmic axes: [(title, {name: [(x, y), ...]})]; a name has the same colour in all."""
    width, height, left, gap = 350, 250, 58, 66
    names = list(dict.fromkeys(name for _, curves_of in panels for name in curves_of))
    color = {name: CURVES[i % len(CURVES)] for i, name in enumerate(names)}
    parts = []
    for number, (title, curves_of) in enumerate(panels):
        x0, y0 = left + number % columns * (width + gap), 26 + number // columns * (height + 62)
        points = [point for curve in curves_of.values() for point in curve]
        across = Scale([x for x, _ in points], x0, x0 + width)
        up = Scale([y for _, y in points], y0 + height, y0)
        parts.append(text(x0, y0 - 8, title, bold=True))
        for mark in across.marks():
            parts += [line(across(mark), y0, across(mark), y0 + height),
                      text(across(mark), y0 + height + 15, short_mark(mark), "middle", 11, "#555555")]
        for mark in up.marks():
            parts += [line(x0, up(mark), x0 + width, up(mark)),
                      text(x0 - 6, up(mark) + 4, short_mark(mark), "end", 11, "#555555")]
        parts.append(f'<rect x="{x0}" y="{y0}" width="{width}" height="{height}" fill="none" stroke="#888888"/>')
        parts.append(text(x0 + width / 2, y0 + height + 31, x_title, "middle", 11, "#555555"))
        parts.append(f'<text transform="translate({x0 - 44} {y0 + height / 2}) rotate(-90)" text-anchor="middle" font-size="11" '
                     f'fill="#555555">{escaped(y_title)}</text>')
        for name, curve in curves_of.items():
            placed = [f"{across(x):.1f} {up(y):.1f}" for x, y in sorted(curve)]
            if len(placed) > 1:
                parts.append(f'<path d="M{"L".join(placed)}" stroke="{color[name]}" stroke-width="1.8" fill="none"/>')
            parts += [f'<circle cx="{place.split()[0]}" cy="{place.split()[1]}" r="3.2" fill="{color[name]}"/>' for place in placed]
    rows = (len(panels) + columns - 1) // columns
    x, y = left, 26 + rows * (height + 62) - 10
    for name in names:
        parts += [line(x, y, x + 20, y, color[name], 2.5), text(x + 26, y + 4, name, size=11)]
        x += 50 + 7 * len(name)
    return picture(left + columns * (width + gap) - gap + 24, y + 20, parts)
