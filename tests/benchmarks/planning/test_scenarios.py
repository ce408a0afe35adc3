from types import SimpleNamespace

from readygo.benchmarks.planning import scenarios
from readygo.common.messages import Outcome


def test_run_is_told_by_its_outcome_or_that_nobody_could_walk(monkeypatch) -> None:
    monkeypatch.setattr(scenarios, "AnimateRequest", lambda scenario: scenario)
    monkeypatch.setattr(scenarios, "handle_animate", lambda animator, scenario: SimpleNamespace(motions=scenario))
    monkeypatch.setattr(scenarios, "drive", lambda planner, scenario, motions: SimpleNamespace(outcome=Outcome.TIMEOUT))
    assert scenarios._driven(None, None, "walk") == "timeout"
    assert scenarios._driven(None, None, None) == "no motion"


def test_measurement_counts_scenarios_and_leaves_the_warm_up_out(monkeypatch) -> None:
    drawn = []

    def draw(planner, seed, index):
        drawn.append(seed)
        human = SimpleNamespace(encounter="crossing")
        humans = SimpleNamespace(humans=(human,) * (index % 3))
        return SimpleNamespace(scenario=None if index == 0 else humans, rejected="no way" if index == 0 else "")

    monkeypatch.setattr(scenarios, "_draw", draw)
    monkeypatch.setattr(scenarios, "open_maps", lambda scene: (SimpleNamespace(floor=None), None))
    for name in ("load_avatars", "Animator", "RobotPlanner", "HumanPlanner"):
        monkeypatch.setattr(scenarios, name, lambda *arguments, **options: SimpleNamespace(expert=None, __len__=None))
    monkeypatch.setattr(scenarios, "load_avatars", dict)
    found = scenarios.measure("places/flat.yaml", "varied", 6, 3, reactive=False, drives=False)
    assert drawn == [4] * scenarios.WARM_UP + [3] * 6
    assert found["scene"] == "flat"
    assert found["rejected"] == {"no way": 1}
    assert found["humans"] == {0: 1, 1: 2, 2: 2}
    assert found["families"] == {"crossing": 6}
    assert found["outcomes"] == {}
