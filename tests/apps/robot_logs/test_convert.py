import dataclasses
from pathlib import Path

import numpy as np
import pytest

from readygo.apps.robot_logs.convert import LogTopics, camera_of, convert
from readygo.apps.robot_logs.reader import LogCamera, RobotLog
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


def test_header_and_samples_are_those_of_the_drive(write_log: WriteLog, tmp_path: Path) -> None:
    robot = RobotConfig(camera=CameraConfig(mount_height_m=0.7), control_hz=20, camera_hz=10)
    told: list[tuple[int, int]] = []
    said = convert(
        write_log(seconds=9.0), tmp_path / "data", TOPICS, robot, episode_s=4.0, progress=lambda *two: told.append(two)
    )
    assert (said.episodes, told) == (2, [(1, 2), (2, 2)])
    data = Dataset([tmp_path / "data"])
    assert validate(tmp_path / "data").ok
    assert [entry.episode.index for entry in data.episodes] == [0, 1]
    assert (data.provenance.scene.name, data.provenance.seed) == ("log", 0)
    assert data.robot == robot
    assert not data.truth["human_visible"].any()
    assert np.isinf(data.truth["human_distance_m"]).all()
    assert np.isinf(data.truth["time_to_collision_s"]).all()
    for entry in data.episodes:
        rows = slice(entry.first_sample, entry.first_sample + entry.sample_count)
        x, y, _, yaw = data.poses[rows].T
        dx, dy = x[-1] - x, y[-1] - y
        goals = np.stack([np.cos(yaw) * dx + np.sin(yaw) * dy, np.cos(yaw) * dy - np.sin(yaw) * dx], axis=1)
        np.testing.assert_allclose(data.goals_xy_m[rows], goals, atol=1e-5)


def test_fisheye_and_intrinsics_become_a_camera_with_centres_of_pixels() -> None:
    k = (200.0, 0.0, 120.25, 0.0, 210.0, 71.5, 0.0, 0.0, 1.0)
    for model in ("equidistant", "fisheye"):
        seen = LogCamera(height_px=144, width_px=250, K_px=k, model=model, distortion=(0.1, 0.02, -0.03, 0.004))
        camera = camera_of(CameraConfig(mount_yaw_deg=3.0, p1=0.2, distortion="brown_conrady"), seen)
        assert (camera.distortion, camera.k1, camera.k2, camera.k3, camera.k4) == ("fisheye", 0.1, 0.02, -0.03, 0.004)
        assert (camera.height_px, camera.width_px, camera.fx_px, camera.fy_px) == (144, 250, 200.0, 210.0)
        assert (camera.cx_px, camera.cy_px, camera.p1, camera.mount_yaw_deg) == (120.75, 72.0, 0.0, 3.0)
        assert camera.horizontal_fov_deg is None
    plain = camera_of(CameraConfig(k1=0.2, distortion="brown_conrady"), dataclasses.replace(seen, distortion=()))
    assert (plain.distortion, plain.k1) == ("none", 0.0)


@pytest.mark.parametrize("episode_s", [1.9, 2.0])
def test_episodes_must_last_two_seconds(write_log: WriteLog, tmp_path: Path, episode_s: float) -> None:
    log = write_log(seconds=2.5)
    if episode_s < 2.0:
        with pytest.raises(ConfigError, match=r"--episode-s must be at least 2, got 1\.9"):
            convert(log, tmp_path / "data", TOPICS, RobotConfig(), episode_s=episode_s)
    else:
        with pytest.raises(DatasetError, match="holds no drive"):
            convert(log, tmp_path / "data", TOPICS, RobotConfig(), episode_s=episode_s)


def test_images_of_another_size_are_refused_with_both_sizes(write_log: WriteLog, tmp_path: Path) -> None:
    robot = RobotConfig(camera=CameraConfig(height_px=72, width_px=128))
    with pytest.raises(DatasetError, match="images are 144x256, the camera has 72x128; pass --camera-info"):
        convert(write_log(), tmp_path / "data", TOPICS, robot)


@pytest.mark.parametrize(
    ("topic", "fx_px", "k1"), [("/camera/image_rect", 180.0, 0.0), ("/camera/image_raw", 200.0, 0.1)]
)
def test_rectified_images_have_the_projection_of_their_camera_info(
    write_log: WriteLog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, topic: str, fx_px: float, k1: float
) -> None:
    K, P = (200.0, 0.0, 127.5, 0.0, 200.0, 71.5, 0.0, 0.0, 1.0), (180.0, 0, 127.5, 0, 0, 180.0, 71.5, 0, 0, 0, 1.0, 0)
    info = LogCamera(height_px=144, width_px=256, K_px=K, model="plumb_bob", distortion=(0.1,), P_px=P)
    monkeypatch.setattr(RobotLog, "camera", lambda log, name: info)
    topics = LogTopics(image=topic, odometry="/odom", camera_info="/camera/camera_info")
    convert(write_log(topic=topic), tmp_path / "data", topics, RobotConfig())
    robot = Dataset([tmp_path / "data"]).robot
    assert robot is not None
    assert (robot.camera.fx_px, robot.camera.k1) == (fx_px, k1)
