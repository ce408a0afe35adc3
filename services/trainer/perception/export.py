"""Perception as a folder that runs without torch."""

import tempfile
import warnings
from pathlib import Path

import numpy as np
import torch

from readygo.common.errors import PolicyError
from readygo.common.files import write_whole
from readygo.common.perception.artifact import FRAMES, GRAPH_FILE, SPEC_FILE, PerceptionSpec, save_perception_spec
from readygo.services.trainer.export import OPSET
from readygo.services.trainer.perception.network import PerceptionModule, PerceptionNet


def export_perception(net: PerceptionNet, spec: PerceptionSpec, folder: Path) -> None:
    """Write a network's graph and `perception.toml`, each atomically.

    Args:
        net: The trained network.
        spec: What it was trained for.
        folder: Where to; what is there is replaced.

    Raises:
        PolicyError: If a file cannot be written.
    """
    camera = spec.robot.camera
    module = PerceptionModule(net, camera).eval()
    frames = torch.zeros((FRAMES, camera.height_px, camera.width_px, 3), dtype=torch.uint8)
    motion = torch.from_numpy(np.zeros((1, 3 * (FRAMES - 1) + 2), np.float32))
    with warnings.catch_warnings(), tempfile.TemporaryDirectory() as temporary, torch.no_grad():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            module,
            (frames, motion),
            Path(temporary) / GRAPH_FILE,
            input_names=["frames", "motion"],
            output_names=["people", "rays"],
            opset_version=OPSET,
            dynamo=False,
        )
        graph = (Path(temporary) / GRAPH_FILE).read_bytes()
    folder.mkdir(parents=True, exist_ok=True)
    # Without it a folder is none: one that is half replaced is not taken for a whole one.
    (folder / SPEC_FILE).unlink(missing_ok=True)
    write_whole(folder / GRAPH_FILE, graph, raises=PolicyError)
    save_perception_spec(spec, folder)
