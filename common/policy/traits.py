"""What a policy for several robots is told of the one that it drives."""

import math

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.robot.config import RobotConfig

TRAITS = ("mount_height_m", "tan_half_fov", "mount_pitch_rad", "radius_m", "v_max_mps", "w_max_radps")
"""The camera's height above the floor, half the width that it shows at a distance of 1, its pitch (positive looks
down); the robot's radius; its limits."""
TRAIT_COUNT = len(TRAITS)
LIMITS_AT = 4
"""Index of the first limit in the robot parameters; commands are in units of the limits."""


def traits_of(robot: RobotConfig) -> Float64Array:
    """The numbers of `TRAITS` of a robot, shape (TRAIT_COUNT,)."""
    camera = robot.camera
    tan_half_fov = 0.5 * camera.width_px / float(camera.K_px[0, 0])
    pitch_rad = math.radians(camera.mount_pitch_deg)
    return np.array(
        [camera.mount_height_m, tan_half_fov, pitch_rad, robot.radius_m, robot.v_max_mps, robot.w_max_radps]
    )


def trait_units(robot: RobotConfig) -> tuple[Float64Array, Float64Array]:
    """Factor and offset that bring the traits of all robots of some ranges to [-1, 1], each shape (TRAIT_COUNT,)."""
    ends = [traits_of(robot.with_values({n: e[side] for n, e in robot.ranges.items() if e})) for side in (0, 1)]
    middle, half = 0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0])
    factor = np.divide(1.0, half, out=np.zeros_like(half), where=half > 0)
    return factor, -middle * factor
