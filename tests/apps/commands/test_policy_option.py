"""`readygo generate --policy`: a policy and the expert drive, and what the expert would do is recorded."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from readygo.apps.commands.generate import GenerateOptions, RecordingOptions, generate
from readygo.common.avatars.file import EMBEDDED_FOLDER
from readygo.common.dataset import Dataset, validate
from readygo.common.errors import PolicyError, RunError
from readygo.common.messages import DriverKind, Outcome
from readygo.runs.options import WorldOptions
from readygo.runs.origin import note_origin, origin_of_data
from tests.common.policy.artifacts import write_policy

EPISODES = 5
CONFIG = """
[episode]
goal_distance_min_m = 1.5
goal_distance_max_m = 2.5
time_limit_s = 8.0
"""


@pytest.fixture(scope="module")
def scene(embedded_bundle: Path) -> str:
    return str(embedded_bundle)


@pytest.fixture(scope="module")
def options(tmp_path_factory: pytest.TempPathFactory) -> dict:
    folder = tmp_path_factory.mktemp("settings")
    (folder / "short.toml").write_text(CONFIG)
    return {"policy": write_policy(folder / "policy"), "config": folder / "short.toml", "json": True}


@pytest.fixture(scope="module")
def recorded(scene: str, options: dict, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("data") / "zero"
    generate(GenerateOptions(scene=scene, out=out, episodes=EPISODES, workers=0, **options))
    return out


def _digests(data: Path) -> dict[str, str]:
    return {entry.episode.episode_id: entry.sha256 for entry in Dataset([data]).episodes}


def test_both_drive_and_what_the_expert_would_do_is_sound(recorded: Path) -> None:
    data = Dataset([recorded])
    assert {entry.driver for entry in data.episodes} == set(DriverKind)
    assert validate(recorded).ok
    assert data.expert_actions.shape == (len(data), 2)
    assert data.expert_ahead.shape == (len(data), 20, 2)
    for entry in data.episodes:
        rows = slice(entry.first_sample, entry.first_sample + entry.sample_count)
        same = np.array_equal(data.expert_actions[rows], data.actions[rows])
        assert same is (entry.driver is DriverKind.EXPERT)


def test_episodes_that_fail_are_kept_with_their_outcome(recorded: Path) -> None:
    data = Dataset([recorded])
    failed = [entry for entry in data.episodes if entry.outcome is not Outcome.SUCCESS]
    assert failed
    for entry in data.episodes:
        assert (entry.outcome is Outcome.TIMEOUT) is (entry.sample_count == 160)


def test_run_goes_on_where_it_was(recorded: Path, scene: str, options: dict, tmp_path: Path) -> None:
    generate(GenerateOptions(scene=scene, out=tmp_path / "data", episodes=2, workers=0, **options))
    assert _digests(tmp_path / "data").items() < _digests(recorded).items()
    generate(GenerateOptions(scene=scene, out=tmp_path / "data", episodes=EPISODES, workers=0, **options))
    assert _digests(tmp_path / "data") == _digests(recorded)
    with pytest.raises(RunError, match="holds data of another run: mix differ"):
        generate(
            GenerateOptions(
                scene=scene,
                out=tmp_path / "data",
                episodes=EPISODES,
                workers=0,
                **options,
                recording=RecordingOptions(mix=0.25),
            )
        )


@pytest.mark.slow
def test_fleet_of_two_drivers_gives_the_same_bytes(recorded: Path, scene: str, options: dict, tmp_path: Path) -> None:
    generate(GenerateOptions(scene=scene, out=tmp_path / "two", episodes=EPISODES, workers=2, **options))
    assert _digests(tmp_path / "two") == _digests(recorded)


def test_static_run_has_no_humans_and_all_the_labels(scene: str, options: dict, tmp_path: Path) -> None:
    generate(
        GenerateOptions(
            scene=scene,
            out=tmp_path / "static",
            episodes=1,
            workers=0,
            **options,
            recording=RecordingOptions(static=True, mix=1.0),
        )
    )
    data = Dataset([tmp_path / "static"])
    assert data.episodes[0].driver is DriverKind.POLICY
    assert np.isinf(data.truth["human_distance_m"]).all()
    assert np.isfinite(data.expert_ahead).all()
    assert validate(tmp_path / "static").ok


def test_what_makes_no_run_is_refused_in_a_line(scene: str, options: dict, tmp_path: Path) -> None:
    out = tmp_path / "data"
    with pytest.raises(RunError, match="--mix is the share of a policy's episodes: name the policy with --policy"):
        generate(GenerateOptions(scene=scene, out=out, recording=RecordingOptions(mix=0.5)))
    with pytest.raises(PolicyError, match=r"--mix must be 0\.\.1, got 2\.0"):
        generate(GenerateOptions(scene=scene, out=out, **options, recording=RecordingOptions(mix=2.0)))
    with pytest.raises(PolicyError, match=r"holds no policy\.toml"):
        generate(GenerateOptions(scene=scene, out=out, **{**options, "policy": tmp_path / "nowhere"}))
    (tmp_path / "wide.toml").write_text("[robot.camera]\nheight_px = 20\n")
    with pytest.raises(PolicyError, match="trained with another camera: height_px 8"):
        generate(GenerateOptions(scene=scene, out=out, **{**options, "config": tmp_path / "wide.toml"}))
    assert not out.exists()


def test_policys_avatars_walk_unless_others_are_named(scene: str, options: dict, tmp_path: Path) -> None:
    people = tmp_path / "people"
    people.mkdir()
    shutil.copy(EMBEDDED_FOLDER / "amara.npz", people)
    policy = shutil.copytree(options["policy"], tmp_path / "policy")
    first, second = tmp_path / "first", tmp_path / "second"
    generate(
        GenerateOptions(scene=scene, out=first, episodes=1, workers=0, **options, world=WorldOptions(avatars=people))
    )
    note_origin(policy, origin_of_data([first]))
    generate(GenerateOptions(scene=scene, out=second, episodes=1, workers=0, **{**options, "policy": policy}))
    assert set(Dataset([second]).provenance.avatars) == {"amara"}
    people.rename(tmp_path / "moved")
    with pytest.raises(PolicyError, match=r"not at .*/people any more; name them with --avatars\.$"):
        generate(
            GenerateOptions(scene=scene, out=tmp_path / "third", episodes=1, workers=0, **{**options, "policy": policy})
        )
    assert not (tmp_path / "third").exists()
