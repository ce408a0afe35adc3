"""Arms that differ in nothing but who walks in their data."""

from pathlib import Path

from experiments.policy.realism import arms_in
from readygo.common.config import section_differences
from readygo.runs.config import load_run_config


def test_arms_differ_in_nothing_but_who_is_there(tmp_path: Path) -> None:
    arms, configs = arms_in("embedded"), {}
    for name, arm in arms.items():
        (tmp_path / f"{name}.toml").write_text(arm.settings)
        configs[name] = load_run_config(tmp_path / f"{name}.toml")
    changed = {
        name: {key for key, *_ in section_differences(configs["photoreal"], config)} for name, config in configs.items()
    }
    assert changed == {
        "photoreal": set(),
        "mesh": {"renderer.human_look"},
        "standing": {
            "episode.human_count_min",
            "episode.human_count_max",
            "human_planner.standing_min",
            "human_planner.standing_max",
        },
        "absent": {"human_planner.absent"},
    }
    assert next(iter(arms)) == "photoreal"
    assert {arm.scenes for arm in arms.values()} == {("embedded",)}
    assert [name for name, arm in arms.items() if arm.crowded] == ["photoreal", "mesh"]
