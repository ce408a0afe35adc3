from types import SimpleNamespace

import pytest

from readygo.apps.run import warm


def test_first_episode_that_can_walk_is_driven_and_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    planned, driven = [], []
    world = SimpleNamespace(human_planner=lambda: None, animator=lambda: None, robot_planner="expert")

    def plan(planner, request):
        planned.append(request.episode.index)
        return SimpleNamespace(scenario=f"scenario {len(planned)}" if len(planned) > 1 else None)

    def animate(animator, request):
        return SimpleNamespace(motions="motions" if request["scenario"] == "scenario 3" else None)

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
    assert driven == ["kernels", ("expert", "scenario 3")]
