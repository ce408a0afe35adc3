"""Write a policy network as the two ONNX graphs of the policy artifact.

The graphs are built from the weights, operation by operation: the file depends on nothing but the weights, and batch
normalisation is folded into the convolutions before it.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import nn

from readygo.common.errors import PolicyError
from readygo.common.files import write_whole
from readygo.common.images.names import DEPTH, RGB, kind_of
from readygo.common.policy.artifact import (
    ENCODER_FILE,
    GOAL_SCALE_M,
    HEAD_FILE,
    SPEC_FILE,
    Goal,
    MotionInput,
    PolicyInputs,
    PolicySpec,
    save_spec,
)
from readygo.common.policy.graph import GRAPH_FILE, Given, GraphSpec
from readygo.common.policy.sight import channels_by_image, graph_input
from readygo.common.policy.traits import LIMITS_AT, TRAIT_COUNT
from readygo.common.robot import RobotConfig
from readygo.services.trainer.model import Bins, PolicyNet, ResidualBlock, motion_units

OPSET = 17
IR_VERSION = 8
"""ONNX 1.12's; onnxruntime 1.13 and later read it."""

LIMIT_COLUMNS = np.arange(LIMITS_AT, TRAIT_COUNT)
Array = npt.NDArray[np.float32]


class GraphBuilder:
    """A chain of ONNX nodes; every method appends nodes and returns the name of their result."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []

    def constant(self, value: npt.NDArray[np.generic]) -> str:
        """A stored array."""
        name = f"constant{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.ascontiguousarray(value), name))
        return name

    def scalar(self, value: float) -> str:
        """A stored number."""
        return self.constant(np.array(value, np.float32))

    def node(self, operation: str, inputs: Sequence[str], **attributes: Any) -> str:
        """One operation."""
        name = f"value{len(self.nodes)}"
        self.nodes.append(helper.make_node(operation, list(inputs), [name], **attributes))
        return name

    def split(self, x: str, count: int) -> list[str]:
        """Equal parts of the columns."""
        names = [f"value{len(self.nodes)}_{part}" for part in range(count)]
        self.nodes.append(helper.make_node("Split", [x], names, axis=1))
        return names

    def conv(self, x: str, conv: nn.Conv2d, norm: nn.BatchNorm2d | None) -> str:
        """A convolution with its batch normalisation folded in."""
        weight, bias = fold_norm(conv, norm)
        padding = int(conv.padding[0])
        return self.node(
            "Conv",
            [x, self.constant(weight), self.constant(bias)],
            strides=list(conv.stride),
            pads=[padding] * 4,
            kernel_shape=list(conv.kernel_size),
        )

    def linear(self, x: str, linear: nn.Linear) -> str:
        """A fully connected layer."""
        names = [self.constant(_array(linear.weight)), self.constant(_array(linear.bias))]
        return self.node("Gemm", [x, *names], transB=1)

    def model(
        self, result: str, inputs: Sequence[onnx.ValueInfoProto], outputs: onnx.ValueInfoProto
    ) -> onnx.ModelProto:
        """The checked model whose output is `result`."""
        self.nodes.append(helper.make_node("Identity", [result], [outputs.name]))
        graph = helper.make_graph(self.nodes, "readygo-policy", list(inputs), [outputs], self.constants)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], producer_name="readygo")
        model.ir_version = IR_VERSION
        onnx.checker.check_model(model, full_check=True)
        return model


def fold_norm(conv: nn.Conv2d, norm: nn.BatchNorm2d | None) -> tuple[Array, Array]:
    """Weight and bias of a convolution followed by a batch normalisation in evaluation mode."""
    weight = conv.weight.detach().double()
    bias = torch.zeros(conv.out_channels, dtype=torch.float64) if conv.bias is None else conv.bias.detach().double()
    if norm is not None:
        assert norm.running_mean is not None
        assert norm.running_var is not None
        scale = norm.weight.detach().double() / torch.sqrt(norm.running_var.double() + norm.eps)
        weight = weight * scale[:, None, None, None]
        bias = (bias - norm.running_mean.double()) * scale + norm.bias.detach().double()
    return weight.float().cpu().numpy(), bias.float().cpu().numpy()


def encoder_graph(model: PolicyNet, robot: RobotConfig) -> onnx.ModelProto:
    """`image` uint8 (B, H, W, C), and further images by name -> `latent` float32 (B, L)."""
    graph = GraphBuilder()
    channels = channels_by_image(model.inputs.images, model.inputs.frames_together)
    x = _append_encoder(graph, model, {name: graph_input(name) for name in channels})
    size_px: tuple[str, int, int] = ("batch", robot.camera.height_px, robot.camera.width_px)
    images = [
        helper.make_tensor_value_info(graph_input(name), TensorProto.UINT8, [*size_px, len(of)])
        for name, of in channels.items()
    ]
    return graph.model(x, images, _float_value("latent", model.inputs.latent_count))


def _append_encoder(graph: GraphBuilder, model: PolicyNet, images: Mapping[str, str]) -> str:
    """The latents of images, of which values of the graph are given by name."""
    encoder = model.encoder
    pooled = [_append_pooling(graph, value, kind_of(name), model.pooling) for name, value in images.items()]
    x = graph.node("Concat", pooled, axis=1) if len(pooled) > 1 else pooled[0]
    x = graph.node("Mul", [x, graph.scalar(1 / 127.5)])
    x = graph.node("Sub", [x, graph.scalar(1.0)])
    x = graph.node("Relu", [graph.conv(x, encoder.stem, encoder.stem_norm)])
    for block in encoder.blocks:
        assert isinstance(block, ResidualBlock)
        x = _append_block(graph, x, block)
    x = graph.node("Relu", [graph.conv(x, encoder.neck, None)])
    return graph.linear(graph.node("Flatten", [x], axis=1), encoder.latent)


def _append_pooling(graph: GraphBuilder, value: str, kind: str, pooling: int) -> str:
    """An image as the network's numbers of bytes, channels first, and as small as it takes it."""
    x = graph.node("Cast", [value], to=TensorProto.FLOAT)
    x = graph.node("Transpose", [x], perm=[0, 3, 1, 2])
    if pooling == 1:
        return x
    if kind == DEPTH:
        # What `thinned` gives.
        begin, end, steps = (
            graph.constant(np.array([value] * 2, np.int64)) for value in (pooling // 2, np.iinfo(np.int64).max, pooling)
        )
        axes = graph.constant(np.array([2, 3], np.int64))
        return graph.node("Slice", [x, begin, end, axes, steps])
    # Means of bytes, halves rounded up: what `pool` gives.
    x = graph.node("AveragePool", [x], kernel_shape=[pooling] * 2, strides=[pooling] * 2)
    return graph.node("Floor", [graph.node("Add", [x, graph.scalar(0.5)])])


def _append_block(graph: GraphBuilder, x: str, block: ResidualBlock) -> str:
    y = graph.node("Relu", [graph.conv(x, block.conv1, block.norm1)])
    y = graph.conv(y, block.conv2, block.norm2)
    shortcut = graph.node("AveragePool", [x], kernel_shape=[2, 2], strides=[2, 2], ceil_mode=1, count_include_pad=0)
    pads = graph.constant(np.array([0, 0, 0, 0, 0, block.extra_channels, 0, 0], np.int64))
    return graph.node("Relu", [graph.node("Add", [y, graph.node("Pad", [shortcut, pads])])])


def head_graph(model: PolicyNet, robot: RobotConfig) -> onnx.ModelProto:
    """`features` float32 (B, F), own motion and goal in SI units -> `action` float32 (B, 2) in SI units.

    That of a policy for several robots also takes `robot` float32 (B, TRAIT_COUNT), in SI units.
    """
    graph, values = GraphBuilder(), [_float_value("features", model.inputs.feature_count)]
    if model.inputs.robot:
        values.append(_float_value("robot", TRAIT_COUNT))
    x = _append_head(graph, model, robot, "features")
    return graph.model(x, values, _float_value("action", 2))


def policy_graph(model: PolicyNet, robot: RobotConfig) -> onnx.ModelProto:
    """All of a policy that sees its goal: frames, the goal's image, own motion -> `action`; see `graph_spec`."""
    graph, inputs = GraphBuilder(), model.inputs
    size_px = (robot.camera.height_px, robot.camera.width_px, 3)
    values = [
        helper.make_tensor_value_info("image", TensorProto.UINT8, [1, inputs.frame_count, *size_px]),
        helper.make_tensor_value_info("goal_image", TensorProto.UINT8, [1, *size_px]),
    ]
    frames = graph.node("Squeeze", ["image", graph.constant(np.array([0], np.int64))])
    latents = _append_encoder(graph, model, {RGB: graph.node("Concat", [frames, "goal_image"], axis=0)})
    told = [graph.node("Reshape", [latents, graph.constant(np.array([1, -1], np.int64))])]
    if inputs.motion is MotionInput.POSES:
        values.append(_float_value("motion", inputs.motion.width(inputs.frame_count)))
        told.append("motion")
    else:
        values.append(_float_value("command", 2))
        told += ["command", graph.constant(np.ones((1, 1), np.float32))]
    if inputs.goal is not Goal.IMAGE:
        values.append(_float_value("goal", 2))
        told.append("goal")
    if inputs.robot:
        values.append(_float_value("robot", TRAIT_COUNT))
    x = _append_head(graph, model, robot, graph.node("Concat", told, axis=1))
    return graph.model(x, values, _float_value("action", 2))


def graph_spec(inputs: PolicyInputs) -> GraphSpec | None:
    """What the graph of a policy that sees its goal is given; None for policies of encoder and head."""
    if inputs.goal is Goal.POINT:
        return None
    motion = Given.MOTION if inputs.motion is MotionInput.POSES else Given.COMMAND
    point = {} if inputs.goal is Goal.IMAGE else {"goal": Given.GOAL}
    robot = {"robot": Given.ROBOT} if inputs.robot else {}
    given = {"image": Given.RGB, "goal_image": Given.GOAL_IMAGE, motion.value: motion, **point, **robot}
    return GraphSpec(inputs=given)


def _append_head(graph: GraphBuilder, model: PolicyNet, robot: RobotConfig, features: str) -> str:
    """The command of features, own motion and goal in SI units, and of `robot` for a policy that knows several."""
    head, inputs = model.head, model.inputs
    limits = graph.constant(np.array([robot.v_max_mps, robot.w_max_radps], np.float32))
    if inputs.robot:
        nominal, limits = limits, graph.node("Gather", ["robot", graph.constant(LIMIT_COLUMNS)], axis=1)
        features = _append_command_units(graph, model, features, graph.node("Div", [nominal, limits]))
    point = 0 if inputs.goal is Goal.IMAGE else 2
    motion_scale, motion_offset = motion_units(inputs, robot)
    scale = [1.0] * inputs.latents_width + motion_scale + [1 / GOAL_SCALE_M] * point
    offset = [0.0] * inputs.latents_width + motion_offset + [0.0] * point
    limit = np.array([np.inf] * (inputs.feature_count - point) + [1.0] * point, np.float32)
    x = graph.node("Mul", [features, graph.constant(np.array(scale, np.float32))])
    x = graph.node("Add", [x, graph.constant(np.array(offset, np.float32))])
    x = graph.node("Min", [x, graph.constant(limit)])
    x = graph.node("Max", [x, graph.constant(-limit)])
    if inputs.robot:
        told = graph.node("Mul", ["robot", graph.constant(_array(model.trait_factor))])
        x = graph.node("Concat", [x, graph.node("Add", [told, graph.constant(_array(model.trait_offset))])], axis=1)
    x = graph.node("Relu", [graph.linear(x, head.layer1)])
    x = graph.node("Relu", [graph.linear(x, head.layer2)])
    x = graph.linear(x, head.layer3)
    if model.bins is not None:
        x = _append_mode(graph, x if model.caution is None else _append_weighing(graph, x, model.caution), model.bins)
    x = graph.node("Min", [x, graph.constant(np.array([1.0, 1.0], np.float32))])
    x = graph.node("Max", [x, graph.constant(np.array([model.slowest, -1.0], np.float32))])
    return graph.node("Mul", [x, limits])


def _append_command_units(graph: GraphBuilder, model: PolicyNet, features: str, ratio: str) -> str:
    """Features whose command is in units of the robot's limits, as `PolicyNet.normalise_motion` has it."""
    commands, begin = _array(model.commands), model.inputs.latents_width
    columns = np.zeros((2, model.inputs.feature_count), np.float32)
    columns[:, begin : begin + commands.shape[1]] = commands
    factor = graph.node("MatMul", [ratio, graph.constant(columns)])
    factor = graph.node("Add", [factor, graph.constant(1 - columns.sum(axis=0))])
    return graph.node("Mul", [features, factor])


def _append_mode(graph: GraphBuilder, logits: str, bins: Bins) -> str:
    """Append `Bins.mode` to a graph."""
    likeliest = graph.node("ArgMax", [logits], axis=1, keepdims=0)
    beside = graph.node("Gather", [graph.constant(_array(bins.beside)), likeliest], axis=0)
    near = graph.node("Softmax", [graph.node("Add", [logits, beside])], axis=1)
    return graph.node("MatMul", [near, graph.constant(_array(bins.centres))])


def _append_weighing(graph: GraphBuilder, answers: str, caution: float) -> str:
    """Append `weigh` to a graph."""
    likely, obstacle, human = graph.split(answers, 3)
    risk = graph.node("Add", [graph.node("Sigmoid", [obstacle]), graph.node("Sigmoid", [human])])
    likely = graph.node("LogSoftmax", [likely], axis=1)
    return graph.node("Sub", [likely, graph.node("Mul", [risk, graph.scalar(caution)])])


def export_policy(model: PolicyNet, spec: PolicySpec, folder: Path) -> None:
    """Write a policy's graphs and `policy.toml`, each atomically; after an interruption they still fit each other."""
    spec = dataclasses.replace(spec, inputs=model.inputs, graph=graph_spec(model.inputs))
    if spec.graph:
        graphs = {GRAPH_FILE: policy_graph(model, spec.robot)}
    else:
        graphs = {ENCODER_FILE: encoder_graph(model, spec.robot), HEAD_FILE: head_graph(model, spec.robot)}
    folder.mkdir(parents=True, exist_ok=True)
    # Without it a folder is no policy: one that is half replaced is not taken for a whole one.
    (folder / SPEC_FILE).unlink(missing_ok=True)
    for name, graph in graphs.items():
        write_whole(folder / name, graph.SerializeToString(), raises=PolicyError)
    save_spec(spec, folder)


def _array(tensor: torch.Tensor) -> Array:
    array: Array = tensor.detach().float().cpu().numpy()
    return array


def _float_value(name: str, width: int) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", width])
