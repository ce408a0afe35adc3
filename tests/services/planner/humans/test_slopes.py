import numpy as np

from readygo.common.maps import FloorMap, OccupancyMap
from readygo.services.planner.humans.slopes import without_slopes
from tests.services.planner.worlds import FRAME


def test_floor_steeper_than_allowed_is_blocked_on_either_axis():
    rows, columns = np.mgrid[0:200, 0:240]
    for height in (0.05 * 0.4 * np.maximum(columns - 120, 0), 0.05 * 0.4 * np.maximum(rows - 100, 0)):
        floor = FloorMap(frame=FRAME, height_m=height.astype(np.float32))
        flat = OccupancyMap(frame=FRAME, occupied=np.zeros((200, 240), np.bool_))
        blocked = without_slopes(flat, floor, 0.3).occupied
        assert blocked[150, 180]
        assert not blocked[50, 60]
        assert not without_slopes(flat, floor, 0.5).occupied.any()
        assert without_slopes(flat, floor, 0.0) is flat
