"""Charts as inline SVG."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
import numpy.typing as npt

from readygo.common.drawing.ticks import log_ticks, nice_ticks, number_text

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
# About as wide as a page on a phone: there, and in one of two columns, its text has the size of the page's text.
_WIDTH, _HEIGHT = 400, 240
_LEFT, _RIGHT, _TOP, _BOTTOM = 54, 28, 46, 40
_LEGEND_PX = 168
"""Width of a curve's entry in the legend, above the plot."""
_LOG_FACTOR = 20
"""Ratio of the largest to the smallest value above which the axis is logarithmic."""
_DOTS_MAX = 30
"""Largest number of points of a curve with dots: a single point would be invisible without one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """One line of a chart."""

    name: str
    """For example "training" or "validation"."""
    x: npt.NDArray[np.float64]
    """Horizontal values, rising, shape (N,)."""
    y: npt.NDArray[np.float64]
    """Vertical values, shape (N,); non-finite ones are left out."""


@dataclass(frozen=True, kw_only=True)
class _Axes:
    """Scales of a chart's axes: values to pixels."""

    x_high: float
    y_ticks: list[float]
    log: bool

    @property
    def x_ticks(self) -> list[float]:
        return [tick for tick in nice_ticks(0.0, self.x_high) if tick <= self.x_high]

    def x(self, value: float) -> float:
        return _LEFT + value / self.x_high * (_WIDTH - _LEFT - _RIGHT)

    def y(self, value: float) -> float:
        low, high = self.y_ticks[0], self.y_ticks[-1]
        a, b, c = (math.log(low), math.log(high), math.log(value)) if self.log else (low, high, value)
        return _HEIGHT - _BOTTOM - (c - a) / max(b - a, 1e-12) * (_HEIGHT - _TOP - _BOTTOM)


def line_chart(curves: Sequence[Curve], *, x_name: str, what: str = "Loss", y_max: float = 0.0) -> str:
    """A line chart from x = 0 on; the vertical axis is logarithmic when the values span more than a factor of 20.

    Args:
        curves: The lines; no x is negative.
        x_name: Name of x, with its unit.
        what: Name of the values.
        y_max: If positive, the vertical axis is linear and goes from 0 to at least this value; 0 fits the values.

    Returns:
        An SVG element, or an empty string when there is nothing finite to draw.
    """
    drawn = [curve for curve in map(_finite, curves) if len(curve.x)]
    if not drawn:
        return ""
    axes = _axes(drawn, y_max)
    kind = f"{what}, logarithmic" if axes.log else what
    head = f'<svg class="chart" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" '
    parts = [f'{head}aria-label="{escape(kind)} over {escape(x_name)}">']
    parts += [f'<text x="4" y="14">{escape(kind)}</text>', *_grid(axes, x_name)]
    for k, curve in enumerate(drawn):
        parts += [*_line(axes, curve, _COLOURS[k % len(_COLOURS)]), *_legend(curve, k, _COLOURS[k % len(_COLOURS)])]
    return "".join([*parts, "</svg>"])


def _axes(curves: Sequence[Curve], y_max: float) -> _Axes:
    y = np.concatenate([curve.y for curve in curves])
    low, high = float(y.min()), float(y.max())
    log = not y_max and low > 0 and high > _LOG_FACTOR * low
    return _Axes(
        x_high=max(*(float(curve.x.max()) for curve in curves), 1e-9),
        y_ticks=log_ticks(low, high) if log else nice_ticks(min(0.0, low), max(high, y_max)),
        log=log,
    )


def _grid(axes: _Axes, x_name: str) -> list[str]:
    parts = []
    for tick in axes.y_ticks:
        y = axes.y(tick)
        parts.append(f'<line x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{y:.1f}" y2="{y:.1f}" class="grid"/>')
        parts.append(f'<text x="{_LEFT - 7}" y="{y + 4:.1f}" text-anchor="end">{number_text(tick)}</text>')
    for tick in axes.x_ticks:
        parts.append(f'<text x="{axes.x(tick):.1f}" y="{_HEIGHT - 22}" text-anchor="middle">{number_text(tick)}</text>')
    middle = (_LEFT + _WIDTH - _RIGHT) / 2
    return [*parts, f'<text x="{middle}" y="{_HEIGHT - 4}" text-anchor="middle">{escape(x_name)}</text>']


def _line(axes: _Axes, curve: Curve, colour: str) -> list[str]:
    places = [(axes.x(x), axes.y(y)) for x, y in zip(curve.x.tolist(), curve.y.tolist(), strict=True)]
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
    parts = [f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="2"/>']
    if len(places) <= _DOTS_MAX:
        parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.5" fill="{colour}"/>' for x, y in places]
    return parts


def _legend(curve: Curve, number: int, colour: str) -> list[str]:
    """Name and last value of a curve."""
    x = _LEFT + _LEGEND_PX * number
    text = f"{escape(curve.name)} {number_text(float(curve.y[-1]))}"
    return [f'<rect x="{x}" y="26" width="18" height="4" fill="{colour}"/>', f'<text x="{x + 24}" y="32">{text}</text>']


def meter(rate: float, low: float, high: float) -> str:
    """A rate in 0..1 as a filled bar, with its interval as a line on it, as an HTML element."""
    share, a, b = (100 * min(max(value, 0.0), 1.0) for value in (rate, low, high))
    return (
        f'<div class="meter" aria-hidden="true"><i style="width:{share:.1f}%"></i>'
        f'<u style="left:{a:.1f}%;width:{b - a:.1f}%"></u></div>'
    )


def share_bar(share: float) -> str:
    """A share in 0..1 as a filled bar, as an SVG element."""
    width = 160 * min(max(share, 0.0), 1.0)
    return (
        '<svg class="rate" viewBox="0 0 160 16" aria-hidden="true"><rect width="160" height="10" y="3" class="track"/>'
        f'<rect width="{width:.1f}" height="10" y="3" fill="#0072b2"/></svg>'
    )


def _finite(curve: Curve) -> Curve:
    x, y = np.asarray(curve.x, dtype=np.float64), np.asarray(curve.y, dtype=np.float64)
    keep = np.isfinite(x) & np.isfinite(y)
    return Curve(name=curve.name, x=x[keep], y=y[keep])
