from pathlib import Path

import numpy as np
import pytest
import torch

from readygo.common.camera.config import CameraConfig
from readygo.common.errors import PolicyError
from readygo.common.perception import PerceptionSpec, load_perception
from readygo.common.robot import RobotConfig
from readygo.services.trainer.perception.export import export_perception
from readygo.services.trainer.perception.network import PerceptionNet
from readygo.services.trainer.perception.train import perceive
from tests.services.trainer.perception.conftest import ROBOT, make_looks


@pytest.mark.parametrize(("height_px", "width_px"), [(72, 128), (24, 32), (72, 100), (100, 161)])
def test_exported_graph_answers_as_the_network(tmp_path: Path, height_px: int, width_px: int) -> None:
    torch.manual_seed(0)
    camera = CameraConfig(height_px=height_px, width_px=width_px)
    robot, looks = RobotConfig(camera=camera), make_looks(camera=camera)
    spec, net = PerceptionSpec(robot=robot), PerceptionNet(camera, (4, 4, 8, 8, 16)).eval()
    export_perception(net, spec, tmp_path)
    perception = load_perception(tmp_path, robot=robot)
    assert perception.spec == spec
    rows = np.arange(6)
    motion = np.random.default_rng(0).uniform(-0.2, 0.2, (6, 8)).astype(np.float32)
    looks.motion[rows] = motion
    maps, free_m = perceive(net, looks, rows, spec)
    for row in rows.tolist():
        perceived = perception.look(looks.frames[looks.window[row]], motion[row])
        # The trainer keeps grey frames in bytes.
        np.testing.assert_allclose(perceived.answers, maps[row], atol=0.02)
        np.testing.assert_allclose(perceived.rays_m, free_m[row], rtol=0.02)


def test_folder_that_is_not_whole_is_refused(tmp_path: Path) -> None:
    export_perception(PerceptionNet(ROBOT.camera, (4, 4, 8, 8, 16)), PerceptionSpec(robot=ROBOT), tmp_path)
    (tmp_path / "perception.onnx").write_bytes(b"no graph")
    with pytest.raises(PolicyError, match=r"perception\.onnx"):
        load_perception(tmp_path)
