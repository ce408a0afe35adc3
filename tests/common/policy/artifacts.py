"""Small policies on disk."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
from onnx import TensorProto, helper, numpy_helper

from readygo.common.policy import PolicySpec, save_spec
from readygo.common.robot import CameraConfig, RobotConfig

CAMERA = CameraConfig(height_px=8, width_px=10)
ROBOT = RobotConfig(camera=CAMERA)


def linear_graph(
    path: Path, name_in: str, dtype: int, shape: tuple[int, ...], name_out: str, weight: npt.NDArray[np.float32]
) -> None:
    nodes = [
        helper.make_node("Cast", [name_in], ["x"], to=TensorProto.FLOAT),
        helper.make_node("Flatten", ["x"], ["flat"], axis=1),
        helper.make_node("MatMul", ["flat", "weight"], [name_out]),
    ]
    graph = helper.make_graph(
        nodes,
        "linear",
        [helper.make_tensor_value_info(name_in, dtype, ["batch", *shape])],
        [helper.make_tensor_value_info(name_out, TensorProto.FLOAT, ["batch", weight.shape[1]])],
        [numpy_helper.from_array(weight, "weight")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    model.ir_version = 8
    path.write_bytes(model.SerializeToString())


def write_policy(folder: Path) -> Path:
    """A policy of two random linear maps."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(0)
    pixels = CAMERA.height_px * CAMERA.width_px * 3
    encoder = rng.normal(0, 0.01, (pixels, 20)).astype(np.float32)
    head = rng.normal(0, 0.1, (70, 2)).astype(np.float32)
    linear_graph(folder / "encoder.onnx", "image", TensorProto.UINT8, (8, 10, 3), "latent", encoder)
    linear_graph(folder / "head.onnx", "features", TensorProto.FLOAT, (70,), "action", head)
    save_spec(PolicySpec(robot=ROBOT), folder)
    return folder
