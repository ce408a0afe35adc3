import dataclasses
from pathlib import Path

import numpy as np
import pytest

from readygo.apps.robot_logs.convert import LogTopics, camera_of, convert
from readygo.apps.robot_logs.reader import LogCamera
from readygo.common.dataset import Dataset, validate
from readygo.common.errors import ConfigError, DatasetError
from readygo.common.robot import CameraConfig, RobotConfig
from tests.apps.robot_logs.conftest import WriteLog

TOPICS = LogTopics(image="/camera/image_raw", odometry="/odom")


@pytest.mark.parametrize("raw", [False, True])
def test_log_becomes_sound_data(write_log: WriteLog, tmp_path: Path, raw: bool) -> None:
    said = convert(write_log(raw=raw), tmp_path / "data", TOPICS, RobotConfig(), license="CC0")
    report = validate(tmp_path / "data")
    assert [str(defect) for defect in report.defects] == []
    data = Dataset([tmp_path / "data"])
    assert (said.episodes, said.samples) == (1, len(data))
    assert len(data) > 110
    np.testing.assert_allclose(data.actions[:, 0], 0.5, atol=0.01)
    np.testing.assert_allclose(data.actions[:, 1], 0.25, atol=0.01)
    assert said.drift_m < 0.01
    assert data.provenance.scene.license == "CC0"
    assert np.linalg.norm(data.goals_xy_m[-1]) < 1e-6


def test_pictures_are_the_newest_at_each_sample(write_log: WriteLog, tmp_path: Path) -> None:
    convert(write_log(), tmp_path / "data", TOPICS, RobotConfig())
    data = Dataset([tmp_path / "data"])
    different = sum(data.image(index) != data.image(index + 1) for index in range(len(data) - 1))
    assert abs(different - 12 * len(data) / 20) <= 2


def test_standing_ends_an_episode(write_log: WriteLog, tmp_path: Path) -> None:
    said = convert(write_log(seconds=12.0, stop_s=(4.0, 7.0)), tmp_path / "data", TOPICS, RobotConfig())
    assert said.episodes == 2


@pytest.mark.parametrize(
    ("changes", "topics", "message"),
    [
        ({"speed_mps": 2.0}, TOPICS, "drives faster"),
        ({"seconds": 1.0}, TOPICS, "holds no drive"),
        ({}, LogTopics(image="/odom", odometry="/odom"), "fitting topics: /camera/image_raw"),
    ],
)
def test_what_cannot_be_used_is_said_and_leaves_nothing(
    write_log: WriteLog, tmp_path: Path, changes: dict[str, float], topics: LogTopics, message: str
) -> None:
    log = write_log(**changes)
    with pytest.raises((ConfigError, DatasetError), match=message):
        convert(log, tmp_path / "data", topics, RobotConfig())
    assert not (tmp_path / "data").exists()


def test_camera_of_the_log_keeps_the_mount() -> None:
    k = (200.0, 0.0, 127.5, 0.0, 210.0, 71.5, 0.0, 0.0, 1.0)
    seen = LogCamera(height_px=144, width_px=256, K_px=k, model="plumb_bob", distortion=(0.1, 0.02, 0.0, 0.001, 0.0))
    camera = camera_of(CameraConfig(mount_height_m=0.7), seen)
    assert (camera.mount_height_m, camera.cx_px, camera.distortion, camera.k1) == (0.7, 128.0, "brown_conrady", 0.1)
    with pytest.raises(ConfigError, match="lens model 'thin_prism'"):
        camera_of(CameraConfig(), LogCamera(height_px=1, width_px=1, K_px=k, model="thin_prism", distortion=(1.0,)))
    eight = dataclasses.replace(seen, model="rational_polynomial", distortion=(*seen.distortion, 0.0, 0.0, 0.0))
    assert camera_of(CameraConfig(), eight) == camera_of(CameraConfig(), seen)
    with pytest.raises(ConfigError, match="known with 5 coefficients, and further ones of the log's are not 0"):
        camera_of(CameraConfig(), dataclasses.replace(eight, distortion=(0.1,) * 8))
