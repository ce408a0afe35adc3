import dataclasses

import numpy as np
import pytest

from readygo.common.episode.loop import DriverFailure
from readygo.common.errors import PolicyError, RunError
from readygo.common.messages import Outcome, Split, topics
from readygo.common.robot import Clock, RobotConfig
from readygo.services.evaluator import (
    EXPERT,
    POLICY,
    STRAIGHT_LINE,
    Category,
    EvaluateRequest,
    Evaluator,
    Task,
    handle_evaluate,
)
from readygo.services.evaluator.drivers import StraightLineDriver
from tests.services.evaluator.conftest import FakeServices


def pick(reply, task, method):
    return [record for record in reply.records if (record.task, record.method) == (task, method)]


def test_every_method_drives_the_same_episodes(make_evaluator):
    reply = handle_evaluate(make_evaluator(), EvaluateRequest(episodes=3))
    assert len(reply.records) == 2 * 3 * 3
    for task in (Task.STATIC, Task.DYNAMIC):
        for method in (POLICY, EXPERT, STRAIGHT_LINE):
            assert [record.episode.index for record in pick(reply, task, method)] == [0, 2, 4]
    assert {record.episode.split for record in reply.records} == {Split.TEST}


def test_episode_in_which_a_driver_fails_is_over_and_the_others_go_on(make_evaluator):
    def fails(_):
        driver = StraightLineDriver()
        ask = driver.act
        driver.act = lambda running: [
            DriverFailure("it is tired") if simulation.scenario.episode.index == 2 and simulation.step == 7 else command
            for (simulation, _), command in zip(running, ask(running), strict=True)
        ]
        return driver

    evaluator = dataclasses.replace(make_evaluator(), drivers={"tired": fails})
    request = EvaluateRequest(tasks=(Task.STATIC,), methods=("tired", STRAIGHT_LINE), episodes=3)
    reply = handle_evaluate(evaluator, request)
    tired, other = pick(reply, Task.STATIC, "tired"), pick(reply, Task.STATIC, STRAIGHT_LINE)
    assert [record.reason for record in tired] == ["", "it is tired", ""]
    assert (tired[1].result.outcome, tired[1].category) == (Outcome.TIMEOUT, Category.DRIVER_FAILED)
    assert [record.result for record in (tired[0], tired[2])] == [record.result for record in (other[0], other[2])]


def test_method_that_does_not_exist_is_named_before_anybody_drives(make_evaluator, services):
    with pytest.raises(RunError, match=r"no method 'astar'; there are policy, straight-line, expert"):
        handle_evaluate(make_evaluator(), EvaluateRequest(methods=(STRAIGHT_LINE, "astar"), episodes=1))
    assert services.requests == []


def test_outcomes_follow_the_map(make_evaluator):
    reply = handle_evaluate(make_evaluator(), EvaluateRequest(tasks=(Task.STATIC,), episodes=3))
    for method in (POLICY, STRAIGHT_LINE):
        outcomes = [record.result.outcome for record in pick(reply, Task.STATIC, method)]
        assert outcomes == [Outcome.SUCCESS, Outcome.SUCCESS, Outcome.STATIC_COLLISION]


def test_straight_line_reaches_the_goal_in_the_time_that_its_limits_allow(make_evaluator):
    request = EvaluateRequest(tasks=(Task.STATIC,), methods=(STRAIGHT_LINE,), episodes=1)
    result = handle_evaluate(make_evaluator(), request).records[0].result
    # 4 m to the circle of success, half a second lost in speeding up to 1 m/s at 1 m/s2.
    assert result.duration_s == pytest.approx(4.5, abs=0.1)
    assert result.path_length_m == pytest.approx(4.0, abs=0.1)
    assert result.shortest_m == pytest.approx(4.0, abs=0.1)


def test_result_does_not_depend_on_the_lockstep(make_evaluator):
    request = EvaluateRequest(episodes=6, methods=(POLICY,))
    alone = handle_evaluate(make_evaluator(lockstep=1), request)
    together = handle_evaluate(make_evaluator(lockstep=4), request)
    assert alone.records == together.records


def test_views_of_running_episodes_share_a_request(make_evaluator, services):
    request = EvaluateRequest(tasks=(Task.STATIC,), methods=(POLICY,), episodes=3)
    handle_evaluate(make_evaluator(lockstep=3), request)
    assert len(services.render_requests[0].views) == 3
    assert max(len(request.views) for request in services.render_requests) == 3


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
    for wrong in ({"episodes": 0}, {"tasks": ()}, {"methods": (EXPERT, EXPERT)}):
        with pytest.raises(ValueError, match=r"at least 1|needs a task|repeat"):
            EvaluateRequest(**wrong)


def test_every_ended_episode_is_reported(make_evaluator):
    reported = []
    reply = handle_evaluate(make_evaluator(), EvaluateRequest(episodes=2), report=reported.append)
    assert sorted(map(str, reported)) == sorted(map(str, reply.records))


def test_policy_that_decides_seldom_drives_otherwise_and_the_others_as_before(make_evaluator):
    often = handle_evaluate(make_evaluator(), EvaluateRequest(tasks=(Task.STATIC,), episodes=3))
    seldom = handle_evaluate(make_evaluator(), EvaluateRequest(tasks=(Task.STATIC,), episodes=3, control_hz=1))
    assert pick(often, Task.STATIC, POLICY) != pick(seldom, Task.STATIC, POLICY)
    for method in (EXPERT, STRAIGHT_LINE):
        assert pick(often, Task.STATIC, method) == pick(seldom, Task.STATIC, method)


@pytest.mark.parametrize("control_hz", [0.0, -4.0, 40.0, 3.0, 15.0, float("nan")])
def test_control_rate_that_is_no_whole_number_of_steps_is_refused(control_hz):
    with pytest.raises(RunError, match="control_hz must be 20 Hz divided by a whole number"):
        EvaluateRequest(control_hz=control_hz).hold_steps(Clock())


def test_control_rates_are_whole_steps():
    rates = (None, 20, 10, 5, 4, 2.5, 1)
    assert [EvaluateRequest(control_hz=rate).hold_steps(Clock()) for rate in rates] == [1, 1, 2, 4, 5, 8, 20]
    often = RobotConfig(control_hz=30, camera_hz=20).clock
    assert [EvaluateRequest(control_hz=rate).hold_steps(often) for rate in (None, 30, 10)] == [2, 2, 6]


def test_human_collision_is_judged_by_who_moved_and_what_the_camera_showed(make_evaluator, services):
    def plan(request):
        reply = FakeServices.plan(services, request)
        standing = dataclasses.replace(reply.scenario.humans[0], xy_m=np.tile([[4.0, 1.0]], (5, 1)))
        return dataclasses.replace(reply, scenario=dataclasses.replace(reply.scenario, humans=(standing,)))

    evaluator = make_evaluator()
    evaluator.bus.serve(topics.HUMAN_PLAN, plan)
    request = EvaluateRequest(tasks=(Task.DYNAMIC,), methods=(STRAIGHT_LINE,), episodes=1)
    (record,) = handle_evaluate(evaluator, request).records
    contact = record.result.conduct.contact
    assert record.result.outcome is Outcome.HUMAN_COLLISION
    assert (contact.robot_moved, contact.in_view, contact.at_fault) == (True, True, True)
    assert contact.seen_s == pytest.approx(record.result.duration_s, abs=0.06)
    assert record.category is Category.SEEN_HUMAN
