"""The journal of a run: what it keeps, and which plans count as other ways."""

import numpy as np
import pytest

from readygo.common.episode.loop import DriverFailure
from readygo.common.errors import RunError
from readygo.common.messages import HumanPlanRequest
from readygo.services.planner import handle_human_plan
from readygo.services.planner.expert.handlers import drive
from readygo.services.planner.explain.journal import Journal, run_beside_expert, run_with_journal
from tests.services.planner.runs import STEPS, WAY, make_journal, make_run
from tests.services.planner.worlds import animate, key

UP = WAY + np.array([0.0, 1.0])
NOTHING = np.empty((0, 2))


def rest(path, step):
    return path[step:]


def test_journal_of_a_run_changes_nothing_and_has_an_entry_per_step(human_planner, robot_planner):
    scenario = handle_human_plan(human_planner, HumanPlanRequest(episode=key(1))).scenario
    plain = drive(robot_planner, scenario, animate(scenario))
    run = run_with_journal(robot_planner, scenario, animate(scenario))
    assert np.array_equal(run.trajectory.actions, plain.actions)
    assert len(run.journal.paths_m) == len(run.journal.perceived) == len(plain.xyyaw)
    assert run.journal.searched == plain.replanned.tolist()
    seen = np.array([run.journal.steps_in_view(k) for k in range(len(scenario.humans))])
    assert np.array_equal(seen.any(axis=0), plain.human_visible)


def test_driving_on_along_a_path_is_no_change():
    assert make_run().journal.changes == (0,)


def test_path_to_the_side_is_another_way_only_where_a_search_ran():
    paths = [rest(WAY if step < 40 else UP, step) for step in range(STEPS)]
    assert make_journal(paths, searches=(0, 20, 40)).changes == (0, 40)
    assert make_journal(paths, searches=(0, 20)).changes == (0,)


@pytest.mark.parametrize(("shift_m", "changes"), [(0.19, (0,)), (0.21, (0, 40))])
def test_ways_differ_from_twenty_centimetres_on(shift_m, changes):
    paths = [rest(WAY if step < 40 else WAY + np.array([0.0, shift_m]), step) for step in range(STEPS)]
    assert make_journal(paths, searches=(0, 40)).changes == changes


def test_plan_that_only_reaches_farther_is_the_same_way():
    paths = [rest(WAY[:60] if step < 40 else WAY, step) for step in range(60)]
    assert make_journal(paths, searches=(0, 40)).changes == (0,)


def test_way_found_after_none_is_a_change_that_gives_nothing_up():
    paths = [NOTHING if 10 <= step < 20 else rest(WAY, step) for step in range(STEPS)]
    journal = make_journal(paths, searches=(0, 10, 20))
    assert journal.changes == (0, 20)
    assert journal.given_up == ()
    sideways = [rest(WAY if step < 40 else UP, step) for step in range(STEPS)]
    assert make_journal(sideways, searches=(0, 40)).given_up == (40,)


def test_seen_tells_views_from_memory():
    journal = make_journal([NOTHING] * 4, searches=(), seen={1: (0.0, 0.0), 2: (0.0, 0.0)})
    assert journal.steps_in_view(0).tolist() == [False, True, True, False]
    assert journal.steps_in_view(1).tolist() == [False] * 4


def test_gap_is_between_centres_and_a_human_stays_where_its_motion_ends():
    run = make_run([(0.0, 4.6), (0.0, 5.6)])
    assert run.gap_m(0)[0] == pytest.approx(2.0, abs=1e-6)
    assert run.gap_m(0)[-1] == pytest.approx(np.hypot(2.0, 1.0), abs=1e-6)
    assert run.human_xy_m(0).shape == (STEPS, 2)


def test_empty_journal_has_no_changes():
    assert Journal().changes == ()


class Steady:
    """Drives along an arc, and gives up where it is told to."""

    looks = False

    def __init__(self, steps, last=None):
        self.steps, self.last = steps, last

    def start(self, simulation):
        return None

    def act(self, running):
        ((simulation, _),) = running
        self.steps.append(simulation.step)
        return [DriverFailure("it is lost") if simulation.step == self.last else (0.3, 0.1)]


def test_driver_that_gives_up_is_an_error(human_planner, robot_planner):
    scenario = handle_human_plan(human_planner, HumanPlanRequest(episode=key(1))).scenario
    with pytest.raises(RunError, match=f"policy gave up in {scenario.episode.episode_id}: it is lost"):
        run_beside_expert(robot_planner, scenario, animate(scenario), Steady([], last=3), "policy")


def test_expert_is_asked_at_every_step_that_somebody_else_drives(human_planner, robot_planner):
    scenario = handle_human_plan(human_planner, HumanPlanRequest(episode=key(1))).scenario
    steps = []

    run = run_beside_expert(robot_planner, scenario, animate(scenario), Steady(steps), "policy")
    assert (run.driver, run.explained) == ("policy", False)
    assert steps == list(range(len(run.trajectory.xyyaw)))
    assert len(run.journal.paths_m) == len(steps)
    assert any(len(path) for path in run.journal.paths_m)
    assert run.trajectory.actions[10].tolist() == pytest.approx([0.3, 0.1])
    seen = np.array([run.journal.steps_in_view(k) for k in range(len(scenario.humans))])
    assert np.array_equal(seen.any(axis=0), run.trajectory.human_visible)
