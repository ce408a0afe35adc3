import math

import numpy as np
import pytest

from readygo.common.episode import GridSearch
from readygo.common.episode.grid_search import FREE
from readygo.common.maps import GridFrame
from readygo.common.robot import RobotConfig, step_unicycle
from readygo.services.planner.expert import hybrid_astar
from readygo.services.planner.expert.config import GEAR_COST_M, GOAL_TOLERANCE_M, PRIMITIVE_S, REVERSE_COST
from readygo.services.planner.expert.hybrid_astar import TURN_COST_M, HybridAStar, make_primitives

FRAME = GridFrame(origin_x_m=-2.0, origin_y_m=-2.0, resolution_m=0.05)
ROBOT = RobotConfig()


@pytest.fixture
def field():
    return np.full((160, 200), FREE, np.uint8)


def _plan(factor, start, goal, **options):
    goal = np.array(goal, float)
    heuristic = GridSearch(factor.shape).distances(factor, FRAME.cell(*goal))
    return HybridAStar(ROBOT).search(factor, heuristic, FRAME, start, goal, **options)


def test_nine_primitives_of_three_speeds_and_three_turn_rates():
    primitives = make_primitives(ROBOT)
    ends = primitives.offsets[np.arange(9), primitives.sample_counts - 1]
    assert sorted(set(np.round(primitives.speeds_mps, 6))) == pytest.approx([1 / 3, 2 / 3, 1])
    assert sorted(np.round(ends[:, 2], 6)) == pytest.approx([-0.6] * 3 + [0.0] * 3 + [0.6] * 3)
    arcs = np.diff(primitives.offsets, axis=1, prepend=0)
    lengths = [np.hypot(*arcs[p, :n, :2].T).sum() for p, n in enumerate(primitives.sample_counts)]
    assert lengths == pytest.approx(primitives.speeds_mps * 0.5, rel=1e-3)


def test_free_ground_gives_the_straight_line_at_full_speed(field):
    plan = _plan(field, (0.0, 0.0, 0.0), (5.0, 0.0))
    assert np.abs(plan.xyyaw[:, 1]).max() < 1e-9
    assert set(plan.speed_mps) == {1.0}
    assert np.hypot(*(plan.xyyaw[-1, :2] - (5.0, 0.0))) < GOAL_TOLERANCE_M


def test_path_is_continuous_and_can_be_driven(field):
    field[40:90, 70:80] = 0
    plan = _plan(field, (0.0, 0.5, 0.3), (5.0, 0.5))
    steps = np.diff(plan.xyyaw, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    assert lengths.max() < 0.06
    turns = np.abs((steps[:, 2] + math.pi) % (2 * math.pi) - math.pi)
    assert (turns <= ROBOT.w_max_radps * lengths / plan.speed_mps[1:] * 1.05 + 1e-6).all()


def test_path_stays_off_blocked_cells(field):
    field[:100, 80] = 0
    plan = _plan(field, (0.0, 0.0, 0.0), (5.0, 0.0))
    cells = np.floor((plan.xyyaw[:, :2] - (FRAME.origin_x_m, FRAME.origin_y_m)) / 0.05).astype(int)
    assert (field[cells[:, 1], cells[:, 0]] > 0).all()
    assert plan.xyyaw[:, 1].max() > 3.0


def test_dear_ground_is_avoided_when_the_detour_is_cheaper(field):
    field[60:, :] = FREE
    field[30:50, 60:120] = 40
    plan = _plan(field, (0.0, 0.0, 0.0), (6.0, 0.0))
    cells = np.floor((plan.xyyaw[:, :2] - (FRAME.origin_x_m, FRAME.origin_y_m)) / 0.05).astype(int)
    assert (field[cells[:, 1], cells[:, 0]] == 40).mean() < 0.05


def test_enclosed_goal_has_no_plan(field):
    field[30:60, 120] = field[30:60, 150] = 0
    field[30, 120:151] = field[59, 120:151] = 0
    assert _plan(field, (0.0, 0.0, 0.0), (4.7, 0.2)) is None


def test_goal_behind_is_reached_forwards_or_after_a_turn(field):
    forwards = _plan(field, (2.0, 2.0, 0.0), (-1.0, 2.0))
    turned = _plan(field, (2.0, 2.0, 0.0), (-1.0, 2.0), turn_first=True)
    assert abs(forwards.xyyaw[0, 2]) < 1e-9
    assert abs(turned.xyyaw[0, 2]) > 1.0
    assert turned.cost < forwards.cost


@pytest.mark.parametrize("bearing_deg", [75, 90, 120, 165])
def test_turn_at_the_start_costs_its_angle_either_way(field, bearing_deg):
    """Turning right costs what turning left costs: it turns into a corridor that is too narrow for arcs, 1.5 m long."""
    costs = []
    rows, columns = np.indices(field.shape)
    x, y = (FRAME.origin_x_m + 0.05 * (columns + 0.5) - 2.0, FRAME.origin_y_m + 0.05 * (rows + 0.5) - 2.0)
    for side in (1, -1):
        bearing = 0.7 + side * math.radians(bearing_deg)
        goal = (2.0 + 1.5 * math.cos(bearing), 2.0 + 1.5 * math.sin(bearing))
        along, beside = x * math.cos(bearing) + y * math.sin(bearing), y * math.cos(bearing) - x * math.sin(bearing)
        field[:] = np.where((along > -0.2) & (abs(beside) < 0.12), FREE, 0)
        plan = _plan(field, (2.0, 2.0, 0.7), goal, turn_first=True)
        turned = (plan.xyyaw[0, 2] - 0.7 + math.pi) % (2 * math.pi) - math.pi
        assert turned * side > 0
        costs.append(plan.cost)
        assert plan.cost == pytest.approx(TURN_COST_M * math.radians(bearing_deg) + 1.5, abs=0.4)
    assert costs[0] == pytest.approx(costs[1], rel=0.2)


@pytest.mark.parametrize("turn_first", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_cost_of_a_path_is_that_of_its_primitives_on_its_ground(seed, turn_first, monkeypatch):
    """Recomputed from poses and speeds, on an oblong patchwork of factors, for a robot that reverses."""
    rng = np.random.default_rng(seed)
    frame = GridFrame(origin_x_m=3.7, origin_y_m=-5.1, resolution_m=0.07)
    robot = RobotConfig(v_max_mps=0.9, v_min_mps=-0.6, w_max_radps=1.1)
    monkeypatch.setattr(hybrid_astar, "STEERING_COST", 0.31)
    monkeypatch.setattr(hybrid_astar, "SLOW_COST", 0.17)
    patches = rng.integers(FREE, 3 * FREE, (9, 13)).astype(np.uint8)
    patches[rng.random(patches.shape) < 0.15] = 0
    patches[[1, 7], [1, 11]] = FREE
    factor = np.repeat(np.repeat(patches, 8, axis=0), 8, axis=1)
    start, goal = (4.4, -4.2, 2.5), np.array([10.1, -0.9])
    heuristic = GridSearch(factor.shape).distances(factor, frame.cell(*goal))
    plan = HybridAStar(robot).search(factor, heuristic, frame, start, goal, turn_first=turn_first)
    first_turn = abs((plan.xyyaw[0, 2] - start[2] + math.pi) % (2 * math.pi) - math.pi)
    assert turn_first or first_turn < 1e-9
    cost, at, gear = TURN_COST_M * first_turn, 0, 0.0
    duration_s = max(PRIMITIVE_S, 0.35 / robot.w_max_radps)
    while at < len(plan.xyyaw) - 1:
        v = plan.speed_mps[at + 1]
        count = math.ceil(abs(v) * duration_s / 0.05 - 1e-9)
        rows = plan.xyyaw[at + 1 : at + 1 + count]
        turned = (rows[-1, 2] - plan.xyyaw[at, 2] + math.pi) % (2 * math.pi) - math.pi
        w = turned / duration_s
        assert min(abs(w - u) for u in (-robot.w_max_radps, 0.0, robot.w_max_radps)) < 1e-9
        ends = step_unicycle(*plan.xyyaw[at].tolist(), v, w, duration_s)
        assert rows[-1] == pytest.approx((*ends[:2], rows[-1, 2]), abs=1e-9)
        cells = np.floor((rows[:, :2] - (frame.origin_x_m, frame.origin_y_m)) / frame.resolution_m).astype(int)
        factors = factor[cells[:, 1], cells[:, 0]]
        assert factors.min() > 0
        per_s = (
            abs(v) + 0.31 * abs(v) * (abs(w) > 1e-9) + 0.17 * (robot.v_max_mps - abs(v)) + REVERSE_COST * max(-v, 0.0)
        )
        cost += per_s * duration_s * factors.mean() / FREE + GEAR_COST_M * (gear * v < 0)
        at, gear = at + count, v
    assert plan.cost == pytest.approx(cost)


def test_corridor_too_narrow_for_an_arc_needs_a_turn(field):
    field[:] = 0
    field[38:42, :] = FREE
    assert _plan(field, (2.0, 0.0, 0.0), (-1.0, 0.0)) is None
    assert _plan(field, (2.0, 0.0, 0.0), (-1.0, 0.0), turn_first=True) is not None


def test_searches_do_not_disturb_each_other(field):
    search, planner = GridSearch(field.shape), HybridAStar(ROBOT)
    goals = [np.array(goal) for goal in ((5.0, 0.5), (-1.0, 3.0), (5.0, 0.5))]
    plans = [planner.search(field, search.distances(field, FRAME.cell(*g)), FRAME, (0.0, 0.0, 1.0), g) for g in goals]
    assert np.array_equal(plans[0].xyyaw, plans[2].xyyaw)
    assert plans[0].cost == plans[2].cost


def test_robots_with_wide_turns_come_round_in_the_open():
    robot = RobotConfig(v_max_mps=0.5, w_max_radps=0.1)  # 5 m at full speed
    factor = np.full((600, 600), FREE, np.uint8)
    search, goal = HybridAStar(robot), np.array([13.0, 13.0])
    heuristic = GridSearch(factor.shape).distances(factor, FRAME.cell(*goal))
    for yaw in np.linspace(-math.pi, math.pi, 8):
        start = (13.0 - 4.0 * math.cos(yaw / 3), 13.0 - 4.0 * math.sin(yaw / 3), float(yaw))
        plan = search.search(factor, heuristic, FRAME, start, goal)
        assert plan is not None
        assert np.hypot(*(plan.xyyaw[-1, :2] - goal)) < GOAL_TOLERANCE_M
        assert search.expansion_count < 2000
