"""Write a policy network as the policy artifact: one ONNX graph, its description, and the weights.

The graph is that of `InferenceModule`.
"""

import copy
import dataclasses
from pathlib import Path
from typing import Any

import safetensors.torch
import torch
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from readygo.common.errors import PolicyError
from readygo.common.files import write_whole
from readygo.common.images.names import DEPTH, kind_of
from readygo.common.policy.artifact import SPEC_FILE, WEIGHTS_FILE, PolicySpec, save_spec
from readygo.common.policy.graph import GRAPH_FILE, Given, GraphSpec
from readygo.common.policy.sight import channels_of
from readygo.common.policy.traits import TRAIT_COUNT
from readygo.common.robot import RobotConfig
from readygo.services.trainer.graph_file import graph_bytes
from readygo.services.trainer.inputs import Fusion, GoalForm, MotionInput
from readygo.services.trainer.model import Encoder, PolicyNet, ResidualBlock
from readygo.services.trainer.pretrained import PretrainedEncoder

MEMORY, MOVING = "memory", "moving"
"""Names of the graph's state, and of its best command that moves."""


class InferenceModule(nn.Module):
    """A policy as its graph: values in the order of `GraphSpec`, bytes and SI units -> command and new latents."""

    def __init__(self, net: PolicyNet, spec: GraphSpec) -> None:
        """Copy a network, with its normalisations folded into the convolutions before them.

        Args:
            net: The trained network.
            spec: From `graph_spec`.
        """
        super().__init__()
        self.net = copy.deepcopy(net).eval().cpu()
        if isinstance(self.net.encoder, Encoder):
            fold_norms(self.net.encoder)
        for value in self.net.parameters():
            value.data = value.data.contiguous()
        self._names = [*spec.inputs, *spec.state, *spec.cache]

    def forward(self, *values: Tensor) -> tuple[Tensor, ...]:
        """One decision.

        Args:
            *values: What `GraphSpec.inputs`, then `GraphSpec.state` and then `GraphSpec.cache` name.

        Returns:
            v [m/s] and w [rad/s], shape (1, 2); the same of the best command that moves, if the network weighs
            commands; the memory, shape (1, R), if there is one; with late fusion the latents of the N new frames,
            shape (N, L).
        """
        net, given = self.net, dict(zip(self._names, values, strict=True))
        # With early fusion shape (1, F, H, W, C) each, else (N, H, W, C).
        pixels = torch.cat([self._pixels(given[name], name) for name in net.inputs.images], dim=1)
        pretrained = isinstance(net.encoder, PretrainedEncoder)
        latents = new = net.encoder(pixels, given[Given.MOTION]) if pretrained else net.encoder(pixels)
        if net.inputs.fusion is Fusion.LATE:
            rows = [given[name] for name in (Given.WINDOW, Given.GOAL_FRAME) if name in given]
            latents = torch.cat([given["latents"], new])[torch.cat(rows)].reshape(1, -1)
        traits, goal_xy_m = given.get(Given.ROBOT), given.get(Given.GOAL, torch.zeros(1, 2))
        if net.inputs.motion is MotionInput.POSES:
            motion = given[Given.MOTION]
        else:
            motion = torch.cat([given[Given.COMMAND], torch.ones(1, 1)], dim=1)
        told, kept, remembered = net.normalise_motion(motion, traits), [], None
        if net.memory is not None:
            seen = torch.cat([latents, told], dim=1)[:, None]
            remembered = net.memory(seen, given[MEMORY][None])[0][:, 0]
            kept.append(remembered)
        if net.inputs.fusion is Fusion.LATE:
            kept.append(new)
        answers = net.act(latents, told, goal_xy_m, traits, remembered)
        decided = [net.decide(answers)] if net.bins is None else [net.decide(answers), net.decide(answers, moves=True)]
        return (*(net.clip(command, traits) for command in decided), *kept)

    def _pixels(self, image: Tensor, name: str) -> Tensor:
        """Bytes of an image -> numbers in [-1, 1], pooled as training pools them, shape (N, C, h, w)."""
        x, factor = image.float(), self.net.pooling
        x = x.permute(0, 1, 4, 2, 3).flatten(1, 2) if x.dim() == 5 else x.permute(0, 3, 1, 2)
        if factor > 1 and kind_of(name) == DEPTH:
            # What `thin_pixels` gives.
            x = x[:, :, factor // 2 :: factor, factor // 2 :: factor]
        elif factor > 1:
            # Means of bytes, halves rounded up: what `pool` gives.
            x = torch.floor(nn.functional.avg_pool2d(x, factor) + 0.5)
        return x / 127.5 - 1.0


def fold_norms(encoder: Encoder) -> None:
    """Fold an encoder's batch normalisations into the convolutions before them."""
    encoder.stem, encoder.stem_norm = _fold(encoder.stem, encoder.stem_norm)
    for block in encoder.blocks:
        assert isinstance(block, ResidualBlock)
        block.conv1, block.norm1 = _fold(block.conv1, block.norm1)
        block.conv2, block.norm2 = _fold(block.conv2, block.norm2)


def _fold(conv: nn.Conv2d, norm: nn.BatchNorm2d) -> tuple[nn.Conv2d, Any]:
    fused: nn.Conv2d = fuse_conv_bn_eval(conv.double(), norm.double()).float()
    return fused, nn.Identity()


def graph_spec(net: PolicyNet, frame_spacing_s: float) -> GraphSpec:
    """What the graph of a policy is given and gives: with late fusion it keeps the latents of its frames.

    Args:
        net: The network.
        frame_spacing_s: Time between its frames [s], in which its memory advances.
    """
    inputs = net.inputs
    late = inputs.fusion is Fusion.LATE
    named = {
        Given.WINDOW: late,
        Given.GOAL_FRAME: inputs.goal is not GoalForm.POINT,
        Given.MOTION: inputs.motion is MotionInput.POSES,
        Given.COMMAND: inputs.motion is MotionInput.COMMAND,
        Given.GOAL: inputs.goal is not GoalForm.IMAGE,
        Given.ROBOT: inputs.robot,
    }
    given = {name: name for name in (*inputs.images, *(each.value for each, takes in named.items() if takes))}
    if Given.MOTION in given and isinstance(net.encoder, PretrainedEncoder):
        given[Given.MOTION] = Given.IMAGE_MOTION.value
    cache = {"latents": "latent"} if late else {}
    return GraphSpec(
        inputs=given,
        state={MEMORY: f"{MEMORY}_next"} if inputs.memory_count else {},
        cache=cache,
        moving="" if net.bins is None else MOVING,
        frame_count=inputs.frame_count,
        rate_hz=1.0 / frame_spacing_s if inputs.memory_count else None,
    )


def policy_graph(net: PolicyNet, robot: RobotConfig, frame_spacing_s: float) -> bytes:
    """The graph of a policy as an ONNX file; arguments as for `graph_spec`."""
    spec, inputs = graph_spec(net, frame_spacing_s), net.inputs
    size_px = robot.camera.height_px, robot.camera.width_px
    frames = (1, inputs.frame_count) if inputs.fusion is Fusion.EARLY else (2,)
    examples = {
        Given.WINDOW: torch.zeros(inputs.frame_count, dtype=torch.int64),
        Given.GOAL_FRAME: torch.zeros(1, dtype=torch.int64),
        Given.MOTION: torch.zeros(1, inputs.motion.width(inputs.frame_count)),
        Given.IMAGE_MOTION: torch.zeros(1, inputs.motion.width(inputs.frame_count)),
        Given.COMMAND: torch.zeros(1, 2),
        Given.GOAL: torch.zeros(1, 2),
        Given.ROBOT: torch.ones(1, TRAIT_COUNT),
        **{name: torch.zeros(*frames, *size_px, channels_of([name]), dtype=torch.uint8) for name in inputs.images},
    }
    values = [examples[given] for given in spec.inputs.values()]
    values += [torch.zeros(1, inputs.memory_count) for _ in spec.state]
    values += [torch.zeros(2, inputs.latent_count) for _ in spec.cache]
    free = {}
    if spec.cache:
        free = {name: {0: "known"} for name in spec.cache}
        free |= {name: {0: "new"} for name in (*inputs.images, *spec.cache.values())}
    return graph_bytes(
        InferenceModule(net, spec),
        values,
        inputs=[*spec.inputs, *spec.state, *spec.cache],
        outputs=spec.outputs,
        free=free,
    )


def export_policy(net: PolicyNet, spec: PolicySpec, folder: Path) -> None:
    """Write a policy's graph, weights and `policy.toml`, each atomically.

    Args:
        net: The trained network.
        spec: What it was trained for; its graph becomes the network's.
        folder: Where to; a policy that is there is replaced.

    Raises:
        PolicyError: If a file cannot be written.
    """
    graph = policy_graph(net, spec.robot, spec.frame_spacing_s)
    weights = {name: value.detach().cpu().contiguous() for name, value in net.driving_weights().items()}
    folder.mkdir(parents=True, exist_ok=True)
    # Without it a folder is no policy: one that is half replaced is not taken for a whole one.
    (folder / SPEC_FILE).unlink(missing_ok=True)
    write_whole(folder / GRAPH_FILE, graph, raises=PolicyError)
    write_whole(folder / WEIGHTS_FILE, safetensors.torch.save(weights), raises=PolicyError)
    save_spec(dataclasses.replace(spec, graph=graph_spec(net, spec.frame_spacing_s)), folder)
