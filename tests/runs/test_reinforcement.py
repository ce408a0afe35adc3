import dataclasses
import os
import signal
from pathlib import Path

import numpy as np
import pytest

from readygo.common.errors import ConfigError, RunError, SceneError
from readygo.common.messages import Split
from readygo.common.perception.noise import EXACT
from readygo.common.state_policy.state_policy import load_state_policy
from readygo.runs.config import RunConfig
from readygo.runs.evaluation import evaluation_world
from readygo.runs.reinforcement import (
    PART,
    draw_bank,
    make_reinforcement_config,
    run_reinforcement,
    with_standing,
)
from readygo.runs.scenarios import accepted_scenarios
from tests.common.state_policy.state_policies import TOLD_COUNT
from tests.common.state_simulation.episodes import draw


@pytest.fixture(scope="module")
def world():
    return evaluation_world("embedded", RunConfig(), avatars=None, seed=0)


def test_bank_has_the_episodes_of_planner_and_animator(world) -> None:
    bank, drawn = draw_bank(world, Split.TEST, 5), draw(5)
    assert np.array_equal(bank.index, drawn.bank.index)
    assert np.array_equal(bank.start_xyyaw, drawn.bank.start_xyyaw)
    rows = min(bank.walks_m.shape[1], drawn.bank.walks_m.shape[1])
    assert np.array_equal(bank.walks_m[:, :rows], drawn.bank.walks_m[:, :rows])
    assert np.array_equal(bank.fields_cm, drawn.bank.fields_cm)


def test_bank_holds_those_who_stand_besides_those_who_walk(world) -> None:
    standing = dataclasses.replace(world.config.human_planner, standing_min=2, standing_max=3)
    other = evaluation_world(
        "embedded", dataclasses.replace(world.config, human_planner=standing), avatars=None, seed=0
    )
    bank = draw_bank(other, Split.TEST, 3)
    assert bank.walks_m.shape[2] == world.config.episode.human_count_max + 3
    assert (bank.human_count >= world.config.episode.human_count_min + 2).all()
    for walks, count in zip(bank.walks_m, bank.human_count.tolist(), strict=True):
        moves = np.ptp(walks[:, :count], axis=0).max(axis=-1) > 0.5
        assert moves[: count - 2].any()
        assert not moves[count - 2 :].any()


def test_parts_are_kept_and_depend_on_split_and_settings(world, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("readygo.runs.reinforcement.PART", 4)
    shown: list[tuple[int, int]] = []
    first = draw_bank(world, Split.VAL, 5, lambda done, total: shown.append((done, total)))
    assert shown[-1] == (5, 5)
    files = sorted(tmp_path.rglob("part-*.npz"))
    times = [file.stat().st_mtime_ns for file in files]
    assert len(files) >= 2
    again = draw_bank(world, Split.VAL, 5)
    assert np.array_equal(first.walks_m, again.walks_m)
    assert [file.stat().st_mtime_ns for file in files] == times
    slower = dataclasses.replace(world.config.episode, human_speed_max_mps=1.0)
    other = evaluation_world(
        "embedded", dataclasses.replace(world.config, episode=slower), avatars=None, seed=0, split=Split.VAL
    )
    draw_bank(other, Split.VAL, 1)
    assert len({file.parent for file in tmp_path.rglob("part-*.npz")}) == 2
    assert PART == 64


def test_scene_without_room_is_refused_in_a_line_also_with_the_parts_of_an_earlier_call(
    world, tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("readygo.runs.reinforcement.REJECTED_PARTS_MAX", 3)
    monkeypatch.setattr("readygo.runs.reinforcement.accepted_scenarios", lambda *_: iter(()))
    for _ in range(2):
        with pytest.raises(SceneError, match=r"^The last 192 scenarios of .* were rejected\.$"):
            draw_bank(world, Split.VAL, 5)
        assert len(list(tmp_path.rglob("part-*.npz"))) == 3


def test_part_without_an_accepted_episode_is_passed_over(world, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("readygo.runs.reinforcement.PART", 4)
    monkeypatch.setattr(
        "readygo.runs.reinforcement.accepted_scenarios",
        lambda planner, animator, seed, split, indices: (
            iter(()) if 4 in indices else accepted_scenarios(planner, animator, seed, split, indices)
        ),
    )
    index = draw_bank(world, Split.VAL, 6).index.tolist()
    assert len(index) == 6
    assert not {4, 5, 6, 7} & set(index)
    assert min(index) < 4 < max(index)


def test_training_that_is_interrupted_after_its_demonstrations_ends_as_one_that_is_not(
    world, tmp_path: Path, monkeypatch
) -> None:
    pytest.importorskip("torch", reason="torch (extra train) is not installed")
    from readygo.services.trainer import Training

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("readygo.runs.reinforcement.EPOCHS", 1)
    keys = {"ppo": {"robots": 8, "stretch": 8, "minibatches": 2, "actor_widths": [8], "critic_widths": [8]}}
    keys |= {"train_episodes": 4, "val_episodes": 2, "demonstrations": 5, "critic_first": 0.0}
    config, run = make_reinforcement_config(EXACT, keys), Training.run

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    run_reinforcement([world], config, tmp_path / "whole", decisions=128, minutes=None)
    monkeypatch.setattr(Training, "run", interrupt)
    with pytest.raises(KeyboardInterrupt):
        run_reinforcement([world], config, tmp_path / "parts", decisions=128, minutes=None)
    monkeypatch.setattr(Training, "run", run)
    run_reinforcement([world], config, tmp_path / "parts", decisions=128, minutes=None)
    told = np.random.default_rng(0).normal(size=(5, TOLD_COUNT)).astype(np.float32)
    whole, parts = (load_state_policy(tmp_path / name) for name in ("whole", "parts"))
    assert np.array_equal(whole.logits(told), parts.logits(told))


def test_several_processes_draw_the_same_parts_and_none_too_many(world, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("readygo.runs.reinforcement.PART", 4)
    parts = []
    for workers in (1, 2):
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / f"{workers}"))
        bank = draw_bank(world, Split.VAL, 9, workers=workers)
        assert len(bank) == 9
        parts.append({file.name: file.read_bytes() for file in (tmp_path / f"{workers}").rglob("part-*.npz")})
    assert len(parts[0]) >= 3
    assert parts[0] == parts[1]


def test_no_process_begins_where_all_parts_are_known(world, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("readygo.runs.reinforcement.PART", 4)
    first = draw_bank(world, Split.VAL, 5)
    monkeypatch.setattr("readygo.runs.reinforcement.ProcessPoolExecutor", None)
    assert np.array_equal(draw_bank(world, Split.VAL, 5, workers=2).walks_m, first.walks_m)


def test_killed_process_that_draws_is_an_error(world, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("readygo.runs.reinforcement._draw", _die)
    with pytest.raises(RunError, match="--workers"):
        draw_bank(world, Split.VAL, 5, workers=2)
    assert not list(tmp_path.rglob("part-*"))


def _die(*_: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_keys_change_settings_and_wrong_ones_are_refused() -> None:
    config = make_reinforcement_config(EXACT, {"ppo": {"robots": 8}, "noise": {"missed": 0.3}})
    assert config.ppo.robots == 8
    assert config.noise == dataclasses.replace(EXACT, missed=0.3)
    with pytest.raises(ConfigError, match="missed"):
        make_reinforcement_config(EXACT, {"noise": {"missed": 2.0}})


def test_people_who_stand_are_as_many_as_either_setting_has() -> None:
    few = with_standing(RunConfig(), 2)
    assert few.human_planner == dataclasses.replace(RunConfig().human_planner, standing_max=2)
    assert few.episode == RunConfig().episode
    assert with_standing(few, 1) == few
    assert with_standing(RunConfig(), 0) == RunConfig()
