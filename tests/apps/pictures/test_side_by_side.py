from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from readygo.apps.pictures.side_by_side import CAPTION_PX, GAP_PX, caption_of, has_several, shown_images, side_by_side
from readygo.common.camera import CameraConfig
from readygo.common.dataset import Dataset
from readygo.common.errors import DatasetError
from readygo.common.robot import RobotConfig
from tests.common.dataset.episodes import write_left_shard, write_shard

ROBOT = RobotConfig(cameras={"left": CameraConfig(mount_yaw_deg=75.0), "right": CameraConfig(mount_yaw_deg=-75.0)})
NAMES = ("rgb", "depth", "mask", "right.rgb", "right.depth", "left.rgb")


def test_cameras_come_from_left_to_right_and_depths_below_colours() -> None:
    assert shown_images(NAMES, ROBOT) == (("left.rgb", "rgb", "right.rgb"), ("depth", "right.depth"))
    assert shown_images(NAMES, ROBOT, "right") == (("right.rgb",), ("right.depth",))
    assert shown_images(NAMES, ROBOT, "front") == (("rgb",), ("depth",))
    assert [caption_of(name, ROBOT) for name in ("rgb", "left.depth")] == ["front", "left depth"]
    with pytest.raises(DatasetError, match="camera 'rear'; there are those of left, front, right"):
        shown_images(NAMES, ROBOT, "rear")


def test_cameras_that_the_robot_does_not_name_are_shown() -> None:
    assert shown_images(("rgb", "top.rgb"), ROBOT) == (("rgb", "top.rgb"),)


def test_pictures_are_enlarged_by_a_whole_factor_or_made_smaller() -> None:
    images = {name: np.full((10, 20, 3), value, np.uint8) for name, value in (("rgb", 50), ("left.rgb", 200))}
    rows = (("left.rgb", "rgb"),)
    picture = side_by_side(images, rows, ROBOT, width_px=130)
    assert picture.shape == (30 + CAPTION_PX, 2 * 60 + GAP_PX, 3)
    assert (int(picture[15, 30, 0]), int(picture[15, 90, 0])) == (200, 50)
    assert side_by_side(images, rows, ROBOT, width_px=20).shape == (5 + CAPTION_PX, 20 + GAP_PX, 3)


def test_images_of_other_sizes_get_the_height_of_the_highest() -> None:
    images = {"rgb": np.zeros((10, 20, 3), np.uint8), "left.rgb": np.zeros((20, 20, 3), np.uint8)}
    assert side_by_side(images, (("left.rgb", "rgb"),), ROBOT, width_px=60).shape[:2] == (20 + CAPTION_PX, 60 + GAP_PX)


def test_data_have_several_images_at_a_time_or_one(tmp_path: Path) -> None:
    write_shard(tmp_path / "one", [0], outputs=("mask",))
    write_left_shard(tmp_path / "two", [0])
    assert [has_several(Dataset([tmp_path / name])) for name in ("one", "two")] == [False, True]


def test_pictures_look_as_they_did(golden_image: Callable[[str, np.ndarray], None]) -> None:
    rng = np.random.default_rng(4)
    images = {
        "rgb": rng.integers(0, 255, (6, 11, 3)).astype(np.uint8),
        "left.rgb": rng.integers(0, 255, (9, 8, 3)).astype(np.uint8),
        "depth": np.geomspace(0.2, 14.0, 6 * 11).reshape(6, 11).astype(np.float32),
    }
    rows = shown_images(images, ROBOT)
    assert rows == (("left.rgb", "rgb"), ("depth",))
    large, small = (side_by_side(images, rows, ROBOT, width_px=width) for width in (270, 19))
    golden_image("side_by_side", large)
    assert small.shape == (2 * (7 + CAPTION_PX), round(8 * 7 / 9) + round(11 * 7 / 6) + GAP_PX, 3)
