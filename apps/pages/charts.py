"""Charts as inline SVG."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
import numpy.typing as npt

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
_WIDTH, _HEIGHT = 720, 280
_LEFT, _RIGHT, _TOP, _BOTTOM = 58, 16, 34, 40
_LEGEND_PX = 180
"""Width of a curve's entry in the legend, above the plot."""
_DOTS_MAX = 30
"""Curves of so few points have a dot at each: a single one would not be seen."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """One line of a chart."""

    name: str
    """For example "training" or "validation"."""
    x: npt.NDArray[np.float64]
    """Rising, shape (N,)."""
    y: npt.NDArray[np.float64]
    """Shape (N,); values that are not finite are left out."""


def line_chart(curves: Sequence[Curve], *, x_name: str, what: str = "Loss", y_max: float = 0.0) -> str:
    """A line chart from x = 0 on; the vertical axis is logarithmic when the values span more than a factor of 20.

    Args:
        curves: The lines.
        x_name: What x is, with its unit.
        what: What the values are.
        y_max: The vertical axis goes from 0 to at least here, and is linear; 0 leaves that to the values.

    Returns:
        An SVG element, or an empty string when there is nothing finite to draw.
    """
    cleaned = [(curve.name, *_finite(curve)) for curve in curves]
    cleaned = [(name, step, loss) for name, step, loss in cleaned if len(step)]
    if not cleaned:
        return ""
    steps = np.concatenate([step for _, step, _ in cleaned])
    losses = np.concatenate([loss for _, _, loss in cleaned])
    log = bool(not y_max and losses.min() > 0 and losses.max() > 20 * losses.min())
    low, high = float(losses.min()), float(losses.max())
    if not log:
        low, high = min(0.0, low), max(high, y_max)
    y_ticks = _decades(low, high) if log else nice_ticks(low, high)
    low, high = min(low, y_ticks[0]), max(high, y_ticks[-1])
    x_low, x_high = min(0.0, float(steps.min())), max(float(steps.max()), 1e-9)
    x_ticks = nice_ticks(x_low, x_high)

    def x_of(step: float) -> float:
        return _LEFT + (step - x_low) / (x_high - x_low) * (_WIDTH - _LEFT - _RIGHT)

    def y_of(loss: float) -> float:
        a, b, c = (math.log(low), math.log(high), math.log(loss)) if log else (low, high, loss)
        return _HEIGHT - _BOTTOM - (c - a) / max(b - a, 1e-12) * (_HEIGHT - _TOP - _BOTTOM)

    label = f"{escape(what)} over {escape(x_name)}"
    parts = [f'<svg class="chart" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="{label}">']
    for tick in y_ticks:
        y = y_of(tick)
        parts.append(f'<line x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{y:.1f}" y2="{y:.1f}" class="grid"/>')
        parts.append(f'<text x="{_LEFT - 8}" y="{y + 4:.1f}" text-anchor="end">{number_text(tick)}</text>')
    for tick in x_ticks:
        if x_low <= tick <= x_high:
            parts.append(
                f'<text x="{x_of(tick):.1f}" y="{_HEIGHT - 20}" text-anchor="middle">{number_text(tick)}</text>'
            )
    middle = (_LEFT + _WIDTH - _RIGHT) / 2
    parts.append(f'<text x="{middle}" y="{_HEIGHT - 4}" text-anchor="middle">{escape(x_name)}</text>')
    for k, (name, step, loss) in enumerate(cleaned):
        colour = _COLOURS[k % len(_COLOURS)]
        places = [(x_of(float(s)), y_of(float(v))) for s, v in zip(step, loss, strict=True)]
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
        parts.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="2"/>')
        if len(places) <= _DOTS_MAX:
            parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.5" fill="{colour}"/>' for x, y in places]
        x = _LEFT + _LEGEND_PX * k
        parts.append(f'<rect x="{x}" y="10" width="18" height="4" fill="{colour}"/>')
        parts.append(f'<text x="{x + 24}" y="16">{escape(name)} {number_text(float(loss[-1]))}</text>')
    return "".join([*parts, "</svg>"])


def rate_bar(rate: float, low: float, high: float) -> str:
    """A rate in 0..1 as a dot on a line with its interval, as an SVG element."""
    x, a, b = (4 + 152 * min(max(value, 0.0), 1.0) for value in (rate, low, high))
    return (
        '<svg class="rate" viewBox="0 0 160 16" aria-hidden="true">'
        '<line x1="4" x2="156" y1="8" y2="8" class="grid"/>'
        f'<line x1="{a:.1f}" x2="{b:.1f}" y1="8" y2="8" stroke="#0072b2" stroke-width="4" stroke-opacity="0.35"/>'
        f'<circle cx="{x:.1f}" cy="8" r="4.5" fill="#0072b2"/></svg>'
    )


def share_bar(share: float) -> str:
    """A share in 0..1 as a filled bar, as an SVG element."""
    width = 160 * min(max(share, 0.0), 1.0)
    return (
        '<svg class="rate" viewBox="0 0 160 16" aria-hidden="true"><rect width="160" height="10" y="3" class="track"/>'
        f'<rect width="{width:.1f}" height="10" y="3" fill="#0072b2"/></svg>'
    )


def _finite(curve: Curve) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.asarray(curve.x, dtype=np.float64), np.asarray(curve.y, dtype=np.float64)
    keep = np.isfinite(x) & np.isfinite(y)
    return x[keep], y[keep]


def nice_ticks(low: float, high: float) -> list[float]:
    """About five round numbers from at or above `low` to at or above `high`."""
    span = max(high - low, 1e-9)
    raw = span / 5
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(m * power for m in (1, 2, 2.5, 5, 10) if m * power >= raw * 0.999)
    first, last = math.ceil(low / step - 1e-9), math.ceil(high / step - 1e-9)
    return [k * step for k in range(first, last + 1)]


def _decades(low: float, high: float) -> list[float]:
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    return [10.0**k for k in range(first, last + 1)]


def number_text(value: float) -> str:
    """A number with about three digits."""
    if value != 0 and (abs(value) < 0.001 or abs(value) >= 1e9):
        return f"{value:.1e}"
    if abs(value) >= 1e6:
        return f"{value / 1e6:.3g}M"
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"
