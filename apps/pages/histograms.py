"""Histograms as inline SVG: bars, a rose of directions, a grid of two quantities."""

import math
from collections.abc import Sequence
from html import escape

import numpy as np
import numpy.typing as npt

from readygo.common.drawing.ticks import nice_ticks, number_text

Array = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int64]

_COLOUR, _REST_COLOUR = "#0072b2", "#9aa3ad"
# As wide as line charts, for the same reason.
_WIDTH, _HEIGHT = 400, 230
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 18, 12, 40
_REST_PX = 68
"""Width of a bar behind the axis, with its name."""
_ROSE_PX, _ROSE_RADIUS = 260, 100


def bar_chart(edges: Array, counts: Counts, *, axis: str, count_name: str, rest: Sequence[tuple[str, int]] = ()) -> str:
    """A histogram.

    Args:
        edges: Edges of the bins, rising, shape (N + 1,).
        counts: Counts of the bins, shape (N,).
        axis: Name and unit of the quantity.
        count_name: Name of the counted items.
        rest: Bars behind the last bin, in grey: (name, count), such as values beyond the last edge.
    """
    rest = [(name, count) for name, count in rest if count]
    right = _WIDTH - _RIGHT - _REST_PX * len(rest)
    slot_px = (right - _LEFT) / len(counts)
    high = max([int(counts.max(initial=0)), *(count for _, count in rest), 1])
    ticks = [tick for tick in nice_ticks(0.0, float(high)) if tick == int(tick)]
    high = max(high, int(ticks[-1]))
    parts = [_head(_WIDTH, _HEIGHT, f"{count_name} by {axis}")]
    for tick in ticks:
        y = _y(tick, high)
        parts.append(f'<line x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{y:.1f}" y2="{y:.1f}" class="grid"/>')
        parts.append(f'<text x="{_LEFT - 8}" y="{y + 4:.1f}" text-anchor="end">{number_text(tick)}</text>')
    for k, count in enumerate(counts.tolist()):
        title = f"{_rounded(edges[k])} to {_rounded(edges[k + 1])}: {count}"
        parts.append(_bar(_LEFT + k * slot_px, slot_px, count, high, _COLOUR, title))
    for k, (name, count) in enumerate(rest):
        middle = right + (k + 0.5) * _REST_PX + 8
        parts.append(_bar(middle - slot_px / 2, slot_px, count, high, _REST_COLOUR, f"{name}: {count}"))
        parts.append(_axis_text(middle, escape(name)))
    parts += _axis_texts(edges, right)
    parts.append(_name_text((_LEFT + right) / 2, axis))
    return "".join([*parts, "</svg>"])


def rose_chart(counts: Counts, *, name: str) -> str:
    """A polar histogram; the first bin is centred on +x, which points right, and bins go counter-clockwise.

    Areas, not radii, are proportional to the counts.
    """
    size, radius, width = _ROSE_PX, _ROSE_RADIUS, math.tau / len(counts)
    highest = max(int(counts.max(initial=0)), 1)
    parts = [_head(size, size, name, kind="chart rose")]
    for share in (0.25, 0.5, 0.75, 1.0):
        r = radius * math.sqrt(share)
        parts.append(f'<circle cx="{size / 2}" cy="{size / 2}" r="{r:.1f}" fill="none" class="grid"/>')
    for k, count in enumerate(counts.tolist()):
        r, low, high = radius * math.sqrt(count / highest), (k - 0.47) * width, (k + 0.47) * width
        corners = [(size / 2 + r * math.cos(a), size / 2 - r * math.sin(a)) for a in (low, high)]
        (x0, y0), (x1, y1) = corners
        parts.append(
            f'<path d="M{size / 2},{size / 2}L{x0:.1f},{y0:.1f}A{r:.1f},{r:.1f} 0 0 0 {x1:.1f},{y1:.1f}Z" '
            f'fill="{_COLOUR}"><title>{math.degrees(k * width):.0f} deg: {count}</title></path>'
        )
    for text, x, y in (("+x", radius + 16, 4), ("+y", 0, -radius - 8), ("-x", -radius - 16, 4), ("-y", 0, radius + 18)):
        parts.append(f'<text x="{size / 2 + x}" y="{size / 2 + y}" text-anchor="middle">{text}</text>')
    return "".join([*parts, "</svg>"])


def grid_chart(x_edges: Array, y_edges: Array, counts: Counts, *, x_axis: str, y_axis: str, count_name: str) -> str:
    """A 2-D histogram; the darkness of a field grows with the logarithm of its count, empty ones stay white.

    Args:
        x_edges: Edges of the columns, shape (C + 1,).
        y_edges: Edges of the rows, shape (R + 1,); the first row is at the bottom.
        counts: Counts of the fields, shape (R, C).
        x_axis: Name and unit of the columns.
        y_axis: Name and unit of the rows.
        count_name: Name of the counted items.
    """
    rows, columns = counts.shape
    width, height = (_WIDTH - _LEFT - _RIGHT) / columns, (_HEIGHT - _TOP - _BOTTOM) / rows
    highest = math.log1p(max(int(counts.max(initial=0)), 1))
    parts = [_head(_WIDTH, _HEIGHT, f"{count_name} by {x_axis} and {y_axis}")]
    parts.append(
        f'<rect x="{_LEFT}" y="{_TOP}" width="{_WIDTH - _LEFT - _RIGHT}" height="{_HEIGHT - _TOP - _BOTTOM}" '
        'fill="none" class="grid"/>'
    )
    for i, j in np.argwhere(counts > 0).tolist():
        x, y = _LEFT + j * width, _HEIGHT - _BOTTOM - (i + 1) * height
        opacity = 0.08 + 0.92 * math.log1p(int(counts[i, j])) / highest
        parts.append(
            f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" fill="{_COLOUR}" '
            f'fill-opacity="{opacity:.2f}"><title>{int(counts[i, j])}</title></rect>'
        )
    parts += _axis_texts(x_edges, _WIDTH - _RIGHT)
    step = max(1, round(rows / 5))
    for i in range(0, rows + 1, step):
        y = _HEIGHT - _BOTTOM - i * height
        parts.append(f'<text x="{_LEFT - 8}" y="{y + 4:.1f}" text-anchor="end">{_rounded(y_edges[i])}</text>')
    parts.append(_name_text((_LEFT + _WIDTH - _RIGHT) / 2, x_axis))
    middle = (_TOP + _HEIGHT - _BOTTOM) / 2
    parts.append(
        f'<text x="12" y="{middle:.1f}" text-anchor="middle" transform="rotate(-90 12 {middle:.1f})">'
        f"{escape(y_axis)}</text>"
    )
    return "".join([*parts, "</svg>"])


def _head(width: int, height: int, label: str, *, kind: str = "chart") -> str:
    return f'<svg class="{kind}" viewBox="0 0 {width} {height}" role="img" aria-label="{escape(label)}">'


def _y(count: float, high: float) -> float:
    return _HEIGHT - _BOTTOM - count / high * (_HEIGHT - _TOP - _BOTTOM)


def _bar(x: float, width: float, count: int, high: int, colour: str, title: str) -> str:
    y = _y(count, high)
    return (
        f'<rect x="{x + 0.5:.1f}" y="{y:.1f}" width="{max(width - 1, 0.5):.1f}" height="{_HEIGHT - _BOTTOM - y:.1f}" '
        f'fill="{colour}"><title>{escape(title)}</title></rect>'
    )


def _axis_texts(edges: Array, right: float) -> list[str]:
    """Round numbers along an axis from the first to the last edge."""
    low, high = float(edges[0]), float(edges[-1])
    ticks = [tick for tick in nice_ticks(low, high) if tick <= high + 1e-6 * (high - low)]
    places = [_LEFT + (tick - low) / (high - low) * (right - _LEFT) for tick in ticks]
    return [_axis_text(place, _rounded(tick)) for place, tick in zip(places, ticks, strict=True)]


def _rounded(value: float) -> str:
    return number_text(round(float(value), 6) + 0.0)


def _axis_text(x: float, text: str) -> str:
    return f'<text x="{x:.1f}" y="{_HEIGHT - 22}" text-anchor="middle">{text}</text>'


def _name_text(x: float, text: str) -> str:
    return f'<text x="{x:.1f}" y="{_HEIGHT - 4}" text-anchor="middle">{escape(text)}</text>'
