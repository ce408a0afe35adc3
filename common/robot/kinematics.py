"""Motion of a unicycle robot: exact arcs and command limits.

Plain scalar arithmetic with `math` functions, so that every worker computes the same bits.
"""

import math

from readygo.common.robot.clock import LOWEST_HZ
from readygo.common.robot.config import RobotConfig

RATE_HZ = LOWEST_HZ
"""Rows per second of humans' trajectories and motions as they are planned, and steps of robots that name no rates."""
DT_S = 1.0 / RATE_HZ
"""Time between these [s]."""
STEP_NS = 1_000_000_000 // RATE_HZ
"""Time between these [ns]."""


def step_unicycle(
    x_m: float, y_m: float, yaw_rad: float, v_mps: float, w_radps: float, dt_s: float
) -> tuple[float, float, float]:
    """Pose after driving (v, w) for `dt_s` along the exact arc; the yaw is not wrapped."""
    if abs(w_radps) < 1e-9:
        return x_m + v_mps * dt_s * math.cos(yaw_rad), y_m + v_mps * dt_s * math.sin(yaw_rad), yaw_rad
    radius_m, yaw_next_rad = v_mps / w_radps, yaw_rad + w_radps * dt_s
    return (
        x_m + radius_m * (math.sin(yaw_next_rad) - math.sin(yaw_rad)),
        y_m - radius_m * (math.cos(yaw_next_rad) - math.cos(yaw_rad)),
        yaw_next_rad,
    )


def limit_command(
    v_mps: float,
    w_radps: float,
    v_previous_mps: float,
    w_previous_radps: float,
    robot: RobotConfig,
    dt_s: float,
) -> tuple[float, float]:
    """What the robot executes over `dt_s`: v in [v_min, v_max], w in +-w_max, changes within a_max and alpha_max."""

    def clip(value: float, low: float, high: float) -> float:
        return min(max(value, low), high)

    dv, dw = robot.a_max_mps2 * dt_s, robot.alpha_max_radps2 * dt_s
    v = clip(clip(v_mps, robot.v_min_mps, robot.v_max_mps), v_previous_mps - dv, v_previous_mps + dv)
    w = clip(clip(w_radps, -robot.w_max_radps, robot.w_max_radps), w_previous_radps - dw, w_previous_radps + dw)
    return v, w
