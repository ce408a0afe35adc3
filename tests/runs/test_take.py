from contextlib import suppress
from types import SimpleNamespace

import pytest

from readygo.common.errors import RunError
from readygo.common.messages import Outcome
from readygo.common.robot import RobotConfig
from readygo.runs.config import RunConfig
from readygo.runs.take import Takes
from readygo.services.animator import handle_animate
from tests.services.animator.bodies import make_avatar
from tests.services.planner.worlds import hall, key, maps_of, rooms


def first_take(takes: Takes):
    for index in range(20):
        try:
            return takes.take(key(index), static=True)
        except RunError:
            continue
    raise AssertionError("no index has a scenario")


def test_take_without_humans_is_driven_and_kept_with_its_journal() -> None:
    take = first_take(Takes(maps_of(hall()), {}, RunConfig()))
    assert take.run is not None
    assert take.run.trajectory.outcome is Outcome.SUCCESS
    assert take.rejected == ""
    assert len(take.run.journal.paths_m) == len(take.run.trajectory.actions)
    assert take.drive_ms > 0.0


def test_humans_move_at_the_rate_of_the_robots_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    animated = []

    def animate(animator, request):
        animated.append(handle_animate(animator, request))
        return animated[-1]

    monkeypatch.setattr("readygo.runs.take.handle_animate", animate)
    config = RunConfig(robot=RobotConfig(control_hz=30))
    takes = Takes(maps_of(rooms()), {"ada": make_avatar("ada")}, config)
    for index in range(20):
        with suppress(RunError):
            takes.take(key(index), static=False)
        if animated:
            break
    rates = {human.motion.rate_hz for reply in animated for human in reply.motions.humans}
    assert rates == {config.robot.clock.rate_hz} == {60}


def test_index_without_a_scenario_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    refused = SimpleNamespace(scenario=None, rejected="no room")
    monkeypatch.setattr("readygo.runs.take.handle_human_plan", lambda planner, request: refused)
    with pytest.raises(RunError, match=r"has no scenario: no room\. Ask for another --index"):
        Takes(maps_of(rooms()), {}, RunConfig()).take(key(4), static=False)


def test_humans_that_cannot_walk_end_the_take(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = object()
    monkeypatch.setattr(
        "readygo.runs.take.handle_human_plan", lambda planner, request: SimpleNamespace(scenario=scenario)
    )
    monkeypatch.setattr(
        "readygo.runs.take.handle_animate", lambda animator, request: SimpleNamespace(motions=None, rejected="feet")
    )
    monkeypatch.setattr("readygo.runs.take.AnimateRequest", SimpleNamespace)
    take = Takes(maps_of(rooms()), {}, RunConfig()).take(key(4), static=False)
    assert (take.scenario, take.run, take.rejected, take.drive_ms) == (scenario, None, "feet", 0.0)
