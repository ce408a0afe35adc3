"""Where a robot gets in a flat that is being furnished."""

import numpy as np
from scipy import ndimage

from readygo.common.arrays import BoolArray, Float64Array
from readygo.common.scenes.embedded.plan import FloorPlan

ROBOT_RADIUS_M = 0.35
_LOST_M2 = 0.1
"""What a piece of furniture may cut off from the rest of the floor."""
_CELL_M = 0.05
_STANDING_M = (0.06, 1.8)
"""Heights between which something is in the way; rugs lie below."""


class FreeFloor:
    """Where the middle of a robot may be, as one connected piece of floor."""

    def __init__(self, plan: FloorPlan, position_m: Float64Array) -> None:
        """The floor between what stands there already.

        Args:
            plan: The flat's.
            position_m: Points on walls and furniture, in the plan's axes, shape (N, 3).
        """
        low, high = np.array(plan.low_m), np.array(plan.high_m)
        standing = (position_m[:, 2] > _STANDING_M[0]) & (position_m[:, 2] < _STANDING_M[1])
        shape = np.rint((high - low) / _CELL_M).astype(int)
        cells = np.floor((position_m[standing, :2] - low) / _CELL_M).astype(int)
        cells = cells[((cells >= 0) & (cells < shape)).all(axis=1)]
        clear = np.ones(shape, dtype=bool)
        clear[cells[:, 0], cells[:, 1]] = False
        self._distance_m = ndimage.distance_transform_edt(clear) * _CELL_M
        axes = [a + (np.arange(n) + 0.5) * _CELL_M for a, n in zip(low, shape, strict=True)]
        self._x, self._y = np.meshgrid(*axes, indexing="ij")
        self._free = _parts(self._distance_m > ROBOT_RADIUS_M)[0]

    @property
    def area_m2(self) -> float:
        """Area of that piece of floor [m2]."""
        return float(self._free.sum()) * _CELL_M**2

    def take_disc(self, x_m: float, y_m: float, radius_m: float) -> bool:
        """Take a disc if it is free, and cuts nothing off; False if not."""
        away_m = np.hypot(self._x - x_m, self._y - y_m)
        if self._distance_m[np.unravel_index(away_m.argmin(), away_m.shape)] < radius_m:
            return False
        return self._take(away_m, radius_m)

    def take_box(self, low_m: tuple[float, float], high_m: tuple[float, float]) -> bool:
        """Take a rectangle if that cuts nothing off; False if not."""
        dx = np.maximum(np.maximum(low_m[0] - self._x, self._x - high_m[0]), 0.0)
        dy = np.maximum(np.maximum(low_m[1] - self._y, self._y - high_m[1]), 0.0)
        # Rounded, because the last bits of hypot differ between machines.
        return self._take(np.round(np.hypot(dx, dy), 6), 0.0)

    def _take(self, away_m: Float64Array, reach_m: float) -> bool:
        left = _parts(self._free & (away_m > reach_m + ROBOT_RADIUS_M))
        if not left or sum(part.sum() for part in left[1:]) * _CELL_M**2 > _LOST_M2:
            return False
        self._free, self._distance_m = left[0], np.minimum(self._distance_m, away_m - reach_m)
        return True


def _parts(free: BoolArray) -> list[BoolArray]:
    """Connected parts, the largest first."""
    labels, count = ndimage.label(free)
    return sorted((labels == k for k in range(1, count + 1)), key=np.sum, reverse=True)
