"""Sections of ranges: what differs from episode to episode."""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Range = tuple[float, ...]
"""(lowest, highest), or () for what does not differ."""


@dataclass(frozen=True, kw_only=True)
class Ranges:
    """A section whose every field is a `Range`; what is drawn is uniform over it."""

    def items(self) -> list[tuple[str, Range]]:
        """Names and ranges, in the order in which they are drawn."""
        return [(entry.name, getattr(self, entry.name)) for entry in dataclasses.fields(self)]

    @property
    def varies(self) -> bool:
        """True if there is a range."""
        return any(ends for _, ends in self.items())

    def drawn_values(self, rng: np.random.Generator) -> dict[str, float]:
        """One episode's values, by name; those without a range are left out.

        One number is drawn per name, whether it has a range or not, so that a range more changes no other value.
        """
        shares = [rng.random() for _ in self.items()]
        return {
            name: ends[0] + (ends[1] - ends[0]) * share
            for (name, ends), share in zip(self.items(), shares, strict=True)
            if ends
        }

    def check(self, check_value: Callable[[str, float], object]) -> None:
        """Raise ValueError unless every range is one, and `check_value` takes its ends."""
        for name, ends in self.items():
            if len(ends) not in (0, 2) or any(not math.isfinite(end) for end in ends) or list(ends) != sorted(ends):
                raise ValueError(f"{name} must be [lowest, highest], got {list(ends)}.")
            for end in ends:
                check_value(name, end)
