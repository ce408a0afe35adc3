import dataclasses
import json
import sys
from pathlib import Path

import pytest

from readygo.__main__ import main
from readygo.apps.commands.evaluate import EvaluateOptions, evaluate
from readygo.apps.commands.generate import GenerateOptions, generate
from readygo.common.dataset import Dataset
from readygo.common.errors import RunError
from readygo.common.messages import EpisodeKey, HumanPlanRequest, RunSpec, Split, decode, encode
from readygo.runs.config import RunConfig, load_run_config
from readygo.runs.folder import RunFolder
from readygo.runs.options import WorldOptions
from readygo.runs.scene_argument import open_scene
from readygo.runs.spec import make_spec
from readygo.runs.world import World
from readygo.services.planner import handle_human_plan
from readygo.services.planner.humans.scenario_file import load_scenarios, save_scenarios


def spec_of(scenarios: Path | None = None, config: RunConfig | None = None) -> RunSpec:
    scene = open_scene("embedded")
    return make_spec(scene, None, config or RunConfig(), seed=3, split=Split.TRAIN, static=False, scenarios=scenarios)


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first scenarios of a run with varied people, entry k that of index k."""
    config = dataclasses.replace(load_run_config(None, people="varied"))
    config = dataclasses.replace(config, episode=dataclasses.replace(config.episode, goal_distance_max_m=3.5))
    planner = World(spec_of(config=config)).human_planner()
    keys = [EpisodeKey(seed=3, split=Split.TRAIN, index=index) for index in range(5)]
    scenarios = [handle_human_plan(planner, HumanPlanRequest(episode=key)).scenario for key in keys]
    path = tmp_path_factory.mktemp("scenarios") / "five.toml"
    save_scenarios(path, [scenario for scenario in scenarios if scenario is not None])
    assert len(load_scenarios(path).entries) == 5
    return path


def test_recipe_of_people_changes_mix_and_counts_and_keeps_the_configurations_rest(tmp_path: Path) -> None:
    file = tmp_path / "config.toml"
    file.write_text("[episode]\ntime_limit_s = 30.0\n[human_planner]\nmix = {frontal = 1}\n")
    assert load_run_config(file).human_planner.mix.shares == {"frontal": 1.0}
    varied = load_run_config(file, people="varied")
    assert varied.episode.time_limit_s == 30.0
    assert (varied.episode.human_count_min, varied.episode.human_count_max) == (0, 4)
    assert len(varied.human_planner.mix.shares) == 11
    assert load_run_config(file, people="paper").human_planner == RunConfig().human_planner


def test_unknown_family_of_a_mix_is_named(tmp_path: Path, capsys, monkeypatch) -> None:
    file = tmp_path / "config.toml"
    file.write_text("[human_planner]\nmix = {frontaly = 1.0}\n")
    monkeypatch.setattr(sys, "argv", ["readygo", "generate", "embedded", "--out", "x", "--config", str(file)])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    assert "human_planner.mix.frontaly" in capsys.readouterr().err


def test_file_travels_with_the_run_and_is_part_of_what_the_run_is(exported: Path, tmp_path: Path) -> None:
    spec = decode(RunSpec, encode(spec_of(exported)))
    assert spec.scenarios == exported.read_text()
    assert spec.metadata["scenarios"]["name"] == "five.toml"
    assert spec.run != spec_of().run
    # A worker plays it without the file.
    reply = handle_human_plan(
        World(spec).human_planner(), HumanPlanRequest(episode=EpisodeKey(seed=9, split=Split.VAL, index=6))
    )
    assert reply.scenario is not None
    assert reply.scenario.goal_xy_m.tolist() == list(load_scenarios(exported).entries[1].goal_m)
    folder = RunFolder(tmp_path / "out")
    with folder.lock():
        folder.save(spec, 5)
    folder.check(spec_of())
    # Data bind the folder to their run.
    folder.ledger.touch()
    folder.check(spec)
    with pytest.raises(RunError, match="scenarios differ"):
        folder.check(spec_of())
    changed = tmp_path / "changed.toml"
    changed.write_text(exported.read_text() + "\n# another one\n")
    with pytest.raises(RunError, match="scenarios differ"):
        folder.check(spec_of(changed))


def test_exported_episodes_give_the_same_samples_as_the_drawn_ones(exported: Path, tmp_path: Path) -> None:
    config = tmp_path / "config.toml"
    config.write_text("[episode]\ngoal_distance_max_m = 3.5\n")
    digests = []
    for name, scenarios in (("drawn", None), ("played", exported)):
        generate(
            GenerateOptions(
                scene="embedded",
                out=tmp_path / name,
                episodes=2,
                workers=0,
                seed=3,
                people="varied",
                config=config,
                json=True,
                world=WorldOptions(scenarios=scenarios),
            )
        )
        data = Dataset([tmp_path / name])
        digests.append({entry.episode.episode_id: entry.sha256 for entry in data.episodes})
    assert len(digests[0]) == 2
    assert digests[0] == digests[1]


def test_evaluation_plays_every_entry_of_a_file_once(exported: Path, tmp_path: Path, capsys) -> None:
    evaluate(
        EvaluateOptions(
            scene="embedded",
            methods=("straight-line",),
            tasks=("dynamic",),
            out=tmp_path / "results",
            json=True,
            world=WorldOptions(scenarios=exported),
        )
    )
    summary = json.loads(capsys.readouterr().out)
    assert summary["episodes"] == 5
    assert len(summary["scenarios"]) == 64
    assert len((tmp_path / "results" / "episodes.jsonl").read_text().splitlines()) == 5


@pytest.mark.parametrize("command", ["generate", "evaluate"])
def test_bad_file_is_one_line_with_exit_code_2_and_nothing_is_written(command, capsys, monkeypatch, tmp_path) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text('format = "readygo-scenarios/1"\n[[scenarios]]\nstart_m = [900.0, 0.0]\ngoal_m = [1.0, 1.0]\n')
    out = tmp_path / "out"
    monkeypatch.setattr(sys, "argv", ["readygo", command, "embedded", "--out", str(out), "--scenarios", str(bad)])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    message = capsys.readouterr().err
    assert message.startswith("readygo: bad.toml, scenarios[0]: start_m (900, 0) is in an obstacle")
    assert message.count("\n") == 1
    assert not out.exists()
