"""Perception as a folder that runs without torch, and its weights for other networks."""

import copy
from pathlib import Path

import numpy as np
import safetensors.torch
import torch

from readygo.common.errors import PolicyError
from readygo.common.files import write_whole
from readygo.common.perception.artifact import (
    FRAMES,
    GRAPH_FILE,
    SPEC_FILE,
    WEIGHTS_FILE,
    PerceptionSpec,
    save_perception_spec,
)
from readygo.services.trainer.graph_file import graph_bytes
from readygo.services.trainer.perception.network import PerceptionModule, PerceptionNet


def export_perception(net: PerceptionNet, spec: PerceptionSpec, folder: Path) -> None:
    """Write a network's graph, weights and `perception.toml`, each atomically.

    Args:
        net: The trained network.
        spec: What it was trained for.
        folder: Where to; what is there is replaced.

    Raises:
        PolicyError: If a file cannot be written.
    """
    camera = spec.robot.camera
    net = copy.deepcopy(net).cpu()
    module = PerceptionModule(net, camera).eval()
    frames = torch.zeros((FRAMES, camera.height_px, camera.width_px, 3), dtype=torch.uint8)
    motion = torch.from_numpy(np.zeros((1, 3 * (FRAMES - 1) + 2), np.float32))
    graph = graph_bytes(module, [frames, motion], inputs=["frames", "motion"], outputs=["people", "rays"])
    folder.mkdir(parents=True, exist_ok=True)
    # Without it a folder is none: one that is half replaced is not taken for a whole one.
    (folder / SPEC_FILE).unlink(missing_ok=True)
    write_whole(folder / GRAPH_FILE, graph, raises=PolicyError)
    weights = {name: value.detach().contiguous() for name, value in net.state_dict().items()}
    write_whole(folder / WEIGHTS_FILE, safetensors.torch.save(weights), raises=PolicyError)
    save_perception_spec(spec, folder)
