import cv2
import numpy as np
import pytest

from readygo.apps.commands.data import InspectOptions, inspect
from readygo.apps.pictures.label_overlay import corners, label_overlay, labelled_image, project
from readygo.common.dataset import Calibration, Dataset
from readygo.common.errors import ConfigError, DatasetError
from readygo.common.robot import CameraConfig
from tests.common.dataset.episodes import write_shard

CAMERA = CameraConfig()


def calibration(model: str = "", distortion: tuple[float, ...] = ()) -> Calibration:
    return Calibration(
        height_px=CAMERA.height_px,
        width_px=CAMERA.width_px,
        K_px=CAMERA.K_px,
        distortion_model=model,
        distortion=distortion,
    )


def test_points_straight_ahead_are_in_the_middle_and_those_behind_nowhere() -> None:
    T = CAMERA.T_world_camera(1.0, 2.0, np.pi / 2, 0.0)
    pixels = project([[1.0, 5.0, 0.5], [0.0, 5.0, 0.5], [1.0, 5.0, 1.5], [1.0, 1.0, 0.5]], T, calibration())
    focal = CAMERA.K_px[0, 0]
    np.testing.assert_allclose(pixels[0], [128.0, 72.0])
    np.testing.assert_allclose(pixels[1], [128.0 - focal / 3, 72.0])
    np.testing.assert_allclose(pixels[2], [128.0, 72.0 - focal / 3])
    assert np.isnan(pixels[3]).all()


def test_lens_of_the_episode_bends_the_view() -> None:
    T = CAMERA.T_world_camera(0.0, 0.0, 0.0, 0.0)
    aside = [[2.0, 1.5, 0.5]]
    straight = project(aside, T, calibration())[0, 0]
    angle, focal = np.arctan(0.75), CAMERA.K_px[0, 0]
    barrel = project(aside, T, calibration("plumb_bob", (-0.1, 0.0, 0.0, 0.0, 0.0)))[0, 0]
    fisheye = project(aside, T, calibration("kannala_brandt", (0.0,) * 4))[0, 0]
    assert barrel == pytest.approx(128.0 - focal * 0.75 * (1 - 0.1 * 0.75**2))
    assert fisheye == pytest.approx(128.0 - focal * angle)
    assert straight == pytest.approx(128.0 - focal * 0.75)


def test_corners_of_a_turned_box() -> None:
    box = corners(np.array([1.0, 2.0, 0.9, 0.4, 0.8, 1.8, np.pi / 2]))
    np.testing.assert_allclose(box.max(axis=0), [1.4, 2.2, 1.8])
    np.testing.assert_allclose(box.min(axis=0), [0.6, 1.8, 0.0], atol=1e-12)
    assert len({tuple(corner) for corner in box.round(6)}) == 8


def test_humans_are_drawn_where_they_are(tmp_path) -> None:
    write_shard(tmp_path, [0], labels=True)
    dataset = Dataset([tmp_path])
    plain = np.asarray(cv2.resize(dataset.decode(2), (640, 480), interpolation=cv2.INTER_CUBIC)).astype(int)
    changed = np.abs(labelled_image(dataset, 2).astype(int) - plain).max(axis=2) > 60
    assert dataset.robot is not None
    T = dataset.robot.camera.T_world_camera(*dataset.poses[2][[0, 1, 3]], dataset.poses[2][2])
    pelvis = 20 * project(dataset.joints_m(2)[0, :1], T, dataset.calibration(2))[0]
    u, v = pelvis.round().astype(int)
    assert changed[v - 3 : v + 3, u - 3 : u + 3].mean() > 0.3
    assert changed.mean() < 0.1


def test_overlay_is_written_for_data_with_labels_only(tmp_path) -> None:
    write_shard(tmp_path / "with", [0], labels=True)
    write_shard(tmp_path / "without", [0])
    inspect(InspectOptions(data=tmp_path / "with", overlay=tmp_path / "new" / "overlay.png"))
    assert cv2.imread(str(tmp_path / "new" / "overlay.png")).shape[1] > 1280
    with pytest.raises(DatasetError, match="have no labels of people"):
        inspect(InspectOptions(data=tmp_path / "without", overlay=tmp_path / "overlay.png"))
    with pytest.raises(ConfigError, match=r"overlay.jpg must end in \.png"):
        inspect(InspectOptions(data=tmp_path / "with", overlay=tmp_path / "overlay.jpg"))
    assert not list(tmp_path.glob("overlay.*"))


def test_dataset_in_which_nobody_is_seen_has_no_overlay(tmp_path) -> None:
    write_shard(tmp_path, [0], sample_count=1, labels=True)
    dataset = Dataset([tmp_path])
    dataset._table.rows["human_visible"] = False
    with pytest.raises(DatasetError, match="no sample in which the robot sees a human"):
        label_overlay(dataset)
