"""Small policies on disk."""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
from onnx import TensorProto, helper, numpy_helper

from readygo.common.images.names import RGB
from readygo.common.policy import PolicySpec, save_spec
from readygo.common.policy.artifact import PolicyInputs
from readygo.common.policy.graph import GRAPH_FILE, Given, GraphSpec
from readygo.common.policy.sight import channels_of, graph_input
from readygo.common.robot import CameraConfig, RobotConfig

CAMERA = CameraConfig(height_px=8, width_px=10)
ROBOT = RobotConfig(camera=CAMERA)


def linear_graph(
    path: Path, inputs: Mapping[str, tuple[int, ...]], dtype: int, name_out: str, weight: npt.NDArray[np.float32]
) -> None:
    flattened = [
        node
        for name in inputs
        for node in (
            helper.make_node("Cast", [name], [f"{name}_x"], to=TensorProto.FLOAT),
            helper.make_node("Flatten", [f"{name}_x"], [f"{name}_flat"], axis=1),
        )
    ]
    nodes = [
        *flattened,
        helper.make_node("Concat", [f"{name}_flat" for name in inputs], ["flat"], axis=1),
        helper.make_node("MatMul", ["flat", "weight"], [name_out]),
    ]
    graph = helper.make_graph(
        nodes,
        "linear",
        [helper.make_tensor_value_info(name, dtype, ["batch", *shape]) for name, shape in inputs.items()],
        [helper.make_tensor_value_info(name_out, TensorProto.FLOAT, ["batch", weight.shape[1]])],
        [numpy_helper.from_array(weight, "weight")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    model.ir_version = 8
    path.write_bytes(model.SerializeToString())


def write_policy(folder: Path, images: tuple[str, ...] = (RGB,)) -> Path:
    """A policy of two random linear maps, which takes some images of one camera."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(0)
    seen = {graph_input(name): (CAMERA.height_px, CAMERA.width_px, channels_of([name])) for name in images}
    encoder = rng.normal(0, 0.01, (sum(map(math.prod, seen.values())), 20)).astype(np.float32)
    head = rng.normal(0, 0.1, (70, 2)).astype(np.float32)
    linear_graph(folder / "encoder.onnx", seen, TensorProto.UINT8, "latent", encoder)
    linear_graph(folder / "head.onnx", {"features": (70,)}, TensorProto.FLOAT, "action", head)
    save_spec(PolicySpec(robot=ROBOT, inputs=PolicyInputs(images=images)), folder)
    return folder


def write_goal_policy(folder: Path) -> Path:
    """A policy of one graph that drives the faster, and turns the more, the brighter its goal is in the image of it."""
    folder.mkdir(parents=True, exist_ok=True)
    shape = [1, 3, CAMERA.height_px, CAMERA.width_px]
    nodes = [
        helper.make_node("Flatten", ["pixels"], ["seen"], axis=1),
        helper.make_node("Flatten", ["there"], ["goal"], axis=1),
        helper.make_node("Concat", ["seen", "goal"], ["both"], axis=1),
        helper.make_node("MatMul", ["both", "weight"], ["action"]),
    ]
    pixels = math.prod(shape)
    weight = np.repeat([[0.0, -2.0], [1.0, 2.0]], pixels, axis=0).astype(np.float32) / pixels
    value = helper.make_tensor_value_info
    inputs = [value(name, TensorProto.FLOAT, shape) for name in ("pixels", "there")]
    outputs = [value("action", TensorProto.FLOAT, [1, 2])]
    graph = helper.make_graph(nodes, "to_goal", inputs, outputs, [numpy_helper.from_array(weight, "weight")])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    model.ir_version = 8
    (folder / GRAPH_FILE).write_bytes(model.SerializeToString())
    spec = GraphSpec(inputs={"pixels": Given.RGB, "there": Given.GOAL_IMAGE})
    save_spec(PolicySpec(robot=ROBOT, inputs=PolicyInputs(frame_count=1), graph=spec), folder)
    return folder
