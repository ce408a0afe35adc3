import dataclasses
import io
import itertools
import json
import math

import numpy as np
import pytest
from rich.console import Console

from readygo.common.errors import PolicyError, SceneError
from readygo.common.messages import Outcome, RobotPlanReply, Split
from readygo.common.robot import RobotConfig
from readygo.services.evaluator import (
    EvaluateRequest,
    Evaluator,
    Method,
    Task,
    handle_evaluate,
    summary_mapping,
    summary_table,
    write_results,
)
from tests.services.evaluator.conftest import ROBOT, GoalSeeker


def pick(reply, task, method):
    return [record for record in reply.records if (record.task, record.method) == (task, method)]


def test_every_method_drives_the_same_episodes(make_evaluator):
    reply = handle_evaluate(make_evaluator(), EvaluateRequest(episodes=3))
    assert len(reply.records) == 2 * 3 * 3
    for task in Task:
        for method in Method:
            assert [record.episode.index for record in pick(reply, task, method)] == [0, 2, 4]
    assert {record.episode.split for record in reply.records} == {Split.TEST}


def test_rejected_scenarios_are_skipped_and_counted(make_evaluator):
    assert handle_evaluate(make_evaluator(), EvaluateRequest(episodes=3)).skipped == 2


def test_indices_do_not_depend_on_the_tasks_asked_for(make_evaluator):
    for task in Task:
        reply = handle_evaluate(make_evaluator(), EvaluateRequest(tasks=(task,), episodes=3))
        assert sorted({record.episode.index for record in reply.records}) == [0, 2, 4]


def test_expert_failures_do_not_remove_an_episode(make_evaluator, services):
    services.expert = lambda request: RobotPlanReply(episode=request.scenario.episode, rejected="no path")
    reply = handle_evaluate(make_evaluator(), EvaluateRequest(tasks=(Task.STATIC,), episodes=3))
    records = pick(reply, Task.STATIC, Method.EXPERT)
    assert [record.result.outcome for record in records] == [Outcome.TIMEOUT] * 3
    assert [record.result.duration_s for record in records] == [50.0] * 3


def test_outcomes_follow_the_map(make_evaluator):
    reply = handle_evaluate(make_evaluator(), EvaluateRequest(tasks=(Task.STATIC,), episodes=3))
    for method in (Method.POLICY, Method.STRAIGHT_LINE):
        outcomes = [record.result.outcome for record in pick(reply, Task.STATIC, method)]
        assert outcomes == [Outcome.SUCCESS, Outcome.SUCCESS, Outcome.STATIC_COLLISION]


def test_straight_line_reaches_the_goal_in_the_time_that_its_limits_allow(make_evaluator):
    request = EvaluateRequest(tasks=(Task.STATIC,), methods=(Method.STRAIGHT_LINE,), episodes=1)
    result = handle_evaluate(make_evaluator(), request).records[0].result
    # 4 m to the circle of success, half a second lost in speeding up to 1 m/s at 1 m/s2.
    assert result.duration_s == pytest.approx(4.5, abs=0.1)
    assert result.path_length_m == pytest.approx(4.0, abs=0.1)
    assert result.shortest_m == pytest.approx(4.0, abs=0.1)


def test_result_does_not_depend_on_the_lockstep(make_evaluator):
    request = EvaluateRequest(episodes=6, methods=(Method.POLICY,))
    alone = handle_evaluate(make_evaluator(lockstep=1), request)
    together = handle_evaluate(make_evaluator(lockstep=4), request)
    assert alone.records == together.records


def test_views_of_running_episodes_share_a_request(make_evaluator, services):
    request = EvaluateRequest(tasks=(Task.STATIC,), methods=(Method.POLICY,), episodes=3)
    handle_evaluate(make_evaluator(lockstep=3), request)
    assert len(services.render_requests[0].views) == 3
    assert max(len(request.views) for request in services.render_requests) == 3


def test_camera_stands_on_the_floor_at_the_robot(make_evaluator, services):
    handle_evaluate(make_evaluator(), EvaluateRequest(tasks=(Task.STATIC,), methods=(Method.POLICY,), episodes=1))
    first = services.render_requests[0].views[0]
    assert first.step == 0
    assert first.T_world_camera[:3, 3].tolist() == pytest.approx([1.0, 1.0, 0.75])
    assert services.render_requests[7].views[0].step == 7


def test_view_names_its_episode_and_where_the_robot_came_from(make_evaluator, services):
    handle_evaluate(make_evaluator(), EvaluateRequest(tasks=(Task.STATIC,), methods=(Method.POLICY,), episodes=1))
    views = [request.views[0] for request in services.render_requests]
    assert {view.episode.index for view in views} == {0}
    assert [len(view.path_xyyaw) for view in views[:5]] == [1, 2, 3, 3, 3]
    for before, now in itertools.pairwise(views):
        assert now.path_xyyaw[-2] == before.path_xyyaw[-1]
        assert now.path_xyyaw[-1][0] == now.T_world_camera[0, 3]


def test_policy_sees_the_image_of_the_cameras_latency_ago(make_evaluator, services):
    robot = dataclasses.replace(ROBOT, camera=dataclasses.replace(ROBOT.camera, latency_s=0.15))
    request = EvaluateRequest(tasks=(Task.STATIC,), methods=(Method.POLICY,), episodes=1)
    handle_evaluate(make_evaluator(robot=robot, policy=GoalSeeker(robot)), request)
    views = [request.views[0] for request in services.render_requests]
    assert [view.step for view in views[:6]] == [0, 0, 0, 0, 1, 2]
    assert views[0].T_world_camera[0, 3] == views[3].T_world_camera[0, 3] == 1.0
    assert 1.0 < views[9].T_world_camera[0, 3] == views[9].path_xyyaw[-1][0]
    assert views[9].path_xyyaw[-2] == views[8].path_xyyaw[-1]


def test_people_travel_once(make_evaluator, services):
    request = EvaluateRequest(tasks=(Task.DYNAMIC,), methods=(Method.POLICY,), episodes=2)
    handle_evaluate(make_evaluator(), request)
    sent = [people.key for request in services.render_requests for people in request.people]
    assert len(sent) == len(set(sent)) == 2
    assert all(view.people for request in services.render_requests for view in request.views)


def test_static_task_draws_nobody(make_evaluator, services):
    request = EvaluateRequest(tasks=(Task.STATIC,), methods=(Method.POLICY,), episodes=2)
    reply = handle_evaluate(make_evaluator(), request)
    assert {view.people for request in services.render_requests for view in request.views} == {""}
    assert all(math.isinf(record.human_distance_min_m) for record in reply.records)


def test_people_that_the_renderer_forgot_are_sent_again(make_evaluator, services):
    request = EvaluateRequest(tasks=(Task.DYNAMIC,), methods=(Method.POLICY,), episodes=2)
    expected = handle_evaluate(make_evaluator(), request)
    services.render_requests.clear()
    services.forget_once = True
    assert handle_evaluate(make_evaluator(), request).records == expected.records


def test_nearest_human_is_recorded(make_evaluator):
    request = EvaluateRequest(tasks=(Task.DYNAMIC,), methods=(Method.STRAIGHT_LINE,), episodes=1)
    record = handle_evaluate(make_evaluator(), request).records[0]
    # The walker comes down to (3, 4) and stays; the robot passes at y = 1.
    assert record.human_distance_min_m == pytest.approx(3.0, abs=0.05)


def test_scene_that_yields_no_episode_is_named(make_evaluator, services):
    services.reject_all = True
    with pytest.raises(SceneError, match="no way to the goal"):
        handle_evaluate(make_evaluator(rejected_max=20), EvaluateRequest(episodes=1))
    assert len(services.requests) == 20


def test_policy_of_another_camera_is_refused(make_evaluator):
    policy = make_evaluator().policy.__class__(RobotConfig())
    with pytest.raises(PolicyError, match=r"height_px 144 \(the robot's: 8\)"):
        make_evaluator(policy=policy)
    assert make_evaluator(policy=policy, camera="robot").policy is policy


def test_method_policy_needs_a_policy(make_evaluator):
    evaluator = make_evaluator()
    without = Evaluator(
        bus=evaluator.bus, robot=evaluator.robot, robot_map=evaluator.robot_map, floor=evaluator.floor, policy=None
    )
    with pytest.raises(PolicyError, match="No policy"):
        handle_evaluate(without, EvaluateRequest(episodes=1))


def test_requests_without_sense_are_refused():
    for wrong in ({"episodes": 0}, {"tasks": ()}, {"methods": (Method.EXPERT, Method.EXPERT)}):
        with pytest.raises(ValueError, match=r"evaluation|repeat"):
            EvaluateRequest(**wrong)


def test_every_ended_episode_is_reported(make_evaluator):
    reported = []
    reply = handle_evaluate(make_evaluator(), EvaluateRequest(episodes=2), report=reported.append)
    assert sorted(map(str, reported)) == sorted(map(str, reply.records))


def test_results_are_written_as_records_and_summary(make_evaluator, tmp_path):
    reply = handle_evaluate(make_evaluator(), EvaluateRequest(episodes=3))
    write_results(tmp_path / "out", reply.records, summary_mapping(reply.summaries))
    lines = [json.loads(line) for line in (tmp_path / "out" / "episodes.jsonl").read_text().splitlines()]
    assert len(lines) == 18
    assert lines[0]["episode"] == "test-0-000000"
    assert lines[0]["human_distance_min_m"] is None
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["static"]["straight-line"]["success_rate"] == pytest.approx(2 / 3)
    assert summary["static"]["straight-line"]["static_collision_rate"] == pytest.approx(1 / 3)
    assert summary["static"]["expert"]["art_s"] == pytest.approx(5.0)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["episodes.jsonl", "summary.json"]


def test_table_shows_rates_and_interval(make_evaluator):
    reply = handle_evaluate(make_evaluator(), EvaluateRequest(episodes=3, tasks=(Task.STATIC,)))
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(summary_table(reply.summaries))
    text = console.export_text()
    assert "straight-line" in text
    assert "66.7" in text
    assert np.all([name in text for name in ("SR %", "95 %", "ART s", "SPL", "late %")])
