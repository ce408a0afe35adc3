"""Every file in examples/ does what its README says."""

import dataclasses
from pathlib import Path

import pytest

from readygo.apps.fleet.run import record
from readygo.common.camera.lens import make_lens
from readygo.common.dataset import Dataset, validate
from readygo.common.episode import EpisodeConfig
from readygo.common.messages import Split
from readygo.common.policy import PolicySpec, check_policy_camera, check_policy_limits
from readygo.common.robot import load_robot
from readygo.runs.config import RunConfig, load_run_config
from readygo.runs.scene_argument import open_scene
from readygo.runs.spec import make_spec
from readygo.services.planner.humans.scenario_file import load_scenarios

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
ROBOTS = sorted((EXAMPLES / "robots").glob("*.toml"))
SHORT = EpisodeConfig(goal_distance_min_m=2.0, goal_distance_max_m=3.0)


def recorded(config: RunConfig, out: Path, *, episodes: int, scenarios: Path | None = None) -> Dataset:
    static = scenarios is None
    spec = make_spec(
        open_scene("embedded"), None, config, seed=0, split=Split.TRAIN, static=static, scenarios=scenarios
    )
    record(spec, out, episodes=episodes, workers=0)
    assert validate(out).ok
    return Dataset(out)


@pytest.mark.parametrize("path", ROBOTS, ids=lambda path: path.stem)
def test_robot_drives_and_sees(path: Path, tmp_path: Path) -> None:
    robot = load_robot(path)
    data = recorded(dataclasses.replace(RunConfig(robot=robot), episode=SHORT), tmp_path / "data", episodes=1)
    assert data.robot == robot
    assert (data.height_px, data.width_px) == (robot.camera.height_px, robot.camera.width_px)
    driven = robot.with_values(data.episodes[0].drawn)
    assert not driven.ranges.varies
    assert data.actions[:, 0].max() <= driven.v_max_mps + 1e-6
    assert data.calibration(0).K_px == pytest.approx(driven.camera.K_px)


def test_robots_are_what_their_names_say() -> None:
    tall, small, wide = (load_robot(EXAMPLES / "robots" / f"{name}.toml") for name in ("tall", "small", "wide_turns"))
    assert tall.camera.mount_height_m > 1.0 > small.camera.mount_height_m
    assert small.camera.distortion == "fisheye"
    make_lens(small.camera)
    assert wide.v_max_mps / wide.w_max_radps >= 1.0
    several, one = (load_robot(EXAMPLES / "robots" / f"{name}.toml") for name in ("several", "one_of_several"))
    check_policy_camera(PolicySpec(robot=several), one)
    check_policy_limits(PolicySpec(robot=several), one)


def test_run_is_recorded_with_its_settings(tmp_path: Path) -> None:
    config = load_run_config(EXAMPLES / "run.toml")
    assert config.renderer.detail == "lod"
    data = recorded(config, tmp_path / "data", episodes=1)
    assert (data.height_px, data.width_px) == (72, 128)


def test_scenarios_are_played(tmp_path: Path) -> None:
    path = EXAMPLES / "scenarios.toml"
    entries = load_scenarios(path).entries
    config = load_run_config(EXAMPLES / "run.toml")
    data = recorded(config, tmp_path / "data", episodes=len(entries), scenarios=path)
    assert [episode.episode.index for episode in data.episodes] == list(range(len(entries))), "none is rejected"
    for entry, episode in zip(entries, data.episodes, strict=True):
        x_m, y_m, _, _ = data.poses[episode.first_sample].tolist()
        assert (x_m, y_m) == pytest.approx(entry.start_m, abs=0.05)
        assert len(data.joints_m(episode.first_sample)) == len(entry.humans)


def test_readme_names_every_file() -> None:
    text = (EXAMPLES / "README.md").read_text()
    for path in EXAMPLES.rglob("*.toml"):
        assert f"`{path.relative_to(EXAMPLES).as_posix()}`" in text
