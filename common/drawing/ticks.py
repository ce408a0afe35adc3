"""Round numbers along the axes of charts, and how they are written."""

import math


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
