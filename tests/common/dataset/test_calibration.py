import dataclasses
from pathlib import Path

import numpy as np
import pytest

from readygo.common.dataset import Dataset, ShardWriter, encode_episode, shard_name
from readygo.common.errors import DatasetError
from readygo.common.messages.samples import FurtherCamera, sample_crc32
from readygo.common.robot import CameraConfig
from tests.common.dataset.episodes import jpeg, make_episode, provenance_with_robot, write_left_shard, write_shard


def test_calibration_is_that_of_the_episode(tmp_path) -> None:
    coefficients = (0.1, -0.2, 0.3, 0.4, 0.5)
    write_shard(tmp_path, [0], distortion_model="plumb_bob", distortion=coefficients)
    write_shard(tmp_path, [1], number=1)
    dataset = Dataset([tmp_path])
    lens, pinhole = dataset.calibration(3), dataset.calibration(20)
    assert (lens.distortion_model, lens.distortion) == ("plumb_bob", coefficients)
    assert (pinhole.distortion_model, pinhole.distortion) == ("", ())
    assert (lens.height_px, lens.width_px) == (24, 32)
    assert dataset.robot is not None
    np.testing.assert_array_equal(pinhole.K_px, dataset.robot.camera.K_px)


def test_camera_that_the_samples_have_not_is_named_with_those_that_they_have(tmp_path) -> None:
    write_shard(tmp_path / "one", [0])
    write_left_shard(tmp_path / "two", [0])
    with pytest.raises(DatasetError, match="have no camera 'rear'; besides the first they have none"):
        Dataset([tmp_path / "one"]).calibration(0, "rear")
    two = Dataset([tmp_path / "two"])
    with pytest.raises(DatasetError, match="have no camera 'rear'; besides the first they have left"):
        two.calibration(0, "rear")
    assert two.calibration(0, "left").width_px != two.calibration(0).width_px


def write_shard_of_cameras(folder: Path, index: int, cameras: dict[str, CameraConfig]) -> None:
    """A shard of an episode that has colours of further cameras, which are named in an order."""
    folder.mkdir()
    header, samples = make_episode(index)
    calibrated = (
        FurtherCamera(name=name, height_px=camera.height_px, width_px=camera.width_px, K_px=tuple(camera.K_px.ravel()))
        for name, camera in cameras.items()
    )
    header = dataclasses.replace(header, cameras=tuple(calibrated))
    images = {f"{name}.rgb": jpeg(1, camera.height_px, camera.width_px) for name, camera in cameras.items()}
    seen = [dataclasses.replace(sample, outputs=images, crc32=sample_crc32(sample.image, images)) for sample in samples]
    provenance = provenance_with_robot(cameras=cameras)
    with ShardWriter(folder / shard_name("r0", 0), provenance, outputs=images, fsync=False) as writer:
        writer.append(encode_episode(header, 1, seen))


def test_calibration_is_that_of_the_named_camera_where_runs_name_cameras_in_another_order(tmp_path) -> None:
    left, rear = CameraConfig(height_px=16, width_px=20), CameraConfig(height_px=12, width_px=28)
    write_shard_of_cameras(tmp_path / "one", 0, {"left": left, "rear": rear})
    write_shard_of_cameras(tmp_path / "two", 1, {"rear": rear, "left": left})
    dataset = Dataset([tmp_path / "one", tmp_path / "two"])
    for episode in (0, 1):
        assert dataset.calibration(12 * episode, "left").width_px == 20
        assert dataset.calibration(12 * episode, "rear").width_px == 28
