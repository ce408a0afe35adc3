import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch

from experiments.policy.perceived import measures
from readygo.common.errors import PolicyError
from readygo.common.perception.artifact import WEIGHTS_FILE, PerceptionSpec
from readygo.services.trainer.perception.export import export_perception
from readygo.services.trainer.perception.network import PerceptionNet
from readygo.services.trainer.perception.train import measure
from tests.services.trainer.perception.conftest import ROBOT, make_looks

WIDTHS = (8, 8, 8, 8, 16)
SPEC = PerceptionSpec(robot=ROBOT, spacing_s=0.2, training={"settings": {"widths": list(WIDTHS)}})


def write_network(folder: Path) -> PerceptionNet:
    torch.manual_seed(5)
    net = PerceptionNet(ROBOT.camera, WIDTHS).eval()
    export_perception(net, SPEC, folder)
    return net


def test_measures_are_those_of_the_weights_in_the_folder(tmp_path: Path) -> None:
    looks, net = make_looks(), write_network(tmp_path)
    found = measures(tmp_path, looks, 10 * len(looks))
    assert found == pytest.approx(dataclasses.asdict(measure(net, looks, np.arange(len(looks)), SPEC)), nan_ok=True)
    assert found["images"] == len(looks)
    assert measures(tmp_path, looks, 3)["images"] == 3


def test_folder_without_weights_is_refused(tmp_path: Path) -> None:
    write_network(tmp_path)
    (tmp_path / WEIGHTS_FILE).unlink()
    with pytest.raises(PolicyError, match=r"weights\.safetensors cannot be read"):
        measures(tmp_path, make_looks(), 3)
