import math

from readygo.common.episode.straight_line import straight_line_command
from readygo.common.messages import Outcome
from readygo.common.robot import RobotConfig

ROBOT = RobotConfig()


def _run(simulation):
    while simulation.outcome is None:
        simulation.advance(*straight_line_command(simulation.goal_xy_robot_m, ROBOT))
    return simulation.outcome


def test_reaches_a_goal_behind_it(simulate):
    assert _run(simulate(start=(5.0, -1.0, 0.0), goal=(0.5, 0.5))) is Outcome.SUCCESS


def test_drives_into_what_stands_in_the_way(simulate):
    assert _run(simulate(start=(0.0, 1.0, 0.0), goal=(8.0, 1.0))) is Outcome.STATIC_COLLISION


def test_turns_in_place_towards_a_goal_at_its_side():
    assert straight_line_command((0.0, 3.0), ROBOT) == (0.0, ROBOT.w_max_radps)
    assert straight_line_command((0.0, -3.0), ROBOT) == (0.0, -ROBOT.w_max_radps)


def test_is_at_full_speed_only_when_it_looks_at_the_goal():
    assert straight_line_command((3.0, 0.0), ROBOT) == (ROBOT.v_max_mps, 0.0)
    slower, turning = straight_line_command((math.cos(0.3), math.sin(0.3)), ROBOT)
    assert 0 < slower < ROBOT.v_max_mps
    assert turning > 0
