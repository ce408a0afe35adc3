import numpy as np

from readygo.services.planner.explain.journal import run_with_journal
from tests.services.planner.runs import make_scenario
from tests.services.planner.worlds import animate, make_robot_planner


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
