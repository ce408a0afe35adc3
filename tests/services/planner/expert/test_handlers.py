import dataclasses
import math

import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig, meets_obstacle
from readygo.common.episode.robot import robot_of_episode
from readygo.common.errors import AvatarError
from readygo.common.maps import OccupancyMap
from readygo.common.messages import (
    EpisodeMotions,
    HumanMotion,
    HumanPlanRequest,
    HumanTrajectory,
    Outcome,
    RobotPlanRequest,
    Scenario,
    encode,
)
from readygo.common.robot import RobotConfig
from readygo.common.robot.ranges import RobotRanges
from readygo.services.planner import ExpertConfig, RobotPlanner, handle_human_plan, handle_robot_plan
from readygo.services.planner.expert.handlers import drive
from tests.services.planner.worlds import FRAME, animate, key, make_robot_planner, maps_of


def _scenario(start, goal, tracks=()):
    return Scenario(
        episode=key(0),
        start_xyyaw=np.array(start, float),
        goal_xy_m=np.array(goal, float),
        humans=tuple(
            HumanTrajectory(avatar="mia", encounter="crossing", speed_mps=1.0, xy_m=np.asarray(track, float))
            for track in tracks
        ),
    )


def _run(planner, *scenario):
    scenario = _scenario(*scenario)
    return drive(planner, scenario, animate(scenario))


@pytest.fixture(scope="module")
def static_runs(human_planner, robot_planner):
    runs = []
    for index in range(30):
        scenario = handle_human_plan(human_planner, HumanPlanRequest(episode=key(index), static=True)).scenario
        runs.append((scenario, drive(robot_planner, scenario, animate(scenario))))
    return runs


def test_static_goals_are_reached(static_runs):
    assert [run.outcome for _, run in static_runs] == [Outcome.SUCCESS] * 30


def test_disc_never_touches_on_the_way(robot_planner, static_runs):
    for _, run in static_runs:
        for x, y, _ in run.xyyaw:
            assert not meets_obstacle(robot_planner.maps.robot, x, y, 0.25)


def test_no_dawdling_and_no_chatter(static_runs):
    speeds = np.concatenate([run.actions[20:, 0] for _, run in static_runs])
    assert speeds.mean() >= 0.75
    for _, run in static_runs:
        flips = np.diff(np.sign(np.where(np.abs(run.actions[:, 1]) < 0.05, 0, run.actions[:, 1])))
        assert (np.abs(flips) == 2).sum() <= 0.2 * len(run.actions)


def test_expert_truth_is_recorded(static_runs):
    for _, run in static_runs:
        assert run.replanned[0]
        assert len(run.replan_times_s) == run.replanned.sum()
        assert (run.expert_cost > 0).all()
        assert not run.human_visible.any()
        assert (np.diff(np.flatnonzero(run.replanned)) <= 20).all()


def test_robot_that_looks_the_wrong_way_turns_in_place_first(robot_planner):
    run = _run(robot_planner, (-2.0, 3.0, math.pi), (1.5, 3.2))
    assert run.outcome is Outcome.SUCCESS
    assert np.hypot(*(run.xyyaw[20, :2] - run.xyyaw[0, :2])) < 0.3
    assert abs(run.xyyaw[20, 2] - math.pi) > 0.5


def test_robot_that_starts_in_a_corner_gets_out(robot_planner):
    run = _run(robot_planner, (-2.63, 2.37, -2.4), (1.0, 5.5))
    assert run.outcome is Outcome.SUCCESS


def test_standing_human_on_the_way_is_driven_around(robot_planner):
    run = _run(robot_planner, (-2.0, 4.0, 0.0), (2.0, 4.0), [[(1.2, 4.05)]])
    assert run.outcome is Outcome.SUCCESS
    assert run.human_visible.any()
    assert run.human_distance_m.min() > 0.55


def test_robot_of_ranges_is_another_in_every_episode_and_drives_within_its_limits():
    ranges = RobotRanges(v_max_mps=(0.4, 0.9), radius_m=(0.15, 0.35))
    robot = RobotConfig(ranges=ranges)
    planner = RobotPlanner(maps_of(), {}, robot, EpisodeConfig(), ExpertConfig())
    task = _scenario((-2.0, 6.0, 0.0), (2.0, 6.0))
    for index in (0, 1):
        scenario = dataclasses.replace(task, episode=key(index))
        drawn = robot_of_episode(robot, scenario.episode)
        simulation = planner.simulation(scenario, animate(scenario))
        assert simulation.robot == planner.of(scenario.episode).robot == drawn
        run = drive(planner, scenario, animate(scenario))
        assert run.outcome is Outcome.SUCCESS
        assert 0.9 * drawn.v_max_mps < run.actions[:, 0].max() <= drawn.v_max_mps + 1e-9
    assert planner.of(key(0)).ground.contact_m != planner.of(key(1)).ground.contact_m


def test_human_ahead_triggers_replans_more_often_than_the_period(robot_planner):
    alone = _run(robot_planner, (-2.0, 6.0, 0.0), (2.0, 6.0))
    met = _run(robot_planner, (-2.0, 6.0, 0.0), (2.0, 6.0), [[(2.0 - 0.04 * k, 5.6) for k in range(100)]])
    assert met.outcome is Outcome.SUCCESS
    assert met.replanned.mean() > alone.replanned.mean()


def test_human_out_of_view_changes_nothing(robot_planner):
    """A human who stays behind the robot is neither seen nor planned around."""
    alone = _run(robot_planner, (-1.5, 6.0, 0.0), (2.0, 6.0))
    followed = _run(robot_planner, (-1.5, 6.0, 0.0), (2.0, 6.0), [[(-2.6, 6.0)]])
    assert not followed.human_visible.any()
    assert np.array_equal(alone.actions, followed.actions)


def test_blocked_door_ends_as_timeout_not_as_crash(robot_planner):
    doors = [[(0.1, 6.98)], [(6.1, 6.98)]]
    run = _run(robot_planner, (0.0, 5.0, 1.57), (0.0, 9.5), doors)
    assert run.outcome is Outcome.TIMEOUT
    assert run.duration_s == 50.0


def test_way_around_may_be_longer_than_the_first_window_is_wide():
    """Somebody stands in the near door; the other one is 9 m farther on."""
    occupied = np.zeros((160, 400), np.bool_)
    occupied[:2] = occupied[-2:] = True
    occupied[:, :2] = occupied[:, -2:] = True
    occupied[78:82] = True
    occupied[78:82, 60:80] = occupied[78:82, 250:280] = False
    wide = make_robot_planner(OccupancyMap(frame=FRAME, occupied=occupied))
    run = _run(wide, (0.5, 4.0, 1.57), (0.5, 8.0), [[(0.5, 6.0)]])
    assert run.outcome is Outcome.SUCCESS
    assert run.xyyaw[:, 0].max() > 9.0


def test_failed_episode_is_rejected_with_its_outcome_and_keeps_its_trajectory(robot_planner):
    scenario = _scenario((0.0, 5.0, 1.57), (0.0, 9.5), [[(0.1, 6.98)], [(6.1, 6.98)]])
    reply = handle_robot_plan(robot_planner, RobotPlanRequest(scenario=scenario, motions=animate(scenario)))
    assert reply.rejected == "timeout"
    assert reply.trajectory.outcome is Outcome.TIMEOUT


def test_same_scenario_gives_the_same_bytes_whatever_ran_before(human_planner, robot_planner):
    other = make_robot_planner()
    requests = []
    for index in (4, 2, 9):
        scenario = handle_human_plan(human_planner, HumanPlanRequest(episode=key(index))).scenario
        if scenario is not None:
            requests.append(RobotPlanRequest(scenario=scenario, motions=animate(scenario)))
    assert requests
    for request in requests:
        first, second = (handle_robot_plan(p, request).trajectory for p in (robot_planner, other))
        for name in ("xyyaw", "actions", "replanned", "expert_cost", "human_visible", "time_to_collision_s"):
            assert encode({"a": getattr(first, name)}) == encode({"a": getattr(second, name)})


def test_oracle_knows_the_true_motion_that_others_only_predict():
    track = [(2.3 - 0.05 * k, 6.0) for k in range(35)] + [(0.55, 6.0 - 0.05 * k) for k in range(40)]
    scenario = _scenario((-2.0, 6.0, 0.0), (2.2, 6.0), [track])
    guessing, knowing = (drive(make_robot_planner(oracle=k), scenario, animate(scenario)) for k in (False, True))
    assert knowing.outcome is Outcome.SUCCESS
    assert not np.array_equal(guessing.actions[:40], knowing.actions[:40])


def test_near_field_feels_who_is_behind():
    track = [(-2.6 + 0.06 * k, 6.0) for k in range(40)]
    scenario = _scenario((-1.5, 6.0, 0.0), (2.0, 6.0), [track])
    alone = _run(make_robot_planner(), (-1.5, 6.0, 0.0), (2.0, 6.0))
    unaware, aware = (drive(make_robot_planner(near_field_m=m), scenario, animate(scenario)) for m in (0.0, 2.0))
    assert np.array_equal(unaware.actions[:10], alone.actions[:10])
    assert not np.array_equal(aware.actions[:10], alone.actions[:10])


def test_unknown_avatar_is_named_by_an_expert_that_looks_at_bodies():
    scenario = _scenario((-2.0, 4.0, 0.0), (2.0, 4.0), [[(1.2, 4.0)]])
    motion = animate(scenario).humans[0].motion
    motions = EpisodeMotions(humans=(HumanMotion(avatar="nobody", motion=motion),))
    with pytest.raises(AvatarError, match="'nobody' is not loaded; loaded: adam, mia, zoe"):
        handle_robot_plan(make_robot_planner(mode="paper"), RobotPlanRequest(scenario=scenario, motions=motions))


def test_expert_in_space_and_time_needs_no_avatars():
    scenario = _scenario((-2.0, 4.0, 0.0), (2.0, 4.0), [[(1.2, 4.0)]])
    bare = RobotPlanner(maps_of(), {}, RobotConfig(), EpisodeConfig(), ExpertConfig())
    assert not ExpertConfig().needs_avatars
    assert ExpertConfig(mode="paper").needs_avatars
    assert drive(bare, scenario, animate(scenario)).outcome is Outcome.SUCCESS
