import hashlib
from pathlib import Path

import pytest

from readygo.common.camera.config import CameraConfig
from readygo.common.errors import PolicyError
from readygo.common.perception import PerceptionSpec
from readygo.common.perception.artifact import WEIGHTS_FILE
from readygo.services.trainer.perception.export import export_perception
from readygo.services.trainer.perception.network import PerceptionNet
from readygo.services.trainer.perception.weights import trained_weights
from tests.services.trainer.perception.conftest import ROBOT

WIDTHS = (8, 12, 16, 16, 32)


@pytest.fixture
def trained(tmp_path: Path) -> tuple[PerceptionNet, Path]:
    net = PerceptionNet(ROBOT.camera, WIDTHS)
    export_perception(net.eval(), PerceptionSpec(robot=ROBOT), tmp_path)
    return net, tmp_path


def test_weights_are_those_of_the_network_with_the_hash_of_their_file(trained: tuple[PerceptionNet, Path]) -> None:
    net, folder = trained
    weights, sha256 = trained_weights(folder, ROBOT.camera, WIDTHS)
    assert weights.keys() == net.state_dict().keys()
    assert all(bool((weights[name] == value).all()) for name, value in net.state_dict().items())
    assert sha256 == hashlib.sha256((folder / WEIGHTS_FILE).read_bytes()).hexdigest()


def test_other_camera_or_widths_and_broken_files_are_refused(trained: tuple[PerceptionNet, Path]) -> None:
    folder = trained[1]
    with pytest.raises(PolicyError, match="perceives with another camera than the data have"):
        trained_weights(folder, CameraConfig(height_px=24, width_px=56), WIDTHS)
    with pytest.raises(
        PolicyError, match=r"is of a network of other widths than \(8, 12, 16, 16, 40\); set widths to its own"
    ):
        trained_weights(folder, ROBOT.camera, (8, 12, 16, 16, 40))
    (folder / WEIGHTS_FILE).write_bytes(b"no weights")
    with pytest.raises(PolicyError, match=r"cannot be read: .*; train perception again"):
        trained_weights(folder, ROBOT.camera, WIDTHS)
