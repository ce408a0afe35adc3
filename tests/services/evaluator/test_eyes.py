import dataclasses
import itertools
import math
from typing import ClassVar

import numpy as np
import pytest

from readygo.common.episode.goal import goal_pose
from readygo.common.messages import Split
from readygo.services.evaluator import (
    POLICY,
    EvaluateRequest,
    Task,
    handle_evaluate,
)
from tests.common.policy.artifacts import graph_seeing
from tests.services.evaluator.conftest import ROBOT, GoalSeeker


def test_camera_stands_on_the_floor_at_the_robot(make_evaluator, services):
    handle_evaluate(make_evaluator(), EvaluateRequest(tasks=(Task.STATIC,), methods=(POLICY,), episodes=1))
    first = services.render_requests[0].views[0]
    assert first.step == 0
    assert first.T_world_camera[:3, 3].tolist() == pytest.approx([1.0, 1.0, 0.75])
    assert services.render_requests[7].views[0].step == 7


def test_view_names_its_episode_and_where_the_robot_came_from(make_evaluator, services):
    handle_evaluate(make_evaluator(), EvaluateRequest(tasks=(Task.STATIC,), methods=(POLICY,), episodes=1))
    views = [request.views[0] for request in services.render_requests]
    assert {view.episode.index for view in views} == {0}
    assert [len(view.path_xyyaw) for view in views[:5]] == [1, 2, 3, 3, 3]
    for before, now in itertools.pairwise(views):
        assert now.path_xyyaw[-2] == before.path_xyyaw[-1]
        assert now.path_xyyaw[-1][0] == now.T_world_camera[0, 3]


def test_policy_sees_the_image_of_the_cameras_latency_ago(make_evaluator, services):
    robot = dataclasses.replace(ROBOT, camera=dataclasses.replace(ROBOT.camera, latency_s=0.15))
    request = EvaluateRequest(tasks=(Task.STATIC,), methods=(POLICY,), episodes=1)
    handle_evaluate(make_evaluator(robot=robot, policy=GoalSeeker(robot)), request)
    views = [request.views[0] for request in services.render_requests]
    assert [view.step for view in views[:6]] == [0, 0, 0, 0, 1, 2]
    assert views[0].T_world_camera[0, 3] == views[3].T_world_camera[0, 3] == 1.0
    assert 1.0 < views[9].T_world_camera[0, 3] == views[9].path_xyyaw[-1][0]
    assert views[9].path_xyyaw[-2] == views[8].path_xyyaw[-1]


def test_humans_travel_once(make_evaluator, services):
    request = EvaluateRequest(tasks=(Task.DYNAMIC,), methods=(POLICY,), episodes=2)
    handle_evaluate(make_evaluator(), request)
    sent = [people.key for request in services.render_requests for people in request.people]
    assert len(sent) == len(set(sent)) == 2
    assert all(view.people for request in services.render_requests for view in request.views)


def test_static_task_draws_nobody(make_evaluator, services):
    request = EvaluateRequest(tasks=(Task.STATIC,), methods=(POLICY,), episodes=2)
    reply = handle_evaluate(make_evaluator(), request)
    assert {view.people for request in services.render_requests for view in request.views} == {""}
    assert all(math.isinf(record.human_distance_min_m) for record in reply.records)


def test_humans_that_the_renderer_forgot_are_sent_again(make_evaluator, services):
    request = EvaluateRequest(tasks=(Task.DYNAMIC,), methods=(POLICY,), episodes=2)
    expected = handle_evaluate(make_evaluator(), request)
    services.render_requests.clear()
    services.forget_once = True
    assert handle_evaluate(make_evaluator(), request).records == expected.records


def test_policy_that_sees_depths_is_shown_what_its_camera_measures_of_them(make_evaluator, services):
    class SeesDepths(GoalSeeker):
        levels: ClassVar[list] = []

        def see(self, memories, images):
            self.levels.append(images[0, ..., 3])
            super().see(memories, images)

    robot = dataclasses.replace(ROBOT, camera=dataclasses.replace(ROBOT.camera, depth_max_m=8.0, depth_lost=0.5))
    policy = SeesDepths(robot)
    policy.spec = dataclasses.replace(policy.spec, graph=graph_seeing(("rgb", "depth")))
    request = EvaluateRequest(tasks=(Task.STATIC,), methods=(POLICY,), episodes=1)
    handle_evaluate(make_evaluator(robot=robot, policy=policy), request)
    assert {asked.outputs for asked in services.render_requests} == {("depth",)}
    assert set(np.unique(policy.levels)) <= {0, 191, 192}
    assert len(np.unique(policy.levels)) == 2
    assert not np.array_equal(policy.levels[0], policy.levels[1])


def test_views_follow_the_clock_of_a_robot_of_other_rates(make_evaluator, services):
    camera = dataclasses.replace(ROBOT.camera, latency_s=0.1)
    robot = dataclasses.replace(ROBOT, camera=camera, control_hz=30, camera_hz=10)
    request = EvaluateRequest(tasks=(Task.STATIC,), methods=(POLICY,), episodes=1)
    handle_evaluate(make_evaluator(robot=robot, policy=GoalSeeker(robot)), request)
    views = [asked.views[0] for asked in services.render_requests]
    # An image every third step, which the policy has three steps later.
    assert [view.step for view in views[:6]] == [0, 0, 3, 6, 9, 12]
    assert [len(view.path_xyyaw) for view in views[:5]] == [1, 1, 4, 4, 4]
    assert views[4].path_xyyaw[0] == views[3].path_xyyaw[3]
    assert views[4].path_xyyaw[3][0] == views[4].T_world_camera[0, 3]


def test_goal_is_looked_at_from_where_the_robot_arrives(make_evaluator, services):
    evaluator = make_evaluator()
    (episode,), _ = evaluator.source().draw(seed=0, split=Split.TEST, count=1, tasks=(Task.STATIC,))
    simulation = evaluator.simulation(episode)
    image = evaluator.eyes().goal_image(simulation)
    assert image.shape == (ROBOT.camera.height_px, ROBOT.camera.width_px, 3)
    (view,) = services.render_requests[0].views
    pose = goal_pose(simulation.scenario, simulation.robot_map, ROBOT.planning_radius_m)
    assert (view.people, view.step, view.episode) == ("", 0, simulation.scenario.episode)
    assert view.T_world_camera == pytest.approx(ROBOT.camera.T_world_camera(*pose, evaluator.floor.at(*pose[:2])))
