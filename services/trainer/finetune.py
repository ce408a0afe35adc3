"""The head of an exported policy as a torch module, and back: for training by other means.

The encoder stays what it is, byte by byte: only what makes commands of its latents is trained.
"""

import dataclasses
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import onnx
import torch
from onnx import numpy_helper

from readygo.common.config import section_from_mapping
from readygo.common.errors import ConfigError, PolicyError
from readygo.common.files import write_whole
from readygo.common.policy.artifact import ENCODER_FILE, HEAD_FILE, SPEC_FILE, load_spec, save_spec
from readygo.services.trainer.config import NetworkConfig
from readygo.services.trainer.export import head_graph
from readygo.services.trainer.model import PolicyNet


def load_head(folder: Path) -> PolicyNet:
    """A network with the head of an exported policy; its encoder's weights are not the policy's.

    Args:
        folder: Where the policy is.

    Raises:
        PolicyError: If it cannot be read, or does not say what network it is.
    """
    spec = load_spec(folder)
    if spec.inputs.robot:
        raise PolicyError(f"{folder} holds a policy for several robots, whose head cannot be trained on alone.")
    try:
        config = section_from_mapping(NetworkConfig, spec.training["config"]["network"])
    except (ConfigError, KeyError, TypeError) as error:
        raise PolicyError(f"{folder / SPEC_FILE} does not say what network it is: {error}; train it again.") from error
    net = PolicyNet(spec.robot, config)
    layers = (net.head.layer1, net.head.layer2, net.head.layer3)
    found = _linear_weights(folder / HEAD_FILE)
    shapes = [(layer.weight.shape, layer.bias.shape) for layer in layers]
    if net.inputs != spec.inputs or [(weight.shape, bias.shape) for weight, bias in found] != shapes:
        raise PolicyError(f"{folder / HEAD_FILE} is not the network that {SPEC_FILE} names; train it again.")
    with torch.no_grad():
        for layer, (weight, bias) in zip(layers, found, strict=True):
            layer.weight.copy_(weight)
            layer.bias.copy_(bias)
    return net


def save_head(net: PolicyNet, source: Path, folder: Path, note: Mapping[str, Any]) -> None:
    """Write a policy that has the encoder of another one, and a head trained on.

    Args:
        net: From `load_head`, trained since.
        source: The policy that it came from.
        folder: Where to; a policy that is there is replaced.
        note: How it was trained, for `[training.fine_tuned]`.

    Raises:
        PolicyError: If it cannot be written, or would replace the one that it came from.
    """
    if folder.resolve() == source.resolve():
        raise PolicyError(f"{folder} is the policy that it began with; write to another folder.")
    spec = load_spec(source)
    graph = head_graph(net, spec.robot)
    folder.mkdir(parents=True, exist_ok=True)
    # Without it a folder is no policy: one that is half replaced is not taken for a whole one.
    (folder / SPEC_FILE).unlink(missing_ok=True)
    shutil.copyfile(source / ENCODER_FILE, folder / ENCODER_FILE)
    write_whole(folder / HEAD_FILE, graph.SerializeToString(), raises=PolicyError)
    training = {**spec.training, "fine_tuned": dict(note)}
    save_spec(dataclasses.replace(spec, training=training), folder)


def _linear_weights(path: Path) -> list[tuple[torch.Tensor, torch.Tensor]]:
    """Weights and biases of the fully connected layers of a graph, in their order."""
    try:
        graph = onnx.load(path).graph
    except Exception as error:  # a missing file, or protobuf's errors for a broken one
        raise PolicyError(f"Policy file {path} cannot be read: {error}; export the policy again.") from error
    constants = {tensor.name: tensor for tensor in graph.initializer}
    linear = [node for node in graph.node if node.op_type == "Gemm"]
    found = [[numpy_helper.to_array(constants[name]).copy() for name in node.input[1:3]] for node in linear]
    return [(torch.from_numpy(weight), torch.from_numpy(bias)) for weight, bias in found]
