"""Charts as SVG text: curves with intervals, histograms, a rose of directions, a grid of two quantities.

The elements of a chart have classes (`c0` to `c3`, `rest`, `grid`), so that the style sheet of a page can give them the
colours of its theme. Their attributes are the colours of light pages: a chart needs no style sheet to be a file.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np

from readygo.common.arrays import Float64Array, Int64Array
from readygo.common.files import write_whole

COLOURS = {"c0": "#0072b2", "c1": "#d55e00", "c2": "#009e73", "c3": "#cc79a7", "rest": "#9aa3ad"}
"""Colours of light pages by class: of the curves in their order, and of bars behind an axis."""
CURVE_COUNT = len(COLOURS) - 1
# About as wide as a page on a phone: there, and in one of two columns, its text has the size of the page's text.
_WIDTH, _HEIGHT = 400, 240
_LEFT, _RIGHT, _TOP, _BOTTOM = 54, 28, 14, 40
_ROW_PX, _CHARACTER_PX = 18, 7.2
"""Height of a row of text, and about the width of a character."""
_LOG_FACTOR = 20
"""Ratio of the largest to the smallest value above which an axis is logarithmic."""
_DOTS_MAX = 30
"""Largest number of points of a curve with dots: a single point would be invisible without one."""
_REST_PX = 68
"""Width of a bar behind the axis, with its name."""
_ROSE_PX, _ROSE_RADIUS_PX = 260, 100


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """One line of a chart."""

    name: str
    """For example "training" or "validation"."""
    x: Float64Array
    """Horizontal values, rising, shape (N,)."""
    y: Float64Array
    """Vertical values, shape (N,); non-finite ones are left out."""
    interval: Float64Array | None = None
    """Lower and upper ends of the intervals of `y`, shape (2, N); None without intervals."""


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
    y = np.concatenate([curve.y for curve in drawn])
    low, high = float(y.min()), float(y.max())
    log = not y_max and low > 0 and high > _LOG_FACTOR * low
    y_ticks = log_ticks(low, high) if log else nice_ticks(min(0.0, low), max(high, y_max))
    legend, top_px = _legend(drawn)
    axes = _Axes(
        x_low=0.0,
        x_high=max(*(float(curve.x.max()) for curve in drawn), 1e-9),
        y_low=y_ticks[0],
        y_high=y_ticks[-1],
        log=log,
        top_px=top_px,
    )
    kind = f"{what}, logarithmic" if log else what
    lines = [_with_colours(f"c{k % CURVE_COUNT}", _line(axes, curve)) for k, curve in enumerate(drawn)]
    parts = [_text(4, 14, kind, "start"), legend, _y_axis(axes, y_ticks), _x_axis(axes, x_name), *lines]
    return _svg(f"{kind} over {x_name}", parts)


def bar_chart(
    edges: Float64Array, counts: Int64Array, *, axis: str, count_name: str, rest: Sequence[tuple[str, int]] = ()
) -> str:
    """A histogram as an SVG element.

    Args:
        edges: Edges of the bins, rising, shape (N + 1,).
        counts: Counts of the bins, shape (N,).
        axis: Name and unit of the quantity.
        count_name: Name of the counted items.
        rest: Bars behind the last bin, in grey: (name, count), such as values beyond the last edge.
    """
    rest = [(name, count) for name, count in rest if count]
    high = float(max([int(counts.max(initial=0)), *(count for _, count in rest), 1]))
    ticks = [tick for tick in nice_ticks(0.0, high) if tick == int(tick)]
    right_px = _WIDTH - _RIGHT - _REST_PX * len(rest)
    axes = _Axes(
        x_low=float(edges[0]), x_high=float(edges[-1]), y_low=0.0, y_high=max(high, ticks[-1]), right_px=right_px
    )
    slot_px = (right_px - _LEFT) / len(counts)
    bars = [
        _bar(axes, _LEFT + k * slot_px, slot_px, count, f"{_number_label(edges[k])} to {_number_label(edges[k + 1])}")
        for k, count in enumerate(counts.tolist())
    ]
    beyond, names = [], []
    for k, (name, count) in enumerate(rest):
        middle_px = right_px + (k + 0.5) * _REST_PX + 8
        beyond.append(_bar(axes, middle_px - slot_px / 2, slot_px, count, name))
        names.append(_text(middle_px, _HEIGHT - 22, name))
    parts = [
        _y_axis(axes, ticks),
        _with_colours("c0", bars),
        _with_colours("rest", beyond),
        *names,
        _x_axis(axes, axis),
    ]
    return _svg(f"{count_name} by {axis}", parts)


def rose_chart(counts: Int64Array, *, name: str) -> str:
    """A polar histogram as an SVG element; its first bin is centred on +x, which points right.

    Bins go counter-clockwise. Areas, not radii, are proportional to the counts.
    """
    middle, radius, width = _ROSE_PX / 2, _ROSE_RADIUS_PX, math.tau / len(counts)
    highest = max(int(counts.max(initial=0)), 1)
    rings = [
        _tag("circle", cx=middle, cy=middle, r=radius * math.sqrt(share), fill="none")
        for share in (0.25, 0.5, 0.75, 1.0)
    ]
    petals = []
    for k, count in enumerate(counts.tolist()):
        r = radius * math.sqrt(count / highest)
        (x0, y0), (x1, y1) = (
            (middle + r * math.cos(a), middle - r * math.sin(a)) for a in ((k - 0.47) * width, (k + 0.47) * width)
        )
        path = f"M{middle},{middle}L{x0:.1f},{y0:.1f}A{r:.1f},{r:.1f} 0 0 0 {x1:.1f},{y1:.1f}Z"
        petals.append(_tag("path", _title(f"{math.degrees(k * width):.0f} deg: {count}"), d=path))
    places = (("+x", radius + 16, 4), ("+y", 0, -radius - 8), ("-x", -radius - 16, 4), ("-y", 0, radius + 18))
    texts = [_text(middle + x, middle + y, text) for text, x, y in places]
    return _svg(
        name, [_with_grid(rings), _with_colours("c0", petals), *texts], size=(_ROSE_PX, _ROSE_PX), kind="chart rose"
    )


def grid_chart(
    x_edges: Float64Array, y_edges: Float64Array, counts: Int64Array, *, x_axis: str, y_axis: str, count_name: str
) -> str:
    """A 2-D histogram as an SVG element; fields get denser with the logarithm of their count, empty ones stay clear.

    Args:
        x_edges: Edges of the columns, shape (C + 1,).
        y_edges: Edges of the rows, shape (R + 1,); the first row is at the bottom.
        counts: Counts of the fields, shape (R, C).
        x_axis: Name and unit of the columns.
        y_axis: Name and unit of the rows.
        count_name: Name of the counted items.
    """
    rows, columns = counts.shape
    axes = _Axes(x_low=float(x_edges[0]), x_high=float(x_edges[-1]), y_low=0.0, y_high=float(rows))
    width = (_WIDTH - _RIGHT - _LEFT) / columns
    highest = math.log1p(max(int(counts.max(initial=0)), 1))
    fields = [
        _tag(
            "rect",
            _title(str(int(counts[i, j]))),
            x=_LEFT + j * width,
            y=axes.y(i + 1),
            width=width,
            height=axes.y(i) - axes.y(i + 1),
            fill_opacity=f"{0.08 + 0.92 * math.log1p(int(counts[i, j])) / highest:.2f}",
        )
        for i, j in np.argwhere(counts > 0).tolist()
    ]
    frame = _tag("rect", x=_LEFT, y=_TOP, width=_WIDTH - _LEFT - _RIGHT, height=_HEIGHT - _TOP - _BOTTOM, fill="none")
    named_rows = range(0, rows + 1, max(1, round(rows / 5)))
    y_texts = [_text(_LEFT - 8, axes.y(i) + 4, _number_label(y_edges[i]), "end") for i in named_rows]
    middle = (_TOP + _HEIGHT - _BOTTOM) / 2
    name = _tag("text", escape(y_axis), x=12, y=middle, text_anchor="middle", transform=f"rotate(-90 12 {middle:.1f})")
    parts = [_with_grid([frame]), _with_colours("c0", fields), *y_texts, name, _x_axis(axes, x_axis)]
    return _svg(f"{count_name} by {x_axis} and {y_axis}", parts)


def write_chart(path: Path, svg: str) -> None:
    """Write a chart as an SVG file, on white.

    Raises:
        ReadygoError: If it cannot be written.
    """
    head = '<svg xmlns="http://www.w3.org/2000/svg" style="background:#fff" font-family="sans-serif" '
    write_whole(path, svg.replace("<svg ", head, 1) + "\n")


def nice_ticks(low: float, high: float) -> list[float]:
    """About five round numbers from at or above `low` to at or above `high`."""
    span = max(high - low, 1e-9)
    raw = span / 5
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(m * power for m in (1, 2, 2.5, 5, 10) if m * power >= raw * 0.999)
    first, last = math.ceil(low / step - 1e-9), math.ceil(high / step - 1e-9)
    return [k * step for k in range(first, last + 1)]


def log_ticks(low: float, high: float) -> list[float]:
    """Round numbers around an interval of a logarithmic axis: 1, 2, 5 of each decade, or decades if those are many.

    Args:
        low: Positive.
        high: At least `low`.

    Returns:
        Two or more; the first is at most `low`, the last at least `high`.
    """
    few = math.log10(high / low) < 2.5
    steps = (1.0, 2.0, 5.0) if few else (1.0,)
    decades = range(math.floor(math.log10(low)) - 1, math.ceil(math.log10(high)) + 2)
    ticks = [step * 10.0**k for k in decades for step in steps]
    first = max(k for k, tick in enumerate(ticks) if tick <= low * (1 + 1e-9))
    last = min(k for k, tick in enumerate(ticks) if tick >= high * (1 - 1e-9))
    return ticks[first : max(last, first + 1) + 1]


def number_text(value: float) -> str:
    """A number with about three digits."""
    if value != 0 and (abs(value) < 0.001 or abs(value) >= 1e9):
        return f"{value:.1e}"
    if abs(value) >= 1e6:
        return f"{value / 1e6:.3g}M"
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"


@dataclass(frozen=True, kw_only=True)
class _Axes:
    """Scales of a chart's axes: values to pixels."""

    x_low: float
    x_high: float
    y_low: float
    y_high: float
    log: bool = False
    """True for a logarithmic vertical axis."""
    top_px: float = _TOP
    right_px: float = _WIDTH - _RIGHT

    def x(self, value: float) -> float:
        return _LEFT + (value - self.x_low) / (self.x_high - self.x_low) * (self.right_px - _LEFT)

    def y(self, value: float) -> float:
        low, high = self.y_low, self.y_high
        if self.log:
            low, high, value = math.log(low), math.log(high), math.log(max(value, low))
        height_px = _HEIGHT - _BOTTOM - self.top_px
        return _HEIGHT - _BOTTOM - min((value - low) / max(high - low, 1e-12), 1.0) * height_px


def _y_axis(axes: _Axes, ticks: Sequence[float]) -> str:
    places = [(axes.y(tick), number_text(tick)) for tick in ticks]
    lines = [_tag("line", x1=_LEFT, x2=_WIDTH - _RIGHT, y1=y, y2=y) for y, _ in places]
    return _with_grid(lines) + "".join(_text(_LEFT - 7, y + 4, text, "end") for y, text in places)


def _x_axis(axes: _Axes, name: str) -> str:
    """Round numbers along the horizontal axis, and its name."""
    reach = axes.x_high + 1e-6 * (axes.x_high - axes.x_low)
    ticks = [tick for tick in nice_ticks(axes.x_low, axes.x_high) if tick <= reach]
    texts = [_text(axes.x(tick), _HEIGHT - 22, _number_label(tick)) for tick in ticks]
    return "".join([*texts, _text((_LEFT + axes.right_px) / 2, _HEIGHT - 4, name)])


def _line(axes: _Axes, curve: Curve) -> list[str]:
    """A curve above the band of its intervals; few points are dots, and a single one has a bar for its interval."""
    x_px = [axes.x(x) for x in curve.x.tolist()]
    y_px = [axes.y(y) for y in curve.y.tolist()]
    parts = []
    if curve.interval is not None:
        low_px, high_px = ([axes.y(y) for y in ends] for ends in curve.interval.tolist())
        outline = _points([*x_px, *reversed(x_px)], [*low_px, *reversed(high_px)])
        parts.append(_tag("polygon", points=outline, fill_opacity="0.15"))
        if len(x_px) == 1:
            parts.append(_tag("line", x1=x_px[0], x2=x_px[0], y1=low_px[0], y2=high_px[0], stroke="currentColor"))
    parts.append(_tag("polyline", points=_points(x_px, y_px), fill="none", stroke="currentColor", stroke_width=2))
    if len(x_px) <= _DOTS_MAX:
        parts += [_tag("circle", cx=x, cy=y, r=3.5) for x, y in zip(x_px, y_px, strict=True)]
    return parts


def _points(x_px: Sequence[float], y_px: Sequence[float]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(x_px, y_px, strict=True))


def _bar(axes: _Axes, x_px: float, width_px: float, count: int, name: str) -> str:
    y_px = axes.y(count)
    return _tag(
        "rect",
        _title(f"{name}: {count}"),
        x=x_px + 0.5,
        y=y_px,
        width=max(width_px - 1, 0.5),
        height=_HEIGHT - _BOTTOM - y_px,
    )


def _legend(curves: Sequence[Curve]) -> tuple[str, float]:
    """Names and last values of curves in rows above the plot, and where the plot begins [px]."""
    parts, x_px, y_px = [], float(_LEFT), _TOP + _ROW_PX
    for k, curve in enumerate(curves):
        text = f"{curve.name} {number_text(float(curve.y[-1]))}"
        width_px = 40 + _CHARACTER_PX * len(text)
        if x_px > _LEFT and x_px + width_px > _WIDTH:
            x_px, y_px = float(_LEFT), y_px + _ROW_PX
        swatch = _tag("rect", x=x_px, y=y_px - 6, width=18, height=4)
        parts += [_with_colours(f"c{k % CURVE_COUNT}", [swatch]), _text(x_px + 24, y_px, text, "start")]
        x_px += width_px
    return "".join(parts), y_px + 14


def _finite(curve: Curve) -> Curve:
    x, y = np.asarray(curve.x, dtype=np.float64), np.asarray(curve.y, dtype=np.float64)
    keep = np.isfinite(x) & np.isfinite(y)
    interval = None if curve.interval is None else curve.interval[:, keep]
    return Curve(name=curve.name, x=x[keep], y=y[keep], interval=interval)


def _number_label(value: float) -> str:
    return number_text(round(float(value), 6) + 0.0)


def _svg(label: str, parts: Sequence[str], *, size: tuple[int, int] = (_WIDTH, _HEIGHT), kind: str = "chart") -> str:
    return _tag(
        "svg",
        "".join(parts),
        class_=kind,
        viewBox=f"0 0 {size[0]} {size[1]}",
        font_size=13,
        fill="#5d6874",
        role="img",
        aria_label=escape(label),
    )


def _with_colours(kind: str, parts: Sequence[str]) -> str:
    """Elements in the colour of a class; empty without any."""
    colour = COLOURS[kind]
    return _tag("g", "".join(parts), class_=kind, color=colour, fill="currentColor") if parts else ""


def _with_grid(parts: Sequence[str]) -> str:
    return _tag("g", "".join(parts), class_="grid", stroke="#d9dee3")


def _text(x: float, y: float, text: str, anchor: str = "middle") -> str:
    return _tag("text", escape(text), x=x, y=y, text_anchor=anchor)


def _title(text: str) -> str:
    return _tag("title", escape(text))


def _tag(name: str, content: str = "", **attributes: str | float) -> str:
    """An element. Numbers have one decimal; names have a hyphen for each underscore but a trailing one."""
    texts = {
        key.rstrip("_").replace("_", "-"): value if isinstance(value, str) else f"{value:.1f}".removesuffix(".0")
        for key, value in attributes.items()
    }
    written = "".join(f' {key}="{text}"' for key, text in texts.items())
    return f"<{name}{written}>{content}</{name}>" if content else f"<{name}{written}/>"
