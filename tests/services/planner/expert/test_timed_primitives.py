import numpy as np
import pytest

from readygo.common.robot import RobotConfig
from readygo.common.robot.kinematics import DT_S
from readygo.services.planner.expert.timed_primitives import make_timed_primitives

ROBOT = RobotConfig()


@pytest.fixture
def primitives():
    return make_timed_primitives(ROBOT)


def used(primitives):
    return range(int(primitives.table.first[-2]))


def test_commands_change_within_the_robots_limits_and_end_on_a_level(primitives):
    table, rules = primitives.table, primitives.rules
    groups = len(rules.v_levels) * primitives.turn_level_count
    for group in range(groups):
        v, w = rules.v_levels[group // primitives.turn_level_count], rules.w_levels[group % primitives.turn_level_count]
        for q in range(table.first[group], table.first[group + 1]):
            commands = np.vstack([(v, w), table.rows[q, :, 3:]])
            assert np.abs(np.diff(commands[:, 0])).max() <= ROBOT.a_max_mps2 * DT_S + 1e-9
            assert np.abs(np.diff(commands[:, 1])).max() <= ROBOT.alpha_max_radps2 * DT_S + 1e-9
            end = rules.v_levels[table.ends[q] // primitives.turn_level_count]
            assert commands[-1] == pytest.approx(
                (end, rules.w_levels[table.ends[q] % primitives.turn_level_count]), abs=1e-9
            )


def test_rows_are_arcs_of_their_commands_and_lengths_their_sums(primitives):
    table = primitives.table
    for q in list(used(primitives))[::7]:
        x, y, yaw, length = 0.0, 0.0, 0.0, 0.0
        for row in table.rows[q]:
            for _ in range(200):
                x, y = x + row[3] * DT_S / 200 * np.cos(yaw), y + row[3] * DT_S / 200 * np.sin(yaw)
                yaw += row[4] * DT_S / 200
            length += row[3] * DT_S
            assert row[:3] == pytest.approx((x, y, yaw), abs=2e-4)
        assert table.lengths_m[q] == pytest.approx(length)


def test_standing_still_costs_half_of_driving_and_turning_is_dearer(primitives):
    table, rules = primitives.table, primitives.rules
    straight = primitives.turn_level_count // 2
    still = next(q for q in range(table.first[straight], table.first[straight + 1]) if not table.rows[q, :, 3:].any())
    duration_s = primitives.steps * DT_S
    assert table.costs[still] == pytest.approx(0.5 * duration_s * ROBOT.v_max_mps)
    full = (len(rules.v_levels) - 1) * primitives.turn_level_count + straight
    costs = {tuple(np.round(table.rows[q, -1, 3:], 6)): table.costs[q] for q in range(*table.first[full : full + 2])}
    ahead = costs[(ROBOT.v_max_mps, 0.0)]
    assert ahead == pytest.approx(duration_s * ROBOT.v_max_mps)
    assert all(cost > ahead for (v, w), cost in costs.items() if v == ROBOT.v_max_mps and w != 0)


def test_root_begins_at_any_command(primitives):
    primitives.fill_root(0.37, -0.2)
    root = len(primitives.table.first) - 2
    begin, end = primitives.table.first[root : root + 2]
    assert end > begin
    firsts = primitives.table.rows[begin:end, 0, 3:]
    assert np.abs(firsts[:, 0] - 0.37).max() <= ROBOT.a_max_mps2 * DT_S + 1e-9
    assert np.abs(firsts[:, 1] + 0.2).max() <= ROBOT.alpha_max_radps2 * DT_S + 1e-9


def test_table_of_a_crooked_robot_is_as_it_was(golden_figures):
    robot = RobotConfig(
        control_hz=10, camera_hz=30, v_max_mps=0.9, v_min_mps=-0.4, w_max_radps=1.4, a_max_mps2=0.8,
        alpha_max_radps2=2.6,
    )  # fmt: skip
    primitives = make_timed_primitives(robot)
    primitives.fill_root(-0.17, 0.31)
    table, used = primitives.table, int(primitives.table.first[-1])
    golden_figures("expert/timed primitives", table.rows[:used], table.costs[:used], table.lengths_m[:used])
    golden_figures("expert/timed groups", table.first, scale=0.1)
    golden_figures("expert/timed ends", table.ends[:used], scale=0.1)
