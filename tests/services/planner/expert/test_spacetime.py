import dataclasses
import math

import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig
from readygo.common.robot import RobotConfig
from readygo.services.planner import ExpertConfig, RobotPlanner
from readygo.services.planner.explain.journal import run_with_journal
from tests.services.planner.expert.crooked_run import crooked_run
from tests.services.planner.runs import make_scenario
from tests.services.planner.worlds import animate, hall, make_robot_planner, maps_of


def run(*humans, **config):
    scenario = make_scenario(*humans)
    return run_with_journal(make_robot_planner(**config), scenario, animate(scenario))


def test_plans_are_renewed_after_a_second_alone_and_a_quarter_among_humans():
    alone = np.flatnonzero(run().journal.searched)
    assert np.diff(alone)[:2].tolist() == [20, 20]
    met = run([(1.5, 6.2)])
    known = [bool(humans) for humans in met.journal.perceived]
    searched = [k for k in np.flatnonzero(met.journal.searched) if known[k]]
    assert np.diff(searched)[:3].tolist() == [5, 5, 5]


def test_executed_commands_are_the_rows_of_the_plan_in_force():
    driven = run([(0.5, 6.0)])
    for step in range(20):
        path = driven.journal.paths_m[step]
        assert np.hypot(*(path[0] - driven.trajectory.xyyaw[step, :2])) < 1e-3
        assert np.hypot(*(path[1] - driven.trajectory.xyyaw[step + 1, :2])) < 1e-3


def test_who_comes_across_is_let_pass_or_passed_and_never_touched():
    for late in (0, 10, 20):
        track = [(0.2, 7.0 - 0.05 * max(k - late, 0)) for k in range(110)]
        driven = run(track)
        assert driven.trajectory.outcome.value == "success"
        assert driven.trajectory.human_distance_m.min() > 0.53


WALKER = [(0.5, 7.0 - 0.05 * k) for k in range(110)]


def _pushed_run(config, times_asked):
    """Decisions at the states of a robot that somebody else drives, and the simulation's end."""
    scenario = make_scenario(WALKER)
    planner = make_robot_planner(**config)
    expert, simulation = planner.expert(scenario, animate(scenario)), planner.simulation(scenario, animate(scenario))
    made = []
    while simulation.outcome is None and simulation.step < 60:
        for _ in range(times_asked):
            decision = expert.act(simulation)
        made.append(decision)
        simulation.advance(0.6, 1.0 if simulation.step % 20 < 10 else -1.0)
    return made


@pytest.mark.parametrize("config", [{}, {"mode": "paper"}])
def test_expert_that_is_asked_twice_says_what_it_says_when_asked_once(config):
    once, twice = _pushed_run(config, 1), _pushed_run(config, 2)
    assert len(once) > 20
    for one, two in zip(once, twice, strict=True):
        assert (one.v_mps, one.w_radps, one.replanned, one.visible) == (
            two.v_mps,
            two.w_radps,
            two.replanned,
            two.visible,
        )
        assert np.array_equal(one.commands, two.commands)


def test_robot_that_leaves_its_plan_is_planned_for_where_it_is():
    made = _pushed_run({}, 1)
    assert sum(decision.replanned for decision in made) > 0.8 * len(made)
    x_m, y_m = zip(*(decision.path_xy_m[0] for decision in made if len(decision.path_xy_m)), strict=True)
    speeds_mps = np.hypot(np.diff(x_m), np.diff(y_m)) / 0.05
    # Plans begin where the robot is, which drives at 0.6 m/s.
    assert speeds_mps[15:].tolist() == pytest.approx([0.6] * len(speeds_mps[15:]), abs=0.01)


def test_first_of_the_commands_is_the_one_that_is_decided():
    for decision in _pushed_run({}, 1):
        assert decision.commands[0].tolist() == [decision.v_mps, decision.w_radps]
    assert max(len(decision.commands) for decision in _pushed_run({}, 1)) > 20


@pytest.mark.parametrize("config", [{}, {"mode": "paper"}])
def test_expert_answers_beyond_the_window_that_it_began_in(config, monkeypatch):
    monkeypatch.setattr("readygo.services.planner.expert.ground._WINDOW_MARGINS_M", (0.5, math.inf))
    scenario = make_scenario()
    planner = make_robot_planner(**config)
    expert, simulation = planner.expert(scenario, animate(scenario)), planner.simulation(scenario, animate(scenario))
    expert.act(simulation)
    simulation.step, simulation.x_m, simulation.y_m = 1, 6.1, 10.5
    there = expert.act(simulation)
    assert there.replanned
    assert len(there.path_xy_m) > 5
    assert np.hypot(*(there.path_xy_m[0] - (6.1, 10.5))) < 0.1


@pytest.mark.parametrize(("control_hz", "camera_hz"), [(10, 20), (10, 30)])
def test_run_among_people_is_as_it_was(control_hz, camera_hz, golden_figures):
    run, made = crooked_run("spacetime", control_hz=control_hz, camera_hz=camera_hz)
    assert len(run.replan_times_s) == run.replanned.sum()
    assert 0.0 <= run.replan_times_s.min() <= run.replan_times_s.max() < 60.0
    rows = (run.xyyaw, run.actions, run.replanned, run.human_visible, 0.3 * run.expert_cost)
    golden_figures(f"expert/spacetime {control_hz} {camera_hz}", *rows)
    known = [[len(made[k].perceived), made[k].cost, *made[k].commands[-1]] for k in range(len(made))]
    golden_figures(f"expert/spacetime decisions {control_hz} {camera_hz}", np.array(known))


@pytest.mark.parametrize("control_hz", [20, 1])
@pytest.mark.parametrize("yaw_rad", [-2.0, 1.0])
def test_robot_that_is_shut_in_turns_towards_its_goal(yaw_rad, control_hz):
    shut_in = hall()
    i, j = shut_in.frame.cell(-2.0, 6.0)
    shut_in.occupied[i - 8 : i + 9, j - 8 : j + 9] = True
    shut_in.occupied[i - 7 : i + 8, j - 7 : j + 8] = False
    scenario = dataclasses.replace(make_scenario(), start_xyyaw=np.array([-2.0, 6.0, yaw_rad]))
    scenario = dataclasses.replace(scenario, goal_xy_m=np.array([2.0, 6.0]))
    robot = RobotConfig(control_hz=control_hz, camera_hz=20)
    planner = RobotPlanner(maps_of(shut_in), {}, robot, EpisodeConfig(), ExpertConfig())
    expert, simulation = planner.expert(scenario, animate(scenario)), planner.simulation(scenario, animate(scenario))
    headings = []
    for _ in range(160):
        decision = expert.act(simulation)
        simulation.advance(decision.v_mps, decision.w_radps)
        headings.append(simulation.yaw_rad)
    assert np.abs(headings[80:]).max() < 0.05
    assert simulation.yaw_rad == pytest.approx(0.0, abs=0.1)
    assert (simulation.x_m, simulation.y_m) == (-2.0, 6.0)
