"""The network of an exported policy, and back: for training by other means."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import safetensors.torch

from readygo.common.config import section_from_mapping
from readygo.common.errors import ConfigError, PolicyError
from readygo.common.policy.artifact import SPEC_FILE, WEIGHTS_FILE, load_spec
from readygo.services.trainer.config import NetworkConfig
from readygo.services.trainer.export import export_policy, graph_spec
from readygo.services.trainer.model import PolicyNet


def load_network(folder: Path) -> PolicyNet:
    """The network of an exported policy, with its weights, in evaluation mode.

    Args:
        folder: Where the policy is.

    Raises:
        PolicyError: If it cannot be read, or does not say what network it is.
    """
    spec = load_spec(folder)
    try:
        config = section_from_mapping(NetworkConfig, spec.training["config"]["network"])
    except (ConfigError, KeyError, TypeError) as error:
        raise PolicyError(f"{folder / SPEC_FILE} does not say what network it is: {error}; train it again.") from error
    net, path = PolicyNet(spec.robot, config), folder / WEIGHTS_FILE
    try:
        weights = safetensors.torch.load(path.read_bytes())
    except Exception as error:  # a missing file, or safetensors' errors for a broken one
        raise PolicyError(f"{path} cannot be read: {error}; export the policy again.") from error
    shapes = {name: value.shape for name, value in net.driving_weights().items()}
    graph = graph_spec(net, spec.frame_spacing_s)
    # Older graphs do not say which command moves, and those with an image of the goal decided 20 times a second.
    older = [dataclasses.replace(graph, moving=""), dataclasses.replace(graph, rate_hz=graph.rate_hz or 20.0)]
    older.append(dataclasses.replace(older[1], moving=""))
    if spec.graph not in (graph, *older) or {name: value.shape for name, value in weights.items()} != shapes:
        raise PolicyError(f"{path} is not of the network that {SPEC_FILE} names; train it again.")
    net.load_state_dict(weights)
    return net.eval()


def save_network(net: PolicyNet, source: Path, folder: Path, note: Mapping[str, Any]) -> None:
    """Write a policy that was trained on.

    Args:
        net: From `load_network`, trained since.
        source: The policy that it came from.
        folder: Where to; a policy that is there is replaced.
        note: How it was trained, for `[training.fine_tuned]`.

    Raises:
        PolicyError: If it cannot be written, or would replace the one that it came from.
    """
    if folder.resolve() == source.resolve():
        raise PolicyError(f"{folder} is the policy that it began with; write to another folder.")
    spec = load_spec(source)
    export_policy(net, dataclasses.replace(spec, training={**spec.training, "fine_tuned": dict(note)}), folder)
