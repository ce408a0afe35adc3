"""`readygo generate --driver.disturbed`: the expert is pushed and obeyed late, and says what it would do."""

from pathlib import Path

import numpy as np
import pytest

from readygo.apps.commands.generate import GenerateOptions, RecordingOptions, generate
from readygo.common.dataset import Dataset, validate
from readygo.common.errors import ConfigError, RunError
from readygo.common.messages import DriverKind

EPISODES = 4
CONFIG = """
[robot.camera]
height_px = 8
width_px = 16
[episode]
goal_distance_min_m = 1.5
goal_distance_max_m = 2.5
time_limit_s = 8.0
"""


def keys(share: float) -> dict[str, dict[str, float]]:
    """The key of noise injection in a share of the episodes."""
    return {"driver": {"disturbed": share}}


@pytest.fixture(scope="module")
def scene(embedded_bundle: Path) -> str:
    return str(embedded_bundle)


@pytest.fixture(scope="module")
def options(tmp_path_factory: pytest.TempPathFactory) -> dict:
    path = tmp_path_factory.mktemp("settings") / "short.toml"
    path.write_text(CONFIG)
    return {
        "config": path,
        "recording": RecordingOptions(static=True),
        "keys": keys(0.3),
        "episodes": EPISODES,
        "json": True,
    }


@pytest.fixture(scope="module")
def recorded(scene: str, options: dict, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("data") / "zero"
    generate(GenerateOptions(scene=scene, out=out, workers=0, **options))
    return out


def _hash(data: Path) -> str:
    return Dataset([data]).content_hash


def test_share_of_the_episodes_is_disturbed_and_the_expert_says_what_it_would_do(recorded: Path) -> None:
    data = Dataset([recorded])
    assert validate(recorded).ok
    assert {(entry.driver, entry.policy) for entry in data.episodes} == {(DriverKind.EXPERT, "")}
    disturbed = []
    for entry in data.episodes:
        rows = slice(entry.first_sample, entry.first_sample + entry.sample_count)
        disturbed.append(not np.array_equal(data.expert_actions[rows], data.actions[rows]))
    assert 0 < sum(disturbed) < EPISODES


def test_run_goes_on_where_it_was_and_with_the_same_share_alone(
    recorded: Path, scene: str, options: dict, tmp_path: Path
) -> None:
    generate(GenerateOptions(scene=scene, out=tmp_path / "data", workers=0, **{**options, "episodes": 1}))
    generate(GenerateOptions(scene=scene, out=tmp_path / "data", workers=0, **options))
    assert _hash(tmp_path / "data") == _hash(recorded)
    with pytest.raises(RunError, match=r"holds data of another run: config \(driver\) differ"):
        generate(GenerateOptions(scene=scene, out=tmp_path / "data", workers=0, **{**options, "keys": keys(0.25)}))


def test_fleet_of_two_drivers_gives_the_same_bytes(recorded: Path, scene: str, options: dict, tmp_path: Path) -> None:
    generate(GenerateOptions(scene=scene, out=tmp_path / "two", workers=2, **options))
    assert _hash(tmp_path / "two") == _hash(recorded)


def test_run_is_made_again_from_its_data_alone(recorded: Path, tmp_path: Path) -> None:
    generate(GenerateOptions(out=tmp_path / "again", workers=0, json=True, recording=RecordingOptions(again=recorded)))
    assert _hash(tmp_path / "again") == _hash(recorded)


def test_what_makes_no_run_is_refused_in_a_line(scene: str, options: dict, recorded: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"--driver\.disturbed must be 0\.\.1"):
        generate(GenerateOptions(scene=scene, out=tmp_path / "data", **{**options, "keys": keys(2.0)}))
    with pytest.raises(RunError, match="Name a scene"):
        generate(GenerateOptions(out=tmp_path / "data"))
    again = GenerateOptions(
        scene=scene, out=tmp_path / "data", seed=4, recording=RecordingOptions(again=recorded, mix=0.1), keys=keys(0.1)
    )
    with pytest.raises(RunError, match=r"leave out SCENE, --seed, --mix, --driver\.disturbed\.$"):
        generate(again)
    with pytest.raises(RunError, match="holds no recorded run"):
        generate(GenerateOptions(out=tmp_path / "data", recording=RecordingOptions(again=tmp_path)))
    assert not (tmp_path / "data").exists()
