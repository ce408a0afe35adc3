import numpy as np
import pytest

from readygo.common.dataset import Dataset
from readygo.common.errors import DatasetError
from tests.common.dataset.episodes import write_left_shard, write_shard


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
