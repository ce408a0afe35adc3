"""Weights of trained perception, for training that begins with them."""

import hashlib
from pathlib import Path

import safetensors.torch
from torch import Tensor

from readygo.common.camera.config import CameraConfig
from readygo.common.errors import PolicyError
from readygo.common.perception.artifact import WEIGHTS_FILE, load_perception_spec
from readygo.services.trainer.perception.network import PerceptionNet


def trained_weights(folder: Path, camera: CameraConfig, widths: tuple[int, ...]) -> tuple[dict[str, Tensor], str]:
    """Weights of trained perception, and their SHA-256.

    Args:
        folder: That `readygo train --recipe perception` wrote.
        camera: Of the images that are learned from.
        widths: Of the network that begins with them, see `PerceptionConfig`.

    Raises:
        PolicyError: If they are missing or broken, or of another camera or other widths.
    """
    path = folder / WEIGHTS_FILE
    if load_perception_spec(folder).robot.camera != camera:
        raise PolicyError(f"{folder} perceives with another camera than the data have; train it with this camera.")
    try:
        data = path.read_bytes()
        weights = safetensors.torch.load(data)
    except Exception as error:  # a missing file, or safetensors' errors for a broken one
        raise PolicyError(f"{path} cannot be read: {error}; train perception again.") from error
    wanted = PerceptionNet(camera, widths).state_dict()
    if {name: value.shape for name, value in weights.items()} != {name: v.shape for name, v in wanted.items()}:
        raise PolicyError(f"{path} is of a network of other widths than {widths}; set widths to its own.")
    return weights, hashlib.sha256(data).hexdigest()
