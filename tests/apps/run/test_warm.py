import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import pytest

from readygo.apps.run import warm


class Beside:
    """Stands in for the other process."""

    def __init__(self, journal: list[object]) -> None:
        self.journal = journal

    def __call__(self, command: list[str], **_: object) -> "Beside":
        self.journal.append("begun beside")
        return self

    def wait(self) -> None:
        self.journal.append("waited")

    def kill(self) -> None:
        self.journal.append("killed")


def test_first_episode_that_can_walk_is_driven_and_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    planned, driven = [], []
    world = SimpleNamespace(human_planner=lambda: None, animator=lambda: None, robot_planner="expert")

    def plan(planner, request):
        planned.append(request.episode.index)
        return SimpleNamespace(scenario=f"scenario {len(planned)}" if len(planned) > 1 else None)

    def animate(animator, request):
        return SimpleNamespace(motions="motions" if request["scenario"] == "scenario 3" else None)

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    beside = Beside(driven)
    monkeypatch.setattr(warm.subprocess, "Popen", beside)
    for name, stand_in in (
        ("warm_rasterizer", lambda: driven.append("kernels")),
        ("open_scene", lambda name: None),
        ("make_spec", lambda *arguments, **options: None),
        ("World", lambda spec: world),
        ("AnimateRequest", dict),
        ("RobotPlanRequest", dict),
        ("handle_human_plan", plan),
        ("handle_animate", animate),
        ("handle_robot_plan", lambda planner, request: driven.append((planner, request["scenario"]))),
    ):
        monkeypatch.setattr(warm, name, stand_in)
    warm.warm_all()
    assert planned == [0, 1, 2]
    assert driven == ["begun beside", ("expert", "scenario 3"), "waited", "killed", "waited", "kernels"]
    # Workers need not do it again.
    monkeypatch.setattr(warm, "warm_all", lambda: driven.append("again"))
    warm.warm_once()
    assert "again" not in driven


def test_other_process_compiles_the_rasterizer(tmp_path: Path) -> None:
    code = warm._RASTERIZER + "; import sys; sys.stdout.write(warm.__module__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "readygo.common.rasterizer.warm"


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
