"""How humans move."""

from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float32Array
from readygo.common.messages.checks import check_array
from readygo.common.robot.kinematics import RATE_HZ


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Motion:
    """Pose of a SMPL-24 skeleton over time; after the last row the pose is held."""

    root_m: Float32Array
    """Pelvis position in the z-up world [m], shape (T, 3)."""
    pose_axis_angle: Float32Array
    """Parent-relative joint rotations [rad] in SMPL's y-up axes, shape (T, 24, 3).

    Joint 0 is the full global orientation in the SMPL y-up world; (x, y, z)_zup = (x, -z, y)_yup.
    """
    rate_hz: int = RATE_HZ

    def __post_init__(self) -> None:
        check_array("root_m", self.root_m, np.float32, (None, 3))
        check_array("pose_axis_angle", self.pose_axis_angle, np.float32, (len(self.root_m), 24, 3))
        if len(self.root_m) == 0:
            raise ValueError("a motion needs at least one row.")

    def row(self, step: int) -> int:
        """Row of simulation step `step`: the last row is held."""
        return min(step, len(self.root_m) - 1)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class HumanMotion:
    """One human of an episode: who, and how they move."""

    avatar: str
    motion: Motion


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class EpisodeMotions:
    """The humans of an episode, in the order of the scenario."""

    humans: tuple[HumanMotion, ...]
