"""Loading an exported policy with onnxruntime: one thread, so the numbers do not depend on the batch."""

from pathlib import Path
from typing import Any

import numpy as np

from readygo.common.errors import PolicyError
from readygo.common.extras import install_command
from readygo.common.policy.artifact import ENCODER_FILE, HEAD_FILE, SPEC_FILE, PolicySpec, load_spec
from readygo.common.policy.encoder_policy import EncoderPolicy
from readygo.common.policy.graph import GRAPH_FILE
from readygo.common.policy.graph_policy import GraphPolicy
from readygo.common.policy.policy import Policy, check_policy_camera
from readygo.common.policy.sight import channels_of
from readygo.common.robot import RobotConfig


def load_policy(folder: str | Path, *, robot: RobotConfig | None = None) -> Policy:
    """Load an exported policy.

    Args:
        folder: The folder that training wrote.
        robot: The robot that it shall drive, one of those that it knows if it knows several; None skips the
            comparison.

    Raises:
        PolicyError: If a file is missing or broken, the format is another version's, the camera differs from
            `robot`'s, or onnxruntime is not installed.
    """
    folder = Path(folder)
    spec = load_spec(folder)
    if robot is not None:
        check_policy_camera(spec, robot)
    policy = _open_policy(spec, folder)
    _check_graphs(policy, folder)
    return policy.for_robot(robot) if robot is not None and spec.robot.ranges.varies else policy


def _open_policy(spec: PolicySpec, folder: Path) -> Policy:
    if spec.graph is None:
        return EncoderPolicy(spec, _open_session(folder / ENCODER_FILE), _open_session(folder / HEAD_FILE))
    return GraphPolicy(spec, _open_session(folder / GRAPH_FILE))


def _open_session(path: Path) -> Any:
    try:
        import onnxruntime
    except ImportError as error:
        raise PolicyError(f"onnxruntime is not installed; run: {install_command('policy')}") from error
    if not path.is_file():
        raise PolicyError(f"Policy file {path} is missing; export the policy again.")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime raises a dozen unrelated types for a broken file
        reason = str(error).splitlines()[0]
        raise PolicyError(f"Policy file {path} cannot be loaded: {reason}; export the policy again.") from error


def _check_graphs(policy: Policy, folder: Path) -> None:
    camera, zeros = policy.spec.robot.camera, np.zeros((1, 2), np.float32)
    shape = (1, camera.height_px, camera.width_px, channels_of(policy.spec.inputs.images))
    memory = policy.start()
    memory.kept.goal_image = np.zeros((*shape[1:3], 3), np.uint8)
    try:
        policy.step([memory], np.zeros(shape, np.uint8), zeros, zeros)
    except PolicyError:
        raise
    except Exception as error:  # as above: a graph of other inputs or shapes
        reason = str(error).splitlines()[0]
        raise PolicyError(f"The graphs of {folder} do not fit its {SPEC_FILE}: {reason}.") from error
