"""Own motion, commands and places of robots that are shown turned or mirrored, or that are not told what they did."""

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array


def turn_world(xy_m: Float32Array, yaws_rad: Float64Array) -> Float32Array:
    """Places in the frames of robots that are turned to the left by `yaws_rad`, shape (B, 2)."""
    c, s = np.cos(yaws_rad), np.sin(yaws_rad)
    x, y = xy_m.T
    turned: Float32Array = np.stack([c * x + s * y, c * y - s * x], axis=1).astype(np.float32)
    return turned


def turn_motion(motion: Float32Array, yaws_rad: Float64Array) -> Float32Array:
    """Own motion of robots that were turned to the left by `yaws_rad` at all of their frames, shape (B, 3 K + 2)."""
    turned = motion.copy()
    for begin in range(0, motion.shape[1] - 2, 3):
        turned[:, begin : begin + 2] = turn_world(motion[:, begin : begin + 2], yaws_rad)
    return turned


def mirrored_motion(width: int) -> Float32Array:
    """Signs of the features of own motion in a mirrored world: of K older frames and the command, shape (3 K + 2,)."""
    return np.array([1, -1, -1] * ((width - 2) // 3) + [1, -1], np.float32)


def correct_for_turn(
    commands: Float32Array,
    yaws_rad: Float64Array,
    gain_per_s: float,
    w_max_radps: Float64Array | float,
) -> Float32Array:
    """Commands of robots that were turned to the left by `yaws_rad`: they turn back.

    Args:
        commands: v [m/s], w [rad/s], shape (B, 2).
        yaws_rad: Turn of each robot [rad], shape (B,).
        gain_per_s: Turn rate per yaw error that brings the robot back [1/s].
        w_max_radps: Limit of the corrected turn rate [rad/s], shape (B,) or one for all.

    Source: Bojarski et al., End to end learning for self-driving cars, 2016 (rotated views with corrected steering).
    """
    corrected = commands.copy()
    turned = yaws_rad != 0
    w_radps = np.clip(commands[:, 1] - gain_per_s * yaws_rad, -w_max_radps, w_max_radps)
    corrected[turned, 1] = w_radps[turned]
    return corrected


def corrupt_previous(commands: Float32Array, noise: Float32Array, withheld: BoolArray) -> Float32Array:
    """Previous actions as `MotionInput.COMMAND` has them, with noise, and withheld (0, 0, 0) in some samples.

    An imitator that sees the previous action learns to repeat it: consecutive actions of an expert hardly differ, and
    the copy scores well on recorded data but never starts or stops by itself.

    Args:
        commands: v [m/s], w [rad/s], shape (B, 2).
        noise: Added to them, shape (B, 2).
        withheld: Where the previous action is not known, shape (B,).

    Returns:
        Shape (B, 3).

    Source: Wen et al., Fighting copycat agents in behavioral cloning from observation histories, 2020.
    """
    known = np.concatenate([commands + noise, np.ones((len(commands), 1))], axis=1)
    return np.where(withheld[:, None], 0.0, known).astype(np.float32)
