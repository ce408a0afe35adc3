"""Small ONNX networks with the inputs and outputs of those that users have."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import onnx
from onnx import TensorProto, helper, numpy_helper


def write_network(
    path: Path,
    nodes: Sequence[onnx.NodeProto],
    size: tuple[int | str, int | str],
    outputs: Sequence[str | onnx.ValueInfoProto],
    constants: Mapping[str, npt.ArrayLike],
) -> Path:
    """A network of some nodes from `image` (1, 3, H, W) to outputs of any shape, named ones of float32."""
    value = helper.make_tensor_value_info
    graph = helper.make_graph(
        nodes,
        "network",
        [value("image", TensorProto.FLOAT, (1, 3, *size))],
        [value(each, TensorProto.FLOAT, None) if isinstance(each, str) else each for each in outputs],
        [numpy_helper.from_array(np.asarray(array), name) for name, array in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    model.ir_version = 8
    path.write_bytes(model.SerializeToString())
    return path


def write_brightness(path: Path, size: tuple[int | str, int | str], threshold: float, gain: float) -> Path:
    """A mask network: the logit of a pixel is `gain` times how much brighter it is than `threshold`."""
    nodes = [
        helper.make_node("ReduceMean", ["image"], ["mean"], axes=[1], keepdims=1),
        helper.make_node("Sub", ["mean", "threshold"], ["above"]),
        helper.make_node("Mul", ["above", "gain"], ["logit"]),
    ]
    constants = {"threshold": np.float32(threshold), "gain": np.float32(gain)}
    return write_network(path, nodes, size, ["logit"], constants)


def write_brightest(path: Path, size: tuple[int, int], count: int, *, simcc: bool) -> Path:
    """A keypoint network: all `count` keypoints are where the image is brightest; as classes or as a heatmap."""
    ones = np.ones((1, count, 1, 1), np.float32)
    nodes = [
        helper.make_node("ReduceMean", ["image"], ["grey"], axes=[1], keepdims=1),
        helper.make_node("Sigmoid", ["grey"], ["bright"]),
        helper.make_node("Mul", ["bright", "ones"], ["heatmap"]),
    ]
    if not simcc:
        return write_network(path, nodes, size, ["heatmap"], {"ones": ones})
    nodes += [
        helper.make_node("ReduceMax", ["heatmap"], ["columns"], axes=[2], keepdims=0),
        helper.make_node("ReduceMax", ["heatmap"], ["rows"], axes=[3], keepdims=0),
        helper.make_node("Resize", ["columns", "", "scales"], ["simcc_x"], mode="nearest"),
        helper.make_node("Resize", ["rows", "", "scales"], ["simcc_y"], mode="nearest"),
    ]
    constants = {"ones": ones, "scales": np.array([1.0, 1.0, 2.0], np.float32)}
    return write_network(path, nodes, size, ["simcc_x", "simcc_y"], constants)


def write_points(path: Path, size: tuple[int, int], points: npt.ArrayLike) -> Path:
    """A keypoint network that gives points (K, 2) in its input for every image, as classes of half a pixel."""
    points = np.asarray(points)
    bins = np.zeros((2, 1, len(points), 2 * max(size)), np.float32)
    for k, (u, v) in enumerate(points):
        bins[0, 0, k, round(2 * u)] = bins[1, 0, k, round(2 * v)] = 0.8
    nodes = [
        helper.make_node("ReduceMean", ["image"], ["mean"], keepdims=0),
        helper.make_node("Mul", ["mean", "zero"], ["nothing"]),
        helper.make_node("Add", ["x", "nothing"], ["simcc_x"]),
        helper.make_node("Add", ["y", "nothing"], ["simcc_y"]),
    ]
    height, width = size
    constants = {"x": bins[0, ..., : 2 * width], "y": bins[1, ..., : 2 * height], "zero": np.float32(0.0)}
    return write_network(path, nodes, size, ["simcc_x", "simcc_y"], constants)
