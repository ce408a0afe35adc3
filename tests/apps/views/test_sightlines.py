import math

import numpy as np
import pytest

from readygo.apps.views.sightlines import sight_m
from readygo.common.maps import GridFrame

FRAME = GridFrame(origin_x_m=-1.0, origin_y_m=-2.0, resolution_m=0.05)


def test_sight_ends_where_something_stands() -> None:
    opaque = np.zeros((100, 100), np.bool_)
    opaque[:, 60] = True
    seen_m = sight_m(opaque, FRAME, np.array([[1.0, 0.0]]), np.array([0.0, math.pi]), far_m=2.5)
    assert seen_m[0, 0] == pytest.approx(1.0, abs=0.06)
    assert seen_m[0, 1] == 2.5
