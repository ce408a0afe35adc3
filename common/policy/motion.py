"""A robot's own motion, from the commands that it executed: the one definition for training and driving."""

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.frames import goals_in_robot_frames
from readygo.common.robot import step_unicycle


def odometry(commands: Float32Array, dt_s: float) -> Float64Array:
    """Where a robot is at every step of an episode, by the commands that it executed.

    Args:
        commands: v [m/s], w [rad/s] executed after each step, shape (T, 2).
        dt_s: Length of a step [s].

    Returns:
        x, y [m], yaw [rad] (not wrapped) at each step in the robot's frame at the first one, shape (T, 3).
    """
    pose = (0.0, 0.0, 0.0)
    poses = [pose]
    for v_mps, w_radps in commands[:-1].tolist():
        pose = step_unicycle(*pose, v_mps, w_radps, dt_s)
        poses.append(pose)
    return np.array(poses[: len(commands)], np.float64).reshape(-1, 3)


def own_motion(older: Float64Array, present: Float64Array, commands: Float32Array) -> Float32Array:
    """Ego-motion since the older frames: their poses in the present robot frame (dx, dy [m], dyaw [rad]), then v, w.

    Args:
        older: Poses x, y [m], yaw [rad] at the older frames, the oldest first, shape (N, K, 3).
        present: Poses now, in the same frame, shape (N, 3).
        commands: v [m/s], w [rad/s] executed over the last step, shape (N, 2).

    Returns:
        Shape (N, 3 K + 2).
    """
    seen = [_seen_from(present, older[:, frame]) for frame in range(older.shape[1])]
    parts = [*seen, commands.astype(np.float64)]
    features: Float32Array = np.concatenate(parts, axis=1).astype(np.float32)
    return features


def _seen_from(present: Float64Array, pose: Float64Array) -> Float64Array:
    """Poses in the robot's frame now: dx, dy [m], dyaw [rad], shape (N, 3)."""
    dyaw = (pose[:, 2] - present[:, 2])[:, None]
    return np.concatenate([goals_in_robot_frames(present, pose[:, :2]), dyaw], axis=1)
