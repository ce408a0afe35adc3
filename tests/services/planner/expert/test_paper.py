import dataclasses

import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig
from readygo.common.messages import Outcome
from readygo.common.robot import RobotConfig
from readygo.services.planner import ExpertConfig, RobotPlanner
from readygo.services.planner.expert.handlers import drive
from readygo.services.planner.explain.journal import run_with_journal
from tests.services.planner.expert.crooked_run import crooked_run
from tests.services.planner.runs import make_scenario
from tests.services.planner.worlds import animate, hall, make_robot_planner, maps_of


def run(*humans, **config):
    scenario = make_scenario(*humans)
    return run_with_journal(make_robot_planner(mode="paper", **config), scenario, animate(scenario))


def test_plan_keeps_off_the_straight_prediction_of_who_walks_across():
    """Somebody comes down towards the way from ahead: the plan keeps off their next two seconds."""
    track = [(0.2, 6.4 - 0.05 * k) for k in range(60)]
    met = run(track)
    step = next(k for k, known in enumerate(met.journal.perceived) if known and known[0].vy_mps < -0.9)
    path = met.journal.paths_m[step + 10]
    human = met.journal.perceived[step + 10][0]
    ahead = np.column_stack([np.full(40, human.x_m), np.linspace(human.y_m, human.y_m - 2.0, 40)])
    gaps = np.hypot(*(path[:, None] - ahead[None]).transpose(2, 0, 1))
    assert gaps.min() > 0.5
    alone = run()
    assert np.hypot(*(alone.journal.paths_m[step + 10][:, None] - ahead[None]).transpose(2, 0, 1)).min() < 0.3


def test_plans_are_made_anew_after_the_period_and_not_before_the_least_interval():
    searched = np.flatnonzero(run().journal.searched)
    assert np.diff(searched).max() == 10
    often = np.flatnonzero(
        run(
            [(1.0, 4.7)],
        ).journal.searched
    )
    assert np.diff(often).min() == 2


def test_robot_passes_who_stands_on_its_way():
    scenario = make_scenario([(0.3, 4.65)])
    driven = drive(make_robot_planner(mode="paper"), scenario, animate(scenario))
    assert driven.outcome.value == "success"
    assert driven.human_distance_m.min() > 0.5


@pytest.mark.parametrize("control_hz", [10, 5, 2])
def test_robot_that_is_commanded_seldom_drives_as_smoothly_as_one_that_is_commanded_at_every_step(control_hz):
    changes, scenario = {}, dataclasses.replace(make_scenario(), start_xyyaw=np.array([-2.0, 4.0, 0.3]))
    scenario = dataclasses.replace(scenario, goal_xy_m=np.array([7.0, 8.7]))
    for rate_hz in (20, control_hz):
        robot = RobotConfig(control_hz=rate_hz, camera_hz=20)
        planner = RobotPlanner(maps_of(hall()), {}, robot, EpisodeConfig(), ExpertConfig(mode="paper"))
        driven = drive(planner, scenario, animate(scenario))
        assert driven.outcome is Outcome.SUCCESS
        changes[rate_hz] = np.sqrt(np.mean(np.diff(driven.actions[:, 1]) ** 2))
    assert changes[control_hz] < 2.5 * changes[20]


@pytest.mark.parametrize(("control_hz", "camera_hz"), [(10, 20), (10, 30)])
def test_run_among_people_is_as_it_was(control_hz, camera_hz, golden_figures):
    run, made = crooked_run("paper", control_hz=control_hz, camera_hz=camera_hz)
    assert len(run.replan_times_s) == run.replanned.sum()
    assert 0.0 <= run.replan_times_s.min() <= run.replan_times_s.max() < 60.0
    rows = (run.xyyaw, run.actions, run.replanned, run.human_visible, 0.3 * run.expert_cost)
    golden_figures(f"expert/paper {control_hz} {camera_hz}", *rows)
    golden_figures(f"expert/paper decisions {control_hz} {camera_hz}", [[len(one.perceived), one.cost] for one in made])
