import numpy as np

from readygo.common.maps import FloorMap, OccupancyMap
from readygo.common.messages import HumanPlanRequest
from readygo.services.planner import handle_human_plan
from readygo.services.planner.humans.slopes import without_slopes
from tests.services.planner.worlds import FRAME, hall, key, planner_of


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


def test_nobody_walks_over_a_step_or_a_steep_slope_if_floors_are_looked_at():
    height = np.zeros((200, 240), np.float32)
    height[:, 120:] = 0.2
    free = planner_of("parallel", occupancy=hall(), height_m=height, people=(1, 1))
    careful = planner_of("parallel", occupancy=hall(), height_m=height, people=(1, 1), slope_max=0.35)
    over = {}
    for name, planner in (("free", free), ("careful", careful)):
        replies = [handle_human_plan(planner, HumanPlanRequest(episode=key(index))) for index in range(20)]
        walks = [reply.scenario.humans[0].xy_m for reply in replies if reply.scenario is not None]
        over[name] = [float(xy[:, 0].min()) < 3.0 < float(xy[:, 0].max()) for xy in walks]
    assert any(over["free"])
    assert over["careful"]
    assert not any(over["careful"])


def test_gentle_ramps_are_walked():
    height = np.tile(np.arange(240, dtype=np.float32) * 0.05 * 0.1, (200, 1))
    planner = planner_of("parallel", occupancy=hall(), height_m=height, slope_max=0.35)
    assert np.array_equal(planner.human_map.occupied, hall().occupied)
