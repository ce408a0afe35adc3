"""What a robot knows at one step: everything that an evaluated method is given."""

from dataclasses import dataclass

from readygo.common.arrays import UInt8Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Observation:
    """One step of an episode, seen from the robot."""

    rgb: UInt8Array
    """The camera's image, sRGB, shape (H, W, 3)."""
    goal_xy_m: tuple[float, float]
    """Goal in the robot's frame: x forward, y left [m]."""
    v_mps: float
    """Present speed [m/s]."""
    w_radps: float
    """Present turn rate [rad/s]."""
    time_s: float
    """Time since the episode began [s]."""
