"""Small policies on disk."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import onnx
import safetensors.numpy
from onnx import TensorProto, helper, numpy_helper

from readygo.common.images.names import RGB
from readygo.common.policy import PolicySpec, save_spec
from readygo.common.policy.artifact import WEIGHTS_FILE
from readygo.common.policy.graph import GRAPH_FILE, Given, GraphSpec
from readygo.common.policy.sight import channels_of
from readygo.common.robot import CameraConfig, RobotConfig

CAMERA = CameraConfig(height_px=8, width_px=10)
ROBOT = RobotConfig(camera=CAMERA)


def graph_seeing(images: Sequence[str]) -> GraphSpec:
    """A graph that takes one frame of some images, and keeps nothing."""
    return GraphSpec(inputs={name: name for name in images}, cache={}, frame_count=1)


def write_graph(
    folder: Path,
    spec: PolicySpec,
    nodes: Sequence[onnx.NodeProto],
    inputs: Mapping[str, tuple[int, Sequence[int | str]]],
    outputs: Mapping[str, Sequence[int | str]],
    constants: Mapping[str, npt.ArrayLike],
) -> Path:
    """A policy of some nodes, whose inputs have a type and a shape each."""
    folder.mkdir(parents=True, exist_ok=True)
    value = helper.make_tensor_value_info
    graph = helper.make_graph(
        nodes,
        "policy",
        [value(name, dtype, shape) for name, (dtype, shape) in inputs.items()],
        [value(name, TensorProto.FLOAT, shape) for name, shape in outputs.items()],
        [numpy_helper.from_array(np.asarray(array), name) for name, array in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    model.ir_version = 8
    onnx.checker.check_model(model)
    (folder / GRAPH_FILE).write_bytes(model.SerializeToString())
    (folder / WEIGHTS_FILE).write_bytes(safetensors.numpy.save({}))
    save_spec(spec, folder)
    return folder


def write_policy(folder: Path, images: tuple[str, ...] = (RGB,), *, seed: int = 0) -> Path:
    """A policy of two random linear maps, which takes some images of one camera and keeps their latents."""
    rng, size = np.random.default_rng(seed), (CAMERA.height_px, CAMERA.width_px)
    seen = {name: (*size, channels_of([name])) for name in images}
    encoder = rng.normal(0, 0.01, (sum(map(math.prod, seen.values())), 20)).astype(np.float32)
    nodes = [helper.make_node("Cast", [name], [f"{name}_x"], to=TensorProto.FLOAT) for name in seen]
    nodes += [helper.make_node("Flatten", [f"{name}_x"], [f"{name}_flat"], axis=1) for name in seen]
    nodes += [
        helper.make_node("Concat", [f"{name}_flat" for name in seen], ["flat"], axis=1),
        helper.make_node("MatMul", ["flat", "encoder"], ["latent"]),
        helper.make_node("Concat", ["latents", "latent"], ["rows"], axis=0),
        helper.make_node("Gather", ["rows", "window"], ["frames"], axis=0),
        helper.make_node("Reshape", ["frames", "one_row"], ["together"]),
        helper.make_node("Concat", ["together", "motion", "goal"], ["features"], axis=1),
        helper.make_node("MatMul", ["features", "head"], ["action"]),
    ]
    inputs = {
        **{name: (TensorProto.UINT8, ("new", *shape)) for name, shape in seen.items()},
        "window": (TensorProto.INT64, (3,)),
        "motion": (TensorProto.FLOAT, (1, 8)),
        "goal": (TensorProto.FLOAT, (1, 2)),
        "latents": (TensorProto.FLOAT, ("known", 20)),
    }
    given = {name: name for name in (*images, "window", "motion", "goal")}
    head = rng.normal(0, 0.1, (70, 2)).astype(np.float32)
    constants = {"encoder": encoder, "head": head, "one_row": np.array([1, -1])}
    spec = PolicySpec(robot=ROBOT, graph=GraphSpec(inputs=given))
    return write_graph(folder, spec, nodes, inputs, {"action": (1, 2), "latent": ("new", 20)}, constants)


def write_goal_policy(folder: Path) -> Path:
    """A policy that drives the faster, and turns the more, the brighter its goal is in the image of it."""
    shape = (1, 3, CAMERA.height_px, CAMERA.width_px)
    nodes = [
        helper.make_node("Flatten", ["pixels"], ["seen"], axis=1),
        helper.make_node("Flatten", ["there"], ["goal"], axis=1),
        helper.make_node("Concat", ["seen", "goal"], ["both"], axis=1),
        helper.make_node("MatMul", ["both", "weight"], ["action"]),
    ]
    pixels = math.prod(shape)
    weight = np.repeat([[0.0, -2.0], [1.0, 2.0]], pixels, axis=0).astype(np.float32) / pixels
    graph = GraphSpec(inputs={"pixels": RGB, "there": Given.GOAL_IMAGE}, cache={}, frame_count=1)
    inputs = {name: (TensorProto.FLOAT, shape) for name in ("pixels", "there")}
    spec = PolicySpec(robot=ROBOT, graph=graph)
    return write_graph(folder, spec, nodes, inputs, {"action": (1, 2)}, {"weight": weight})
