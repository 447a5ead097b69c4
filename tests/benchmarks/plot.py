"""Curves on logarithmic axes as an SVG, legible on white and on dark pages alike.

The picture has no background of its own; its greys and colours have a contrast of at least 3 to 1
to white and to a dark page, the least for graphics by WCAG 2.2 (1.4.11).
"""

import math
from collections.abc import Sequence
from xml.sax.saxutils import escape

from tests.benchmarks.report import Plot, Point

_WIDTH, _HEIGHT = 460, 330  # of one plot, with its margins
_LEFT, _RIGHT, _TOP, _BOTTOM = 62, 14, 36, 46
_LEGEND_LINE = 15
_GREY, _GRID = "#7a838f", "#7a838f40"
_COLORS = ("#2f81f7", "#e3622b", "#1a9b54", "#a067e0", "#c2567d", "#8a7a1f", "#3a97a3", "#7a838f")


def svg(plots: Sequence[Plot]) -> str:
    """Return the plots as one picture, two in a row."""
    across = min(2, max(1, len(plots)))
    legend = _LEGEND_LINE * max((len(plot.curves) for plot in plots), default=0)
    height = _HEIGHT + legend
    down = math.ceil(len(plots) / across)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {across * _WIDTH} {down * height}" '
        f'width="{across * _WIDTH}" height="{down * height}" font-size="11" fill="{_GREY}" '
        'font-family="system-ui, -apple-system, Segoe UI, Helvetica, Arial, sans-serif">'
    ]
    for number, plot in enumerate(plots):
        x, y = number % across * _WIDTH, number // across * height
        parts.append(f'<g transform="translate({x} {y})">{_one(plot)}</g>')
    return "\n".join([*parts, "</svg>"]) + "\n"


class _Axis:
    """A logarithmic axis from one power of ten, or near it, to another."""

    def __init__(self, values: Sequence[float], start: float, end: float) -> None:
        low, high = (math.log10(limit) for limit in (min(values), max(values)))
        room = max(0.04 * (high - low), 0.02)
        self._low, self._high = low - room, high + room
        self._start, self._end = start, end

    def place(self, value: float) -> float:
        share = (math.log10(value) - self._low) / (self._high - self._low)
        return self._start + share * (self._end - self._start)

    def ticks(self) -> list[float]:
        """1, 10, 100, ...; or more of them where fewer than three would be in sight."""
        for digits in ((1,), (1, 3), (1, 2, 5), tuple(range(1, 10))):
            powers = range(math.floor(self._low), math.ceil(self._high) + 1)
            candidates = [digit * 10.0**power for power in powers for digit in digits]
            found = [v for v in candidates if self._low <= math.log10(v) <= self._high]
            if len(found) >= 3:
                return found
        return found


def _one(plot: Plot) -> str:
    curves = {name: _drawable(points) for name, points in plot.curves.items()}
    points = [point for curve in curves.values() for point in curve]
    title = f'<text x="{_LEFT}" y="18" font-size="13" font-weight="600">{escape(plot.title)}</text>'
    if not points:
        return title
    right, bottom = _WIDTH - _RIGHT, _HEIGHT - _BOTTOM
    across = _Axis([x for x, _ in points], _LEFT, right)
    up = _Axis([y for _, y in points], bottom, _TOP)
    parts = [title, *_grid(across, up, plot)]
    for number, (name, curve) in enumerate(curves.items()):
        color = _COLORS[number % len(_COLORS)]
        line = " ".join(f"{across.place(x):.1f},{up.place(y):.1f}" for x, y in curve)
        parts.append(
            f'<polyline points="{line}" fill="none" stroke="{color}" stroke-width="2" '
            'stroke-linejoin="round"/>'
        )
        parts += [
            f'<circle cx="{across.place(x):.1f}" cy="{up.place(y):.1f}" r="2.6" fill="{color}"/>'
            for x, y in curve
        ]
        y = _HEIGHT + _LEGEND_LINE * number
        parts.append(
            f'<line x1="{_LEFT}" x2="{_LEFT + 18}" y1="{y}" y2="{y}" stroke="{color}" '
            f'stroke-width="3"/><text x="{_LEFT + 26}" y="{y + 4}">{escape(name)}</text>'
        )
    return "\n".join(parts)


def _grid(across: _Axis, up: _Axis, plot: Plot) -> list[str]:
    right, bottom = _WIDTH - _RIGHT, _HEIGHT - _BOTTOM
    parts = []
    for value in across.ticks():
        x = across.place(value)
        parts.append(
            f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{_TOP}" y2="{bottom}" stroke="{_GRID}"/>'
            f'<text x="{x:.1f}" y="{bottom + 16}" text-anchor="middle">{value:g}</text>'
        )
    for value in up.ticks():
        y = up.place(value)
        parts.append(
            f'<line x1="{_LEFT}" x2="{right}" y1="{y:.1f}" y2="{y:.1f}" stroke="{_GRID}"/>'
            f'<text x="{_LEFT - 7}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text>'
        )
    middle = (_TOP + bottom) / 2
    parts += [
        f'<text x="{(_LEFT + right) / 2}" y="{bottom + 33}" text-anchor="middle">'
        f"{escape(plot.x)}</text>",
        f'<text x="14" y="{middle}" text-anchor="middle" transform="rotate(-90 14 {middle})">'
        f"{escape(plot.y)}</text>",
    ]
    return parts


def _drawable(points: Sequence[Point]) -> list[Point]:
    """Points that have a place on logarithmic axes."""
    return [(x, y) for x, y in points if 0.0 < x < math.inf and 0.0 < y < math.inf]
