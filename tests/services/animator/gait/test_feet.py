import numpy as np
import pytest

from readygo.benchmarks.motion.paths import floor, line
from readygo.services.animator import skeleton_of
from readygo.services.animator.gait.quality import heights_above, joints_of, sole_points

SILL_M = 0.08


@pytest.mark.parametrize("place_m", np.arange(0.0, 0.8, 0.1).tolist())
def test_feet_swing_over_a_narrow_sill(place_m, avatar, animate):
    """Wherever in the stride a sill of 5 cm across the way lies, no foot sweeps through it."""
    sill = floor(lambda x, y: np.where(np.abs(x - place_m) < 0.025, SILL_M, 0.0), half_m=8.0, cell_m=0.05)
    motion = animate(line(1.2), sill)
    points = sole_points(*joints_of(motion, avatar), skeleton_of(avatar))
    heights = heights_above(points, sill)
    assert heights.min() > -0.03
