import dataclasses
from types import SimpleNamespace

import numpy as np

from readygo.apps.run.config import RunConfig
from readygo.apps.run.evaluation import evaluation_world, make_evaluator
from readygo.apps.run.goals import goal_pose, goal_seen
from readygo.common.camera import CameraConfig
from readygo.common.messages import Split
from readygo.common.robot import RobotConfig
from readygo.services.evaluator import Task
from readygo.services.evaluator.goal_image import goal_image


def test_policy_that_is_recorded_with_sees_its_goal_as_in_an_evaluation() -> None:
    robot = RobotConfig(camera=CameraConfig(height_px=24, width_px=40))
    world = evaluation_world("embedded", dataclasses.replace(RunConfig(), robot=robot), avatars=None, seed=0)
    renderer = world.renderer()
    evaluator = make_evaluator(world, renderer=renderer, methods={})
    (episode,), _ = evaluator.source().draw(seed=0, split=Split.TEST, count=1, tasks=(Task.DYNAMIC,))
    simulation = evaluator.simulation(episode)
    wants = SimpleNamespace(spec=SimpleNamespace(wants_goal_image=True))
    seen = goal_seen(wants, renderer, simulation)  # type: ignore[arg-type]
    assert seen is not None
    np.testing.assert_array_equal(seen, goal_image(evaluator.eyes(("rgb",)), simulation))
    x_m, y_m, _ = goal_pose(simulation.scenario, simulation.robot_map, robot.planning_radius_m)
    assert [x_m, y_m] == simulation.scenario.goal_xy_m.tolist()
    wants.spec.wants_goal_image = False
    assert goal_seen(wants, renderer, simulation) is None  # type: ignore[arg-type]
