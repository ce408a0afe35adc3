from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest

from readygo.common.state_simulation.simulation import StateSimulation
from readygo.runs import warm


def test_first_episode_that_can_walk_is_driven_and_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    planned, driven = [], []
    world = SimpleNamespace(human_planner=lambda: None, animator=lambda: None, robot_planner="expert")

    def plan(planner, request):
        planned.append(request.episode.index)

    def accepted(planner, animator, seed, split, indices):
        for index in indices:
            planned.append(index)
            yield f"scenario {index}", "motions"

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    @contextmanager
    def beside(work) -> Iterator[None]:
        assert work is warm.warm_walking
        driven.append("begun beside")
        yield
        driven.append("ended beside")

    for name, stand_in in (
        ("_beside", beside),
        ("warm_rasterizer", lambda: driven.append("kernels")),
        ("open_scene", lambda name: None),
        ("make_spec", lambda *arguments, **options: None),
        ("World", lambda spec: world),
        ("RobotPlanRequest", dict),
        ("handle_human_plan", plan),
        ("accepted_scenarios", accepted),
        ("handle_robot_plan", lambda planner, request: driven.append((planner, request["scenario"]))),
    ):
        monkeypatch.setattr(warm, name, stand_in)
    warm.warm_all()
    assert planned == [0, 0]
    assert driven == ["begun beside", "kernels", "ended beside", ("expert", "scenario 0")]
    # Workers need not do it again.
    monkeypatch.setattr(warm, "warm_all", lambda: driven.append("again"))
    warm.warm_once()
    assert "again" not in driven


def test_robots_drive_in_the_simulation_of_states(monkeypatch: pytest.MonkeyPatch) -> None:
    driven = []

    class Simulation(StateSimulation):
        def advance(self, commands, *, again=True):
            ended = super().advance(commands, again=again)
            driven.append(self.last.length.tolist())
            return ended

    monkeypatch.setattr(warm, "StateSimulation", Simulation)
    warm.warm_states()
    assert driven == [[4]]


def test_kernels_are_compiled_once_however_many_workers_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    compiled: list[int] = []

    def compile_all() -> None:
        compiled.append(1)
        warm._marker().touch()

    monkeypatch.setattr(warm, "warm_all", compile_all)
    with ThreadPoolExecutor(4) as workers:
        list(workers.map(lambda _: warm.warm_once(), range(4)))
    assert compiled == [1]
